//! `hush report` through the command: the page and its files, with and without references, and what is refused.

mod common;

use std::collections::BTreeSet;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Output, Stdio};

use exr::prelude::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, SmallVec, WritableImage};

use common::{Look, Shot, name, write_frame};
use hush::internals::{EvaluateOptions, MeasureOptions, REACH, evaluate, measure};
use hush::io::Selection;
use hush::io::sequence::Sequence;
use hush::shot::{CancelToken, Scope};
use hush::{Engine, Settings};
use serde_json::Value;

const FILES: [&str; 10] = [
    "by-frame.png",
    "by-frame.svg",
    "by-stage.png",
    "by-stage.svg",
    "error-time.png",
    "error-time.svg",
    "frames.csv",
    "index.html",
    "report.json",
    "settings.csv",
];

fn command(shot: &Shot, args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hush"));
    // No Python and no tool on the path: what is installed here must not matter.
    command.current_dir(shot.dir.path()).args(args).env("PATH", "").stdin(Stdio::null());
    command
}

fn hush(shot: &Shot, args: &[&str]) -> Output {
    command(shot, args).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// References in `ref/`: the same frames with other noise.
fn add_references(shot: &Shot, numbers: impl IntoIterator<Item = i64>, look: Look) {
    fs::create_dir_all(shot.dir.path().join("ref")).unwrap();
    for n in numbers {
        write_frame(&shot.dir.path().join("ref").join(name(n)), n, Look { seed: Some(500 + n as u32), ..look });
    }
}

fn names(folder: &Path) -> BTreeSet<String> {
    fs::read_dir(folder).map_or(BTreeSet::new(), |d| d.map(|e| e.unwrap().file_name().into_string().unwrap()).collect())
}

/// The numbers and the page, checked for what holds of every report.
fn read_report(shot: &Shot, folder: &str) -> (Value, String) {
    let folder = shot.dir.path().join(folder);
    assert_eq!(names(&folder), FILES.iter().map(|f| f.to_string()).collect());
    for file in FILES {
        let bytes = fs::read(folder.join(file)).unwrap();
        match file.rsplit_once('.').unwrap().1 {
            "png" => assert!(bytes.starts_with(b"\x89PNG\r\n"), "{file}"),
            "svg" => _ = roxmltree::Document::parse(&text(&bytes)).unwrap(),
            _ => {}
        }
    }
    let page = fs::read_to_string(folder.join("index.html")).unwrap();
    for foreign in ["http:", "https:", "//cdn", "<link", "@import", "url(", "src=\"/", "src='"] {
        assert!(!page.contains(foreign), "{foreign} in the page");
    }
    assert!(page.split("src=\"").skip(1).all(|rest| rest.starts_with("data:image/png;base64,")));
    let drawings: Vec<&str> = page.split("<svg").skip(1).map(|rest| rest.split_once("</svg>").unwrap().0).collect();
    assert_eq!(drawings.len(), 3);
    for drawing in drawings {
        roxmltree::Document::parse(&format!("<svg{drawing}</svg>")).unwrap();
    }
    (serde_json::from_slice(&fs::read(folder.join("report.json")).unwrap()).unwrap(), page)
}

fn row<'a>(report: &'a Value, name: &str) -> &'a Value {
    let rows = report["rows_by_setting"].as_array().unwrap();
    rows.iter().find(|r| r["name"] == name).unwrap_or_else(|| panic!("no row {name}"))
}

#[test]
fn with_references_the_errors_are_those_of_eval() {
    let shot = Shot::new(1..=4, Look::default());
    add_references(&shot, 1..=3, Look::default());
    let output = hush(&shot, &["report", "shot", "--reference", "ref", "--output", "report", "--repeats", "2"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(text(&output.stdout).contains("report/index.html") && text(&output.stdout).contains("window 2"));
    let (report, page) = read_report(&shot, "report");
    assert_eq!((&report["basis"], &report["frames"]), (&"reference".into(), &serde_json::json!([1, 2, 3])));
    let rows = report["rows_by_setting"].as_array().unwrap();
    let settings = ["noisy", "window 2", "window 0", "window 1", "window 3", "second pass", "no skipping", "λ 4", "λ 16"];
    assert_eq!(rows.iter().map(|r| r["name"].as_str().unwrap()).collect::<Vec<_>>(), settings);
    assert!(rows[0]["seconds"].is_null());
    for row in &rows[1..] {
        assert_eq!(row["times"].as_array().unwrap().len(), 2);
        let (low, median, high) = (&row["seconds"]["low"], &row["seconds"]["median"], &row["seconds"]["high"]);
        assert!(low.as_f64() > Some(0.0) && low.as_f64() <= median.as_f64() && median.as_f64() <= high.as_f64());
        assert!(row["stages"].as_array().unwrap().iter().map(|s| s.as_f64().unwrap()).sum::<f64>() > 0.0);
        assert!(row["window_bytes"].as_u64() > Some(0) && row["errors"][0]["median"].as_f64() > Some(0.0));
    }
    assert!(
        rows.iter().any(|r| r["front"][0] == true) && row(&report, "no skipping")["errors"] == row(&report, "window 2")["errors"]
    );
    for remark in ["Not measured, as they have no reference: frame 4.", "OIDN was not measured"] {
        assert!(page.contains(remark), "{remark}");
    }
    assert!(page.contains("worst") && page.matches("<figure>").count() == 20, "two tiles of nine settings and the reference");
    for (setting, output, more) in [("window 2", "out", &[][..]), ("second pass", "twice", &["--second-pass"])] {
        let args = ["denoise", "shot", "--output", output, "--frames", "1-3", "--quiet"];
        assert!(hush(&shot, &[&args, more].concat()).status.success());
        let (reference, denoised) = (shot.dir.path().join("ref"), shot.dir.path().join(output));
        let expected = evaluate(&reference, &denoised, &EvaluateOptions::default()).unwrap().mean.unwrap();
        let found = row(&report, setting)["errors"].as_array().unwrap();
        for (found, expected) in found.iter().zip([expected.smape, expected.relmse, expected.flicker.unwrap()]) {
            let found = found["mean"].as_f64().unwrap();
            assert!((found / expected - 1.0).abs() < 1e-5, "{setting}: {found} {expected}");
        }
    }
    assert!(row(&report, "second pass")["errors"] != row(&report, "window 2")["errors"]);
    assert!(row(&report, "second pass")["stages"][7].as_f64() > Some(0.0) && row(&report, "window 2")["stages"][7] == 0.0);
    let csv = fs::read_to_string(shot.dir.path().join("report/settings.csv")).unwrap();
    let fields: BTreeSet<usize> = csv.lines().map(|line| line.split(',').count()).collect();
    assert_eq!((csv.lines().count(), fields.len()), (10, 1));
    let csv = fs::read_to_string(shot.dir.path().join("report/frames.csv")).unwrap();
    assert_eq!(csv.lines().count(), 28);
    let again = hush(&shot, &["report", "shot", "-r", "ref", "-o", "report", "--repeats", "1", "--frames", "2", "--quiet"]);
    assert!(again.status.success() && again.stdout.is_empty() && again.stderr.is_empty(), "{}", text(&again.stderr));
    assert_eq!(read_report(&shot, "report").0["frames"], serde_json::json!([2]), "a report of ours is replaced");
}

#[test]
fn without_references_it_says_that_the_error_is_an_estimate() {
    let shot = Shot::new(1..=9, Look { columns: 40, rows: 32, ..Look::default() });
    let output = hush(&shot, &["report", "shot", "-o", "report", "--repeats", "1", "--frames", "4-6", "-q"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let (report, page) = read_report(&shot, "report");
    assert_eq!(
        (&report["basis"], &report["estimate"]["distance"], &report["estimate"]["frames"]),
        (&"estimate".into(), &3.into(), &3.into())
    );
    assert!(
        page.contains("the error is an estimate")
            && page.contains("On Hush's sample shot")
            && !page.contains("against the references")
    );
    assert!(row(&report, "window 2")["errors"][0].is_null());
    // The noise is uniform between 0 and 1 around a truth of 0.5.
    let noisy = row(&report, "noisy")["errors"][1]["mean"].as_f64().unwrap();
    let best = row(&report, "window 2")["errors"][1]["mean"].as_f64().unwrap();
    assert!(noisy > 0.3 && best < 0.3 * noisy, "{noisy} {best}");
    assert!(row(&report, "window 3")["errors"][1].is_null() && page.contains("Window 3 has no estimate"));
    assert!(row(&report, "second pass")["errors"][1].is_null() && page.contains("The second pass has no estimate"));
}

#[test]
fn where_nothing_can_be_estimated_times_are_still_told() {
    for (look, reason) in [
        (Look { vector: None, ..Look::default() }, "there are no motion vectors"),
        (Look { seed: Some(3), vector: Some(0.0), ..Look::default() }, "share one noise pattern"),
    ] {
        let shot = Shot::new(1..=7, look);
        let output = hush(&shot, &["report", "shot", "-o", "report", "--repeats", "1", "-q"]);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let (report, page) = read_report(&shot, "report");
        assert!(page.contains(reason) && report["estimate"].is_null(), "{reason}");
        let windows = report["rows_by_setting"].as_array().unwrap().iter().filter(|r| r["kind"] == "window").count();
        assert_eq!(windows, if look.vector.is_none() { 1 } else { 4 });
        let base = report["rows_by_setting"].as_array().unwrap().iter().find(|r| r["default"] == true).unwrap().clone();
        assert!(base["seconds"]["median"].as_f64() > Some(0.0));
    }
}

#[test]
fn what_has_no_estimate_is_told_with_its_reason() {
    for (frames, told, untold) in [
        (1, "no frame has enough readable frames before and after it", "there are no motion vectors"),
        (5, "Windows 1 to 3, and the settings that use them, have no estimate", "could not be estimated"),
    ] {
        let shot = Shot::new(1..=frames, Look::default());
        let output = hush(&shot, &["report", "shot", "-o", "report", "--repeats", "1", "-q"]);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let page = read_report(&shot, "report").1;
        assert!(page.contains(told) && !page.contains(untold), "{frames} frames: {told}");
    }
}

#[test]
fn what_makes_frames_or_references_poor_to_measure_by_is_told() {
    let denoised = Look { noisy_image: true, ..Look::default() };
    let shot = Shot::new(1..=2, denoised);
    add_references(&shot, 1..=2, denoised);
    let output = hush(&shot, &["report", "shot", "-r", "ref", "-o", "report", "--repeats", "1", "-q"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let page = read_report(&shot, "report").1;
    for told in
        ["The references of frames 1-2 are denoised themselves", "The frames hold a Noisy Image: it is denoised, not Combined"]
    {
        assert!(page.contains(told), "{told}");
    }
}

#[test]
fn what_cannot_be_done_is_refused_and_nothing_is_written() {
    let shot = Shot::new(1..=3, Look::default());
    add_references(&shot, 7..=8, Look::default());
    fs::create_dir(shot.dir.path().join("wide")).unwrap();
    write_frame(&shot.dir.path().join("wide").join(name(2)), 2, Look { columns: 32, ..Look::default() });
    fs::write(shot.dir.path().join("file"), "").unwrap();
    fs::create_dir(shot.dir.path().join("mine")).unwrap();
    fs::write(shot.dir.path().join("mine/index.html"), "my own").unwrap();
    let report = |more: &[&str]| hush(&shot, &[&["report", "shot", "--repeats", "1"], more].concat());
    for (args, message) in [
        (&["-o", "new", "-r", "ref"][..], "no frame has a reference: frames 7-8 here, frames 1-3 in the shot"),
        (&["-o", "new", "-r", "wide"], "f_0002.exr is 32×16, expected 24×16"),
        (&["-o", "new", "-r", "nowhere"], "no such file or folder"),
        (&["-o", "new", "--oidn", "nowhere"], "there is no oidnDenoise at nowhere"),
        (&["-o", "new", "--frames", "9"], "none of the frames asked for is there"),
        (&["-o", "file"], "file"),
        (&["-o", "shot"], "is where the frames lie"),
        (&["-o", "mine"], "was not written by hush report"),
        (&["-o", "new", "--repeats", "0"], "repeats"),
    ] {
        let output = report(args);
        assert_eq!(output.status.code(), Some(1), "{args:?}");
        assert!(text(&output.stderr).contains(message), "{args:?}: {}", text(&output.stderr));
        assert!(names(&shot.dir.path().join("new")).is_empty());
    }
    assert_eq!(fs::read_to_string(shot.dir.path().join("mine/index.html")).unwrap(), "my own");
    assert_eq!(names(&shot.folder()).len(), 3);
}

#[test]
fn a_bad_frame_is_told_and_the_others_are_measured() {
    let shot = Shot::new(1..=3, Look::default());
    shot.truncate(3);
    let output = hush(&shot, &["report", "shot", "-o", "report", "--repeats", "1", "-q"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("frame 3"), "{}", text(&output.stderr));
    let (report, page) = read_report(&shot, "report");
    assert_eq!(report["frames"], serde_json::json!([1, 2]));
    assert!(page.contains("Frame 3 was not measured"));
    let beside = hush(&shot, &["report", "shot", "-o", "beside", "--frames", "1-2", "--repeats", "1", "-q"]);
    assert_eq!(beside.status.code(), Some(2), "two windows were measured without it");
    assert!(read_report(&shot, "beside").1.contains("Frame 3 was not measured"));
}

#[test]
fn a_frame_whose_header_is_bad_is_told_as_well() {
    let shot = Shot::new(1..=3, Look::default());
    fs::write(shot.input(2), "no EXR").unwrap();
    let output = hush(&shot, &["report", "shot", "-o", "report", "--repeats", "1", "-q"]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    let (report, page) = read_report(&shot, "report");
    assert_eq!(report["frames"], serde_json::json!([1, 3]));
    assert!(page.contains("Frame 2 was not measured") && text(&output.stderr).contains("error: frame 2: "));
}

/// An image whose pixels are all NaN.
fn write_nan(path: &Path) {
    let names = ["R", "G", "B"].map(|c| format!("ViewLayer.Combined.{c}"));
    let channels = names.map(|name| AnyChannel::new(name.as_str(), FlatSamples::F32(vec![f32::NAN; 24 * 16])));
    let list = AnyChannels::sort(SmallVec::from_vec(channels.into()));
    let layer = Layer::new((24, 16), LayerAttributes::default(), Encoding::FAST_LOSSLESS, list);
    Image::from_layer(layer).write().to_file(path).unwrap();
}

#[cfg(unix)]
#[test]
fn a_frame_that_fails_does_not_count_in_the_times_of_the_others() {
    let shot = Shot::new(1..=3, Look::default());
    add_references(&shot, 1..=3, Look::default());
    write_nan(&shot.dir.path().join("ref").join(name(2)));
    let script = "while [ $# -gt 0 ]; do case $1 in --hdr|--alb|--nrm) image=$2;; -o) out=$2;; esac; shift; done\n\
        /bin/cat \"$image\" > \"$out\"; echo 'Denoising 100% '; echo '  msec=8'";
    let path = tool(&shot, script);
    let output = hush(&shot, &["report", "shot", "-r", "ref", "-o", "report", "--repeats", "1", "--oidn", &path, "-q"]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("ref/f_0002.exr: holds no finite pixel"), "{}", text(&output.stderr));
    let (report, _) = read_report(&shot, "report");
    assert_eq!(report["frames"], serde_json::json!([1, 3]));
    assert!((row(&report, "OIDN fast")["seconds"]["median"].as_f64().unwrap() - 0.008).abs() < 1e-9);
}

#[cfg(unix)]
fn tool(shot: &Shot, script: &str) -> String {
    use std::os::unix::fs::PermissionsExt;
    let path = shot.dir.path().join("oidnDenoise");
    fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    path.display().to_string()
}

#[cfg(unix)]
#[test]
fn the_peer_runs_as_cycles_runs_it_and_is_measured_by_its_own_clock() {
    let shot = Shot::new(1..=2, Look::default());
    add_references(&shot, 1..=2, Look::default());
    // Gives its input back: the picture, or a guide by itself. Each kind of run has a time of its own.
    let script = "echo \"$*\" >> runs; clean=; quality=\nwhile [ $# -gt 0 ]; do case $1 in --hdr) colour=$2;; --alb) albedo=$2;; \
        --nrm) normal=$2;; -o) out=$2;; -q) quality=$2;; --clean_aux) clean=yes;; esac; shift; done\n\
        case \"${colour:+colour}${albedo:+albedo}${normal:+normal}$clean$quality\" in albedohigh) time=100;; normalhigh) time=200;; \
        colouralbedonormalyeshigh) time=12.5;; colouralbedonormalhigh) time=7.5;; colouralbedonormalfast) time=2.5;; *) exit 9;; esac\n\
        /bin/cat \"${colour:-${albedo:-$normal}}\" > \"$out\"; echo '  device=CPU, version=9.8.7, msec=4'; echo 'Denoising 100% '; \
        echo '  msec=900.5'; echo 'Denoising 100% '; echo \"  msec=$time, hash=1\"";
    let path = tool(&shot, script);
    let output = hush(&shot, &["report", "shot", "-r", "ref", "-o", "report", "--repeats", "2", "--oidn", &path, "-q"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let (report, page) = read_report(&shot, "report");
    for (name, mode, seconds) in
        [("OIDN 9.8.7", "cycles", 0.3125), ("OIDN 9.8.7 raw", "raw_guides", 0.0075), ("OIDN 9.8.7 fast", "fast", 0.0025)]
    {
        let peer = row(&report, name);
        assert!((peer["seconds"]["median"].as_f64().unwrap() - seconds).abs() < 1e-9, "{name}: {}", peer["seconds"]);
        assert_eq!(peer["errors"], row(&report, "noisy")["errors"], "it gave the noisy picture back");
        assert_eq!(peer["method"], serde_json::json!({"by": "oidn", "mode": mode}));
    }
    assert!(page.contains("Its time is its filters', these two included."));
    // Two frames, twice: a guide each, the picture with what became of them, and twice with the guides as rendered.
    let runs = fs::read_to_string(shot.dir.path().join("runs")).unwrap();
    let with = |words: &[&str]| runs.lines().filter(|line| words.iter().all(|word| line.contains(word))).count();
    assert_eq!(runs.lines().count(), 4 * 5);
    assert_eq!(with(&["/albedo.clean.pfm --nrm", "/normal.clean.pfm --clean_aux"]), 4);
    assert_eq!(with(&["--hdr", "/albedo.pfm --nrm", "/normal.pfm -o"]), 8);
    assert_eq!((with(&["--alb", "/albedo.pfm -o", "/albedo.clean.pfm"]), with(&["--nrm", "/normal.pfm -o", "clean"])), (4, 4));
    let path = tool(&shot, "echo 'out of order' >&2; exit 3");
    let named = hush(&shot, &["report", "shot", "-o", "other", "--repeats", "1", "--oidn", &path]);
    assert_eq!(named.status.code(), Some(1));
    assert!(text(&named.stderr).contains("out of order: pass --no-oidn to do without it"), "{}", text(&named.stderr));
    let found =
        command(&shot, &["report", "shot", "-o", "found", "--repeats", "1", "-q"]).env("PATH", shot.dir.path()).output().unwrap();
    assert_eq!(found.status.code(), Some(0), "{}", text(&found.stderr));
    let (report, page) = read_report(&shot, "found");
    assert!(
        page.contains("OIDN is left out") && report["rows_by_setting"].as_array().unwrap().iter().all(|r| r["kind"] != "oidn")
    );
    // All NaN.
    let script = "while [ $# -gt 0 ]; do case $1 in -o) out=$2;; esac; shift; done\n\
        { printf 'PF\\n24 16\\n-1.0\\n'; /usr/bin/head -c 4608 /dev/zero | /usr/bin/tr '\\0' '\\377'; } > \"$out\"\n\
        echo 'Denoising 100% '; echo '  msec=8'";
    let nothing = tool(&shot, script);
    let failed = hush(&shot, &["report", "shot", "-r", "ref", "-o", "nan", "--repeats", "1", "--oidn", &nothing]);
    assert!(text(&failed.stderr).contains("gave an image without a finite pixel"), "{}", text(&failed.stderr));
}

#[cfg(unix)]
#[test]
fn stopped_it_leaves_no_page() {
    let shot = Shot::new(1..=3, Look::default());
    let mut child =
        command(&shot, &["report", "shot", "-o", "report", "--repeats", "1000"]).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    assert!(lines.next().unwrap().unwrap().contains("measuring"));
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let said: Vec<String> = lines.map(|l| l.unwrap()).collect();
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert!(said.iter().any(|l| l.contains("nothing was written")), "{said:?}");
    assert!(names(&shot.dir.path().join("report")).is_empty());
}

/// The page quotes these bounds to those who have no references.
#[test]
fn estimate_on_the_sample_shot() {
    let samples = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples");
    let sequence = Sequence::find(&[samples.join("shot")]).unwrap();
    let frames = "4-5".parse().unwrap();
    let scope = Scope::open(&sequence, &Selection::default(), Some(&frames), None, REACH).unwrap();
    let options = MeasureOptions {
        reference: Some(samples.join("reference")),
        repeats: 1,
        chosen: true,
        oidn: None,
        layer: None,
        view: None,
    };
    let engine = Engine::new(Settings::default()).unwrap();
    let measured = measure(&scope, &engine, &options, &|_, _| (), &CancelToken::new()).unwrap();
    let checks = &measured.report.checks;
    assert_eq!(checks.len(), 6, "all but the noisy picture and window 3, which the shot is too short for");
    let off: Vec<f64> = checks.iter().map(|check| check.estimated - check.measured).collect();
    for (check, off) in checks.iter().zip(&off) {
        println!("{}: {:.4} ± {:.4}, {:.4}, off by {off:+.4}", check.name, check.estimated, check.deviation, check.measured);
    }
    assert!(off.iter().all(|off| (-0.0085..-0.0065).contains(off)), "{off:?}");
    for i in 0..checks.len() {
        for j in 0..checks.len() {
            // Settings that differ by more than the estimate's uncertainty are in the right order.
            if checks[i].measured > checks[j].measured + 0.003 {
                assert!(checks[i].estimated > checks[j].estimated, "{} and {}", checks[i].name, checks[j].name);
            }
        }
    }
}
