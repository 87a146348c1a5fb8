//! `hush watch` beside writers of all kinds: no frame missed, none half there, and the result of a plain run.
#![cfg(unix)]

mod common;
mod watch_support;

use std::cell::RefCell;
use std::fs;
use std::process::Command;
use std::time::{Duration, Instant};

use common::{Look, name, write_frame};
use hush::shot::{CancelToken, Event, Job, Status};
use hush::watch::{WatchEvent, WatchOptions};
use hush::{Engine, Settings};
use watch_support::{Scene, Watch, write_slowly};

const PAUSE: Duration = Duration::from_millis(150);

#[test]
fn frames_are_denoised_while_they_land_each_once() {
    let scene = Scene::new();
    let mut watch = scene.watch(&["--frames", "1-6"]);
    for n in 1..=4 {
        scene.land(n);
    }
    watch.until("frame 2", |w| w.denoised().contains(&2));
    assert!(!watch.denoised().contains(&3), "its window is not there yet");
    write_slowly(&scene.input(5), &scene.bytes(5), 5, PAUSE);
    let aside = scene.path("in/.f_0006.exr.tmp");
    fs::write(&aside, scene.bytes(6)).unwrap();
    fs::rename(aside, scene.input(6)).unwrap();
    let last = watch.finish(6);
    let mut denoised = watch.denoised();
    denoised.sort_unstable();
    assert_eq!(denoised, [1, 2, 3, 4, 5, 6], "each once");
    assert_eq!((watch.named("start").len(), watch.named("landed").len()), (1, 6));
    assert_eq!(last["written"], 6);
    scene.assert_like_a_plain_run("in", "out");
}

#[test]
fn events_are_quicker_than_scans() {
    let scene = Scene::new();
    let mut watch = scene.watch(&["--window", "0"]);
    watch.until("the first scan", |w| !w.named("waiting").is_empty());
    fs::create_dir_all(scene.path("in/new/deep")).unwrap();
    for path in [scene.input(1), scene.path("in/new/deep/s_1.exr")] {
        let began = Instant::now();
        let before = watch.denoised().len();
        write_frame(&path, 1, Look::default());
        watch.until("the frame", |w| w.denoised().len() > before);
        assert!(began.elapsed() < Duration::from_secs(4), "{:?}", began.elapsed());
    }
    watch.stop();
}

#[test]
fn a_stub_is_given_up_after_a_while_and_redone_when_it_is_whole() {
    let scene = Scene::new();
    let bytes = scene.bytes(3);
    for n in [1, 2, 4, 5] {
        scene.land(n);
    }
    fs::write(scene.input(3), &bytes[..bytes.len() * 2 / 3]).unwrap();
    let mut watch = scene.watch(&["--frames", "1-5", "--settle", "1"]);
    watch.until("the others", |w| w.denoised().len() == 4);
    assert!(!scene.path("out").join(name(3)).exists());
    watch.until("a word about the stub", |w| !w.named("incomplete").is_empty());
    fs::write(scene.input(3), &bytes).unwrap();
    watch.finish(5);
    assert_eq!(watch.denoised()[4..], [1, 2, 3, 4, 5]);
    scene.assert_like_a_plain_run("in", "out");
}

#[test]
fn a_denoised_frame_that_was_deleted_is_made_again_before_the_end() {
    let scene = Scene::new();
    (1..=4).for_each(|n| scene.land(n));
    let mut watch = scene.watch(&["--frames", "1-6"]);
    watch.until("two frames", |w| w.denoised() == [1, 2]);
    fs::remove_file(scene.path("out").join(name(1))).unwrap();
    (5..=6).for_each(|n| scene.land(n));
    watch.finish(6);
    assert_eq!(watch.denoised(), [1, 2, 3, 4, 5, 6, 1]);
    scene.assert_like_a_plain_run("in", "out");
}

#[test]
fn without_redo_what_is_done_stays() {
    let scene = Scene::new();
    for n in [1, 2, 4] {
        scene.land(n);
    }
    let mut watch = scene.watch(&["--frames", "1-4", "--settle", "0.5", "--no-redo"]);
    watch.until_done(3);
    scene.land(3);
    watch.finish(4);
    assert_eq!(watch.denoised(), [1, 2, 4, 3]);
}

#[test]
fn a_frame_rendered_again_takes_its_window_along() {
    let scene = Scene::new();
    (1..=7).for_each(|n| scene.land(n));
    // A frame that never comes keeps it watching.
    let mut watch = scene.watch(&["--frames", "1-7,99"]);
    watch.until_done(7);
    write_slowly(&scene.input(4), &scene.bytes(99), 3, PAUSE);
    watch.until("the window", |w| w.denoised().len() == 12);
    watch.until_done(7);
    assert_eq!(watch.denoised()[7..], [2, 3, 4, 5, 6]);
    let landed = watch.named("landed");
    assert_eq!((landed.len(), &landed[7]["frame"], &landed[7]["again"]), (8, &4.into(), &true.into()));
    watch.stop();
    scene.assert_like_a_plain_run("in", "out");
}

#[test]
fn shots_in_subfolders_are_mirrored_and_folders_may_go_and_come() {
    let scene = Scene::new();
    let shot = |folder: &str, file: &str, numbers: std::ops::RangeInclusive<i64>| {
        fs::create_dir_all(scene.path(folder)).unwrap();
        for n in numbers {
            write_frame(&scene.path(folder).join(format!("{file}{n:03}.exr")), n, Look::default());
        }
    };
    let mut watch = scene.watch(&["--settle", "1"]);
    shot("in/a/beauty", "b_", 1..=3);
    shot("in/a", "f.", 7..=8);
    watch.until_done(5);
    fs::remove_dir_all(scene.path("in")).unwrap();
    watch.until("the folder's end", |w| w.named("waiting").last().is_some_and(|e| e["input"] == false));
    shot("in/a/beauty", "b_", 1..=4);
    // Frame 1 and all that helped it have the same bytes as before.
    watch.until("the new frame", |w| w.denoised().len() == 5 + 3);
    watch.stop();
    scene.assert_like_a_plain_run("in/a/beauty", "out/a/beauty");
    assert_eq!(scene.names("out/a"), ["beauty", "f.007.exr", "f.008.exr"], "what was made of files that are gone stays");
}

#[test]
fn the_folder_may_come_later_and_hold_the_outputs() {
    let scene = Scene::new();
    fs::remove_dir(scene.path("in")).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_hush"));
    command.current_dir(scene.dir.path()).args(["watch", "in/f_####.exr", "-o", "in/clean", "--json", "--frames", "1-3,99"]);
    let mut watch = Watch::start(command);
    watch.until("a word about the folder", |w| w.named("waiting").iter().any(|e| e["input"] == false));
    fs::create_dir(scene.path("in")).unwrap();
    fs::write(scene.path("in/g_0001.exr"), scene.bytes(1)).unwrap();
    (1..=3).for_each(|n| scene.land(n));
    watch.until_done(3);
    std::thread::sleep(Duration::from_secs(1));
    assert_eq!((watch.denoised().len(), watch.named("landed").len()), (3, 3), "outputs are no inputs");
    watch.stop();
}

#[test]
fn scanning_does_as_well_as_events() {
    let scene = Scene::new();
    let mut watch = scene.watch(&["--frames", "1-4", "--poll=0.3"]);
    assert!(watch.denoised().is_empty());
    scene.land(1);
    scene.land(2);
    write_slowly(&scene.input(3), &scene.bytes(3), 4, PAUSE);
    scene.land(4);
    watch.finish(4);
    assert_eq!(watch.named("watching")[0]["polling"], true);
    assert_eq!(watch.denoised().len(), 4);
    scene.assert_like_a_plain_run("in", "out");
}

#[test]
fn killed_watches_lose_nothing_and_do_little_twice() {
    let scene = Scene::new();
    let look = Look { columns: 96, rows: 54, ..Look::default() };
    (1..=40).for_each(|n| write_frame(&scene.input(n), n, look));
    let mut total = 0;
    for kill_after in [1, 4, 9, 17] {
        let mut watch = scene.watch(&["--frames", "1-40"]);
        watch.until("some frames", |w| w.denoised().len() >= kill_after);
        watch.signal("-KILL");
        watch.end();
        total += watch.denoised().len();
        for file in scene.names("out").iter().filter(|n| n.ends_with(".exr")) {
            hush::io::is_complete(&scene.path("out").join(file)).unwrap();
        }
    }
    let mut watch = scene.watch(&["--frames", "1-40"]);
    let last = watch.finish(40);
    total += watch.denoised().len();
    // What was done in the last second before a kill may be done again.
    assert!(total < 40 + 4 * 16, "{total} frames denoised for 40");
    let skipped = last["skipped"].as_u64().unwrap();
    assert!(skipped > 0, "what was done before is not done again");
    scene.assert_like_a_plain_run("in", "out");
}

#[test]
fn two_watchers_share_the_work() {
    let scene = Scene::new();
    let look = Look { columns: 96, rows: 54, ..Look::default() };
    let mut watches = [scene.watch(&["--frames", "1-60"]), scene.watch(&["--frames", "1-60", "--poll=0.2"])];
    for n in (1..=60).rev() {
        write_frame(&scene.input(n), n, look);
        std::thread::sleep(Duration::from_millis(20));
    }
    watches.iter_mut().for_each(|w| _ = w.finish(60));
    let each: Vec<usize> = watches.iter().map(|w| w.denoised().len()).collect();
    let mut all: Vec<i64> = watches.iter().flat_map(Watch::denoised).collect();
    all.sort_unstable();
    assert_eq!(all, (1..=60).collect::<Vec<_>>(), "none twice, none missed: {each:?}");
    assert!(each.iter().all(|n| *n > 0), "both work: {each:?}");
    assert!(scene.names("out").iter().all(|n| n.ends_with(".exr") || n == ".hush-claims"));
    scene.assert_like_a_plain_run("in", "out");
}

#[test]
fn once_does_what_is_there_and_stops() {
    let scene = Scene::new();
    (1..=4).for_each(|n| scene.land(n));
    let bytes = scene.bytes(5);
    fs::write(scene.input(5), &bytes[..bytes.len() / 2]).unwrap();
    let mut watch = scene.watch(&["--once"]);
    let (code, last) = watch.end();
    assert_eq!((code, &last["written"], &last["failed"]), (Some(2), &4.into(), &serde_json::json!([5])));
    fs::write(scene.input(5), &bytes).unwrap();
    let mut watch = scene.watch(&["--once"]);
    let (code, last) = watch.end();
    assert_eq!((code, &last["skipped"]), (Some(0), &2.into()), "{last}");
    assert_eq!(watch.denoised(), [3, 4, 5]);
    let (code, last) = scene.watch(&["--once"]).end();
    assert_eq!((code, &last["written"], &last["skipped"]), (Some(0), &0.into(), &5.into()));
    let (code, last) = scene.watch(&["--once", "--frames", "1-7"]).end();
    assert_eq!((code, &last["missing"]), (Some(2), &"6-7".into()));
    scene.assert_like_a_plain_run("in", "out");
}

#[test]
fn with_several_shots_it_ends_when_each_has_its_frames() {
    let scene = Scene::new();
    let land = |shot: &str, n: i64| write_frame(&scene.path("in").join(format!("{shot}_{n:04}.exr")), n, Look::default());
    let mut watch = scene.watch(&["--frames", "1-4", "--settle", "0.5"]);
    watch.until("a word about the empty folder", |w| !w.named("waiting").is_empty());
    land("logo", 100);
    (1..=3).for_each(|n| land("a", n));
    [2, 4].into_iter().for_each(|n| land("b", n));
    watch.until("what is there", |w| w.denoised().len() == 5);
    let missing = Watch::stop(watch)["missing"].clone();
    assert_eq!(missing, "a_####.exr 4; b_####.exr 1,3");
    let mut watch = scene.watch(&["--frames", "1-4", "--settle", "0.5"]);
    land("a", 4);
    watch.until("a's last frame", |w| w.denoised().contains(&4));
    [1, 3].into_iter().for_each(|n| land("b", n));
    let last = watch.finish(8);
    assert_eq!(last["failed"], serde_json::json!([]));
    assert_eq!(scene.names("out").iter().filter(|n| n.ends_with(".exr")).count(), 8);
    // All is there already, and that is the end too.
    assert_eq!(scene.watch(&["--frames", "1-4"]).finish(8)["skipped"], 8);
}

#[test]
fn one_bad_frame_does_not_stop_the_others() {
    let scene = Scene::new();
    (1..=3).for_each(|n| scene.land(n));
    write_frame(&scene.input(2), 2, Look { vector: None, ..Look::default() });
    fs::create_dir(scene.path("out")).unwrap();
    fs::write(scene.path("out").join(name(3)), b"precious").unwrap();
    let mut watch = scene.watch(&["--frames", "1-3", "--window", "1"]);
    watch.until("both errors", |w| w.named("error").len() == 2 && w.denoised() == [1]);
    let text = format!("{:?}", watch.named("error"));
    assert!(text.contains("Vector") && text.contains("move it away"), "{text}");
    assert_eq!(fs::read(scene.path("out").join(name(3))).unwrap(), b"precious");
    scene.land(2);
    watch.until("the frame and its neighbour", |w| w.denoised() == [1, 1, 2] || w.denoised() == [1, 2, 1]);
    watch.stop();
}

#[test]
fn a_frame_damaged_for_good_does_not_keep_it_watching() {
    let scene = Scene::new();
    (1..=4).for_each(|n| scene.land(n));
    let mut bytes = fs::read(scene.input(3)).unwrap();
    // All is there, but the pixels are no ZIP data.
    let middle = bytes.len() * 3 / 4;
    bytes[middle..middle + 64].fill(0xff);
    fs::write(scene.input(3), bytes).unwrap();
    let (code, last) = scene.watch(&["--frames", "1-4", "--settle", "2"]).end_by_itself();
    assert_eq!((code, &last["failed"], &last["written"]), (Some(2), &serde_json::json!([3]), &3.into()), "{last}");
    assert_eq!(last["degraded"], serde_json::json!([1, 2, 4]));
    // The next one finds nothing to do but the one that failed.
    let (code, last) = scene.watch(&["--frames", "1-4", "--settle", "2"]).end_by_itself();
    assert_eq!((code, &last["failed"], &last["written"]), (Some(2), &serde_json::json!([3]), &0.into()), "{last}");
}

#[test]
fn a_frame_that_could_not_be_read_is_tried_again_with_those_around_it() {
    let scene = Scene::new();
    (1..=5).for_each(|n| scene.land(n));
    let engine = Engine::new(Settings::default()).unwrap();
    let options =
        WatchOptions { input: scene.path("in"), output: scene.path("out"), settle: None, redo: true, poll: None, once: false };
    let job = |sequence| Ok(Job::new(sequence, "out").with(|s| s.frames = Some("1-5".parse().unwrap())));
    let aside = scene.path("aside.exr");
    let (cancel, written) = (CancelToken::new(), RefCell::new(Vec::new()));
    let began = Instant::now();
    let report = |event: WatchEvent<'_>| {
        if began.elapsed() > Duration::from_secs(60) {
            cancel.cancel();
        }
        match event {
            // Out of reach while the first frames are decoded, and back as it was.
            WatchEvent::Shot { event: Event::Start { .. }, .. } => fs::rename(scene.input(3), &aside).unwrap(),
            WatchEvent::Shot { event: Event::Error { frame: Some(3), .. }, .. } => fs::rename(&aside, scene.input(3)).unwrap(),
            WatchEvent::Shot { event: Event::Frame { frame, status: Status::Denoised, .. }, .. } => {
                written.borrow_mut().push(frame);
            }
            _ => {}
        }
    };
    let summary = hush::watch::watch(&options, &job, &engine, &report, &cancel).unwrap();
    assert!(summary.is_complete(), "{summary:?}");
    let times = |n: i64| written.borrow().iter().filter(|w| **w == n).count();
    assert_eq!((times(1), times(3)), (2, 1), "{written:?}");
    scene.assert_like_a_plain_run("in", "out");
}

#[test]
fn a_version_behind_the_frame_number_is_told() {
    let scene = Scene::new();
    (1..=3).for_each(|n| write_frame(&scene.path("in").join(format!("f_{n:04}_v02.exr")), n, Look::default()));
    let mut watch = scene.watch(&["--once"]);
    watch.end();
    let told = format!("{:?}", watch.named("warning"));
    assert!(told.contains("f_####_v02.exr' instead"), "{told}");
}

#[test]
fn settings_that_cannot_be_read_hold_up_their_own_shot_alone() {
    let scene = Scene::new();
    fs::create_dir(scene.path("in/bad")).unwrap();
    fs::write(scene.path("in/bad/hush.toml"), "lambda = 0.5\n").unwrap();
    write_frame(&scene.path("in/bad/s_1.exr"), 1, Look::default());
    scene.land(1);
    let mut watch = scene.watch(&["--settle", "0.5"]);
    watch.until("the other shot and a warning", |w| w.denoised().len() == 1 && !w.named("warning").is_empty());
    let warning = format!("{:?}", watch.named("warning"));
    assert!(warning.contains("bad/s_#.exr") && warning.contains("hush.toml"), "{warning}");
    fs::write(scene.path("in/bad/hush.toml"), "lambda = 4.0\n").unwrap();
    watch.until("the mended shot", |w| w.named("frame").last().is_some_and(|f| f["shot"] == "bad/s_#.exr" && f["lambda"] == 4.0));
    watch.stop();
}

#[test]
fn settings_that_change_are_told_and_taken_by_the_next_watch() {
    let scene = Scene::new();
    scene.land(1);
    let settings = scene.path("in/hush.toml");
    let told = |w: &Watch| format!("{:?}", w.named("warning")).matches("has changed: start the watch again").count();
    let mut watch = scene.watch(&["--settle", "0.2", "--poll=0.1"]);
    watch.until_done(1);
    // A file that appears, one that says the same in other words, and another value.
    for (text, count) in [("lambda = 4.0\n", 1), ("# twice\nlambda = 4.0\n", 2), ("# nothing\n", 2), ("lambda = 8.0\n", 3)] {
        fs::write(&settings, text).unwrap();
        let frame = scene.path("out").read_dir().unwrap().count();
        watch.until("a warning of changed settings", |w| told(w) == count);
        std::thread::sleep(PAUSE * 3);
        assert_eq!((told(&watch), scene.path("out").read_dir().unwrap().count()), (count, frame), "{text}");
    }
    watch.stop();
    let mut watch = scene.watch(&["--settle", "0.2", "--poll=0.1"]);
    watch.until("the frame with the new settings", |w| w.named("frame").last().is_some_and(|f| f["lambda"] == 8.0));
    assert_eq!(told(&watch), 0);
    watch.stop();
}

#[test]
fn settings_for_another_engine_hold_up_their_own_shot_alone() {
    for (line, name) in
        [("renderer = \"mitsuba\"", "renderer"), ("skip = \"none\"", "skip"), ("second_pass = true", "second_pass")]
    {
        let scene = Scene::new();
        fs::create_dir(scene.path("in/other")).unwrap();
        fs::write(scene.path("in/other/hush.toml"), line).unwrap();
        write_frame(&scene.path("in/other/s_1.exr"), 1, Look::default());
        scene.land(1);
        let mut watch = scene.watch(&["--settle", "0.5"]);
        let told = |w: &Watch| format!("{:?}", w.named("warning"));
        let advice = format!("set {name} to one for all");
        watch.until("the other shot and a warning", |w| w.denoised().len() == 1 && told(w).contains(&advice));
        assert!(told(&watch).contains("other/s_#.exr") && !scene.path("out/other").exists(), "{}", told(&watch));
        watch.stop();
    }
}

#[test]
fn an_output_folder_that_cannot_be_written_is_waited_for() {
    let scene = Scene::new();
    fs::create_dir(scene.path("in/a")).unwrap();
    fs::create_dir(scene.path("out")).unwrap();
    fs::write(scene.path("out/a"), b"a file where a folder belongs").unwrap();
    write_frame(&scene.path("in/a").join(name(1)), 1, Look::default());
    let mut watch = scene.watch(&["--frames", "1"]);
    watch.until("a word about it", |w| !w.named("paused").is_empty());
    fs::remove_file(scene.path("out/a")).unwrap();
    watch.finish(1);
    assert_eq!(scene.names("out/a"), [name(1)]);
}

#[test]
fn wrong_usage_is_refused() {
    let scene = Scene::new();
    scene.land(1);
    for (args, expected) in [
        (vec!["in", "-o", "in"], "would be overwritten"),
        (vec!["in", "-o", "."], "would be overwritten"),
        (vec!["in/f_0001.exr", "-o", "out"], "name the folder"),
        (vec!["nowhere", "-o", "out", "--once"], "no such folder"),
        (vec!["in", "-o", "out", "--settle", "soon"], "seconds"),
        (vec!["in", "-o", "out", "--window", "9"], "out of range: 0 to 3"),
        (vec!["in/sub_####.exr", "-o", "out", "--once"], "holds no .exr"),
    ] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hush"));
        let output = command.current_dir(scene.dir.path()).arg("watch").args(&args).output().unwrap();
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(1) && text.contains(expected), "{args:?}: {text}");
    }
}
