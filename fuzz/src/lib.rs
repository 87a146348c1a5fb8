//! What each fuzz target does with its input; `tests/corpus.rs` does the same with the files of `tests/corpus`.
//!
//! A check returns Ok where the input is sound and an error where it is refused. It panics where a promise is broken: an error that
//! does not name the file, an output that cannot be read again, a pixel out of range.

pub mod engine;
pub mod frame_file;
pub mod manifest;
pub mod settings;
pub mod texts;
pub mod weights;

use std::path::Path;

/// Does what a target does, with a folder of its own that may hold what an earlier input left there.
pub type Check = fn(&Path, &[u8]) -> hush::Result<()>;

/// The targets by their names, which are those of the folders of `tests/corpus` too.
pub const TARGETS: [(&str, Check); 7] = [
    ("frame_file", frame_file::check),
    ("settings_file", settings::check_file),
    ("usd_layer", settings::check_stage),
    ("manifest", manifest::check),
    ("weights", weights::check),
    ("texts", texts::check),
    ("engine", engine::check),
];

/// Writes the input to the file that is read.
fn put(path: &Path, bytes: &[u8]) {
    std::fs::write(path, bytes).expect("the folder can be written to");
}

/// Passes a result on; an error has to name the file.
fn named<T>(path: &Path, result: hush::Result<T>) -> hush::Result<T> {
    if let Err(error) = &result {
        let (name, text) = (path.file_name().expect("a file").to_string_lossy(), error.to_string());
        assert!(text.contains(&*name), "the message does not name {name}: {text}");
    }
    result
}
