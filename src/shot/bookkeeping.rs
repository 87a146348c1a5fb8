//! What a run takes note of: each frame's entry in the manifest, the counts, the events.

use std::time::{Duration, Instant};

use super::dial::{DialEntry, FrameDial};
use super::events::{Event, Status};
use super::planned_frame::PlannedFrame;
use super::prepare::is_degraded;
use super::run_state::Run;
use super::threads::{Written, ends_the_run};
use crate::error::{Error, Result};
use crate::rules::checks::{Warning, WarningKind};
use crate::rules::window::{Unused, WindowFrame};

/// The manifest is written at most this often.
const SAVE_EVERY: Duration = Duration::from_secs(1);

impl Run<'_> {
    /// Puts the frames that one really depends on into the manifest.
    pub(super) fn note_window(&mut self, target: &PlannedFrame, window: &[WindowFrame]) {
        let mut neighbours = self.plan.neighbour_entries(window);
        for neighbour in &mut neighbours {
            neighbour.stamp = neighbour.stamp.map(|state| self.cache.with_content(neighbour.frame, state));
        }
        let notes = self.notes.remove(&target.frame).unwrap_or_default();
        self.notes.retain(|n, _| *n > target.frame);
        if let Some(entry) = self.manifest.entry_mut(&target.output) {
            entry.neighbours = neighbours;
            entry.stamp = entry.stamp.map(|state| self.cache.with_content(target.frame, state));
            entry.warnings.extend(notes);
        }
    }

    /// Puts what a frame's first pass left out into the manifest, the image that was its mask and the dials of those that the second
    /// pass took; tells once what is odd about a mask.
    pub(super) fn note_pass(&mut self, target: &PlannedFrame, window: &[WindowFrame]) {
        let Some(made) = self.cache.made.get(&target.frame) else { return };
        if let (Some(note), false) = (&made.mask_note, self.mask_noted) {
            self.mask_noted = true;
            let message = format!("the mask of lambda in frame {} {note}", target.frame);
            (self.report)(Event::Warning(&Warning::new(WarningKind::LambdaMask, message)));
        }
        let Some(entry) = self.manifest.entry_mut(&target.output) else { return };
        (entry.left_out, entry.lambda_image) = (made.left_out.clone(), made.mask_state());
        let reach = self.plan.settings.second_reach() as u64;
        let taken = |n: &WindowFrame| n.unused.is_none() && u64::from(n.offset.unsigned_abs()) <= reach;
        for (entry, n) in entry.neighbours.iter_mut().zip(window).filter(|(_, n)| taken(n)) {
            if let Some(made) = self.cache.made.get(&n.number) {
                entry.dial = Some(made.dial.clone());
            } else {
                (entry.used, entry.reason) = (false, Some(Unused::Bad));
                entry.dial = Some(DialEntry::in_vain(&FrameDial::of(self.job, n.number)));
            }
        }
    }

    /// Takes note of what the writer did.
    pub(super) fn settle(&mut self, written: Written) {
        match written.result {
            Ok(state) => {
                let frame = self.plan.frames.get(written.index);
                if let Some(entry) = frame.and_then(|frame| self.manifest.entry_mut(&frame.output)) {
                    entry.output = state;
                }
                self.finish(written.index, Status::Denoised, None, written.seconds);
            }
            Err(error) => self.fail(written.index, error, written.seconds),
        }
        if self.saved.elapsed() >= SAVE_EVERY
            && let Err(error) = self.save()
        {
            self.stop(error);
        }
    }

    /// A frame that could not be denoised or written; the whole run ends where the next one would fare no better.
    pub(super) fn fail(&mut self, index: usize, error: Error, seconds: f64) {
        let number = self.plan.frames.get(index).map(|f| f.frame);
        if let (Some(number), Error::Io { path, .. }) = (number, &error)
            && !path.starts_with(&self.job.output)
        {
            self.summary.unreadable.insert(number, error.to_string());
        }
        (self.report)(Event::Error { frame: number, message: error.to_string() });
        self.finish(index, Status::Failed, Some(error.to_string()), seconds);
        if self.job.strict || ends_the_run(&error, &self.job.output) {
            self.stop(error);
        }
    }

    pub(super) fn stop(&mut self, error: Error) {
        if self.summary.stopped.is_none() {
            (self.report)(Event::Error { frame: None, message: format!("stopped: {error}; run again to continue") });
            self.summary.stopped = Some(error);
        }
    }

    /// Counts a frame and tells about it.
    pub(super) fn finish(&mut self, index: usize, status: Status, reason: Option<String>, seconds: f64) {
        let Some(frame) = self.plan.frames.get(index) else { return };
        self.finished += 1;
        let mut used = Vec::new();
        if let Some(entry) = self.manifest.entry_mut(&frame.output) {
            if status != Status::Skipped {
                (entry.status, entry.reason, entry.seconds) = (status, reason.clone(), seconds);
            }
            used.extend(entry.neighbours.iter().filter(|n| n.used).map(|n| n.frame));
            if status != Status::Failed && is_degraded(entry.neighbours.iter().map(|n| &n.reason)) {
                self.summary.degraded.push(frame.frame);
            }
        }
        match status {
            Status::Denoised => self.summary.written += 1,
            Status::Skipped => self.summary.skipped += 1,
            Status::Failed | Status::Planned => self.summary.failed.push(frame.frame),
        }
        (self.report)(Event::Frame {
            frame: frame.frame,
            status,
            lambda: frame.lambda,
            source: frame.source.clone(),
            output: frame.output.clone(),
            neighbours: if status == Status::Failed { Vec::new() } else { used },
            reason,
            seconds,
            finished: self.finished,
            frames: self.plan.frames.len(),
        });
    }

    pub(super) fn save(&mut self) -> Result<()> {
        self.saved = Instant::now();
        self.ledger.merge(&self.manifest)
    }
}
