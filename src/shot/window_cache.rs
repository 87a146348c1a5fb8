//! Encoded frames between one target and the next, and between one run and the next.

use std::collections::BTreeMap;
use std::path::PathBuf;

use super::file_state::{Content, Stamp};
use super::prepare::{Action, Plan};
use crate::engine::EncodedFrame;
use crate::rules::pixel_checks::PixelChecks;

/// A frame of the sliding window.
pub(super) struct Slot {
    /// One a view.
    pub encoded: Vec<EncodedFrame>,
    /// Time spent encoding it.
    pub seconds: f64,
    /// That of its file.
    pub content: Option<Content>,
    path: PathBuf,
    stamp: Option<Stamp>,
}

impl Slot {
    /// A frame of the plan.
    pub fn new(plan: &Plan, number: i64, encoded: Vec<EncodedFrame>, seconds: f64, content: Option<Content>) -> Self {
        let path = plan.sources.good.get(&number).map(|s| s.path.clone()).unwrap_or_default();
        Self { encoded, seconds, content, path, stamp: plan.sources.stamps.get(&number).copied().flatten() }
    }

    /// Whether it is what a plan would read.
    fn fits(&self, plan: &Plan, number: i64) -> bool {
        let stamp = plan.sources.stamps.get(&number).copied().flatten();
        stamp.is_some() && stamp == self.stamp && plan.sources.good.get(&number).is_some_and(|s| s.path == self.path)
    }
}

/// What is kept: never more than one window.
#[derive(Default)]
pub(super) struct WindowCache {
    pub ring: BTreeMap<i64, Slot>,
    pub pixels: PixelChecks,
    /// The sequence and the settings that the frames belong to.
    of: (String, String),
}

impl WindowCache {
    /// Drops what a run over the plan cannot use.
    pub fn prepare(&mut self, sequence: &str, plan: &Plan) {
        let mut settings = plan.settings.clone();
        (settings.lambda, settings.lambda_masked) = (1.0, None); // The dial comes after the encoder.
        let of = (sequence.to_string(), settings.key());
        if of != self.of {
            *self = Self { of, ..Self::default() };
        }
        let first = plan.frames.iter().find(|f| matches!(f.action, Action::Denoise(_))).map(|f| f.frame);
        let near = |n: i64| first.is_some_and(|f| f.abs_diff(n) <= plan.settings.window as u64);
        self.ring.retain(|n, slot| near(*n) && slot.fits(plan, *n));
    }
}
