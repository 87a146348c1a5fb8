//! The files of `tests/corpus` through what the fuzz targets do: valid ones are taken, damaged ones refused with the file's name,
//! and none of them, nor those that fuzzing found, ends in a panic or takes long.

#[path = "../fuzz/src/lib.rs"]
mod targets;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use targets::{Check, TARGETS};

/// For one file, on a loaded machine and without optimisation; libFuzzer's own limit is 25 s too.
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

/// What a check says to a file, in an empty folder of its own.
fn outcome(check: Check, file: &Path) -> hush::Result<()> {
    let (folder, bytes) = (tempfile::tempdir().unwrap(), std::fs::read(file).unwrap());
    let started = Instant::now();
    let result = catch_unwind(AssertUnwindSafe(|| check(folder.path(), &bytes)));
    let result = result.unwrap_or_else(|_| panic!("{} panicked", file.display()));
    assert!(started.elapsed() < MOST_TIME, "{} took {:?}", file.display(), started.elapsed());
    result
}

#[test]
fn every_file_of_the_corpus_gives_what_its_folder_says() {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus");
    for (target, check) in TARGETS {
        // Settings in stages need the library that reads them.
        if cfg!(not(feature = "usd")) && target == "usd_layer" {
            continue;
        }
        let of = |kind: &str| files(&corpus.join(target).join(kind));
        assert!(!of(VALID).is_empty(), "{target} has no valid files");
        for file in of(VALID) {
            outcome(check, &file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        }
        for file in of(DAMAGED) {
            assert!(outcome(check, &file).is_err(), "{} was taken", file.display());
        }
        for file in of(FOUND) {
            // Either will do, but for files whose name says that they are sound.
            let sound = file.file_name().is_some_and(|name| name.to_string_lossy().starts_with("sound"));
            let result = outcome(check, &file);
            assert!(result.is_ok() || !sound, "{}: {result:?}", file.display());
        }
    }
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
