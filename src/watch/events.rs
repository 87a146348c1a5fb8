//! What a watch reports while it goes on, and its result.

use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::shot;

/// One step of a watch. As JSON each is an object with an `event` field: those of a run (`start`, `working`, `frame`, `warning`,
/// `error`), with the `shot` added, and `watching`, `landed`, `incomplete`, `waiting`, `paused`, `done`. Fields may be added,
/// never renamed.
#[derive(Debug, Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
#[non_exhaustive]
pub enum WatchEvent<'a> {
    /// First of all.
    Watching {
        /// The watched folder.
        input: &'a Path,
        /// Where the frames go.
        output: &'a Path,
        /// The folder is scanned again and again; otherwise the system tells of changes.
        polling: bool,
    },
    /// A frame is there and whole.
    Landed {
        /// The shot, such as `beauty/frame_####.exr`.
        shot: &'a str,
        /// Frame number.
        frame: i64,
        /// The input file.
        source: PathBuf,
        /// It was there before with other content.
        again: bool,
    },
    /// A file has not changed for a while and is not whole.
    Incomplete {
        /// The shot.
        shot: &'a str,
        /// Frame number.
        frame: i64,
        /// The input file.
        source: PathBuf,
        /// What is missing.
        reason: String,
    },
    /// There is nothing to do now; reported when the numbers change, and after each landing and each run.
    Waiting(&'a Waiting),
    /// Nothing can be written now; it is tried again.
    Paused {
        /// What is wrong and what to do.
        message: String,
        /// Until the next attempt.
        seconds: f64,
    },
    /// Something about the watch as a whole.
    Warning {
        /// As in a run's warnings.
        kind: crate::rules::checks::WarningKind,
        /// One sentence with what to do.
        message: String,
    },
    /// Last of all.
    Done(&'a WatchSummary),
    /// A step of the run over some frames of a shot. `start` comes once a shot; the counts are those of the shot.
    #[serde(untagged)]
    Shot {
        /// The shot.
        shot: &'a str,
        /// The step.
        #[serde(flatten)]
        event: shot::Event<'a>,
    },
}

/// How far the watch is.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Waiting {
    /// The watched folder is there.
    pub input: bool,
    /// Frames that are there and whole.
    pub landed: usize,
    /// Frames that are denoised.
    pub denoised: usize,
    /// Whole frames that wait for those beside them.
    pub waiting: usize,
    /// Files that are not whole, or not known to be.
    pub incomplete: usize,
    /// Frames that another process is at.
    pub elsewhere: usize,
    /// Whole frames that could not be denoised.
    pub failed: usize,
}

/// The result of a watch.
#[derive(Debug, Default, Serialize)]
pub struct WatchSummary {
    /// Frames that are there and whole.
    pub frames: usize,
    /// Frames written, those made again each time.
    pub written: usize,
    /// Frames that are denoised and were not written by this process.
    pub skipped: usize,
    /// Frames that could not be denoised; with `once` also the files that are not whole.
    pub failed: Vec<i64>,
    /// Frames done without a neighbour whose file is bad.
    pub degraded: Vec<i64>,
    /// Frames asked for by number that have not come, as `3-5,9`; of several shots as `a_####.exr 3-5,9; b_####.exr 7`.
    pub missing: String,
    /// Stopped by the [`CancelToken`](crate::shot::CancelToken).
    pub interrupted: bool,
    /// What ended the watch early: with `once`, a full disk.
    pub stopped: Option<String>,
    /// Wall-clock time of the whole watch.
    pub seconds: f64,
}

impl WatchSummary {
    /// Every frame that is there, or was asked for by number, is denoised with all that could help it.
    pub fn is_complete(&self) -> bool {
        self.failed.is_empty()
            && self.degraded.is_empty()
            && self.missing.is_empty()
            && self.stopped.is_none()
            && !self.interrupted
    }
}
