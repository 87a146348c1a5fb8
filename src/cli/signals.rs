//! Ctrl-C, SIGTERM and SIGHUP.

use std::path::Path;

use super::{Exit, Handler, say};
use crate::error::{Error, Result};
use crate::shot::{CancelToken, remove_unfinished};

/// Has a handler called at the signals that end a process, but for those that the process was started to ignore, as by `nohup`.
pub(super) fn catch(handler: Handler) -> Result<()> {
    let ignored = ignored();
    let bad = |e: ctrlc::Error| Error::BadInput { input: "signal handler".into(), reason: e.to_string() };
    ctrlc::set_handler(handler).map_err(bad)?;
    ignored.into_iter().for_each(|signal| _ = ignore(signal));
    Ok(())
}

/// The signals that are ignored.
#[cfg(unix)]
fn ignored() -> Vec<i32> {
    let is_ignored = |signal: &i32| {
        let before = ignore(*signal);
        // SAFETY: it is what it was before.
        (before != libc::SIG_IGN).then(|| unsafe { libc::signal(*signal, before) }).is_none()
    };
    [libc::SIGHUP, libc::SIGINT, libc::SIGTERM].into_iter().filter(is_ignored).collect()
}

/// Ignores a signal; returns what it did before.
#[cfg(unix)]
fn ignore(signal: i32) -> libc::sighandler_t {
    // SAFETY: no code of ours runs at the signal.
    unsafe { libc::signal(signal, libc::SIG_IGN) }
}

#[cfg(not(unix))]
fn ignored() -> Vec<i32> {
    Vec::new()
}

#[cfg(not(unix))]
fn ignore(_: i32) {}

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
