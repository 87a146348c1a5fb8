//! The mask of λ from a pass or from images: the pixels that come out, what is refused, and when a frame is out of date.

mod common;

use std::process::{Command, Output, Stdio};

use common::{Look, Shot, name, write_frame, write_mask};
use hush::io::{Selection, read_frame, read_layout, resolve};
use hush::preview::{Request, preview};
use hush::settings::ShotSettings;
use hush::shot::{CancelToken, FrameState, Job, SequenceCheck, StaleKind, Status};
use hush::{EncodedFrame, Frame, LambdaMask};
use ndarray::{Array2, Array3};

const AOV: &str = "Hush Lambda";

/// Marked on the right, with an edge that a filter made.
fn right(_: usize, x: usize) -> f32 {
    ((x as f32 - 10.0) / 4.0).clamp(0.0, 1.0)
}

const MASKED: Look = Look { mask: Some(right), ..Look::PLAIN };

/// λ from 1 to 64 by the pass.
fn by_pass(s: &mut ShotSettings) {
    s.lambda_pass = Some(AOV.into());
    s.lambda_masked = Some("64".parse().unwrap());
}

/// λ from 1 to 64 by images in `masks`.
fn by_images(shot: &Shot) -> impl FnOnce(&mut ShotSettings) {
    let pattern = shot.dir.path().join("masks/m_####.exr");
    |s: &mut ShotSettings| {
        s.lambda_images = Some(pattern);
        s.lambda_masked = Some("64".parse().unwrap());
    }
}

fn write_masks(shot: &Shot, numbers: std::ops::RangeInclusive<i64>, grey: bool, value: fn(usize, usize) -> f32) {
    std::fs::create_dir_all(shot.dir.path().join("masks")).unwrap();
    for number in numbers {
        write_mask(&shot.dir.path().join(format!("masks/m_{number:04}.exr")), MASKED, grey, value);
    }
}

fn frame_of(path: &std::path::Path) -> Frame {
    let layout = read_layout(path).unwrap();
    read_frame(&layout, &resolve(&layout, &Selection { denoised_ok: true, ..Selection::default() }).unwrap()).unwrap()
}

fn written(shot: &Shot, number: i64) -> Array3<f32> {
    frame_of(&shot.output(number)).colour
}

/// What the engine makes of a frame of a shot of three with this mask, from λ 1 to 64.
fn in_memory(shot: &Shot, number: i64, mask: fn(usize, usize) -> f32) -> Array3<f32> {
    let encoded: Vec<EncodedFrame> = (1..=3).map(|n| shot.engine.encode(frame_of(&shot.input(n))).unwrap()).collect();
    let near = (1..=3).filter(|n| *n != number).map(|n| ((n - number) as i32, &encoded[n as usize - 1]));
    let mask = LambdaMask::new(Array2::from_shape_fn((16, 24), |(y, x)| mask(y, x)).view());
    let around: Vec<_> = near.collect();
    shot.engine.denoise(&encoded[number as usize - 1], &around, &mask.mix(1.0, 64.0).unwrap()).unwrap().colour
}

fn hush(shot: &Shot, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_hush")).current_dir(shot.dir.path()).args(args).stdin(Stdio::null()).output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn the_command_writes_what_the_engine_makes_of_the_mask() {
    let shot = Shot::new(1..=3, MASKED);
    let run = hush(&shot, &["denoise", "shot", "-o", "out", "--lambda-pass", AOV, "--lambda-masked", "64", "--quiet"]);
    assert!(run.status.success() && run.stderr.is_empty(), "{}", said(&run));
    for number in 1..=3 {
        assert!(written(&shot, number) == in_memory(&shot, number, right), "frame {number}");
    }
    let keep = written(&shot, 2);
    shot.run(&Job { overwrite: true, ..shot.job() });
    assert!(written(&shot, 2) != keep, "the mask matters");
    // The same mask from images, of one channel and grey.
    for grey in [false, true] {
        write_masks(&shot, 1..=3, grey, right);
        std::fs::write(shot.folder().join("hush.toml"), "lambda_images = \"../masks/m_####.exr\"\nlambda_masked = 64\n").unwrap();
        let run = hush(&shot, &["denoise", "shot", "-o", "out", "--overwrite"]);
        assert!(run.status.success(), "{}", said(&run));
        assert!(written(&shot, 2) == keep, "grey {grey}");
    }
}

#[test]
fn what_is_not_marked_is_as_without_a_mask() {
    let shot = Shot::new(1..=2, Look { mask: Some(|_, _| 0.0), ..MASKED });
    shot.run(&shot.job());
    let plain = written(&shot, 1);
    let with = |change: &dyn Fn(&mut ShotSettings)| {
        shot.run(&Job { overwrite: true, ..shot.job().with(change) });
        written(&shot, 1)
    };
    assert!(with(&by_pass) == plain);
    let high = with(&|s| s.lambda = Some("64".parse().unwrap()));
    write_masks(&shot, 1..=2, false, |_, _| 1.0);
    assert!(with(&|s| by_images(&shot)(s)) == high);
    // The default of what is marked is 16.
    let sixteen = with(&|s| s.lambda = Some("16".parse().unwrap()));
    let unsaid = with(&|s| {
        by_images(&shot)(s);
        s.lambda_masked = None;
    });
    assert!(unsaid == sixteen && high != sixteen);
    // Keyed like λ itself.
    let keyed = with(&|s| {
        by_images(&shot)(s);
        s.lambda_masked = Some("1:64,2:1".parse().unwrap());
    });
    assert!(keyed == high);
}

#[test]
fn a_mask_that_is_not_there_or_does_not_fit_is_told_by_name() {
    let shot = Shot::new(1..=3, Look::default());
    let refused = shot.run(&shot.job().with(by_pass)).error();
    assert!(refused.contains("f_0001.exr") && refused.contains(AOV) && refused.contains("Shader AOV"), "{refused}");
    assert!(refused.contains("ViewLayer.Combined"), "{refused}");
    // Images: frame 2 has none, that of frame 3 is too small. A frame that only helps needs none.
    write_masks(&shot, 1..=1, false, right);
    write_mask(&shot.dir.path().join("masks/m_0003.exr"), Look { columns: 12, ..MASKED }, false, right);
    let job = shot.job().with(by_images(&shot));
    let outcome = shot.run(&job);
    assert_eq!(outcome.summary().failed, [2, 3]);
    assert_eq!((outcome.log.with(Status::Denoised), outcome.log.neighbours(1)), (vec![1], vec![2, 3]));
    let reason = |number: i64| shot.manifest().frames[&name(number)].reason.clone().unwrap();
    assert!(reason(2).contains("m_0002.exr") && reason(2).contains("no such file"), "{}", reason(2));
    assert!(reason(3).contains("m_0003.exr") && reason(3).contains("12×16, expected 24×16"), "{}", reason(3));
    let strict = shot.run(&Job { strict: true, overwrite: true, ..job }).error();
    assert!(strict.contains("m_0002.exr"), "{strict}");
    std::fs::write(shot.dir.path().join("masks/m_0003.exr"), b"no image").unwrap();
    let run =
        hush(&shot, &["denoise", "shot", "-o", "out", "-f", "3", "--lambda-images", "masks/m_####.exr", "--lambda-masked", "64"]);
    assert!(!run.status.success() && said(&run).contains("m_0003.exr"), "{}", said(&run));
}

#[test]
fn odd_values_and_odd_settings_are_told_once() {
    let shot = Shot::new(1..=3, Look { mask: Some(|y, x| if y == 3 { f32::NAN } else { x as f32 }), ..MASKED });
    let outcome = shot.run(&shot.job().with(by_pass));
    assert!(outcome.summary().is_complete());
    let told: Vec<_> = outcome.log.warnings.iter().filter(|w| w.0 == "lambda_mask").collect();
    assert_eq!(told.len(), 1, "{:?}", outcome.log.warnings);
    assert!(
        told[0].1.contains("frame 1") && told[0].1.contains("24 pixels") && told[0].1.contains("such as 23"),
        "{}",
        told[0].1
    );
    assert!(written(&shot, 2) == in_memory(&shot, 2, |y, x| if y == 3 || x == 0 { 0.0 } else { 1.0 }));
    let alone = shot.run(&shot.job().with(|s| s.lambda_masked = Some("9".parse().unwrap())));
    assert!(alone.log.warnings.iter().any(|w| w.1.contains("does nothing without a mask")), "{:?}", alone.log.warnings);
    let beyond = shot.run(&shot.job().with(|s| {
        by_pass(s);
        s.lambda_masked = Some("900".parse().unwrap())
    }));
    assert!(beyond.log.warnings.iter().any(|w| w.1.contains("lambda masked: lambda 900")), "{:?}", beyond.log.warnings);
}

#[test]
fn a_mask_that_changed_makes_its_frame_stale() {
    let shot = Shot::new(1..=3, MASKED);
    write_masks(&shot, 1..=3, false, right);
    let job = shot.job().with(by_images(&shot));
    assert!(shot.run(&job).summary().is_complete());
    let stale = |job: &Job| -> Vec<(i64, StaleKind)> {
        let checked = SequenceCheck::new().check(job).unwrap();
        let stale = checked.frames.iter().filter(|f| f.state == FrameState::Stale);
        stale.map(|f| (f.frame, f.kind.unwrap())).collect()
    };
    let all = |kind: StaleKind| [1, 2, 3].map(|n| (n, kind)).to_vec();
    assert_eq!(stale(&job), []);
    assert_eq!(shot.run(&job).log.with(Status::Skipped), [1, 2, 3]);
    // A copy of the same masks elsewhere is the same mask.
    let elsewhere = shot.dir.path().join("elsewhere");
    std::fs::create_dir(&elsewhere).unwrap();
    for n in 1..=3 {
        std::fs::copy(shot.dir.path().join(format!("masks/m_{n:04}.exr")), elsewhere.join(format!("m_{n:04}.exr"))).unwrap();
    }
    assert_eq!(stale(&job.clone().with(|s| s.lambda_images = Some(elsewhere.join("m_####.exr")))), []);
    write_masks(&shot, 2..=2, false, |_, _| 0.75);
    assert_eq!(stale(&job), [(2, StaleKind::LambdaImage)]);
    let again = shot.run(&job);
    assert_eq!((again.log.with(Status::Denoised), again.log.with(Status::Skipped)), (vec![2], vec![1, 3]));
    assert!(
        again.log.warnings.iter().any(|w| w.0 == "redone" && w.1.contains("the lambda image changed")),
        "{:?}",
        again.log.warnings
    );
    std::fs::remove_file(shot.dir.path().join("masks/m_0003.exr")).unwrap();
    assert_eq!(stale(&job), [(3, StaleKind::LambdaImage)]);
    write_masks(&shot, 3..=3, false, right);
    assert_eq!(stale(&job), []);
    // Settings of the mask.
    let setting = StaleKind::Setting;
    assert_eq!(stale(&job.clone().with(|s| s.lambda_masked = Some("8".parse().unwrap()))), all(setting("lambda_masked")));
    assert_eq!(stale(&job.clone().with(|s| s.lambda_images = None)), all(setting("lambda_images")));
    assert_eq!(stale(&shot.job().with(by_pass)), all(StaleKind::Several));
    // One λ for what is marked, whatever the frame's: no other frame is made again for keys that miss it.
    let keyed = job.clone().with(|s| s.lambda_masked = Some("1:64,2:64,3:2".parse().unwrap()));
    assert_eq!(stale(&keyed), [(3, setting("lambda_masked"))]);
    let told = shot.run(&keyed).log.warnings.iter().find(|w| w.0 == "redone").unwrap().1.clone();
    assert!(told.contains("lambda masked 64 → 2"), "{told}");
    // Without a mask its λ is no setting of the frame.
    shot.run(&Job { overwrite: true, ..shot.job() });
    assert_eq!(stale(&shot.job().with(|s| s.lambda_masked = Some("8".parse().unwrap()))), []);
}

#[test]
fn keys_of_both_dials_are_one_reason() {
    let shot = Shot::new(1..=3, MASKED);
    let keyed = |lambda: &str, masked: &str| {
        let (lambda, masked) = (lambda.parse().unwrap(), masked.parse().unwrap());
        shot.job().with(|s| (s.lambda, s.lambda_masked, s.lambda_pass) = (Some(lambda), Some(masked), Some(AOV.into())))
    };
    shot.run(&keyed("1:1,3:3", "1:10,3:30"));
    let told: Vec<_> = shot.run(&keyed("1:2,3:4", "1:20,3:40")).log.warnings.into_iter().filter(|w| w.0 == "redone").collect();
    assert_eq!(told.len(), 1, "{told:?}");
    assert!(told[0].1.contains("frames 1-3 are made again: lambda has changed"), "{}", told[0].1);
}

#[test]
fn a_preview_shows_the_mask() {
    let shot = Shot::new(1..=3, MASKED);
    write_masks(&shot, 2..=2, false, right);
    let request =
        Request { frame: 2, lambdas: vec![1.0], lambda_masked: Some(64.0), windows: vec![2], region: None, flicker: false };
    for job in [shot.job().with(by_pass), shot.job().with(by_images(&shot))] {
        let selection = job.settings.selection();
        let made = preview((&job.sequence, &selection), &request, &shot.engine, &|_| (), &CancelToken::new()).unwrap();
        assert!(made.layers[0].variants[0].colour == in_memory(&shot, 2, right));
    }
}

#[test]
fn a_layer_takes_the_mask_of_its_own() {
    let shot = Shot::new(1..=1, Look { layers: &["A", "B"], ..MASKED });
    let layout = read_layout(&shot.input(1)).unwrap();
    for (layer, pass, from) in [("A", AOV, "A"), ("B", AOV, "B"), ("B", "A.Hush Lambda", "A")] {
        let selection = Selection { layers: vec![layer.into()], lambda_pass: Some(pass.into()), ..Selection::default() };
        let found = resolve(&layout, &selection).unwrap().lambda_mask.unwrap();
        assert_eq!((found.channels.len(), found.channels[0].name.as_str()), (1, format!("{from}.Hush Lambda.X").as_str()));
    }
    write_frame(&shot.input(2), 2, Look { mask: None, ..MASKED });
    let layout = read_layout(&shot.input(2)).unwrap();
    // Colours are masks by their red channel, whole numbers are none.
    let red = resolve(&layout, &Selection { lambda_pass: Some("Denoising Albedo".into()), ..Selection::default() }).unwrap();
    assert_eq!(red.lambda_mask.unwrap().channels[0].component, "R");
}
