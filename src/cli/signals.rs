//! Ctrl-C and SIGTERM.

use std::path::Path;

use super::{Exit, say};
use crate::error::{Error, Result};
use crate::shot::{CancelToken, remove_unfinished};

/// The first signal lets the frame in hand be finished, the second ends the process at once.
pub(super) fn stop_on_signal(cancel: &CancelToken, output: &Path) -> Result<()> {
    let (cancel, output) = (cancel.clone(), output.to_path_buf());
    let handler = move || {
        if cancel.is_cancelled() {
            remove_below(&output);
            std::process::exit(Exit::Stopped as i32);
        }
        cancel.cancel();
        say("stopping after the frame in hand; once more stops at once");
    };
    ctrlc::set_handler(handler).map_err(|e| Error::BadInput { input: "signal handler".into(), reason: e.to_string() })
}

/// What this process has not finished writing, in a folder and, as a watch mirrors folders, below it.
fn remove_below(folder: &Path) {
    remove_unfinished(folder);
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.file_type().is_ok_and(|t| t.is_dir()) {
            remove_below(&entry.path());
        }
    }
}
