//! Frames between one target and the next, and between one run and the next: encoded, and after their first pass.

use std::collections::BTreeMap;
use std::path::PathBuf;

use super::dial::{DialEntry, FrameDial};
use super::file_state::{Content, FileState, Stamp};
use super::job::Job;
use super::prepare::{Action, Plan};
use crate::engine::{EncodedFrame, FirstPass, LeftOut};
use crate::rules::pixel_checks::PixelChecks;
use crate::rules::window::{Unused, WindowFrame, neighbours};

/// A frame of the sliding window.
pub(super) struct Slot {
    /// One a view.
    pub encoded: Vec<EncodedFrame>,
    /// Time spent encoding it.
    pub seconds: f64,
    path: PathBuf,
    stamp: Option<Stamp>,
}

impl Slot {
    /// A frame of the plan.
    pub fn new(plan: &Plan, number: i64, encoded: Vec<EncodedFrame>, seconds: f64) -> Self {
        let path = plan.sources.good.get(&number).map(|s| s.path.clone()).unwrap_or_default();
        Self { encoded, seconds, path, stamp: plan.sources.stamp(number) }
    }

    /// Whether it is what a plan would read.
    fn fits(&self, plan: &Plan, number: i64) -> bool {
        let stamp = plan.sources.stamp(number);
        stamp.is_some() && stamp == self.stamp && plan.sources.good.get(&number).is_some_and(|s| s.path == self.path)
    }
}

/// A frame after its first pass.
pub(super) struct Made {
    /// One a view.
    pub views: Vec<FirstPass>,
    pub left_out: Vec<LeftOut>,
    /// What is odd about its mask.
    pub mask_note: Option<String>,
    pub dial: DialEntry,
    /// Time spent encoding it and on its first pass.
    pub seconds: f64,
    /// The files that it was made from.
    from: Files,
}

type Files = Vec<(i64, Option<Unused>, Option<Stamp>)>;

impl Made {
    /// Of a frame of the plan and its window.
    pub fn new(
        plan: &Plan,
        (number, window): (i64, &[WindowFrame]),
        (views, left_out): (Vec<FirstPass>, Vec<LeftOut>),
        (dial, mask_note): (DialEntry, Option<String>),
        seconds: f64,
    ) -> Self {
        Self { views, left_out, mask_note, dial, seconds, from: files(plan, number, window) }
    }

    /// The state of the image that was its mask.
    pub fn mask_state(&self) -> Option<FileState> {
        self.dial.lambda_image
    }

    /// Whether a run over the plan would make the same, and has all of it.
    fn fits(&self, job: &Job, plan: &Plan, number: i64) -> bool {
        let window = neighbours(number, plan.settings.window, |n| plan.sources.known(n));
        let is_target = plan.frames.iter().any(|f| f.frame == number && matches!(f.action, Action::Denoise(_)));
        let whole = !is_target || self.views.iter().all(|view| !view.is_averaged());
        whole && self.from == files(plan, number, &window) && self.dial.is_dial(&FrameDial::of(job, number))
    }
}

fn files(plan: &Plan, number: i64, window: &[WindowFrame]) -> Files {
    let own = (number, None, plan.sources.stamp(number));
    window.iter().map(|n| (n.number, n.unused, plan.sources.stamp(n.number))).chain([own]).collect()
}

/// What is kept: never more than one window of encoded frames, and what the second pass takes.
#[derive(Default)]
pub(super) struct WindowCache {
    pub ring: BTreeMap<i64, Slot>,
    /// Frames after their first pass, where a second one follows.
    pub made: BTreeMap<i64, Made>,
    /// The contents of files that were read, and their stamps.
    contents: BTreeMap<i64, (Stamp, Content)>,
    pub pixels: PixelChecks,
    /// The sequence and the settings that the frames belong to.
    of: (String, String),
}

impl WindowCache {
    /// Drops what a run over the plan cannot use.
    pub fn prepare(&mut self, sequence: &str, job: &Job, plan: &Plan) {
        let mut settings = plan.settings.clone();
        (settings.lambda, settings.lambda_masked) = (1.0, None); // The dial comes after the encoder.
        let of = (sequence.to_string(), settings.key());
        if of != self.of {
            *self = Self { of, ..Self::default() };
        }
        let first = plan.frames.iter().find(|f| matches!(f.action, Action::Denoise(_))).map(|f| f.frame);
        let near = |n: i64, reach: usize| first.is_some_and(|f| f.abs_diff(n) <= reach as u64);
        let context = plan.settings.context();
        self.ring.retain(|n, slot| near(*n, context) && slot.fits(plan, *n));
        self.made.retain(|n, made| near(*n, plan.settings.second_reach()) && made.fits(job, plan, *n));
        self.contents.retain(|n, _| near(*n, context));
    }

    /// Takes note of the content of a file that was read, or that it could not be read.
    pub fn saw(&mut self, plan: &Plan, number: i64, content: Option<Content>) {
        match plan.sources.stamp(number).zip(content) {
            Some(known) => _ = self.contents.insert(number, known),
            None => _ = self.contents.remove(&number),
        }
    }

    /// The state of a file, with its content where it was read.
    pub fn with_content(&self, number: i64, state: FileState) -> FileState {
        let known = self.contents.get(&number).filter(|(stamp, _)| *stamp == state.stamp);
        FileState { content: known.map(|(_, content)| *content), ..state }
    }

    /// Lets go of what no target from this one on needs.
    pub fn slide(&mut self, plan: &Plan, target: i64) {
        let (context, reach) = (plan.settings.context() as i64, plan.settings.second_reach() as i64);
        self.made.retain(|n, _| *n >= target - reach);
        self.contents.retain(|n, _| *n >= target - context);
    }
}
