//! What a run tells while it goes on, and its result.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::Serialize;

use crate::error::Error;
use crate::rules::checks::Warning;

/// What became of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// Not yet begun, or the run was stopped before it.
    Planned,
    /// Written.
    Denoised,
    /// The output was there already, whole and made from the same input with the same settings.
    Skipped,
    /// Could not be read, denoised or written.
    Failed,
}

/// One step of a run. As JSON each is an object with an `event` field: `start`, `working`, `progress`, `frame`, `warning`, `error`, `done`.
/// Fields may be added, never renamed.
#[derive(Debug, Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
#[non_exhaustive]
pub enum Event<'a> {
    /// First of all.
    Start {
        /// The sequence, such as `frame_####.exr`.
        sequence: &'a str,
        /// Where the frames go.
        output: &'a std::path::Path,
        /// Frames of the range that have a file.
        frames: usize,
        /// Frames to denoise; the others are there already.
        todo: usize,
        /// Frames on each side that help.
        window: usize,
        /// The dial of the first frame, after clamping.
        lambda: f32,
    },
    /// A frame is begun: what is not there yet of its window is read, then it is denoised.
    Working {
        /// Frame number.
        frame: i64,
    },
    /// How far the frame in hand is: nothing in its first second, then about five a second at most.
    Progress {
        /// Frame number.
        frame: i64,
        /// 0…1 of reading its window, encoding and denoising; rises.
        fraction: f64,
    },
    /// A frame is finished, one way or another.
    Frame {
        /// Frame number.
        frame: i64,
        /// What became of it.
        status: Status,
        /// The dial, after clamping.
        lambda: f32,
        /// The input file.
        source: PathBuf,
        /// The output file.
        output: PathBuf,
        /// Numbers of the neighbours that helped.
        neighbours: Vec<i64>,
        /// Why it failed or was skipped.
        reason: Option<String>,
        /// Time spent computing it.
        seconds: f64,
        /// Frames finished so far, this one included.
        finished: usize,
        /// Frames of the range that have a file.
        frames: usize,
    },
    /// Something about the shot, once.
    Warning(&'a Warning),
    /// A frame is bad, or the run cannot go on (then without a frame).
    Error {
        /// The bad frame.
        frame: Option<i64>,
        /// What is wrong and what to do.
        message: String,
    },
    /// Last of all, also after an interruption.
    Done(&'a Summary),
}

/// The result of a run.
#[derive(Debug, Default, Serialize)]
pub struct Summary {
    /// Frames of the range that have a file.
    pub frames: usize,
    /// Frames written.
    pub written: usize,
    /// Frames that were there already.
    pub skipped: usize,
    /// Frames that failed.
    pub failed: Vec<i64>,
    /// Frames done, now or earlier, without a neighbour whose file is bad.
    pub degraded: Vec<i64>,
    /// Frames, also those that only help, of which the system refused to read a file, and what it said: worth another try.
    #[serde(skip)]
    pub unreadable: BTreeMap<i64, String>,
    /// Frames asked for by number that have no file, as `3-5,9`.
    pub missing: String,
    /// Stopped by the [`CancelToken`](super::CancelToken).
    pub interrupted: bool,
    /// What ended the run early: a full disk, a bad frame with `strict`.
    #[serde(serialize_with = "as_text")]
    pub stopped: Option<Error>,
    /// Wall-clock time of the whole run.
    pub seconds: f64,
}

impl Summary {
    /// Every frame that was asked for is there, denoised with all that could help it.
    pub fn is_complete(&self) -> bool {
        self.written + self.skipped == self.frames
            && self.failed.is_empty()
            && self.degraded.is_empty()
            && self.missing.is_empty()
            && !self.interrupted
            && self.stopped.is_none()
    }
}

fn as_text<S: serde::Serializer>(error: &Option<Error>, to: S) -> Result<S::Ok, S::Error> {
    error.as_ref().map(ToString::to_string).serialize(to)
}
