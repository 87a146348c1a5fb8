//! What a farm's disks and names do to a run: a full disk, folders that nobody may write to, names of all kinds, switched-off shots.
#![cfg(target_os = "linux")]

mod common;

use std::ffi::OsStr;
use std::fs::{self, File};
use std::os::unix::ffi::OsStrExt;
use std::process::{Command, Output, Stdio};

use common::{Look, Shot, name, write_frame};
use serde_json::Value;

fn command(shot: &Shot) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hush"));
    command.current_dir(shot.dir.path()).stdin(Stdio::null());
    command
}

fn hush(shot: &Shot, args: &[&str]) -> Output {
    command(shot).args(args).output().unwrap()
}

fn err(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

#[test]
fn what_could_not_be_printed_is_no_success() {
    let shot = Shot::new(1..=2, Look::default());
    let full = |args: &[&str]| command(&shot).args(args).stdout(File::create("/dev/full").unwrap()).output().unwrap();
    // The frames are the result of a run; its events are not.
    assert_eq!(full(&["denoise", "shot", "-o", "out", "--json"]).status.code(), Some(0));
    assert_eq!(shot.written(), [name(1), name(2)]);
    for args in [
        &["check", "shot", "-o", "out"][..],
        &["inspect", "shot/f_0001.exr", "--json"],
        &["inspect", "shot/f_0001.exr"],
        &["eval", "shot", "out", "--json"],
        &["survey", "shot", "--no-timing"],
        &["shot", "show", "shot"],
        &["denoise", "shot", "-o", "out", "--dry-run"],
    ] {
        let lost = full(args);
        assert_eq!(lost.status.code(), Some(1), "{args:?}");
        assert!(err(&lost).contains("standard output: No space left on device"), "{args:?}: {}", err(&lost));
    }
}

#[test]
fn a_misspelt_instruction_set_is_refused() {
    let shot = Shot::new(1..=1, Look::default());
    for (word, code) in [("portabel", 1), ("Portable", 0), ("neon", 0), ("", 0)] {
        let ran = command(&shot).args(["inspect", "shot/f_0001.exr"]).env("HUSH_SIMD", word).output().unwrap();
        assert_eq!(ran.status.code(), Some(code), "{word}: {}", err(&ran));
        assert_eq!(err(&ran).contains("HUSH_SIMD: 'portabel' is no instruction set: there are portable, neon"), code == 1);
    }
}

#[test]
fn a_retry_of_a_shot_that_is_done_needs_no_writing() {
    let shot = Shot::new(1..=2, Look::default());
    assert!(hush(&shot, &["denoise", "shot", "-o", "out"]).status.success());
    // No file can grow, whoever runs it.
    let program = env!("CARGO_BIN_EXE_hush");
    let unwritable = |options: &str| {
        let line = format!("trap '' XFSZ; ulimit -f 0; exec '{program}' denoise shot -o out {options}");
        Command::new("bash").current_dir(shot.dir.path()).args(["-c", &line]).output().unwrap()
    };
    let retry = unwritable("");
    assert_eq!(retry.status.code(), Some(0), "{}", err(&retry));
    assert!(err(&retry).contains("warning: out/hush-manifest.json: File too large"), "{}", err(&retry));
    assert_eq!(unwritable("--lambda 2").status.code(), Some(1));
    assert_eq!(hush(&shot, &["check", "shot", "-o", "out"]).status.code(), Some(0));
}

#[test]
fn names_may_be_long_but_must_be_text() {
    let shot = Shot::new(1..=2, Look::default());
    let long = "x".repeat(246);
    for n in 1..=2 {
        fs::rename(shot.input(n), shot.folder().join(format!("{long}_{n:04}.exr"))).unwrap();
    }
    let done = hush(&shot, &["denoise", "shot", "-o", "out"]);
    assert_eq!(done.status.code(), Some(0), "{}", err(&done));
    let odd = shot.dir.path().join("odd");
    fs::create_dir(&odd).unwrap();
    write_frame(&odd.join(OsStr::from_bytes(b"\xe9_0001.exr")), 1, Look::default());
    for args in
        [&["denoise", "odd", "-o", "o"][..], &["denoise", "odd", "-o", "o", "--dry-run"], &["watch", "odd", "-o", "o", "--once"]]
    {
        let refused = hush(&shot, args);
        assert_eq!(refused.status.code(), Some(1), "{args:?}");
        assert!(err(&refused).contains("not UTF-8"), "{args:?}: {}", err(&refused));
    }
    let inspected =
        command(&shot).args(["inspect", "--json"]).arg(odd.join(OsStr::from_bytes(b"\xe9_0001.exr"))).output().unwrap();
    assert_eq!(inspected.status.code(), Some(1));
}

#[test]
fn a_watch_of_a_switched_off_shot_ends_and_says_so() {
    let shot = Shot::new(1..=2, Look::default());
    fs::write(shot.folder().join("hush.toml"), "enable = false").unwrap();
    for more in [&["--once"][..], &["--frames", "1-2", "--settle", "0.3"]] {
        let ended = hush(&shot, &[&["watch", "shot", "-o", "out", "--json"], more].concat());
        assert_eq!(ended.status.code(), Some(3), "{more:?}: {}", err(&ended));
        assert!(err(&ended).contains("switched off for this shot by shot/hush.toml"), "{}", err(&ended));
    }
}

#[test]
fn frames_that_are_cropped_at_another_place_do_not_help() {
    let shot = Shot::new(1..=2, Look::default());
    write_frame(&shot.input(2), 2, Look { origin: (3, 0), ..Look::default() });
    let done = hush(&shot, &["denoise", "shot", "-o", "out", "--json"]);
    assert_eq!(done.status.code(), Some(0), "{}", err(&done));
    let events: Vec<Value> = String::from_utf8(done.stdout).unwrap().lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    let frames: Vec<&Value> = events.iter().filter(|e| e["event"] == "frame").collect();
    assert!(frames.len() == 2 && frames.iter().all(|f| f["neighbours"].as_array().unwrap().is_empty()), "{frames:?}");
    assert!(events.iter().any(|e| e["kind"] == "resolution" && e["message"].as_str().unwrap().contains("the crop moves")));
}

#[test]
fn a_frame_that_lost_its_neighbours_is_kept_and_the_reason_is_true() {
    let shot = Shot::new(1..=3, Look::default());
    assert!(hush(&shot, &["denoise", "shot", "-o", "out", "--frames", "1"]).status.success());
    (2..=3).for_each(|n| fs::remove_file(shot.input(n)).unwrap());
    let kept = hush(&shot, &["denoise", "shot", "-o", "out"]);
    assert_eq!(kept.status.code(), Some(1));
    let told = err(&kept);
    assert!(told.contains("frame 1 better than this run would make it") && told.contains("missing, damaged"), "{told}");
    assert!(!told.contains("no motion vectors"), "{told}");
}
