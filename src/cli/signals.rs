//! Ctrl-C and SIGTERM.

use std::path::Path;

use super::{Exit, Handler, say};
use crate::shot::{CancelToken, remove_unfinished};

/// The first signal lets the frame in hand be finished, the second ends the process at once.
pub(super) fn stop_handler(cancel: &CancelToken, output: Option<&Path>) -> Handler {
    let (cancel, output) = (cancel.clone(), output.map(Path::to_path_buf));
    Box::new(move || {
        if cancel.is_cancelled() {
            output.iter().for_each(|folder| remove_below(folder));
            std::process::exit(Exit::Stopped as i32);
        }
        cancel.cancel();
        say("stopping after the frame in hand; once more stops at once");
    })
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
