//! Ctrl-C, SIGTERM, SIGHUP and SIGXFSZ.

use std::path::Path;

use super::{Exit, Handler, say};
use crate::error::{Error, Result};
use crate::shot::{CancelToken, remove_unfinished};

/// Has a handler called at the signals that end a process; a hang-up that the process was started to ignore, as by `nohup`, stays ignored.
pub(super) fn catch(handler: Handler) -> Result<()> {
    let hang_up = ignores_hang_up();
    let bad = |e: ctrlc::Error| Error::BadInput { input: "signal handler".into(), reason: e.to_string() };
    ctrlc::set_handler(handler).map_err(bad)?;
    ignore_file_limit();
    if hang_up {
        ignore_hang_up();
    }
    Ok(())
}

#[cfg(unix)]
fn ignores_hang_up() -> bool {
    let before = ignore_hang_up();
    // SAFETY: it is what it was before.
    unsafe { libc::signal(libc::SIGHUP, before) };
    before == libc::SIG_IGN
}

/// Ignores it; returns what was done at it before.
#[cfg(unix)]
fn ignore_hang_up() -> libc::sighandler_t {
    // SAFETY: no code of ours runs at the signal.
    unsafe { libc::signal(libc::SIGHUP, libc::SIG_IGN) }
}

/// At the limit of a file's size (`ulimit -f`) a write fails, which is told; the signal would end the process without a word.
#[cfg(unix)]
fn ignore_file_limit() {
    // SAFETY: no code of ours runs at the signal.
    unsafe { libc::signal(libc::SIGXFSZ, libc::SIG_IGN) };
}

#[cfg(not(unix))]
fn ignore_file_limit() {}

#[cfg(not(unix))]
fn ignores_hang_up() -> bool {
    false
}

#[cfg(not(unix))]
fn ignore_hang_up() {}

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
