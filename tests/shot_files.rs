//! The runner over files: every frame is written, bad ones are gone around, wrong jobs are refused.

mod common;

use std::fs;
use std::path::{Path, PathBuf};

use common::{Look, Shot, name, write_frame};
use exr::prelude::Compression;
use hush::io::sequence::Sequence;
use hush::io::{Selection, read_frame, read_layout, resolve};
use hush::shot::{Job, Status};

#[test]
fn every_frame_is_written_the_first_and_the_last_included() {
    let shot = Shot::new(1..=6, Look::default());
    let outcome = shot.run(&shot.job());
    assert!(outcome.summary().is_complete());
    assert_eq!(outcome.log.with(Status::Denoised), [1, 2, 3, 4, 5, 6]);
    assert_eq!(outcome.log.neighbours(1), [2, 3]);
    assert_eq!(outcome.log.neighbours(3), [1, 2, 4, 5]);
    assert_eq!(outcome.log.neighbours(6), [4, 5]);
    assert_eq!(shot.written(), (1..=6).map(name).collect::<Vec<_>>());
    assert_eq!((outcome.log.warnings.len(), outcome.log.errors.len(), outcome.log.done), (0, 0, 1), "{:?}", outcome.log);
    for number in 1..=6 {
        hush::io::is_complete(&shot.output(number)).unwrap();
    }
    let manifest = shot.manifest();
    let entry = &manifest.frames[&name(1)];
    assert_eq!((entry.status, entry.neighbours.len()), (Status::Denoised, 4));
    assert_eq!(entry.neighbours[0].reason, Some(hush::shot::Unused::EndOfShot));
    assert!(entry.source.is_absolute());
    assert_eq!(manifest.settings[&entry.settings].window, 2);
}

#[test]
fn a_single_frame_and_a_lone_file_work() {
    let shot = Shot::new([7], Look::default());
    assert!(shot.run(&shot.job()).summary().is_complete());
    assert_eq!(shot.written(), [name(7)]);
    let still = shot.dir.path().join("still.exr");
    write_frame(&still, 0, Look::default());
    let job = Job::new(Sequence::find(&[still]).unwrap(), shot.dir.path().join("stills"));
    assert!(shot.run(&job).summary().is_complete());
    assert!(job.output.join("still.exr").is_file());
}

#[test]
fn frames_limit_what_is_written_but_not_what_helps() {
    let shot = Shot::new(1..=9, Look::default());
    let job = shot.job().with(|s| s.frames = Some("4-5,9".parse().unwrap()));
    let outcome = shot.run(&job);
    assert!(outcome.summary().is_complete());
    assert_eq!(shot.written(), [name(4), name(5), name(9)]);
    assert_eq!(outcome.log.neighbours(4), [2, 3, 5, 6]);
    assert_eq!(outcome.log.neighbours(9), [7, 8]);
}

#[test]
fn files_that_are_named_are_written_and_those_beside_them_help() {
    let shot = Shot::new(1..=8, Look::default());
    let job = |inputs: &[PathBuf]| Job::new(Sequence::find(inputs).unwrap(), shot.out());
    let outcome = shot.run(&job(&[shot.input(3)]));
    assert!(outcome.summary().is_complete());
    assert_eq!((outcome.summary().frames, outcome.log.neighbours(3)), (1, vec![1, 2, 4, 5]));
    assert_eq!(shot.written(), [name(3)]);
    // As the shell or Hush itself spells a glob out.
    for inputs in [vec![shot.input(6), shot.input(7)], vec![shot.folder().join("f_000[67].exr")]] {
        let outcome = shot.run(&Job { overwrite: true, ..job(&inputs) });
        assert_eq!((outcome.summary().written, outcome.log.neighbours(7)), (2, vec![5, 6, 8]));
    }
    assert_eq!(shot.written(), [3, 6, 7].map(name));
    let both = Job { overwrite: true, ..job(&[shot.input(6), shot.input(7)]) }.with(|s| s.frames = Some("1-6".parse().unwrap()));
    assert_eq!(shot.run(&both).summary().written, 1);
    // The result is that of a run over the whole shot.
    let bytes = fs::read(shot.output(3)).unwrap();
    assert!(shot.run(&shot.job()).summary().is_complete());
    assert_eq!(fs::read(shot.output(3)).unwrap(), bytes);
    let all: Vec<PathBuf> = (1..=8).map(|n| shot.input(n)).collect();
    assert_eq!(Sequence::find(&all).unwrap().named, None);
}

#[test]
fn a_frame_step_is_told() {
    let shot = Shot::new([1, 3, 5, 7, 11], Look::default());
    let outcome = shot.run(&shot.job());
    assert_eq!(outcome.log.kinds(), ["missing_frames", "frame_step"]);
    let told = &outcome.log.warnings;
    assert!(told[0].1.starts_with("missing frame 9:") && told[1].1.contains("2 apart"), "{told:?}");
    assert!(outcome.log.neighbours(3).is_empty());
    let whole = Shot::new([1, 3, 5, 7], Look::default());
    assert_eq!(whole.run(&whole.job()).log.kinds(), ["frame_step"]);
    let alone = whole.run(&Job { overwrite: true, ..whole.job() }.with(|s| s.window = Some(0)));
    assert_eq!(alone.log.kinds(), Vec::<&str>::new());
}

#[test]
fn a_frame_without_a_finite_pixel_fails_and_the_others_do_without_it() {
    let shot = Shot::new(1..=4, Look::default());
    spoil(&shot.input(3));
    let outcome = shot.run(&shot.job());
    let summary = outcome.summary();
    assert_eq!(
        (summary.written, summary.failed.as_slice(), summary.degraded.as_slice()),
        (3, [3].as_slice(), [1, 2, 4].as_slice())
    );
    let message = &outcome.log.errors.iter().find(|e| e.0 == Some(3)).unwrap().1;
    assert!(message.ends_with("f_0003.exr: ViewLayer.Combined holds no finite pixel: render it again"), "{message}");
    assert!(outcome.log.neighbours(4).is_empty() && !shot.output(3).exists());
}

/// Makes every colour of a frame NaN.
fn spoil(path: &Path) {
    use exr::prelude::{FlatSamples, WritableImage, read_first_flat_layer_from_file};
    let mut image = read_first_flat_layer_from_file(path).unwrap();
    for channel in image.layer_data.channel_data.list.iter_mut().filter(|c| c.name.to_string().contains("Combined")) {
        let FlatSamples::F32(values) = &mut channel.sample_data else { panic!() };
        values.fill(f32::NAN);
    }
    image.write().to_file(path).unwrap();
}

#[test]
fn frames_asked_for_that_are_missing_show_in_the_summary() {
    let shot = Shot::new([1, 2, 4], Look::default());
    let outcome = shot.run(&shot.job().with(|s| s.frames = Some("1-5".parse().unwrap())));
    assert_eq!(outcome.summary().missing, "3,5");
    assert!(!outcome.summary().is_complete());
    assert_eq!(outcome.log.kinds(), ["missing_frames"]);
    let none = shot.run(&shot.job().with(|s| s.frames = Some("50-60".parse().unwrap())));
    assert!(none.error().contains("1-2,4"), "{}", none.error());
}

#[test]
fn a_gap_is_told_and_gone_around() {
    let shot = Shot::new([1, 2, 4, 5], Look::default());
    let outcome = shot.run(&shot.job());
    assert!(outcome.summary().is_complete());
    assert_eq!(outcome.log.kinds(), ["missing_frames"]);
    assert_eq!(outcome.log.neighbours(2), [1]);
    assert_eq!(outcome.log.neighbours(4), [5]);
    let strict = shot.run(&Job { strict: true, overwrite: true, ..shot.job() });
    assert!(strict.error().contains("missing frame 3:"), "{}", strict.error());
}

#[test]
fn a_bad_frame_does_not_stop_the_shot() {
    for header_too in [false, true] {
        let shot = Shot::new(1..=6, Look::default());
        match header_too {
            true => fs::write(shot.input(3), b"not an image").unwrap(),
            false => shot.truncate(3),
        }
        let outcome = shot.run(&shot.job());
        let summary = outcome.summary();
        assert_eq!((summary.written, summary.failed.as_slice()), (5, [3].as_slice()), "{:?}", outcome.log);
        assert_eq!(summary.degraded, [1, 2, 4, 5]);
        assert!(!summary.is_complete());
        assert_eq!(outcome.log.neighbours(2), [1]);
        assert_eq!(outcome.log.neighbours(6), [4, 5]);
        assert_eq!(outcome.log.errors.iter().filter(|e| e.0 == Some(3)).count(), 1);
        assert_eq!(shot.written(), [1, 2, 4, 5, 6].map(name));
        let entry = &shot.manifest().frames[&name(3)];
        assert!(entry.status == Status::Failed && entry.reason.as_ref().is_some_and(|r| r.contains("f_0003.exr")), "{entry:?}");
        // What was done without it is not done again, and still said.
        let again = shot.run(&shot.job());
        assert_eq!(again.log.with(Status::Skipped), [1, 2, 4, 5, 6]);
        assert_eq!(again.summary().degraded, [1, 2, 4, 5]);
        // Once it is there, it and the frames around it are.
        write_frame(&shot.input(3), 3, Look::default());
        let healed = shot.run(&shot.job());
        assert!(healed.summary().is_complete());
        assert_eq!(healed.log.with(Status::Denoised), [1, 2, 3, 4, 5]);
    }
}

#[test]
fn strict_stops_at_the_first_bad_frame() {
    let shot = Shot::new(1..=8, Look::default());
    shot.truncate(5);
    let outcome = shot.run(&Job { strict: true, ..shot.job() });
    assert!(outcome.summary().stopped.as_ref().is_some_and(|e| e.to_string().contains("f_0005.exr")), "{:?}", outcome.log);
    assert_eq!(shot.written(), [1, 2].map(name));
    fs::write(shot.input(5), b"").unwrap();
    assert!(shot.run(&Job { strict: true, ..shot.job() }).error().contains("f_0005.exr"));
}

#[test]
fn all_frames_bad_is_an_error() {
    let shot = Shot::new(1..=2, Look::default());
    (1..=2).for_each(|n| fs::write(shot.input(n), b"x").unwrap());
    assert!(shot.run(&shot.job()).error().contains("f_0001.exr"));
    assert!(!shot.out().exists());
}

#[test]
fn without_vectors_the_window_falls_back_or_is_refused() {
    let shot = Shot::new(1..=3, Look { vector: None, ..Look::default() });
    let refused = shot.run(&shot.job().with(|s| s.window = Some(1)));
    assert!(refused.error().contains("no Vector pass") && refused.error().contains("set window to 0"), "{}", refused.error());
    assert!(!shot.out().exists());
    let outcome = shot.run(&shot.job());
    assert!(outcome.summary().is_complete());
    assert_eq!(outcome.log.kinds(), ["no_vector"]);
    assert!(outcome.log.neighbours(2).is_empty());
    let asked = shot.run(&Job { overwrite: true, ..shot.job() }.with(|s| s.window = Some(0)));
    assert_eq!(asked.log.kinds(), Vec::<&str>::new());
    let mut contradiction = shot.job().with(|s| s.window = Some(2));
    contradiction.settings.guides = Some(Vec::new());
    assert!(shot.run(&contradiction).error().contains("window"));
}

#[test]
fn one_frame_without_vectors_is_named() {
    let shot = Shot::new(1..=5, Look::default());
    write_frame(&shot.input(3), 3, Look { vector: None, ..Look::default() });
    let outcome = shot.run(&shot.job());
    assert!(outcome.log.warnings[0].1.starts_with("frame 3 has no Vector pass"), "{:?}", outcome.log);
    assert!(outcome.log.neighbours(3).is_empty());
    assert_eq!(outcome.log.neighbours(2), [1, 3]);
}

#[test]
fn another_resolution_is_told_and_not_mixed() {
    let shot = Shot::new(1..=4, Look::default());
    write_frame(&shot.input(4), 4, Look { columns: 10, rows: 6, ..Look::default() });
    let outcome = shot.run(&shot.job());
    assert!(outcome.summary().is_complete());
    assert_eq!(outcome.log.kinds(), ["resolution"]);
    assert_eq!(outcome.log.neighbours(3), [1, 2]);
    assert!(outcome.log.neighbours(4).is_empty());
    assert!(shot.run(&Job { strict: true, overwrite: true, ..shot.job() }).error().contains("resolution"));
}

#[test]
fn frames_whose_film_is_seen_through_and_others_help_each_other() {
    let opaque = Look { alpha: Some(|_, _| 1.0), ..Look::default() };
    let shot = Shot::new(1..=5, opaque);
    write_frame(&shot.input(3), 3, Look { alpha: Some(|y, x| if (y, x) == (0, 0) { 0.5 } else { 1.0 }), ..opaque });
    let made = |window: usize| {
        let outcome = shot.run(&Job { overwrite: true, ..shot.job().with(|s| s.window = Some(window)) });
        assert!(outcome.log.kinds().is_empty());
        (1..=5).map(|n| std::fs::read(shot.output(n)).unwrap()).collect::<Vec<_>>()
    };
    let (alone, together) = (made(0), made(2));
    alone.iter().zip(&together).for_each(|(alone, together)| assert!(alone != together));
}

#[test]
fn the_render_settings_to_change_are_named() {
    let repeated = Shot::new(1..=4, Look { seed: Some(5), ..Look::default() });
    let outcome = repeated.run(&repeated.job());
    assert_eq!(outcome.log.kinds(), ["repeated_noise"]);
    assert!(outcome.log.warnings[0].1.contains("frames 1 and 2") && outcome.log.warnings[0].1.contains("Seed"));
    assert_eq!(repeated.manifest().frames[&name(3)].warnings, ["the same noise as in frame 2"]);

    let blurred = Shot::new(1..=4, Look { vector: Some(0.0), ..Look::default() });
    let outcome = blurred.run(&blurred.job());
    assert_eq!(outcome.log.kinds(), ["zero_vector"]);

    let noisy = Shot::new(1..=2, Look { noisy_image: true, ..Look::default() });
    assert_eq!(noisy.run(&noisy.job()).log.kinds(), ["noisy_image"]);

    let lossy = Shot::new(1..=2, Look { compression: Compression::B44, ..Look::default() });
    let log = lossy.run(&lossy.job()).log;
    assert!(!log.warnings.is_empty() && log.warnings.iter().all(|w| w.0 == "note" && w.1.contains("lossy")), "{log:?}");
}

#[test]
fn the_originals_are_safe() {
    let shot = Shot::new(1..=2, Look::default());
    let before = fs::read(shot.input(1)).unwrap();
    for output in [shot.folder(), shot.folder().join("."), shot.folder().join("../shot")] {
        let refused = shot.run(&Job { output, overwrite: true, ..shot.job() });
        assert!(refused.error().contains("overwritten"), "{}", refused.error());
    }
    let inside = Job { output: shot.folder().join("denoised"), ..shot.job() };
    assert!(shot.run(&inside).summary().is_complete());
    assert_eq!(Sequence::find(&[shot.folder()]).unwrap().numbers(), [1, 2]);
    assert_eq!(fs::read(shot.input(1)).unwrap(), before);
}

#[test]
fn an_output_that_cannot_be_written_is_refused() {
    let shot = Shot::new(1..=2, Look::default());
    fs::write(shot.out(), b"a file").unwrap();
    assert!(shot.run(&shot.job()).error().contains("is a file"));
    let below = Job { output: shot.out().join("deeper"), ..shot.job() };
    assert!(shot.run(&below).summary.is_err());
    assert_eq!(fs::read(shot.out()).unwrap(), b"a file");
}

#[test]
fn an_output_that_vanishes_ends_the_run_with_a_reason() {
    let shot = Shot::new(1..=9, Look::default());
    let outcome = shot.run_until(&shot.job(), &Default::default(), |event| {
        if matches!(event, hush::shot::Event::Working { frame: 3 }) {
            // The frame before may just be written into it.
            while fs::remove_dir_all(shot.out()).is_err() {}
            fs::write(shot.out(), b"in the way").unwrap();
        }
    });
    let summary = outcome.summary();
    assert!(summary.stopped.is_some() && !summary.is_complete(), "{:?}", outcome.log);
    assert!(summary.failed.len() < 4, "further frames were attempted: {:?}", outcome.log);
}

#[test]
fn several_view_layers_in_one_run_are_as_each_alone() {
    let shot = Shot::new(1..=3, Look { layers: &["Back", "Front"], ..Look::default() });
    let select = |layer: &str| Selection { layers: vec![layer.into()], ..Selection::default() };
    let colour = |number: i64, layer: &str| {
        let layout = read_layout(&shot.output(number)).unwrap();
        read_frame(&layout, &resolve(&layout, &select(layer)).unwrap()).unwrap().colour
    };
    let of = |asked: &str| {
        shot.run(&shot.job().with(|s| s.layers = Some(vec![asked.into()]))).summary();
        [1, 2, 3].map(|n| ["Back", "Front"].map(|layer| colour(n, layer)))
    };
    let (back, front, both) = (of("Back"), of("Front"), of("all"));
    for i in 0..3 {
        assert!(both[i] == [back[i][0].clone(), front[i][1].clone()], "frame {}", i + 1);
        assert!(both[i][0] != front[i][0], "a layer that was not asked for stays as it was");
    }
}
