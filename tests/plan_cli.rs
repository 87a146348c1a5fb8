//! `hush plan`, and the options that force its rules on and off.

mod common;

use std::process::{Command, Output, Stdio};

use common::{Look, Shot};
use serde_json::Value;

fn hush(shot: &Shot, args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hush"));
    command.current_dir(shot.dir.path()).args(args).stdin(Stdio::null()).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

fn plan(shot: &Shot, more: &[&str]) -> Value {
    let output = hush(shot, &[&["plan", "shot", "--json"], more].concat());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn rule<'a>(plan: &'a Value, name: &str) -> &'a Value {
    plan["rules"].as_array().unwrap().iter().find(|r| r["rule"] == name).unwrap()
}

#[test]
fn a_still_shot_is_copied_and_timed() {
    let shot = Shot::new(1..=3, Look { vector: Some(0.0), noisy_image: true, ..Look::default() });
    let found = plan(&shot, &[]);
    assert_eq!((&found["window"], found["frames"].as_array().unwrap().len()), (&2.into(), 3));
    let still = rule(&found, "still");
    assert_eq!((&still["on"], &still["frames"], &still["mean"]), (&true.into(), &3.into(), &2.0.into()));
    assert_eq!(found["frames"][0]["left_out"][0]["still"], 2);
    assert!(found["time"]["with"].as_f64() > Some(0.0) && found["time"]["without"].as_f64() > Some(0.0));
    assert!(found["time"]["shot_with"].as_f64() >= found["time"]["with"].as_f64());
    let unread: Vec<&str> = found["unread"].as_array().unwrap().iter().map(|u| u["pass"].as_str().unwrap()).collect();
    assert_eq!(unread, ["ViewLayer.Combined"], "the Noisy Image is read instead");
    assert!(found["unread"][0]["apart"] == false && found["unread_share"].as_f64().is_some_and(|s| (0.1..0.3).contains(&s)));
    let none = plan(&shot, &["--no-skip", "all"]);
    assert!(none["time"].is_null(), "nothing is left out");
    let off = plan(&shot, &["--no-skip", "still", "--no-timing"]);
    assert_eq!((&rule(&off, "still")["on"], &rule(&off, "still")["mean"]), (&false.into(), &2.0.into()), "what it would do");
    assert!(off["time"].is_null() && off["frames"][0]["left_out"][0]["still"] == 0);
    let words = text(&hush(&shot, &["plan", "shot"]).stdout);
    for part in [
        "copies 2.0 neighbours a frame, in 3 of 3 frames (exact)",
        "ViewLayer.Combined",
        "3 of 3 frames: about",
        "3 frames, window 2",
    ] {
        assert!(words.contains(part), "{part} in {words}");
    }
    assert!(!shot.out().exists());
}

#[test]
fn alpha_that_is_one_everywhere_is_left_out() {
    use exr::prelude::{AnyChannel, FlatSamples, WritableImage, read_first_flat_layer_from_file};
    let shot = Shot::new(1..=2, Look::default());
    for number in 1..=2 {
        let mut image = read_first_flat_layer_from_file(shot.input(number)).unwrap();
        let list = &mut image.layer_data.channel_data.list;
        list.push(AnyChannel::new("ViewLayer.Combined.A", FlatSamples::F32(vec![1.0; 24 * 16])));
        list.sort_by_key(|channel| channel.name.to_string());
        image.write().to_file(shot.input(number)).unwrap();
    }
    let found = plan(&shot, &["--no-timing"]);
    assert_eq!((&rule(&found, "opaque")["frames"], &rule(&found, "opaque")["mean"]), (&2.into(), &1.0.into()));
    let words = text(&hush(&shot, &["plan", "shot", "--no-timing"]).stdout);
    assert!(words.contains("leaves out alpha in 2 of 2 frames"), "{words}");
    let none = plan(&Shot::new(1..=2, Look::default()), &["--no-timing"]);
    assert_eq!(rule(&none, "opaque")["frames"], 0, "there is no alpha");
}

#[test]
fn a_bad_frame_shows_in_the_exit_code() {
    let shot = Shot::new(1..=3, Look::default());
    shot.truncate(2);
    let output = hush(&shot, &["plan", "shot", "--no-timing"]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("frame 2") && text(&output.stdout).contains("2 frames"));
    assert_eq!(hush(&shot, &["plan", "nowhere"]).status.code(), Some(1));
}

#[test]
fn rules_can_be_forced_and_the_manifest_tells() {
    let shot = Shot::new(1..=3, Look { seed: Some(7), ..Look::default() });
    let run = |more: &[&str]| {
        let output = hush(&shot, &[&["denoise", "shot", "-o", "out"], more].concat());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        text(&output.stderr)
    };
    run(&[]);
    let entry = |shot: &Shot| shot.manifest().frames.values().next().unwrap().clone();
    let again = run(&["--no-skip", "all"]);
    assert!(again.contains("left out constant+opaque+untrusted+still → nothing"), "{again}");
    assert_eq!(entry(&shot).left_out[0], Default::default());
    assert!(run(&["--no-skip", "all"]).contains("3 already done"));
    for (args, message) in [(["--skip", "fog"], "is no rule"), (["--no-skip", "fog"], "is no rule")] {
        let output = hush(&shot, &["denoise", "shot", "-o", "out", args[0], args[1]]);
        assert!(output.status.code() == Some(1) && text(&output.stderr).contains(message), "{}", text(&output.stderr));
    }
    let both = hush(&shot, &["denoise", "shot", "-o", "out", "--skip", "still", "--no-skip", "still"]);
    assert!(both.status.code() == Some(1) && text(&both.stderr).contains("stands in --skip"), "{}", text(&both.stderr));
}
