//! The files of `tests/corpus` through what the fuzz targets do: valid ones are taken, damaged ones refused with the file's name,
//! and none of them, nor those that fuzzing found, ends in a panic or takes long.

#[path = "../fuzz/src/lib.rs"]
mod targets;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use targets::{Check, TARGETS};

/// For one file, on a loaded machine.
const MOST_TIME: Duration = Duration::from_secs(25);
const VALID: &str = "valid";
const DAMAGED: &str = "damaged";
const FOUND: &str = "found-by-fuzzing";

/// The files of a folder, in order of their names; a folder that is not there has none.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let mut files: Vec<PathBuf> = entries.map(|e| e.unwrap().path()).collect();
    files.sort();
    files
}

/// What a check says to a file, in an empty folder of its own; the outer error is what must not be.
fn outcome(check: Check, file: &Path) -> Result<hush::Result<()>, String> {
    let (folder, bytes) = (tempfile::tempdir().unwrap(), std::fs::read(file).unwrap());
    let started = Instant::now();
    let result = catch_unwind(AssertUnwindSafe(|| check(folder.path(), &bytes))).map_err(|_| "panicked".to_string())?;
    match started.elapsed() {
        long if long > MOST_TIME => Err(format!("took {long:?}")),
        _ => Ok(result),
    }
}

/// What is wrong with what the program says to a stage that ends the process that reads it.
fn wrong_fenced(file: &Path) -> Option<String> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hush"));
    let output = command.args(["shot", "show", "--usd"]).arg(file).stdin(Stdio::null()).output().unwrap();
    let (said, name) = (String::from_utf8_lossy(&output.stderr), file.file_name().unwrap().to_string_lossy());
    let sound = output.status.code() == Some(1) && said.contains(&*name) && said.contains("broke down");
    (!sound).then(|| format!("{}: {said}", output.status))
}

/// What is wrong with the outcome of a file in a folder of this kind.
fn wrong(check: Check, kind: &str, file: &Path) -> Option<String> {
    if file.file_name().is_some_and(|name| name.to_string_lossy().starts_with("fenced")) {
        return wrong_fenced(file);
    }
    // Of what was found either will do, but for files whose name says that they are sound.
    let sound = file.file_name().is_some_and(|name| name.to_string_lossy().starts_with("sound"));
    match outcome(check, file) {
        Err(reason) => Some(reason),
        Ok(Ok(())) if kind == DAMAGED => Some("was taken".into()),
        Ok(Err(error)) if kind == VALID || sound => Some(error.to_string()),
        Ok(_) => None,
    }
}

#[test]
fn every_file_of_the_corpus_gives_what_its_folder_says() {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus");
    let mut problems = Vec::new();
    for (target, check) in TARGETS {
        // Settings in stages need the library that reads them.
        if cfg!(not(feature = "usd")) && target == "usd_layer" {
            continue;
        }
        for kind in [VALID, DAMAGED, FOUND] {
            let files = files(&corpus.join(target).join(kind));
            assert!(kind != VALID || !files.is_empty(), "{target} has no valid files");
            problems.extend(files.iter().filter_map(|f| Some(format!("{}: {}", f.display(), wrong(check, kind, f)?))));
        }
    }
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}

#[test]
fn every_folder_of_the_corpus_has_a_target() {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus");
    for folder in files(&corpus).into_iter().filter(|path| path.is_dir()) {
        let name = folder.file_name().unwrap().to_string_lossy().into_owned();
        assert!(TARGETS.iter().any(|(target, _)| *target == name), "{name} is the folder of no target");
        for kind in files(&folder) {
            let kind = kind.file_name().unwrap().to_string_lossy().into_owned();
            assert!([VALID, DAMAGED, FOUND].contains(&kind.as_str()), "{name}/{kind} is run by nothing");
        }
    }
}
