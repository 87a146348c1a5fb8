//! Which denoised frames are current: one answer for all, and every way in which a frame goes out of date.

mod common;

use std::fs;
use std::path::Path;
use std::time::{Duration, SystemTime};

use common::{Look, Shot, name, write_frame};
use hush::io::sequence::Sequence;
use hush::settings::Lambda;
use hush::settings::{Guide, ShotSettings};
use hush::shot::{Checked, FrameState, Job, SequenceCheck, StaleKind, Status};

fn check(job: &Job) -> Checked {
    SequenceCheck::new().check(job).unwrap()
}

/// The frames of a state.
fn with(checked: &Checked, state: FrameState) -> Vec<i64> {
    checked.frames.iter().filter(|f| f.state == state).map(|f| f.frame).collect()
}

/// The kinds of the stale frames, by frame.
fn stale(checked: &Checked) -> Vec<(i64, StaleKind)> {
    let stale = checked.frames.iter().filter(|f| f.state == FrameState::Stale);
    stale.map(|f| (f.frame, f.kind.expect("a stale frame has a reason"))).collect()
}

fn touch(path: &Path) {
    let file = fs::File::options().write(true).open(path).unwrap();
    file.set_modified(SystemTime::now() - Duration::from_secs(500)).unwrap();
}

#[test]
fn a_denoised_shot_is_current() {
    let shot = Shot::new(1..=4, Look::default());
    let before = check(&shot.job());
    assert_eq!(with(&before, FrameState::Missing), [1, 2, 3, 4]);
    assert_eq!((before.counts.missing, before.frames[0].kind), (4, None));
    shot.run(&shot.job());
    let after = check(&shot.job());
    assert_eq!(with(&after, FrameState::Current), [1, 2, 3, 4]);
    let frame = &after.frames[2];
    assert_eq!((frame.columns, frame.rows), (Some(24), Some(16)));
    assert_eq!((frame.source.as_deref(), frame.output.as_deref()), (Some(&*shot.input(3)), Some(&*shot.output(3))));
    let asked = check(&shot.job().with(|s| s.frames = Some("3-6".parse().unwrap())));
    assert_eq!(with(&asked, FrameState::Current), [3, 4]);
    assert_eq!(with(&asked, FrameState::Unrendered), [5, 6]);
}

#[test]
fn every_setting_that_changes_pixels_makes_frames_stale() {
    let shot = Shot::new(1..=3, Look::default());
    shot.run(&shot.job());
    let model = shot.other_weights();
    type Change<'a> = &'a dyn Fn(&mut ShotSettings);
    let changes: [(&str, Change<'_>); 10] = [
        ("lambda", &|s| s.lambda = Some(Lambda::constant(2.0).unwrap())),
        ("window", &|s| s.window = Some(1)),
        ("layers", &|s| s.layers = Some(vec!["ViewLayer".into()])),
        ("keep_noisy", &|s| s.keep_noisy = Some(true)),
        ("guides", &|s| s.guides = Some(vec![Guide::Albedo, Guide::Depth, Guide::Vector])),
        ("aovs", &|s| s.aovs = Some(vec!["all".into()])),
        ("passes", &|s| s.passes_beauty = Some("ViewLayer.Combined".into())),
        ("skip", &|s| s.skip = Some(Vec::new())),
        ("model", &|s| s.model = Some(model.clone())),
        ("renderer", &|s| s.renderer = Some("mitsuba".into())),
    ];
    for (name, change) in changes {
        let kind = StaleKind::Setting(name);
        assert_eq!(stale(&check(&shot.job().with(change))), [(1, kind), (2, kind), (3, kind)]);
    }
    let several = shot.job().with(|s| {
        s.keep_noisy = Some(true);
        s.window = Some(0)
    });
    let frames = check(&several).frames;
    assert_eq!(frames[0].kind, Some(StaleKind::Several));
    assert_eq!(frames[0].reason.as_deref(), Some("window 2 → 0, keep noisy false → true"));
    let keyed = check(&shot.job().with(|s| s.lambda = Some("1:1,3:9".parse().unwrap())));
    assert_eq!(stale(&keyed), [(2, StaleKind::Setting("lambda")), (3, StaleKind::Setting("lambda"))]);
}

#[test]
fn a_render_that_changed_went_or_was_cut_is_seen() {
    let shot = Shot::new(1..=8, Look::default());
    shot.run(&shot.job());
    let mut memory = SequenceCheck::new();
    assert_eq!(memory.check(&shot.job()).unwrap().counts.current, 8);
    shot.render_again(4);
    let changed = memory.check(&shot.job()).unwrap();
    assert_eq!(changed, check(&shot.job()), "what is remembered does not hide a change");
    let beside = |n| (n, StaleKind::Neighbours);
    assert_eq!(stale(&changed), [beside(2), beside(3), (4, StaleKind::InputChanged), beside(5), beside(6)]);
    shot.run(&shot.job());
    shot.truncate(1);
    assert_eq!(stale(&memory.check(&shot.job()).unwrap()), [(1, StaleKind::InputDamaged), beside(2), beside(3)]);
    write_frame(&shot.input(1), 1, Look::default());
    shot.run(&shot.job());
    fs::remove_file(shot.input(8)).unwrap();
    let gone = memory.check(&shot.job().with(|s| s.frames = Some("5-8".parse().unwrap()))).unwrap();
    assert_eq!(stale(&gone), [beside(6), beside(7), (8, StaleKind::InputMissing)]);
    assert!(gone.frames[3].reason.as_ref().is_some_and(|reason| reason.contains("delete the denoised frame")));
    assert_eq!((gone.frames[3].source.as_ref(), gone.frames[3].output.as_deref()), (None, Some(&*shot.output(8))));
}

#[cfg(unix)]
#[test]
fn a_render_of_the_same_size_and_date_is_seen() {
    const RAW: Look = Look { compression: exr::prelude::Compression::Uncompressed, ..Look::PLAIN };
    let shot = Shot::new(1..=5, RAW);
    let date = SystemTime::now() - Duration::from_secs(5000);
    let dated = |number: i64, look: Look| {
        write_frame(&shot.input(number), number, look);
        fs::File::options().write(true).open(shot.input(number)).unwrap().set_modified(date).unwrap();
    };
    (1..=5).for_each(|number| dated(number, RAW));
    shot.run(&shot.job());
    let stamp = hush::shot::Stamp::of(&shot.input(5));
    std::thread::sleep(Duration::from_millis(30));
    dated(5, Look { seed: Some(99), ..RAW });
    assert_eq!(hush::shot::Stamp::of(&shot.input(5)), stamp);
    let beside = |n| (n, StaleKind::Neighbours);
    assert_eq!(stale(&check(&shot.job())), [beside(3), beside(4), (5, StaleKind::InputChanged)]);
    assert_eq!(shot.run(&shot.job()).log.with(Status::Denoised), [3, 4, 5]);
    assert_eq!(check(&shot.job()).counts.current, 5);
}

#[test]
fn without_any_render_the_denoised_frames_are_listed() {
    let shot = Shot::new(1..=2, Look::default());
    shot.run(&shot.job());
    let output = shot.out();
    (1..=2).for_each(|n| fs::remove_file(shot.input(n)).unwrap());
    for input in [shot.folder(), shot.folder().join("f_####.exr")] {
        assert!(Sequence::find(&[&input]).is_err());
        let job = Job::new(Sequence::unrendered(&[&input]), &output);
        assert_eq!(stale(&check(&job)), [(1, StaleKind::InputMissing), (2, StaleKind::InputMissing)], "{}", input.display());
    }
    let other = Job::new(Sequence::unrendered(&[shot.folder().join("g_####.exr")]), &output);
    assert_eq!(check(&other), Checked::default(), "frames of another name are another sequence's");
}

#[test]
fn copies_and_touched_files_stay_current() {
    let shot = Shot::new(1..=3, Look::default());
    shot.run(&shot.job());
    for number in 1..=3 {
        touch(&shot.input(number));
        touch(&shot.output(number));
    }
    assert_eq!(check(&shot.job()).counts.current, 3);
    let again = shot.run(&shot.job());
    assert_eq!(again.log.with(Status::Skipped), [1, 2, 3]);
    let entry = &shot.manifest().frames[&name(2)];
    let stamp = |path: &Path| hush::shot::Stamp::of(path);
    assert_eq!(entry.stamp.map(|s| s.stamp), stamp(&shot.input(2)), "the new date is known from then on");
    let beside = entry.neighbours.iter().find(|n| n.frame == 3).unwrap();
    assert_eq!(beside.stamp.map(|s| s.stamp), stamp(&shot.input(3)));
    assert_eq!(entry.output.map(|s| s.stamp), stamp(&shot.output(2)));
}

#[test]
fn an_output_that_is_not_ours_any_more_is_seen() {
    let shot = Shot::new(1..=4, Look::default());
    shot.run(&shot.job());
    let whole = fs::read(shot.output(1)).unwrap();
    fs::write(shot.output(1), &whole[..whole.len() - 9]).unwrap();
    write_frame(&shot.output(2), 7, Look::default());
    fs::remove_file(shot.output(3)).unwrap();
    write_frame(&shot.output(5), 5, Look::default());
    write_frame(&shot.input(5), 5, Look::default());
    let checked = check(&shot.job().with(|s| {
        s.window = Some(2);
        s.frames = Some("1-3,5".parse().unwrap())
    }));
    let kinds: Vec<_> = stale(&checked);
    assert_eq!(kinds[0], (1, StaleKind::OutputDamaged));
    assert_eq!(kinds[1], (2, StaleKind::OutputChanged));
    assert_eq!(kinds[2], (5, StaleKind::Foreign));
    assert_eq!(with(&checked, FrameState::Missing), [3]);
}

#[test]
fn the_check_and_the_run_agree() {
    let shot = Shot::new(1..=6, Look::default());
    shot.run(&shot.job());
    shot.render_again(6);
    fs::remove_file(shot.output(2)).unwrap();
    let job = shot.job().with(|s| s.lambda = Some("1:8,2:1".parse().unwrap()));
    let current = with(&check(&job), FrameState::Current);
    assert_eq!(shot.run(&job).log.with(Status::Skipped), current);
    assert_eq!(current, [3]);
    assert_eq!(check(&job).counts.current, 6);
}

#[test]
fn one_frame_is_asked_about_as_the_whole_shot_is() {
    let shot = Shot::new(1..=4, Look::default());
    write_frame(&shot.input(4), 4, Look { vector: None, ..Look::default() });
    shot.run(&shot.job());
    assert_eq!(check(&shot.job()).counts.current, 4);
    for number in 1..=4 {
        let alone = check(&shot.job().with(|s| s.frames = Some(number.to_string().parse().unwrap())));
        assert_eq!(alone.counts.current, 1, "frame {number}: {:?}", alone.frames);
    }
}

#[test]
fn better_frames_are_not_replaced_by_worse_ones() {
    const TWO: Look = Look { layers: &["ViewLayer", "Sharp"], ..Look::PLAIN };
    let shot = Shot::new(1..=3, TWO);
    let mut with_vectors = shot.job();
    with_vectors.settings.layers = Some(vec!["ViewLayer".into()]);
    with_vectors.settings.vector_layer = Some("Sharp".into());
    assert!(shot.run(&with_vectors).summary().is_complete());
    let before = fs::read(shot.output(2)).unwrap();
    let mut without = with_vectors.clone();
    without.settings.vector_layer = None;
    let refused = shot.run(&without).error();
    assert!(refused.contains("1-3") && refused.contains("Sharp"), "{refused}");
    let mut blind = with_vectors.clone();
    blind.settings.guides = Some(vec![Guide::Albedo, Guide::Normal, Guide::Depth]);
    assert_eq!(fs::read(shot.output(2)).unwrap(), before);
    assert_eq!(stale(&check(&without))[0], (1, StaleKind::Setting("vector_layer")));
    for asked in [Job { overwrite: true, ..without.clone() }, with_vectors.clone().with(|s| s.window = Some(0)), blind] {
        assert!(shot.run(&asked).summary().is_complete(), "what is asked for is done");
        shot.run(&Job { overwrite: true, ..with_vectors.clone() });
    }
    let render_again = |n: i64| write_frame(&shot.input(n), n, Look { seed: Some(n as u32 + 99), ..TWO });
    render_again(2);
    assert!(shot.run(&without).summary.is_err(), "frames 1 and 3 still have the same input");
    render_again(1);
    render_again(3);
    assert!(shot.run(&without).summary().is_complete(), "a new render is another matter");
}
