//! What decides whether a frame is ready.

use std::time::Duration;

use crate::rules::frames::FrameSet;

/// What decides whether a frame is ready.
#[derive(Clone, Debug, Default)]
pub(super) struct ReadyRules {
    /// Frames on each side that help; None: as many as by default where there are motion vectors.
    pub window: Option<usize>,
    /// Motion vectors may be used.
    pub vectors: bool,
    /// A frame depends on twice the window.
    pub second_pass: bool,
    /// The frames that the shot will have.
    pub frames: Option<FrameSet>,
    /// How long no frame must have come before missing neighbours are given up.
    pub settle: Option<Duration>,
    /// Frames are made again when a neighbour comes that they lacked.
    pub redo: bool,
    /// How long a file must not have changed where nobody said that it was closed.
    pub quiet: Duration,
    /// Take what is there and wait for nothing.
    pub once: bool,
}

impl ReadyRules {
    /// Whether a frame is to be written; others only help.
    pub fn wants(&self, number: i64) -> bool {
        self.frames.as_ref().is_none_or(|set| set.contains(number))
    }
}
