//! One encoder for each renderer: `--renderer`, and frames as Mitsuba writes them.

mod common;

use std::path::Path;
use std::process::{Command, Output, Stdio};

use common::{Look, Shot, name};
use exr::prelude::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, SmallVec, WritableImage};

fn hush(shot: &Shot, args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hush"));
    command.current_dir(shot.dir.path()).args(args).stdin(Stdio::null()).output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The colour channels of the first frame in an output folder; Blender's and plain names.
fn colours(shot: &Shot, folder: &str) -> Vec<Vec<f32>> {
    let file = exr::prelude::read_all_flat_layers_from_file(shot.dir.path().join(folder).join(name(1))).unwrap();
    let channels = file.layer_data.iter().flat_map(|layer| &layer.channel_data.list);
    let colours = channels.filter(|c| {
        ["ViewLayer.Combined.", ""].map(|p| ["R", "G", "B"].map(|l| format!("{p}{l}"))).concat().contains(&c.name.to_string())
    });
    colours.map(|c| c.sample_data.values_as_f32().collect()).collect()
}

/// A frame as Mitsuba's `hdrfilm` writes it: one part, the beauty plain, the AOVs by name; and a `vector` of ours.
fn mitsuba_frame(path: &Path, number: u32) {
    let (columns, rows) = (24, 16);
    let noise = |channel: u32| {
        let value = move |i: usize| (i as u32).wrapping_mul(2_654_435_761).wrapping_add(number * 7919 + channel * 104_729) >> 8;
        (0..columns * rows).map(|i| value(i) as f32 / (1 << 24) as f32).collect::<Vec<_>>()
    };
    let mut channels = Vec::new();
    let mut add = |name: &str, values| channels.push(AnyChannel::new(name, FlatSamples::F32(values)));
    for (i, c) in (0..).zip(["R", "G", "B"]) {
        add(c, noise(i));
        add(&format!("albedo.{c}"), vec![0.25; columns * rows]);
        add(&format!("image.{c}"), noise(i));
    }
    add("depth.T", noise(7));
    for (c, v) in [("X", 0.0), ("Y", 1.0), ("Z", 0.0)] {
        add(&format!("normal.{c}"), vec![v; columns * rows]);
    }
    ["X", "Y", "Z", "W"].iter().for_each(|c| add(&format!("vector.{c}"), vec![0.0; columns * rows]));
    let list = AnyChannels::sort(SmallVec::from_vec(channels));
    let layer = Layer::new((columns, rows), LayerAttributes::default(), Encoding::FAST_LOSSLESS, list);
    Image::from_layer(layer).write().to_file(path).unwrap();
}

#[test]
fn each_renderer_has_its_encoder() {
    let shot = Shot::new(1..=2, Look::default());
    let manifest = |folder: &str| std::fs::read_to_string(shot.dir.path().join(folder).join("hush-manifest.json")).unwrap();
    for (folder, options) in
        [("plain", vec![]), ("cycles", vec!["--renderer", "cycles"]), ("mitsuba", vec!["--renderer", "Mitsuba"])]
    {
        let run = hush(&shot, &[&["denoise", "shot", "-o", folder][..], &options].concat());
        assert!(run.status.success(), "{}", said(&run));
    }
    assert_eq!(colours(&shot, "plain").len(), 3);
    assert_eq!(colours(&shot, "plain"), colours(&shot, "cycles"));
    assert_ne!(colours(&shot, "plain"), colours(&shot, "mitsuba"));
    assert!(manifest("mitsuba").contains(r#""renderer": "mitsuba""#));
    assert_eq!(manifest("plain").contains("renderer"), manifest("cycles").contains("renderer"));
    let again = hush(&shot, &["denoise", "shot", "-o", "mitsuba"]);
    assert!(said(&again).contains("renderer mitsuba → cycles"), "{}", said(&again));
    assert_eq!(colours(&shot, "plain"), colours(&shot, "mitsuba"));
}

#[test]
fn a_renderer_without_an_encoder_is_refused_by_every_command() {
    let shot = Shot::new(1..=2, Look::default());
    for command in ["denoise", "survey", "report", "watch"] {
        let output = if command == "survey" { vec![] } else { vec!["-o", "out"] };
        let refused = hush(&shot, &[&[command, "shot", "--renderer", "arnold"][..], &output].concat());
        assert_eq!(refused.status.code(), Some(1), "{command}: {}", said(&refused));
        assert!(said(&refused).contains("arnold") && said(&refused).contains("cycles, mitsuba"), "{command}: {}", said(&refused));
    }
}

#[test]
fn frames_of_mitsuba_are_read_with_a_settings_file() {
    let shot = Shot::new([], Look::default());
    (1..=3).for_each(|n| mitsuba_frame(&shot.input(n), n as u32));
    let settings =
        "renderer = \"mitsuba\"\n[passes]\nalbedo = \"albedo\"\nnormal = \"normal\"\ndepth = \"depth\"\nvector = \"vector\"\n";
    std::fs::write(shot.folder().join("hush.toml"), settings).unwrap();
    let run = hush(&shot, &["denoise", "shot", "-o", "out", "--json"]);
    let events = String::from_utf8_lossy(&run.stdout).into_owned();
    assert!(run.status.success() && !events.contains("missing_guide"), "{events}");
    assert!(events.contains(r#""neighbours":[2,3]"#), "the motion vectors are used: {events}");
    for without in ["albedo", "normal", "depth"] {
        let others = ["albedo", "normal", "depth", "vector"].into_iter().filter(|guide| *guide != without).collect::<Vec<_>>();
        let run = hush(&shot, &["denoise", "shot", "-o", without, "--guides", &others.join(",")]);
        assert!(run.status.success(), "{}", said(&run));
        assert_ne!(colours(&shot, "out"), colours(&shot, without), "{without} is used");
    }
    let cycles = hush(&shot, &["denoise", "shot", "-o", "cycles", "--renderer", "cycles"]);
    assert!(cycles.status.success(), "{}", said(&cycles));
    assert_ne!(colours(&shot, "out"), colours(&shot, "cycles"));
}
