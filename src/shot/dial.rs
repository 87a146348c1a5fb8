//! What a frame's first pass takes besides the frames: λ, and the mask of another λ.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::file_state::{FileMemory, FileState, Stamp};
use super::job::Job;

/// The dial of a frame as it is asked for.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FrameDial {
    pub lambda: f32,
    pub lambda_masked: Option<f32>,
    /// The image that is the mask.
    pub lambda_image: Option<PathBuf>,
}

impl FrameDial {
    /// That of a frame, whether it is to be written or not.
    pub fn of(job: &Job, frame: i64) -> Self {
        Self { lambda: job.lambda().at(frame), lambda_masked: job.lambda_masked(frame), lambda_image: job.lambda_image(frame) }
    }
}

/// The dial that the first pass of a frame beside another was made with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DialEntry {
    /// 1…64.
    pub lambda: f32,
    /// λ of what the mask marks, 1…64; None without a mask.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lambda_masked: Option<f32>,
    /// The image that was the mask, as it was.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lambda_image: Option<FileState>,
}

impl DialEntry {
    /// Of a dial whose image was in this state.
    pub(super) fn new(dial: &FrameDial, lambda_image: Option<FileState>) -> Self {
        Self { lambda: dial.lambda, lambda_masked: dial.lambda_masked, lambda_image }
    }

    /// Of a dial that the first pass could not be done with. An image that cannot be read is told as none, so that it is tried again.
    pub(super) fn in_vain(dial: &FrameDial) -> Self {
        let image = dial.lambda_image.as_deref().and_then(FileState::read);
        Self::new(dial, image.filter(|state| state.content.is_some()))
    }

    fn has_values_of(&self, dial: &FrameDial) -> bool {
        (self.lambda, self.lambda_masked) == (dial.lambda, dial.lambda_masked)
    }

    /// Whether a frame would have the same dial now.
    pub(super) fn is_same(&self, job: &Job, frame: i64, files: &mut FileMemory) -> bool {
        let now = FrameDial::of(job, frame);
        self.has_values_of(&now) && files.is_same(now.lambda_image.as_deref(), self.lambda_image)
    }

    /// As [`is_same`](Self::is_same), by the image's stamp alone.
    pub(crate) fn is_untouched(&self, job: &Job, frame: i64) -> bool {
        self.is_dial(&FrameDial::of(job, frame))
    }

    /// Whether it is this dial, by the image's stamp.
    pub(super) fn is_dial(&self, dial: &FrameDial) -> bool {
        let stamp = dial.lambda_image.as_deref().and_then(Stamp::of);
        self.has_values_of(dial) && stamp == self.lambda_image.map(|state| state.stamp)
    }
}
