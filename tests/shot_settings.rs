//! Settings from a USD stage, from the file beside the frames and from the command line, as the command uses and shows them.

#![cfg(feature = "usd")]

mod common;

use std::path::Path;
use std::process::{Command, Output, Stdio};

use common::{Look, Shot, name};
use exr::prelude::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, SmallVec, WritableImage};
use serde_json::Value;

const QUIET: &str = "--quiet";

fn hush(shot: &Shot, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_hush")).current_dir(shot.dir.path()).args(args).stdin(Stdio::null()).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// What the command says where it refuses.
fn refusal(shot: &Shot, args: &[&str]) -> String {
    let output = hush(shot, args);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{args:?}: {said}");
    assert!(!said.contains("panicked"), "{said}");
    said
}

fn shown(shot: &Shot, args: &[&str]) -> Value {
    let output = hush(shot, &[&["shot", "show", "--json"], args].concat());
    assert!(output.status.success(), "{args:?}: {}", text(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn put(shot: &Shot, file: &str, content: &str) {
    std::fs::write(shot.dir.path().join(file), content).unwrap();
}

fn stage(shot: &Shot, body: &str) {
    put(shot, "shot.usda", &format!("#usda 1.0\ndef Scope \"Render\"\n{{\n{body}\n}}\n"));
}

const PASS: &str = r#"
    def RenderPass "Pass" {
        float hush:lambda.timeSamples = { 1: 1, 3: 5 }
        int hush:window = 1
        uniform token[] hush:aovs = []
        string hush:output = "from_usd"
    }"#;

#[test]
fn a_lambda_beyond_the_range_is_told_of_wherever_it_stands() {
    let shot = Shot::new(1..=1, Look::default());
    stage(&shot, "def RenderPass \"Pass\" { float hush:lambda = 1000 }");
    put(&shot, "hush.toml", "lambda = 1000");
    for source in [["--usd", "shot.usda"], ["--settings", "hush.toml"]] {
        let output = hush(&shot, &[&["denoise", "shot", "-o", "out", "--dry-run"], &source[..]].concat());
        let said = text(&output.stdout) + &text(&output.stderr);
        assert!(output.status.success() && said.contains("lambda 1000 is beyond the range, 64 is used"), "{source:?}: {said}");
    }
}

#[test]
fn later_sources_win_and_each_value_knows_its_source() {
    let shot = Shot::new(1..=2, Look::default());
    stage(&shot, PASS);
    put(&shot, "shot/hush.toml", "usd = \"../shot.usda\"\nwindow = 2\noutput = \"../from_toml\"\n");
    let all = shown(&shot, &["shot", "--view", "left", "--guides", "vector,albedo,normal", "--keep-noisy=false"]);
    let setting = |name: &str| all["settings"][name].clone();
    assert_eq!(setting("lambda")["source"], "usd");
    assert_eq!(setting("lambda")["prim"], "/Render/Pass");
    assert_eq!(setting("lambda")["attribute"], "hush:lambda");
    assert_eq!(setting("lambda")["value"], serde_json::json!([[1.0, 1.0], [3.0, 5.0]]));
    assert_eq!((&setting("window")["source"], &setting("window")["value"]), (&"settings_file".into(), &2.into()));
    assert!(setting("output")["value"].as_str().unwrap().ends_with("from_toml"));
    assert_eq!((&setting("view")["option"], &setting("view")["value"]), (&"--view".into(), &"left".into()));
    assert_eq!(setting("guides")["value"], serde_json::json!(["albedo", "normal", "vector"]));
    assert_eq!(setting("guides")["option"], "--guides");
    assert_eq!(setting("keep_noisy")["value"], false);
    assert_eq!((&setting("model")["source"], &setting("model")["value"]), (&"default".into(), &Value::Null));
    let table = text(&hush(&shot, &["shot", "show", "shot"]).stdout);
    assert!(table.contains("1:1,3:5") && table.contains("shot.usda </Render/Pass.hush:lambda>"), "{table}");
    assert!(table.contains("hush.toml, window") && !table.contains("2 with a Vector pass"), "{table}");
    assert!(shown(&shot, &["shot", "--no-settings"])["settings"].as_object().unwrap().values().all(|s| s["source"] == "default"));
}

#[test]
fn a_run_follows_the_stage_frame_by_frame() {
    let shot = Shot::new(1..=3, Look::default());
    stage(&shot, PASS);
    let run = hush(&shot, &["denoise", "shot", "--usd", "shot.usda", "--json"]);
    assert!(run.status.success(), "{}", text(&run.stderr));
    let manifest = hush::shot::Manifest::load(&shot.dir.path().join("from_usd")).unwrap();
    let lambda = |number: i64| manifest.settings[&manifest.frames[&name(number)].settings].lambda;
    assert_eq!([1, 2, 3].map(lambda), [1.0, 3.0, 5.0]);
    assert!(manifest.settings.values().all(|s| s.window == 1));
    // The command line wins, and what it says is told of nobody else.
    let run = hush(&shot, &["denoise", "shot", "--usd", "shot.usda", "-o", "out", "-l", "2"]);
    assert!(run.status.success() && text(&run.stderr).contains("shot.usda says"), "{}", text(&run.stderr));
    assert!(shot.manifest().settings.values().all(|s| s.lambda == 2.0));
}

#[test]
fn a_layer_is_never_written_over_the_stage_that_it_lies_over() {
    let shot = Shot::new(1..=1, Look::default());
    stage(&shot, PASS);
    let before = std::fs::read(shot.dir.path().join("shot.usda")).unwrap();
    put(&shot, "top.usda", "#usda 1.0\n(\n    subLayers = [@./shot.usda@]\n)\n");
    for (output, below) in [("shot.usda", "shot.usda"), ("shot/../shot.usda", "shot.usda"), ("shot.usda", "top.usda")] {
        let told = refusal(&shot, &["shot", "write", "-o", output, "--sublayer", below, "--lambda", "3", "--overwrite"]);
        assert!(told.contains("would be lost: name another file"), "{told}");
    }
    assert_eq!(std::fs::read(shot.dir.path().join("shot.usda")).unwrap(), before);
    let told = refusal(&shot, &["shot", "show", "shot.usda@/Render/Pass{quality=low}"]);
    assert!(told.contains("selects a variant"), "{told}");
}

#[test]
fn a_stage_may_name_the_frames() {
    let shot = Shot::new(1..=2, Look::default());
    stage(
        &shot,
        r#"def RenderSettings "Settings" { rel products = </Render/Product> }
           def RenderProduct "Product" { token productName = "shot/f_$F4.exr" }"#,
    );
    let run = hush(&shot, &["denoise", "--usd", "shot.usda@/Render/Settings", "-o", "out", QUIET]);
    assert!(run.status.success(), "{}", text(&run.stderr));
    assert_eq!(shot.written(), [name(1), name(2)]);
    put(&shot, "job.toml", "input = \"shot/f_####.exr\"\noutput = \"out2\"\nframes = \"2\"\n");
    let run = hush(&shot, &["denoise", "--settings", "job.toml", QUIET]);
    assert!(run.status.success(), "{}", text(&run.stderr));
    assert!(shot.dir.path().join("out2").join(name(2)).exists() && !shot.dir.path().join("out2").join(name(1)).exists());
    assert!(refusal(&shot, &["denoise", "-o", "out"]).contains("name the frames"));
}

#[test]
fn a_shot_switched_off_is_left_alone_and_says_so() {
    let shot = Shot::new(1..=1, Look::default());
    stage(&shot, r#"def RenderPass "Pass" { uniform bool denoise:enable = false }"#);
    let off = hush(&shot, &["denoise", "shot", "-o", "out", "--usd", "shot.usda"]);
    let said = text(&off.stderr);
    assert_eq!(off.status.code(), Some(3), "{said}");
    assert!(
        said.contains("switched off") && said.contains("</Render/Pass.denoise:enable>") && said.contains("--enable"),
        "{said}"
    );
    assert!(!shot.out().exists());
    let on = hush(&shot, &["denoise", "shot", "-o", "out", "--usd", "shot.usda", "--enable", QUIET]);
    assert!(on.status.success(), "{}", text(&on.stderr));
    // The schema's fallback is false: only what somebody wrote counts.
    stage(&shot, r#"def RenderPass "Pass" { }"#);
    let on = hush(&shot, &["denoise", "shot", "-o", "out", "--usd", "shot.usda", QUIET]);
    assert!(on.status.success(), "{}", text(&on.stderr));
}

#[test]
fn what_is_wrong_is_named_with_file_and_prim() {
    let shot = Shot::new(1..=1, Look::default());
    let usd = ["denoise", "shot", "-o", "out", "--usd", "shot.usda"];
    for (body, parts) in [
        (
            r#"def RenderPass "P" { string hush:lambda = "4" }"#,
            vec!["shot.usda: </Render/P.hush:lambda> is string \"4\"", "expected a number from 1 to 64"],
        ),
        (r#"def RenderPass "P" { float hush:lambda = 0.5 }"#, vec!["</Render/P.hush:lambda>", "out of range"]),
        (
            r#"def RenderPass "P" { float hush:window = 1.5 }"#,
            vec!["</Render/P.hush:window>", "expected a whole number from 0 to 3"],
        ),
        (
            r#"def RenderPass "P" { int hush:window.timeSamples = { 1: 1, 2: 2 } }"#,
            vec!["hush:window>", "only hush:lambda and hush:lambdaMasked may change"],
        ),
        (r#"def RenderPass "P" { token[] hush:guides = ["colour"] }"#, vec!["hush:guides>", "albedo, normal"]),
        (r#"def RenderPass "P" { rel denoise:pass = </Render/Gone> }"#, vec!["denoise:pass> points to </Render/Gone>"]),
        ("", vec!["has no RenderPass and no RenderSettings prim"]),
        (
            r#"def RenderPass "A" { int hush:window = 1 } def RenderPass "B" { int hush:window = 1 }"#,
            vec!["several render prims", "</Render/A>", "</Render/B>", "such as FILE@/Render/A"],
        ),
        ("def RenderPass \"P\" {", vec!["shot.usda", "cannot be used; hush.toml"]),
    ] {
        stage(&shot, body);
        let said = refusal(&shot, &usd);
        assert!(parts.iter().all(|part| said.contains(part)), "{body}: {said}");
    }
    stage(&shot, PASS);
    assert!(
        refusal(&shot, &["shot", "show", "shot.usda@/Render/Pas"]).contains("no prim </Render/Pas>; there are </Render/Pass>")
    );
    assert!(refusal(&shot, &["denoise", "shot", "-o", "out", "--usd", "gone.usda"]).contains("gone.usda"));
    put(&shot, "shot/hush.toml", "lamda = 4");
    let said = refusal(&shot, &["denoise", "shot", "-o", "out"]);
    assert!(said.contains("hush.toml: unknown key lamda; did you mean lambda?"), "{said}");
    put(&shot, "shot/hush.toml", "lambda = \"4\"");
    assert!(refusal(&shot, &["denoise", "shot", "-o", "out"]).contains("lambda = \"4\": expected a number"));
    assert!(!shot.out().exists());
    let run = hush(&shot, &["denoise", "shot", "-o", "out", "--no-settings", QUIET]);
    assert!(run.status.success(), "{}", text(&run.stderr));
}

#[test]
fn an_unknown_attribute_is_a_warning_with_the_nearest_one() {
    let shot = Shot::new(1..=1, Look::default());
    stage(&shot, r#"def RenderPass "P" { float hush:lamda = 4  int hush:wndow = 1  float hush:lambda = 2 }"#);
    let run = hush(&shot, &["denoise", "shot", "-o", "out", "--usd", "shot.usda"]);
    let said = text(&run.stderr);
    assert!(run.status.success(), "{said}");
    assert!(said.contains("</Render/P.hush:lamda> is no setting of Hush; did you mean hush:lambda?"), "{said}");
    assert!(said.contains("did you mean hush:window?"), "{said}");
    assert_eq!(shown(&shot, &["shot.usda"])["notes"].as_array().unwrap().len(), 2);
}

#[test]
fn hostile_stages_end_in_an_error() {
    let shot = Shot::new(1..=1, Look::default());
    let refused = |file: &str| {
        let said = refusal(&shot, &["shot", "show", file]);
        assert!(said.contains(file), "{said}");
        said
    };
    put(&shot, "deep.usda", &format!("#usda 1.0\n{}{}", "def \"a\" {\n".repeat(20_000), "}".repeat(20_000)));
    assert!(refused("deep.usda").contains("nests brackets"));
    let dictionary = format!("#usda 1.0\n( customLayerData = {} )", "{ dictionary a = ".repeat(50_000));
    put(&shot, "dictionary.usda", &dictionary);
    refused("dictionary.usda");
    put(&shot, "a.usda", "#usda 1.0\n(subLayers = [@b.usda@])\ndef RenderPass \"R\" { }");
    put(&shot, "b.usda", "#usda 1.0\n(subLayers = [@a.usda@])\ndef RenderPass \"R\" { int hush:window = 2 }");
    assert!(refused("a.usda").contains("cycle"));
    put(&shot, "missing.usda", "#usda 1.0\n(subLayers = [@gone.usda@])\ndef RenderPass \"R\" { }");
    assert!(refused("missing.usda").contains("gone.usda"));
    put(&shot, "empty.usda", "");
    put(&shot, "noise.usdc", "PXR-USDC\u{1}\u{2}\u{3}");
    put(&shot, "noise.usdz", "PK\u{3}\u{4} nothing");
    for file in ["empty.usda", "noise.usdc", "noise.usdz"] {
        refused(file);
    }
}

#[test]
fn a_written_layer_is_read_back_alike() {
    let shot = Shot::new(1..=1, Look::default());
    let write =
        ["shot", "write", "--output", "own.usda", "--lambda", "1:1,24.5:8", "--window", "0", "--aov", "all", "--frames", "1-4"];
    let done = hush(&shot, &[&write[..], &["--to", "clean", "--guides", "none", "--memory", "4G", "--enable=false"]].concat());
    assert!(done.status.success(), "{}", text(&done.stderr));
    let read = shown(&shot, &["own.usda"]);
    let value = |name: &str| read["settings"][name]["value"].clone();
    assert_eq!(value("lambda"), serde_json::json!([[1.0, 1.0], [24.5, 8.0]]));
    assert_eq!((value("window"), value("frames"), value("enable")), (0.into(), "1-4".into(), false.into()));
    assert_eq!((value("aovs"), value("guides")), (serde_json::json!(["all"]), serde_json::json!([])));
    assert!(Path::new(value("output").as_str().unwrap()).ends_with("clean"));
    assert_eq!((read["settings"]["window"]["prim"].clone(), value("memory")), ("/Render/Denoise".into(), (4u64 << 30).into()));
    assert!(refusal(&shot, &write).contains("there already"));
    // Over a stage, on the prim that is there, and stronger than what it says.
    stage(&shot, PASS);
    let over = ["shot", "write", "-o", "over.usda", "--sublayer", "shot.usda", "-l", "16"];
    assert!(hush(&shot, &over).status.success());
    let read = shown(&shot, &["over.usda"]);
    assert_eq!(read["settings"]["lambda"]["value"], 16.0);
    assert!(read["settings"]["lambda"]["file"].as_str().unwrap().ends_with("over.usda"));
    assert!(read["settings"]["window"]["file"].as_str().unwrap().ends_with("shot.usda"));
    assert!(refusal(&shot, &["shot", "write", "-o", "x.usda", "--sublayer", "shot.usda"]).contains("nothing to write"));
    assert!(refusal(&shot, &["shot", "write", "-o", "x.usd", "-l", "2"]).contains("no .usda file"));
    assert!(refusal(&shot, &["shot", "write", "-o", "x.usda", "-l", "2", "--prim", "Render"]).contains("no prim path"));
}

/// A frame whose passes are called as another renderer calls them.
fn foreign_frame(path: &Path, number: u32) {
    let (columns, rows) = (24, 16);
    let noise = |channel: u32| {
        let value = move |i: usize| (i as u32).wrapping_mul(2_654_435_761).wrapping_add(number * 7919 + channel * 104_729) >> 8;
        (0..columns * rows).map(|i| value(i) as f32 / (1 << 24) as f32).collect::<Vec<_>>()
    };
    let mut channels = Vec::new();
    let mut add = |name: &str, values| channels.push(AnyChannel::new(name, FlatSamples::F32(values)));
    for (i, c) in (0..).zip(["R", "G", "B"]) {
        add(&format!("C.{c}"), noise(i));
        add(&format!("basecolor.{c}"), vec![0.5; columns * rows]);
        add(&format!("directdiffuse.{c}"), noise(10 + i));
    }
    for (c, v) in [("X", 0.0), ("Y", 0.0), ("Z", 1.0)] {
        add(&format!("N.{c}"), vec![v; columns * rows]);
    }
    add("Pz.Z", vec![3.0; columns * rows]);
    let list = AnyChannels::sort(SmallVec::from_vec(channels));
    let layer = Layer::new((columns, rows), LayerAttributes::default(), Encoding::FAST_LOSSLESS, list);
    Image::from_layer(layer).write().to_file(path).unwrap();
}

#[test]
fn passes_may_have_other_names() {
    let shot = Shot::new([], Look::default());
    (1..=2).for_each(|n| foreign_frame(&shot.input(n), n as u32));
    assert!(refusal(&shot, &["denoise", "shot", "-o", "out"]).contains("Combined"), "nothing tells which pass is the beauty");
    let vars = r#"def RenderSettings "S" { rel products = </Render/P> }
        def RenderProduct "P" { rel orderedVars = [</Render/P/beauty>, </Render/P/a>, </Render/P/n>, </Render/P/depth>, </Render/P/d>]
            def RenderVar "beauty" { string driver:parameters:aov:name = "C"  string sourceName = "C.*[LO]" }
            def RenderVar "a" { string driver:parameters:aov:name = "basecolor" }
            def RenderVar "n" { string driver:parameters:aov:name = "N"  string sourceName = "ray:hitN" }
            def RenderVar "depth" { string driver:parameters:aov:name = "Pz" }
            def RenderVar "d" { string driver:parameters:aov:name = "directdiffuse" }
        }"#;
    stage(&shot, vars);
    let run = hush(&shot, &["denoise", "shot", "-o", "out", "--usd", "shot.usda", "--json"]);
    let said = text(&run.stdout);
    assert!(run.status.success(), "{said}");
    assert!(
        !said.contains("Denoising Albedo") && !said.contains("Denoising Normal") && !said.contains("Denoising Depth"),
        "{said}"
    );
    let settings = shot.manifest().settings.into_values().next().unwrap();
    let named = ["beauty", "albedo", "normal", "depth"].map(|pass| settings.others[&format!("passes.{pass}")].clone());
    assert_eq!(named, ["C", "basecolor", "N", "Pz"]);
    // The same from the settings file makes the same bits, so that nothing is left to do.
    put(&shot, "shot/hush.toml", "[passes]\nbeauty = \"C\"\nalbedo = \"basecolor\"\nnormal = \"N\"\ndepth = \"Pz\"\n");
    let again = hush(&shot, &["denoise", "shot", "-o", "out"]);
    assert!(again.status.success() && text(&again.stderr).contains("2 already done"), "{}", text(&again.stderr));
    // Without the guides the result is another one: they were used.
    let alone = hush(&shot, &["denoise", "shot", "-o", "alone", "--guides", "none", QUIET]);
    assert!(alone.status.success(), "{}", text(&alone.stderr));
    let (with, without) =
        (std::fs::read(shot.output(1)).unwrap(), std::fs::read(shot.dir.path().join("alone").join(name(1))).unwrap());
    assert_ne!(with, without);
    put(&shot, "shot/hush.toml", "passes.beauty = \"Ci\"");
    let said = refusal(&shot, &["denoise", "shot", "-o", "out"]);
    assert!(said.contains("no Ci pass") && said.contains("its passes are") && said.contains("basecolor"), "{said}");
}
