//! What a report holds.

use std::collections::BTreeMap;

use serde::Serialize;

use super::candidates::Candidate;
use super::machine::Machine;
use super::statistics::Spread;
use crate::engine::STAGES;
use crate::stability;

/// What the errors are measured against.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Basis {
    /// References: SMAPE, relMSE, flicker.
    Reference,
    /// Noisy frames before and after: an estimate of relMSE, and how much the picture changes along the motion.
    Estimate,
}

/// The errors that a report shows, in this order: SMAPE, relMSE, flicker.
pub const ERRORS: usize = 3;

impl Basis {
    /// What each error is called; None where there is none.
    pub fn titles(self) -> [Option<&'static str>; ERRORS] {
        match self {
            Self::Reference => [Some("SMAPE"), Some("relMSE"), Some("flicker")],
            Self::Estimate => [None, Some("relMSE, estimated"), Some("change along the motion")],
        }
    }
}

/// Everything that was measured.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The version of Hush.
    pub hush: &'static str,
    /// The shot's name.
    pub sequence: String,
    /// The references' path.
    pub reference: Option<String>,
    /// The size of a frame.
    pub columns: usize,
    pub rows: usize,
    /// The frames measured, ascending.
    pub frames: Vec<i64>,
    /// How many the shot has, or `--frames` named, that can be read and have a reference where there are any.
    pub of_frames: usize,
    /// How often each frame was timed.
    pub repeats: usize,
    pub machine: Machine,
    pub basis: Basis,
    /// One a candidate, the noisy picture first.
    pub rows_by_setting: Vec<SettingRow>,
    /// About the estimate, where there is one.
    pub estimate: Option<EstimateNote>,
    /// The estimate beside the measured error, where there are references.
    pub checks: Vec<EstimateCheck>,
    /// The table of numerical soundness, where it was asked for.
    pub stability: Vec<stability::CheckRow>,
    /// What a reader must know, a sentence each.
    pub remarks: Vec<String>,
    /// Frames that could not be measured, those beside the measured ones that cannot be read included, and why.
    pub failed: BTreeMap<i64, String>,
}

/// One candidate.
#[derive(Clone, Debug, Serialize)]
pub struct SettingRow {
    #[serde(flatten)]
    pub candidate: Candidate,
    /// Seconds a frame: the median, least and greatest of the repeats, each the mean over the frames. None for the noisy picture.
    pub seconds: Option<Spread>,
    /// Seconds a frame by repeat.
    pub times: Vec<f64>,
    /// The median over the frames, and the quartiles.
    pub errors: [Option<Spread>; ERRORS],
    /// Whether nothing is both faster and better, for each error.
    pub front: [bool; ERRORS],
    /// By frame.
    pub by_frame: Vec<FrameErrors>,
    /// Seconds a frame in each stage, in the order of [`STAGES`].
    pub stages: Option<[f64; STAGES.len()]>,
    /// The mean share of pixels that was not computed.
    pub left_out: Option<f64>,
    /// Bytes of the window's frames and of the largest tile's buffers, by Hush's own account.
    pub window_bytes: Option<usize>,
    pub tile_bytes: Option<usize>,
    /// Peak resident bytes of the process, for OIDN, which has one of its own.
    pub peak_bytes: Option<u64>,
}

impl SettingRow {
    /// The number that stands for an error: the median over the frames; of an estimate the mean, which alone has no bias.
    pub fn error(&self, which: usize, basis: Basis) -> Option<f64> {
        self.errors[which].map(|s| if basis == Basis::Estimate && which == 1 { s.mean } else { s.median })
    }

    /// Time and one error.
    pub fn point(&self, which: usize, basis: Basis) -> Option<(f64, f64)> {
        Some((self.seconds?.median, self.error(which, basis)?))
    }
}

/// One frame of one candidate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FrameErrors {
    /// Its number.
    pub frame: i64,
    /// As [`Basis::titles`] says.
    pub errors: [Option<f64>; ERRORS],
}

/// How the estimate was made.
#[derive(Clone, Debug, Serialize)]
pub struct EstimateNote {
    /// Each frame was judged by those so many frames before and after it.
    pub distance: usize,
    /// Frames that could be judged.
    pub frames: usize,
    /// The mean share of their pixels that could be followed.
    pub share: f64,
    /// The largest standard error of a candidate's mean.
    pub deviation: f64,
}

/// An estimate beside what the references say, on the same pixels.
#[derive(Clone, Debug, Serialize)]
pub struct EstimateCheck {
    /// The candidate's name.
    pub name: String,
    /// The estimated relMSE.
    pub estimated: f64,
    /// Its standard error.
    pub deviation: f64,
    /// The relMSE against the references, their noise included.
    pub measured: f64,
}
