//! What is known of a frame and its file.

use std::time::Duration;

use crate::shot::Stamp;

/// A file that was not whole is looked at again this often, for a minute after its last change.
pub(super) const LOOK_AGAIN: Duration = Duration::from_secs(5);
pub(super) const LOOK_AGAIN_FOR: Duration = Duration::from_secs(60);

/// How a frame was made, to tell whether it is to be made again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Made {
    /// The input as it was.
    pub stamp: Option<Stamp>,
    /// The files beside it as they were, by offset; those that were there.
    pub around: Box<[(i32, Stamp)]>,
    /// Frames on each side that could help.
    pub window: usize,
    /// It was tried in vain.
    pub failed: bool,
}

/// What a look into a file found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum FileCheck {
    /// Header, chunk table and chunks are there.
    Whole { vector: bool },
    /// Something is missing.
    Partial(String),
    /// It could not be read just now.
    Unreadable(String),
}

/// What is known of a frame's file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Landing {
    Unchecked { closed: bool },
    Whole { vector: bool },
    Partial { reason: String, again: Option<Duration> },
    Gone,
}

impl Landing {
    /// The system refused to read it; the reason follows `it`.
    pub fn unreadable(reason: &str, now: Duration) -> Self {
        Self::Partial { reason: format!("could not be read: {reason}"), again: Some(now + LOOK_AGAIN) }
    }
}

/// What is known of a frame.
#[derive(Clone, Debug)]
pub(super) struct FrameState {
    pub stamp: Stamp,
    /// When the stamp was first seen.
    pub since: Duration,
    pub landing: Landing,
    /// It has been whole before.
    pub landed: bool,
    pub made: Option<Made>,
    pub held: Duration,
    /// A run could not read it, though nothing was missing.
    pub unread: bool,
}

impl FrameState {
    /// Whatever kept a run from reading it is over.
    pub fn becomes_readable(&mut self) {
        if std::mem::take(&mut self.unread) {
            self.made.take_if(|made| made.failed);
        }
    }
}
