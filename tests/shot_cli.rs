//! The command: exit codes, JSON events, dry runs, and what signals leave behind.

mod common;

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Output, Stdio};

use common::{Look, Shot, name};
use serde_json::Value;

fn hush(shot: &Shot, args: &[&str]) -> Output {
    command(shot, args).output().unwrap()
}

fn command(shot: &Shot, args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hush"));
    command.current_dir(shot.dir.path()).args(args).stdin(Stdio::null());
    command
}

fn out(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

fn err(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

fn events(text: &str) -> Vec<Value> {
    text.lines().map(|line| serde_json::from_str(line).unwrap_or_else(|e| panic!("{line}: {e}"))).collect()
}

fn named(events: &[Value], name: &str) -> Vec<Value> {
    events.iter().filter(|e| e["event"] == name).cloned().collect()
}

#[test]
fn the_readme_command_writes_every_frame() {
    let shot = Shot::new(1..=3, Look::default());
    let first = hush(&shot, &["denoise", "shot", "--output", "out"]);
    assert_eq!(first.status.code(), Some(0), "{}", err(&first));
    assert_eq!(shot.written(), (1..=3).map(name).collect::<Vec<_>>());
    assert!(out(&first).is_empty() && err(&first).contains("3 denoised"), "{}", err(&first));
    let again = hush(&shot, &["denoise", "shot/f_####.exr", "--output", "out"]);
    assert!(again.status.success() && err(&again).contains("3 already done"), "{}", err(&again));
    let quiet = hush(&shot, &["denoise", "shot/f_*.exr", "--output", "out", "--overwrite", "--quiet"]);
    assert!(quiet.status.success() && quiet.stderr.is_empty() && quiet.stdout.is_empty());
}

#[test]
fn whatever_makes_a_run_fail_is_told_in_every_mode() {
    let shot = Shot::new(1..=3, Look::default());
    for mode in ["--quiet", "--openjd", "--strict"] {
        let masked = hush(&shot, &["denoise", "shot", "-o", "out", "--lambda-images", "m_####.exr", mode]);
        let told = out(&masked) + &err(&masked);
        assert!(!masked.status.success() && told.contains("m_0001.exr: there is no such file"), "{mode}: {told}");
        assert!(mode != "--openjd" || told.contains("openjd_fail: frame 3: "), "{told}");
    }
    for (mode, word) in [("--quiet", "error: "), ("--openjd", "openjd_fail: ")] {
        let missing = hush(&shot, &["denoise", "shot", "-o", "out", "--frames", "1-3,5,8-9", mode]);
        let told = out(&missing) + &err(&missing);
        assert!(missing.status.code() == Some(2), "{told}");
        assert!(told.contains(&format!("{word}missing, though asked for: 5,8-9")), "{told}");
    }
}

#[test]
fn json_events_are_one_object_a_line() {
    let shot = Shot::new([1, 2, 3, 5], Look::default());
    shot.truncate(3);
    let output = hush(&shot, &["denoise", "shot", "-o", "out", "--json", "--lambda", "100"]);
    assert_eq!(output.status.code(), Some(2));
    let events = events(&out(&output));
    assert_eq!(events.first().unwrap()["event"], "start");
    assert_eq!(events.last().unwrap()["event"], "done");
    let start = &events[0];
    assert_eq!((&start["frames"], &start["window"], &start["lambda"]), (&4.into(), &2.into(), &64.0.into()));
    let frames = named(&events, "frame");
    assert_eq!(frames.len(), 4);
    assert_eq!(frames.iter().filter(|f| f["status"] == "denoised").count(), 3);
    assert_eq!(frames.last().unwrap()["finished"], 4);
    let warnings: Vec<_> = named(&events, "warning").iter().map(|w| w["kind"].clone()).collect();
    assert_eq!(warnings, ["setting", "missing_frames"]);
    assert_eq!(named(&events, "error")[0]["frame"], 3);
    assert_eq!(events.last().unwrap()["failed"], serde_json::json!([3]));
    let refused = hush(&shot, &["denoise", "nowhere", "-o", "out", "--json"]);
    assert_eq!(refused.status.code(), Some(1));
    let events = self::events(&out(&refused));
    assert!(events.len() == 1 && events[0]["event"] == "error" && events[0]["frame"].is_null(), "{events:?}");
}

#[test]
fn wrong_usage_is_exit_code_one() {
    let shot = Shot::new(1..=2, Look::default());
    for (args, expected) in [
        (vec!["denoise", "shot"], "--output"),
        (vec!["denoise", "shot", "-o", "shot"], "overwritten"),
        (vec!["denoise", "shot", "-o", "out", "--lambda", "0.5"], "lambda"),
        (vec!["denoise", "shot", "-o", "out", "--lambda", "-3"], "lambda"),
        (vec!["denoise", "shot", "-o", "out", "--lambda", "nan"], "lambda"),
        (vec!["denoise", "shot", "-o", "out", "--window", "4"], "window"),
        (vec!["denoise", "shot", "-o", "out", "--frames", "7-3"], "backwards"),
        (vec!["denoise", "shot", "-o", "out", "--frames", "50"], "1-2"),
        (vec!["denoise", "shot", "-o", "out", "--memory", "lots"], "4G"),
        (vec!["denoise", "shot", "-o", "out", "--threads", "0"], "threads"),
        (vec!["denoise", "shot", "-o", "out", "--model", "nowhere.safetensors"], "nowhere.safetensors"),
        (vec!["denoise", "shot", "-o", "out", "--renderer", "arnold"], "cycles, mitsuba"),
        (vec!["survey", "shot", "--renderer", "arnold"], "cycles, mitsuba"),
        (vec!["denoise", "shot", "-o", "out", "--layer", "Fog"], "Fog"),
        (vec!["denoise", "shot", "-o", "out", "--aov", "Diffuse Direct"], "Diffuse Direct"),
        (vec!["denoise", "nowhere", "-o", "out"], "nowhere"),
        (vec!["inspect", "nowhere.exr"], "nowhere.exr"),
        (vec!["eval", "nowhere", "shot"], "nowhere"),
        (vec!["dance"], "dance"),
        (vec![], "Usage"),
    ] {
        let output = hush(&shot, &args);
        assert_eq!(output.status.code(), Some(1), "{args:?}: {}", err(&output));
        assert!(err(&output).contains(expected), "{args:?}: {}", err(&output));
        assert!(!shot.out().exists(), "{args:?}");
    }
}

#[test]
fn a_check_that_finds_no_frame_fails() {
    let shot = Shot::new([], Look::default());
    for input in ["shot", "nowhere", "shot/f_####.exr", "nowhere/f_####.exr"] {
        let checked = hush(&shot, &["check", input, "-o", "out"]);
        assert_eq!((checked.status.code(), out(&checked).as_str()), (Some(1), ""), "{input}");
        assert!(err(&checked).contains(input) && err(&checked).contains("no frame is there"), "{input}: {}", err(&checked));
        let json = hush(&shot, &["check", input, "-o", "out", "--json"]);
        assert_eq!((json.status.code(), &events(&out(&json))[0]["frames"]), (Some(1), &serde_json::json!([])), "{input}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn the_input_folder_is_refused_under_another_mount_path() {
    let shot = Shot::new(1..=2, Look::default());
    std::fs::create_dir(shot.dir.path().join("alias")).unwrap();
    let mounted = |args: &str| {
        let script = format!("mount --bind shot alias && exec '{}' {args}", env!("CARGO_BIN_EXE_hush"));
        Command::new("unshare").args(["-rm", "sh", "-c", &script]).current_dir(shot.dir.path()).output()
    };
    if !mounted("--version").is_ok_and(|output| output.status.success()) {
        return eprintln!("not tried: mounting is not allowed here");
    }
    let before = std::fs::read(shot.input(1)).unwrap();
    for args in
        ["denoise shot -o alias --overwrite", "denoise shot/f_0001.exr -o alias --overwrite", "watch shot -o alias --once"]
    {
        let refused = mounted(args).unwrap();
        assert_eq!(refused.status.code(), Some(1), "{args}: {}", err(&refused));
        assert!(err(&refused).contains("overwritten"), "{args}: {}", err(&refused));
        assert_eq!(std::fs::read(shot.input(1)).unwrap(), before, "{args}");
    }
}

#[test]
fn what_is_not_there_is_said_in_words() {
    let shot = Shot::new([], Look::default());
    std::fs::create_dir(shot.dir.path().join("odd")).unwrap();
    std::fs::write(shot.dir.path().join("odd/a_0001.png.exr"), b"").unwrap();
    for (input, expected) in [
        ("nowhere/f_####.exr", "nowhere/f_####.exr: there is no folder nowhere"),
        ("nowhere/f_0001.exr", "nowhere/f_0001.exr: there is no folder nowhere"),
        ("nowhere/*.exr", "nowhere/*.exr: there is no folder nowhere"),
        ("nowhere", "nowhere: no such file or folder"),
        ("shot", "shot: holds no .exr files"),
        ("odd/a_0001.png", "name 'odd/a_####.png.exr'"),
    ] {
        let output = hush(&shot, &["denoise", input, "-o", "out"]);
        assert_eq!(output.status.code(), Some(1), "{input}: {}", err(&output));
        assert!(err(&output).contains(expected) && !err(&output).contains("os error"), "{input}: {}", err(&output));
    }
    // Names may be read, files may not; root may read them all the same.
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let odd = |mode| std::fs::set_permissions(shot.dir.path().join("odd"), PermissionsExt::from_mode(mode)).unwrap();
        odd(0o400);
        let hidden = shot.dir.path().join("odd/a_0001.png.exr").metadata().is_err();
        let output = hush(&shot, &["denoise", "odd", "-o", "out"]);
        odd(0o700);
        assert!(!hidden || err(&output).contains("a_0001.png.exr: Permission denied"), "{}", err(&output));
    }
    let missing = hush(&shot, &["inspect", "nowhere.exr"]);
    assert_eq!(err(&missing).trim(), "error: nowhere.exr: there is no such file or folder");
}

#[cfg(unix)]
#[test]
fn a_frame_that_is_a_link_to_nowhere_fails_and_is_not_left_out() {
    let shot = Shot::new(1..=2, Look::default());
    std::os::unix::fs::symlink("/nowhere/f_0003.exr", shot.input(3)).unwrap();
    for input in ["shot", "shot/f_####.exr", "shot/*.exr"] {
        let output = hush(&shot, &["denoise", input, "-o", "out"]);
        assert_eq!(output.status.code(), Some(2), "{input}: {}", err(&output));
        assert!(err(&output).contains("frame 3: shot/f_0003.exr: there is no such file"), "{input}: {}", err(&output));
    }
}

#[test]
fn advice_names_options_here_and_settings_in_events() {
    let shot = Shot::new(1..=2, Look { vector: None, ..Look::default() });
    let lines = hush(&shot, &["denoise", "shot", "-o", "out"]);
    assert!(err(&lines).contains("or pass --window 0"), "{}", err(&lines));
    let json = hush(&shot, &["denoise", "shot", "-o", "out2", "--json"]);
    let warning = events(&out(&json)).into_iter().find(|e| e["kind"] == "no_vector").unwrap();
    assert!(warning["message"].as_str().unwrap().ends_with("or set window to 0"), "{warning}");
    std::fs::remove_file(shot.out().join(hush::shot::MANIFEST)).unwrap();
    let foreign = hush(&shot, &["denoise", "shot", "-o", "out"]);
    assert!(err(&foreign).contains("(2 such files)") && err(&foreign).contains("pass --overwrite"), "{}", err(&foreign));
}

#[test]
fn one_file_is_a_frame_of_its_shot() {
    let shot = Shot::new(1..=4, Look::default());
    let output = hush(&shot, &["denoise", "shot/f_0002.exr", "-o", "out"]);
    assert_eq!(output.status.code(), Some(0), "{}", err(&output));
    for part in ["f_####.exr: frame 2 of 4 frames there is denoised, those beside may help", "1 of 1 frame to denoise, window 2"]
    {
        assert!(err(&output).contains(part), "{part}: {}", err(&output));
    }
    assert_eq!(shot.manifest().frames[&name(2)].neighbours.iter().filter(|n| n.used).count(), 3);
    let dry = hush(&shot, &["denoise", "shot/f_0003.exr", "-o", "out", "--dry-run"]);
    assert!(out(&dry).contains("1 frame, window 2") && out(&dry).contains("frame 3: denoise with -2 -1 +1"), "{}", out(&dry));
}

#[test]
fn help_and_version_are_good() {
    let shot = Shot::new([], Look::default());
    let help = hush(&shot, &["denoise", "--help"]);
    assert!(help.status.success() && out(&help).contains("Exit codes") && out(&help).contains("130"));
    let version = hush(&shot, &["--version"]);
    assert_eq!(out(&version).trim(), format!("hush {}", env!("CARGO_PKG_VERSION")));
}

#[test]
fn a_dry_run_tells_and_writes_nothing() {
    let shot = Shot::new(1..=3, Look::default());
    let output = hush(&shot, &["denoise", "shot", "-o", "out", "--dry-run", "--frames", "2"]);
    assert!(output.status.success() && out(&output).contains("frame 2: denoise with -1 +1"), "{}", out(&output));
    assert!(!shot.out().exists());
    let json = hush(&shot, &["denoise", "shot", "-o", "out", "--dry-run", "--json"]);
    let plan: Value = serde_json::from_slice(&json.stdout).unwrap();
    assert_eq!(plan["frames"][0]["action"], "denoise");
    assert_eq!(plan["frames"][0]["neighbours"], serde_json::json!([2, 3]));
}

#[test]
fn inspect_and_eval_answer() {
    let shot = Shot::new(1..=2, Look::default());
    let text = hush(&shot, &["inspect", "shot/f_0001.exr"]);
    assert!(text.status.success() && out(&text).contains("Combined"), "{}", out(&text));
    let json = hush(&shot, &["inspect", "shot/f_0001.exr", "shot/f_0002.exr", "--json"]);
    assert_eq!(events(&out(&json)).len(), 2);
    let mixed = hush(&shot, &["inspect", "shot/f_0001.exr", "nowhere.exr"]);
    assert_eq!(mixed.status.code(), Some(2));
    let same = hush(&shot, &["eval", "shot", "shot", "--json"]);
    let report: Value = serde_json::from_slice(&same.stdout).unwrap();
    assert_eq!(report["mean"]["smape"], 0.0);
}

/// A long run that has begun its work.
#[cfg(unix)]
fn begun(shot: &Shot) -> (Child, impl Iterator<Item = String> + use<>) {
    begun_as(command(shot, &["denoise", "shot", "-o", "out", "--json"]))
}

#[cfg(unix)]
fn begun_as(mut command: Command) -> (Child, impl Iterator<Item = String> + use<>) {
    let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
    let third = |line: &String| line.contains(r#""working""#) && line.contains(r#""frame":3"#);
    assert!(lines.any(|line| third(&line)), "the run ended early");
    (child, lines)
}

#[cfg(unix)]
fn signal(child: &Child, signal: &str) {
    assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
}

#[cfg(unix)]
#[test]
fn a_signal_lets_the_frame_in_hand_be_finished() {
    let shot = Shot::new(1..=60, Look { columns: 160, rows: 90, ..Look::default() });
    for which in ["-INT", "-TERM"] {
        let (mut child, lines) = begun(&shot);
        signal(&child, which);
        let last: Value = serde_json::from_str(&lines.last().unwrap()).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(130), "{last}");
        assert_eq!((&last["event"], &last["interrupted"]), (&"done".into(), &true.into()));
        assert_eq!(shot.written().len(), last["written"].as_u64().unwrap() as usize);
        for file in shot.written() {
            hush::io::is_complete(&shot.out().join(file)).unwrap();
        }
        std::fs::remove_dir_all(shot.out()).unwrap();
    }
}

#[cfg(unix)]
#[test]
fn a_hang_up_that_is_to_be_ignored_is() {
    let shot = Shot::new(1..=20, Look { columns: 160, rows: 90, ..Look::default() });
    let ignoring = |which: &str| {
        let script = format!("trap '' {which}; exec '{}' denoise shot -o out --json", env!("CARGO_BIN_EXE_hush"));
        let mut command = Command::new("sh");
        command.args(["-c", &script]).current_dir(shot.dir.path()).stdin(Stdio::null());
        command
    };
    // As nohup does.
    let (mut child, lines) = begun_as(ignoring("HUP"));
    signal(&child, "-HUP");
    let last: Value = serde_json::from_str(&lines.last().unwrap()).unwrap();
    assert_eq!((child.wait().unwrap().code(), &last["written"]), (Some(0), &20.into()), "{last}");
    std::fs::remove_dir_all(shot.out()).unwrap();
    // As shells do with what runs in the background: somebody who sends it on purpose is heard.
    for (ignored, sent) in [("HUP", "-TERM"), ("INT", "-INT")] {
        let (mut child, lines) = begun_as(ignoring(ignored));
        signal(&child, sent);
        drop(lines.last());
        assert_eq!(child.wait().unwrap().code(), Some(130), "{ignored} is ignored, {sent} is sent");
        std::fs::remove_dir_all(shot.out()).unwrap();
    }
}

#[cfg(unix)]
#[test]
fn a_file_above_the_limit_of_its_size_is_told() {
    let shot = Shot::new(1..=2, Look { columns: 96, rows: 64, ..Look::default() });
    let mut limited = Command::new("sh");
    let script = "ulimit -f 16; exec \"$0\" denoise shot -o out";
    let stopped = limited.current_dir(shot.dir.path()).args(["-c", script, env!("CARGO_BIN_EXE_hush")]).output().unwrap();
    let told = err(&stopped);
    assert_eq!(stopped.status.code(), Some(1), "{stopped:?}");
    assert!(told.contains("out/f_0001.exr: File too large") && told.contains("stopped"), "{told}");
    assert!(shot.written().is_empty(), "{:?}", shot.written());
}

#[cfg(unix)]
#[test]
fn a_killed_run_is_continued() {
    let shot = Shot::new(1..=40, Look { columns: 160, rows: 90, ..Look::default() });
    let (mut child, lines) = begun(&shot);
    signal(&child, "-KILL");
    drop(lines);
    child.wait().unwrap();
    for file in shot.written().iter().filter(|f| !f.ends_with(".part")) {
        hush::io::is_complete(&shot.out().join(file)).unwrap();
    }
    let rest = hush(&shot, &["denoise", "shot", "-o", "out", "--quiet"]);
    assert_eq!((rest.status.code(), err(&rest).as_str()), (Some(0), ""));
    let files: Vec<_> = shot.written().into_iter().filter(|f| !f.ends_with(".part")).collect();
    assert_eq!(files, (1..=40).map(name).collect::<Vec<_>>());
}

#[test]
fn a_frame_that_takes_long_tells_how_far_it_is() {
    let shot = Shot::new(1..=2, Look { columns: 480, rows: 360, ..Look::default() });
    let args = ["denoise", "shot", "-o", "out", "--json", "--frames", "1", "--threads", "1"];
    let output = command(&shot, &args).env("HUSH_SIMD", "portable").output().unwrap();
    assert!(output.status.success(), "{}", err(&output));
    let all = events(&out(&output));
    let names: Vec<&str> = all.iter().map(|e| e["event"].as_str().unwrap()).filter(|n| *n != "warning").collect();
    assert_eq!((names[0], names[1], names[names.len() - 2], names[names.len() - 1]), ("start", "working", "frame", "done"));
    let told = named(&all, "progress");
    assert!(!told.is_empty() && told.len() == names.len() - 4, "{names:?}");
    let fractions: Vec<f64> = told.iter().map(|e| e["fraction"].as_f64().unwrap()).collect();
    assert!(told.iter().all(|e| e["frame"] == 1) && fractions.iter().all(|f| (0.0..=1.0).contains(f)));
    assert!(fractions.windows(2).all(|w| w[1] > w[0]), "{fractions:?}");
    let seconds = named(&all, "frame")[0]["seconds"].as_f64().unwrap();
    assert!(told.len() as f64 <= 5.0 * seconds + 1.0, "{} in {seconds} s", told.len());
    // And nothing of frames that are done at once.
    let quick = Shot::new(1..=2, Look::default());
    let output = hush(&quick, &["denoise", "shot", "-o", "out", "--json"]);
    assert_eq!(named(&events(&out(&output)), "progress"), Vec::<Value>::new());
}
