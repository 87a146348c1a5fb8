//! Running again: what is good stays, what is not is made again, and nothing is ever half there.

mod common;

use std::fs;
use std::time::SystemTime;

use common::{Look, Shot, name, write_frame};
use hush::settings::Lambda;
use hush::shot::{CancelToken, Event, Job, MANIFEST, SequenceCheck, StaleKind, Status};

fn modified(shot: &Shot, number: i64) -> SystemTime {
    fs::metadata(shot.output(number)).unwrap().modified().unwrap()
}

#[test]
fn a_second_run_does_nothing() {
    let shot = Shot::new(1..=4, Look::default());
    shot.run(&shot.job());
    let before = modified(&shot, 2);
    let again = shot.run(&shot.job());
    assert!(again.summary().is_complete());
    assert_eq!(again.log.with(Status::Skipped), [1, 2, 3, 4]);
    assert_eq!(modified(&shot, 2), before);
    let entry = &shot.manifest().frames[&name(2)];
    assert_eq!(entry.status, Status::Skipped);
    assert_eq!(entry.neighbours.iter().filter(|n| n.used).count(), 3, "what was done before is kept");
    let forced = shot.run(&Job { overwrite: true, ..shot.job() });
    assert_eq!(forced.log.with(Status::Denoised), [1, 2, 3, 4]);
    assert_ne!(modified(&shot, 2), before);
}

#[test]
fn other_settings_make_the_frames_again_and_say_so() {
    let mut shot = Shot::new(1..=3, Look::default());
    shot.run(&shot.job());
    let changed = [
        (shot.job().with(|s| s.lambda = Some(Lambda::constant(4.0).unwrap())), "lambda 1 → 4"),
        (shot.job().with(|s| s.window = Some(1)), "lambda 4 → 1, window 2 → 1"),
        (shot.job().with(|s| s.keep_noisy = Some(true)), "window 1 → 2, keep noisy false → true"),
        (shot.job().with(|s| s.model = Some(shot.other_weights())), "model embedded ("),
        (shot.job().with(|s| s.renderer = Some("mitsuba".into())), "), renderer cycles → mitsuba"),
    ];
    for (job, expected) in changed {
        shot.engine = job.settings.engine().unwrap();
        let outcome = shot.run(&job);
        assert_eq!(outcome.log.with(Status::Denoised), [1, 2, 3], "{expected}");
        let (kind, text) = &outcome.log.warnings[0];
        assert!(kind == "redone" && text.contains("1-3") && text.contains(expected), "{text}");
        assert!(job.settings.model.is_none() || text.contains(") → b.safetensors ("), "{text}");
        assert_eq!(shot.run(&job).log.with(Status::Skipped), [1, 2, 3], "{expected}");
    }
    assert_eq!(shot.manifest().settings.len(), 1, "settings that no frame has are forgotten");
}

#[test]
fn what_a_hush_made_that_denoises_differently_is_made_again() {
    let shot = Shot::new(1..=3, Look::default());
    shot.run(&shot.job());
    let path = shot.output(1).with_file_name(MANIFEST);
    let written = fs::read_to_string(&path).unwrap();
    let this = format!("\"revision\": {}", hush::engine::REVISION);
    assert_eq!(written.matches(&this).count(), 1, "{written}");
    fs::write(&path, written.replace(&this, "\"revision\": 0")).unwrap();
    let checked = SequenceCheck::new().check(&shot.job()).unwrap();
    assert!(checked.frames.iter().all(|f| f.kind == Some(StaleKind::Revision)), "{:?}", checked.frames);
    let outcome = shot.run(&shot.job());
    assert_eq!(outcome.log.with(Status::Denoised), [1, 2, 3]);
    let (kind, text) = &outcome.log.warnings[0];
    assert!(
        kind == "redone" && text.contains(concat!("this Hush denoises it differently from Hush ", env!("CARGO_PKG_VERSION"))),
        "{text}"
    );
    assert_eq!(shot.run(&shot.job()).log.with(Status::Skipped), [1, 2, 3]);
}

#[test]
fn two_versions_that_share_a_folder_do_not_make_each_others_frames_for_ever() {
    let shot = Shot::new(1..=3, Look::default());
    shot.run(&shot.job());
    let path = shot.output(1).with_file_name(MANIFEST);
    let this = format!("\"revision\": {}", hush::engine::REVISION);
    let later = format!("\"revision\": {}", hush::engine::REVISION + 1);
    let written = fs::read_to_string(&path).unwrap().replace(&this, &later);
    fs::write(&path, &written).unwrap();
    let frame = fs::read(shot.output(2)).unwrap();
    let error = shot.run(&shot.job()).error();
    assert!(error.contains("frames 1-3 better than this run would make them") && error.contains("use that version"), "{error}");
    assert_eq!((fs::read_to_string(&path).unwrap(), fs::read(shot.output(2)).unwrap()), (written, frame), "nothing is touched");
    // Of a frame that was rendered again nothing later is lost.
    write_frame(&shot.input(2), 2, Look { seed: Some(99), ..Look::default() });
    let error = shot.run(&shot.job()).error();
    assert!(error.contains("frames 1,3 better"), "{error}");
    let outcome = shot.run(&Job { overwrite: true, ..shot.job() });
    assert_eq!(outcome.log.with(Status::Denoised), [1, 2, 3]);
}

#[test]
fn where_lambda_follows_keys_only_the_frames_that_it_changes_are_made_again() {
    let shot = Shot::new(1..=4, Look::default());
    let job = |lambda: &str| shot.job().with(|s| s.lambda = Some(lambda.parse().unwrap()));
    let outcome = shot.run(&job("1:100,2:4,4:200"));
    assert_eq!(outcome.log.kinds(), ["setting"], "one warning for all keys");
    let outcome = shot.run(&job("4"));
    let told: Vec<&str> = outcome.log.warnings.iter().map(|w| w.1.as_str()).collect();
    assert_eq!(told, ["frames 1,3-4 are made again: lambda has changed"]);
    let constant = fs::read(shot.output(2)).unwrap();
    let keyed = shot.run(&job("1:1,2:4,4:8"));
    assert_eq!(keyed.log.with(Status::Denoised), [1, 3, 4]);
    assert_eq!(keyed.log.with(Status::Skipped), [2]);
    let manifest = shot.manifest();
    let lambda = |n| manifest.settings[&manifest.frames[&name(n)].settings].lambda;
    assert_eq!([1, 2, 3, 4].map(lambda), [1.0, 4.0, 6.0, 8.0]);
    shot.run(&Job { overwrite: true, ..job("1:1,2:4,4:8") });
    assert!(fs::read(shot.output(2)).unwrap() == constant, "a frame's λ is its own, whatever the others have");
}

#[test]
fn a_changed_frame_is_made_again_with_those_around_it() {
    let shot = Shot::new(1..=8, Look::default());
    shot.run(&shot.job());
    shot.render_again(3);
    let outcome = shot.run(&shot.job());
    assert_eq!(outcome.log.with(Status::Denoised), [1, 2, 3, 4, 5]);
    assert_eq!(outcome.log.with(Status::Skipped), [6, 7, 8]);
    write_frame(&shot.input(9), 9, Look::default());
    assert_eq!(shot.run(&shot.job()).log.with(Status::Denoised), [7, 8, 9], "new frames help the last ones");
}

#[test]
fn what_was_made_without_a_frame_that_could_not_be_read_is_made_again() {
    let shot = Shot::new(1..=8, Look::default());
    let aside = shot.dir.path().join("aside.exr");
    // The file is out of reach while frames are decoded, and back with the date that it had.
    let outcome = shot.run_until(&shot.job(), &CancelToken::new(), |event| match event {
        Event::Start { .. } => fs::rename(shot.input(3), &aside).unwrap(),
        Event::Done(_) => fs::rename(&aside, shot.input(3)).unwrap(),
        _ => {}
    });
    assert_eq!((outcome.summary().failed.as_slice(), outcome.summary().degraded.as_slice()), (&[3][..], &[1, 2, 4, 5][..]));
    let checked = SequenceCheck::new().check(&shot.job()).unwrap();
    let stale: Vec<_> = checked.frames.iter().filter_map(|f| Some((f.frame, f.kind?))).collect();
    let beside = |n| (n, StaleKind::Neighbours);
    assert_eq!(stale, [beside(1), beside(2), (3, StaleKind::Failed), beside(4), beside(5)]);
    let again = shot.run(&shot.job());
    assert_eq!(again.log.with(Status::Denoised), [1, 2, 3, 4, 5]);
    assert!(again.summary().is_complete());
    assert_eq!(shot.run(&shot.job()).log.with(Status::Skipped), [1, 2, 3, 4, 5, 6, 7, 8]);
    let undisturbed = Shot::new(1..=8, Look::default());
    undisturbed.run(&undisturbed.job());
    (1..=8).for_each(|n| assert!(fs::read(shot.output(n)).unwrap() == fs::read(undisturbed.output(n)).unwrap(), "frame {n}"));
}

#[test]
fn what_an_earlier_run_wrote_is_no_result_of_one_that_was_stopped_or_failed() {
    let shot = Shot::new(1..=4, Look::default());
    shot.run(&shot.job());
    let job = |lambda: &str| shot.job().with(|s| s.lambda = Some(lambda.parse().unwrap()));
    let stale = |job: &Job| -> Vec<_> {
        let checked = SequenceCheck::new().check(job).unwrap();
        checked.frames.iter().filter_map(|f| Some((f.frame, f.kind?))).collect()
    };
    let cancel = CancelToken::new();
    shot.run_until(&job("4"), &cancel, |event| {
        if matches!(event, Event::Working { frame: 2 }) {
            cancel.cancel();
        }
    });
    assert_eq!(stale(&job("4")), [(3, StaleKind::Unfinished), (4, StaleKind::Unfinished)]);
    assert_eq!(shot.run(&job("4")).log.with(Status::Denoised), [3, 4]);
    let (aside, before) = (shot.dir.path().join("aside.exr"), fs::read(shot.output(4)).unwrap());
    let outcome = shot.run_until(&job("8"), &CancelToken::new(), |event| match event {
        Event::Start { .. } => fs::rename(shot.input(4), &aside).unwrap(),
        Event::Done(_) => fs::rename(&aside, shot.input(4)).unwrap(),
        _ => {}
    });
    assert_eq!((outcome.summary().failed.as_slice(), fs::read(shot.output(4)).unwrap()), (&[4][..], before));
    let beside = |n| (n, StaleKind::Neighbours);
    assert_eq!(stale(&job("8")), [beside(2), beside(3), (4, StaleKind::Failed)]);
    assert_eq!(shot.run(&job("8")).log.with(Status::Denoised), [2, 3, 4]);
    assert_eq!(stale(&job("8")), []);
}

#[test]
fn a_damaged_output_is_made_again() {
    let shot = Shot::new(1..=3, Look::default());
    shot.run(&shot.job());
    let whole = fs::read(shot.output(2)).unwrap();
    fs::write(shot.output(2), &whole[..whole.len() / 2]).unwrap();
    fs::remove_file(shot.output(3)).unwrap();
    let outcome = shot.run(&shot.job());
    assert_eq!(outcome.log.with(Status::Denoised), [2, 3]);
    assert_eq!(fs::read(shot.output(2)).unwrap(), whole);
}

#[test]
fn files_of_others_are_left_alone() {
    let shot = Shot::new(1..=2, Look::default());
    fs::create_dir(shot.out()).unwrap();
    fs::write(shot.output(2), b"precious").unwrap();
    let refused = shot.run(&shot.job());
    assert!(refused.error().contains("f_0002.exr") && refused.error().contains("set overwrite to true"), "{}", refused.error());
    assert_eq!(fs::read(shot.output(2)).unwrap(), b"precious");
    assert_eq!(shot.written(), [name(2)]);
    assert!(shot.run(&Job { overwrite: true, ..shot.job() }).summary().is_complete());
}

#[test]
fn frames_of_another_shot_are_left_alone() {
    let (shot, other) = (Shot::new(1..=2, Look::default()), Shot::new([], Look::default()));
    for n in 1..=2 {
        write_frame(&other.input(n), n, Look { seed: Some(n as u32 + 500), ..Look::default() });
    }
    shot.run(&shot.job());
    let before = fs::read(shot.output(2)).unwrap();
    let into = Job { output: shot.out(), ..other.job() };
    let refused = shot.run(&into).error();
    assert!(refused.contains("(2 such files)") && refused.contains("set overwrite to true"), "{refused}");
    assert!(refused.contains(&shot.input(1).display().to_string()), "{refused}");
    assert_eq!(fs::read(shot.output(2)).unwrap(), before);
    assert_eq!(shot.run(&shot.job()).log.with(Status::Skipped), [1, 2]);
    // A shot that was moved, and then rendered again.
    let moved = shot.dir.path().join("moved");
    fs::rename(shot.folder(), &moved).unwrap();
    let job = Job::new(hush::io::sequence::Sequence::find(&[&moved]).unwrap(), shot.out());
    assert_eq!(shot.run(&job).log.with(Status::Skipped), [1, 2]);
    write_frame(&moved.join(name(2)), 2, Look { seed: Some(77), ..Look::default() });
    assert_eq!(shot.run(&job).log.with(Status::Denoised), [1, 2]);
    assert!(shot.run(&Job { overwrite: true, ..into }).summary().is_complete());
}

#[test]
fn a_folder_that_was_copied_with_its_denoised_frames_goes_on() {
    let (shot, copy) = (Shot::new(1..=3, Look::default()), tempfile::tempdir().unwrap());
    shot.run(&shot.job());
    for folder in ["shot", "out"] {
        fs::create_dir(copy.path().join(folder)).unwrap();
        for file in fs::read_dir(shot.dir.path().join(folder)).unwrap().map(|file| file.unwrap()) {
            fs::copy(file.path(), copy.path().join(folder).join(file.file_name())).unwrap();
        }
    }
    let frames = copy.path().join("shot");
    write_frame(&frames.join(name(2)), 2, Look { seed: Some(77), ..Look::default() });
    let job = |output| Job::new(hush::io::sequence::Sequence::find(&[&frames]).unwrap(), output);
    let refused = shot.run(&job(shot.out())).error();
    assert!(refused.contains("(1 such file)"), "into the denoised frames of the one that was copied: {refused}");
    // As `output = "../out"` in hush.toml says it.
    assert_eq!(shot.run(&job(frames.join("../out"))).log.with(Status::Denoised), [1, 2, 3]);
    assert_eq!(shot.run(&shot.job()).log.with(Status::Skipped), [1, 2, 3]);
}

#[test]
fn a_damaged_manifest_is_told() {
    let shot = Shot::new(1..=2, Look::default());
    shot.run(&shot.job());
    fs::write(shot.out().join(MANIFEST), b"{ half").unwrap();
    let refused = shot.run(&shot.job()).error();
    assert!(refused.contains("f_0001.exr") && refused.contains("damaged manifest"), "of unknown origin now: {refused}");
    let unknown = hush::shot::SequenceCheck::new().check(&shot.job()).unwrap_err().to_string();
    assert!(unknown.contains(MANIFEST) && unknown.contains("set overwrite to true"), "{unknown}");
    let aside = shot.out().join("hush-manifest.json.damaged");
    assert!(!aside.exists(), "a run that is refused changes nothing");
    let outcome = shot.run(&Job { overwrite: true, ..shot.job() });
    assert!(outcome.log.kinds().contains(&"manifest"));
    assert_eq!(fs::read(aside).unwrap(), b"{ half");
    assert_eq!(shot.run(&shot.job()).log.with(Status::Skipped), [1, 2]);
}

#[test]
fn a_manifest_that_is_not_understood_is_never_replaced() {
    let shot = Shot::new(1..=2, Look::default());
    fs::create_dir(shot.out()).unwrap();
    let path = shot.out().join(MANIFEST);
    let later = br#"{"version": 2, "shots": {}}"#;
    fs::write(&path, later).unwrap();
    for job in [shot.job(), Job { overwrite: true, ..shot.job() }] {
        let refused = shot.run(&job).error();
        assert!(refused.contains(MANIFEST) && refused.contains("later version"), "{refused}");
    }
    assert_eq!((fs::read(&path).unwrap().as_slice(), shot.written()), (later.as_slice(), vec![]));
    fs::remove_file(&path).unwrap();
    fs::create_dir(&path).unwrap();
    assert!(shot.run(&Job { overwrite: true, ..shot.job() }).error().contains(MANIFEST), "it cannot be read");
    assert_eq!(shot.written(), Vec::<String>::new());
}

#[test]
fn a_run_that_cannot_read_the_manifest_any_more_leaves_it() {
    let shot = Shot::new(1..=2, Look::default());
    let path = shot.out().join(MANIFEST);
    let later = br#"{"version": 2, "shots": {}}"#;
    let outcome = shot.run_until(&shot.job(), &CancelToken::new(), |event| {
        if matches!(event, Event::Working { frame: 2 }) {
            fs::write(&path, later).unwrap();
        }
    });
    assert!(outcome.summary().stopped.is_some());
    assert_eq!(fs::read(&path).unwrap(), later);
}

#[test]
fn two_ranges_share_a_folder_and_its_manifest() {
    let shot = Shot::new(1..=6, Look::default());
    let part = |frames: &str| shot.job().with(|s| s.frames = Some(frames.parse().unwrap()));
    std::thread::scope(|scope| {
        for frames in ["1-3", "4-6"] {
            let job = part(frames);
            scope.spawn(|| {
                let job = job;
                hush::shot::run(&job, &shot.engine, &|_| {}, &CancelToken::new()).unwrap()
            });
        }
    });
    assert_eq!(shot.manifest().frames.len(), 6);
    assert_eq!(shot.run(&shot.job()).log.with(Status::Skipped), [1, 2, 3, 4, 5, 6]);
}

#[test]
fn an_interrupted_run_leaves_whole_files_and_goes_on() {
    for stop_at in 1..=5 {
        let shot = Shot::new(1..=5, Look::default());
        let cancel = CancelToken::new();
        let outcome = shot.run_until(&shot.job(), &cancel, |event| {
            if matches!(event, Event::Working { frame } if *frame == stop_at) {
                cancel.cancel();
            }
        });
        let summary = outcome.summary();
        // The frame in hand is finished; in the last one nothing is left to interrupt.
        assert_eq!((summary.written as i64, summary.interrupted), (stop_at, stop_at < 5), "{:?}", outcome.log);
        assert_eq!(shot.written(), (1..=stop_at).map(name).collect::<Vec<_>>());
        for number in 1..=stop_at {
            hush::io::is_complete(&shot.output(number)).unwrap();
        }
        assert_eq!(outcome.log.done, 1);
        let rest = shot.run(&shot.job());
        assert!(rest.summary().is_complete());
        assert_eq!(rest.log.with(Status::Skipped), (1..=stop_at).collect::<Vec<_>>());
        assert_eq!(rest.log.with(Status::Denoised), (stop_at + 1..=5).collect::<Vec<_>>());
    }
}

#[test]
fn cancelled_before_the_start_writes_nothing() {
    let shot = Shot::new(1..=3, Look::default());
    let cancel = CancelToken::new();
    cancel.cancel();
    let outcome = shot.run_until(&shot.job(), &cancel, |_| {});
    assert!(outcome.summary().interrupted);
    assert_eq!(shot.written(), Vec::<String>::new());
    assert!(shot.manifest().frames.values().all(|e| e.status == Status::Planned));
}
