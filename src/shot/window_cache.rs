//! Frames between one target and the next, and between one run and the next: encoded, and after their first pass.

use std::collections::BTreeMap;
use std::path::PathBuf;

use super::dial::{DialEntry, FrameDial};
use super::file_state::FileState;
use super::job::Job;
use super::planned_frame::Action;
use super::prepare::Plan;
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
    state: Option<FileState>,
}

impl Slot {
    /// A frame of the plan.
    pub fn new(plan: &Plan, number: i64, encoded: Vec<EncodedFrame>, seconds: f64) -> Self {
        let path = plan.sources.good.get(&number).map(|s| s.path.clone()).unwrap_or_default();
        Self { encoded, seconds, path, state: plan.sources.stamp(number) }
    }

    /// Whether it is what a plan would read.
    fn fits(&self, plan: &Plan, number: i64) -> bool {
        let state = plan.sources.stamp(number);
        state.is_some() && is_same(state, self.state) && plan.sources.good.get(&number).is_some_and(|s| s.path == self.path)
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

type File = (i64, Option<Unused>, Option<FileState>);
type Files = Vec<File>;

/// Whether a file is as it was, as far as the system tells.
fn is_same(now: Option<FileState>, then: Option<FileState>) -> bool {
    match (now, then) {
        (Some(now), Some(then)) => now.is_untouched_since(&then),
        (now, then) => now.is_none() && then.is_none(),
    }
}

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
        let now = files(plan, number, &window);
        let same = |(now, then): (&File, &File)| (now.0, now.1) == (then.0, then.1) && is_same(now.2, then.2);
        let same_files = now.len() == self.from.len() && now.iter().zip(&self.from).all(same);
        whole && same_files && self.dial.is_dial(&FrameDial::of(job, number))
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
    /// The files that were read, with their contents.
    read: BTreeMap<i64, FileState>,
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
        self.read.retain(|n, _| near(*n, context));
    }

    /// Takes note of a file that was read, or that it could not be read.
    pub fn saw(&mut self, number: i64, state: Option<FileState>) {
        match state {
            Some(state) => _ = self.read.insert(number, state),
            None => _ = self.read.remove(&number),
        }
    }

    /// The state of a file, with its content where it was read.
    pub fn with_content(&self, number: i64, state: FileState) -> FileState {
        let known = self.read.get(&number).filter(|known| known.is_untouched_since(&state));
        known.copied().unwrap_or(state)
    }

    /// Lets go of what no target from this one on needs.
    pub fn slide(&mut self, plan: &Plan, target: i64) {
        let (context, reach) = (plan.settings.context() as i64, plan.settings.second_reach() as i64);
        self.made.retain(|n, _| *n >= target - reach);
        self.read.retain(|n, _| *n >= target - context);
    }
}
