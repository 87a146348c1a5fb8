//! What a run knows while it goes on.

use std::collections::BTreeMap;
use std::time::Instant;

use super::events::{Event, Summary};
use super::job::Job;
use super::ledger::Ledger;
use super::manifest::Manifest;
use super::prepare::{Plan, missing_text};
use super::window_cache::WindowCache;
use crate::error::Error;

/// The state of a run.
pub(super) struct Run<'a> {
    pub(super) job: &'a Job,
    pub(super) plan: &'a Plan,
    pub(super) report: &'a dyn Fn(Event<'_>),
    pub(super) cache: &'a mut WindowCache,
    pub(super) ledger: &'a mut Ledger,
    /// The frames of this run.
    pub(super) manifest: Manifest,
    pub(super) summary: Summary,
    /// Frames that turned out to be bad when they were decoded.
    pub(super) bad: BTreeMap<i64, Error>,
    /// Frames whose first pass went wrong, and the time that it took.
    pub(super) failed: BTreeMap<i64, (Error, f64)>,
    /// What was odd about a frame, until it is written.
    pub(super) notes: BTreeMap<i64, Vec<String>>,
    pub(super) finished: usize,
    /// Whether it was told that a mask has odd values.
    pub(super) mask_noted: bool,
    pub(super) saved: Instant,
}

impl<'a> Run<'a> {
    pub(super) fn new(
        job: &'a Job,
        plan: &'a Plan,
        report: &'a dyn Fn(Event<'_>),
        cache: &'a mut WindowCache,
        ledger: &'a mut Ledger,
    ) -> Self {
        let summary = Summary { frames: plan.frames.len(), missing: missing_text(plan), ..Summary::default() };
        let (bad, failed, notes, mask_noted) = (BTreeMap::new(), BTreeMap::new(), BTreeMap::new(), false);
        let manifest = Manifest::default();
        Self {
            job,
            plan,
            report,
            cache,
            ledger,
            manifest,
            summary,
            bad,
            failed,
            notes,
            finished: 0,
            mask_noted,
            saved: Instant::now(),
        }
    }
}
