//! Previews: a region agrees with the whole frame, only what is needed is read, and the sheet shows what was asked for.

mod common;

use std::path::Path;
use std::process::{Command, Output};

use common::{Look, Shot};
use hush::io::Selection;
use hush::io::sequence::Sequence;
use hush::preview::{Preview, Region, Request, preview};
use hush::shot::{CancelToken, Job, run};
use hush::{Engine, Error, Settings};
use ndarray::{Array3, s};

fn sample() -> Sequence {
    Sequence::find(&[Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/shot")]).unwrap()
}

fn request(frame: i64, windows: &[usize], region: Option<&str>) -> Request {
    let region = region.map(|text| text.parse().unwrap());
    Request { frame, lambdas: vec![2.0], lambda_masked: None, windows: windows.to_vec(), region, flicker: false }
}

fn made(sequence: &Sequence, request: &Request) -> Result<Preview, Error> {
    let engine = Engine::new(Settings::default()).unwrap();
    preview((sequence, &Selection::default()), request, &engine, &|_| (), &CancelToken::new())
}

/// The largest difference as a share of the value and a hundredth of a well exposed frame.
fn apart(a: &Array3<f32>, b: &Array3<f32>) -> f32 {
    assert_eq!(a.dim(), b.dim());
    assert!(a.iter().chain(b).all(|v| v.is_finite()), "no image");
    a.iter().zip(b).map(|(a, b)| (a - b).abs() / (a.abs().max(b.abs()) + 0.01)).fold(0.0, f32::max)
}

fn cut(image: &Array3<f32>, region: Region) -> Array3<f32> {
    image.slice(s![region.rows(), region.columns(), ..]).to_owned()
}

#[test]
fn a_region_agrees_with_the_same_part_of_the_whole_frame() {
    let sequence = sample();
    for windows in [&[2][..], &[0]] {
        let whole = made(&sequence, &Request { flicker: true, ..request(4, windows, None) }).unwrap();
        let all = &whole.layers[0].variants[0];
        for text in ["150,60,120,80", "0,0,64,48", "301,171,35,21"] {
            let part = made(&sequence, &Request { flicker: true, ..request(4, windows, Some(text)) }).unwrap();
            let (here, region) = (&part.layers[0].variants[0], part.region);
            assert_eq!((region.to_string().as_str(), &here.neighbours), (text, &all.neighbours));
            assert_eq!(part.layers[0].noisy, cut(&whole.layers[0].noisy, region));
            let (colour, noisy) = (apart(&here.colour, &cut(&all.colour, region)), apart(&here.colour, &part.layers[0].noisy));
            assert!(colour < 1e-3, "{text} window {windows:?}: off by {colour}");
            assert!(noisy > 0.05, "{text}: not denoised");
            let (flicker, expected) = (here.flicker.as_ref().unwrap(), all.flicker.as_ref().unwrap());
            let expected = expected.part(region.rows(), region.columns());
            assert_eq!(flicker.change.mapv(f32::is_nan), expected.change.mapv(f32::is_nan), "{text}");
            let (a, b) = (flicker.mean.unwrap(), expected.mean.unwrap());
            assert!((a - b).abs() < 1e-3, "{text}: flicker {a} instead of {b}");
            assert!(part.layers[0].flicker.as_ref().unwrap().mean.unwrap() > 1.1 * a, "{text}: noise flickers more");
        }
    }
}

#[test]
fn the_whole_frame_has_the_bits_of_a_run() {
    let sequence = sample();
    let dir = tempfile::tempdir().unwrap();
    let engine = Engine::new(Settings::default()).unwrap();
    let job = Job::new(sequence.clone(), dir.path()).with(|s| {
        s.frames = Some("4".parse().unwrap());
        s.lambda = Some("2".parse().unwrap())
    });
    assert!(run(&job, &engine, &|_| (), &CancelToken::new()).unwrap().is_complete());
    let layout = hush::io::read_layout(&dir.path().join("frame_0004.exr")).unwrap();
    let selection = Selection { denoised_ok: true, ..Selection::default() };
    let written = hush::io::read_frame(&layout, &hush::io::resolve(&layout, &selection).unwrap()).unwrap();
    let shown = made(&sequence, &request(4, &[], None)).unwrap();
    assert_eq!(shown.layers[0].variants[0].window, 2);
    // The file may hold half floats.
    assert!(apart(&shown.layers[0].variants[0].colour, &written.colour) < 1e-3);
}

#[test]
fn every_combination_is_there_and_only_the_window_is_read() {
    let shot = Shot::new(1..=9, Look { layers: &["A", "B"], ..Look::default() });
    // A frame outside the windows is not even looked at.
    std::fs::write(shot.input(9), b"no image").unwrap();
    shot.truncate(8);
    let sequence = Sequence::find(&[shot.folder()]).unwrap();
    let selection = Selection { layers: vec!["all".into()], ..Selection::default() };
    let asked =
        Request { frame: 5, lambdas: vec![1.0, 16.0], lambda_masked: None, windows: vec![0, 2], region: None, flicker: true };
    let mut told = std::sync::Mutex::new(Vec::new());
    let listen = |f: f64| told.lock().unwrap().push(f);
    let made = preview((&sequence, &selection), &asked, &shot.engine, &listen, &CancelToken::new()).unwrap();
    assert_eq!(made.layers.iter().map(|l| l.name.as_str()).collect::<Vec<_>>(), ["A", "B"]);
    let all: Vec<_> = made.layers[1].variants.iter().map(|v| (v.window, v.lambda, v.neighbours.clone())).collect();
    let (none, around) = (vec![], vec![3, 4, 6, 7]);
    assert_eq!(all, [(0, 1.0, none.clone()), (0, 16.0, none), (2, 1.0, around.clone()), (2, 16.0, around)]);
    assert!(!made.notes.iter().any(|n| n.contains("frame 8") || n.contains("frame 9")), "{:?}", made.notes);
    let told = told.get_mut().unwrap();
    assert!(told.windows(2).all(|w| w[1] > w[0]) && told.last() == Some(&1.0), "{told:?}");
}

#[test]
fn a_bad_neighbour_is_told_and_a_bad_frame_is_an_error() {
    let shot = Shot::new(1..=5, Look::default());
    shot.truncate(2);
    let sequence = Sequence::find(&[shot.folder()]).unwrap();
    let made = |frame: i64, flicker| {
        let asked = Request { flicker, ..request(frame, &[1], None) };
        preview((&sequence, &Selection::default()), &asked, &shot.engine, &|_| (), &CancelToken::new())
    };
    let shown = made(3, true).unwrap();
    assert_eq!(shown.layers[0].variants[0].neighbours, [4]);
    assert!(shown.notes.iter().any(|n| n.contains("frame 2")), "{:?}", shown.notes);
    assert!(shown.layers[0].flicker.is_none() && shown.layers[0].variants[0].flicker.is_none());
    assert!(made(2, false).is_err());
    assert!(made(77, false).err().unwrap().to_string().contains("1-5"));
    let cancel = CancelToken::new();
    cancel.cancel();
    let stopped = preview((&sequence, &Selection::default()), &request(3, &[1], None), &shot.engine, &|_| (), &cancel);
    assert!(matches!(stopped, Err(Error::Cancelled)));
    assert!(made(1, true).unwrap().notes.iter().any(|n| n.contains("flicker cannot be shown")));
}

fn hush(shot: &Shot, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_hush")).current_dir(shot.dir.path()).args(args).output().unwrap()
}

#[test]
fn the_command_writes_a_sheet_with_the_settings_beside_the_frames() {
    let shot = Shot::new(1..=5, Look { columns: 64, rows: 48, ..Look::default() });
    std::fs::write(shot.folder().join("hush.toml"), "lambda = 4\nwindow = 1\n").unwrap();
    let size =
        |name: &str| resvg::tiny_skia::Pixmap::load_png(shot.dir.path().join(name)).map(|p| (p.width(), p.height())).unwrap();
    let text = |o: &Output| (String::from_utf8_lossy(&o.stdout).into_owned(), String::from_utf8_lossy(&o.stderr).into_owned());
    let plain = hush(&shot, &["preview", "shot", "--frame", "3", "--output", "plain.png"]);
    assert!(plain.status.success(), "{plain:?}");
    assert!(text(&plain).0.starts_with("lambda 4, window 1 with frames 2 4: "), "{plain:?}");
    // Two tiles of 64 pixels, four times as large.
    assert_eq!(size("plain.png"), (12 + 2 * (256 + 12), 12 + 2 * 22 + 22 + 192 + 12));
    let args = ["preview", "shot", "--frame", "3", "-o", "more.png", "-l", "1,4,16", "-w", "0,2", "--flicker", "--before-after"];
    let more = hush(&shot, &args);
    assert!(more.status.success() && text(&more).0.lines().count() == 7, "{more:?}");
    assert!(text(&more).0.contains("change"));
    assert_eq!(size("more.png"), (12 + 4 * (256 + 12), 12 + 2 * 22 + 4 * (22 + 192 + 12) + 22 + 12));
    let region = hush(&shot, &["preview", "shot", "--frame", "3", "-o", "part.png", "--region", "8,8,32,16", "-q"]);
    assert!(region.status.success() && region.stdout.is_empty() && region.stderr.is_empty(), "{region:?}");
    assert!(!shot.out().exists() && std::fs::read_dir(shot.folder()).unwrap().count() == 6, "something was written");
}

#[test]
fn the_command_refuses_what_cannot_be() {
    let shot = Shot::new(1..=3, Look::default());
    let refused = |more: &[&str], words: &str| {
        let args: Vec<&str> = ["preview", "shot"].into_iter().chain(more.iter().copied()).collect();
        let output = hush(&shot, &args);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(1) && said.contains(words), "{args:?}: {said}");
    };
    let frame = ["--frame", "2", "-o", "a.png"];
    let with = |more: &[&'static str]| [&frame[..], more].concat();
    refused(&["--frame", "2", "-o", "a.jpg"], ".png");
    refused(&["--frame", "9", "-o", "a.png"], "1-3");
    refused(&with(&["--region", "0,0,25,16"]), "24×16");
    refused(&with(&["--region", "1,2"]), "X,Y,WIDTH,HEIGHT");
    refused(&with(&["--lambda", "0.5"]), "out of range");
    refused(&with(&["--window", "4"]), "0 to 3");
    refused(&with(&["--before-after", "1.5"]), "0 (all denoised)");
    assert!(!shot.dir.path().join("a.png").exists());
}
