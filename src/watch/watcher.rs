//! The loop: take in what changed, look into files, work, wait.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use super::WatchOptions;
use super::allocator::give_memory_back;
use super::events::{Waiting, WatchEvent, WatchSummary};
use super::folder::Folder;
use super::folder_events::Changes;
use super::ready::{FrameCounts, LEAST};
use super::shots::Shot;
use super::work::Worker;
use crate::engine::Engine;
use crate::error::{Error, Result};
use crate::io::sequence::Sequence;
use crate::shot::{CancelToken, Job};
use crate::words;

/// Free memory is given back this often.
const TRIM: Duration = Duration::from_secs(5);
/// The longest wait between two looks.
const TICK: Duration = Duration::from_millis(200);
/// A file must have been incomplete this long to be reported.
const REPORT_AFTER: Duration = Duration::from_secs(5);

/// A watch.
pub(super) struct Watcher<'a> {
    options: &'a WatchOptions,
    report: &'a dyn Fn(WatchEvent<'_>),
    cancel: &'a CancelToken,
    folder: Folder<'a>,
    worker: Worker<'a>,
    next_trim: Duration,
    /// The numbers that were reported last, where nothing happened since.
    reported: Option<Waiting>,
    began: Instant,
}

impl<'a> Watcher<'a> {
    /// As [`super::watch`].
    pub fn new(
        options: &'a WatchOptions,
        job: &'a dyn Fn(Sequence) -> Result<Job>,
        engine: &'a Engine,
        report: &'a dyn Fn(WatchEvent<'_>),
        cancel: &'a CancelToken,
    ) -> Result<Self> {
        let began = Instant::now();
        let folder = Folder::new(options, job, engine.identity(), report, began)?;
        let worker = Worker::new(options.once, engine, report, cancel, began);
        Ok(Self { options, report, cancel, folder, worker, next_trim: TRIM, reported: None, began })
    }

    /// Time since the start.
    fn now(&self) -> Duration {
        self.began.elapsed()
    }

    /// Runs until cancelled or done.
    pub fn run(mut self) -> Result<WatchSummary> {
        self.folder.begin();
        if self.options.once && !self.folder.tree.input.is_dir() {
            let reason = "there is no such folder".into();
            return Err(Error::BadInput { input: self.folder.tree.input.display().to_string(), reason });
        }
        let mut changes = Changes::default();
        while !self.cancel.is_cancelled() && self.worker.stopped.is_none() {
            self.folder.take_in(changes)?;
            if self.folder.look_into_files(self.cancel) {
                self.reported = None;
            }
            changes = match self.worker.work(&mut self.folder.shots, &self.folder.tree) {
                true => {
                    // The end of the work is reported, even where the numbers are as before.
                    self.reported = None;
                    if self.now() >= self.next_trim {
                        give_memory_back();
                        self.next_trim = self.now() + TRIM;
                    }
                    self.folder.changes(Duration::ZERO)
                }
                // Nobody who waits for the end is told of frames that were deleted meanwhile.
                false if self.is_at_its_end() && self.forget_lost() => Changes::default(),
                false if self.options.once && self.is_finished() => break,
                false if self.has_all() || self.is_switched_off() => {
                    self.report_waiting();
                    break;
                }
                false => {
                    self.report_waiting();
                    self.folder.changes(TICK)
                }
            };
        }
        self.finish()
    }

    /// Whether all is done, as far as is known.
    fn is_at_its_end(&self) -> bool {
        (self.options.once && self.is_finished()) || self.has_all()
    }

    /// Has the frames of one shot made again whose denoised files are gone. False where none is in any.
    fn forget_lost(&mut self) -> bool {
        self.folder.shots.values_mut().any(Shot::forget_lost)
    }

    /// With `once`: nothing is left to do.
    fn is_finished(&self) -> bool {
        let now = self.now();
        let idle = |s: &Shot| s.frames.held(now) == 0 && s.frames.due(&s.rules, now).is_empty();
        self.folder.shots.values().all(idle)
    }

    /// Every frame that was asked for by number is done or has failed for good, in every shot that has one of them; no other shot is
    /// known to come.
    fn has_all(&self) -> bool {
        let now = self.now();
        let mut wanted = self.wanted().peekable();
        wanted.peek().is_some() && wanted.all(|s| s.frames.has_all(&s.rules, now)) && !self.folder.may_bring_more()
    }

    /// Frames were asked for by number, and nothing that may be denoised came for a while.
    fn is_switched_off(&self) -> bool {
        let settle = self.options.settle.unwrap_or(LEAST);
        self.folder.has_end() && self.folder.switched_off().is_some_and(|(_, since)| self.now().saturating_sub(since) >= settle)
    }

    /// The shots that hold a frame that is to be written.
    fn wanted(&self) -> impl Iterator<Item = &Shot> {
        self.folder.shots.values().filter(|s| s.rules.frames.is_none() || s.frames.any_wanted(&s.rules))
    }

    /// The frames that were asked for and have not come: `3-5,9`; of several shots each with its name.
    fn missing(&self) -> String {
        let all = self.wanted().count() == 0;
        let shots: Vec<&Shot> = if all { self.folder.shots.values().collect() } else { self.wanted().collect() };
        let missing = |shot: &Shot| {
            let there: Vec<i64> = shot.frames.there().collect();
            words::ranges(&shot.rules.frames.as_ref().map(|set| set.missing(&there)).unwrap_or_default())
        };
        match shots.as_slice() {
            [only] => missing(only),
            several => {
                let parts = several.iter().map(|s| (s, missing(s))).filter(|(_, missing)| !missing.is_empty());
                parts.map(|(shot, missing)| format!("{} {missing}", shot.name)).collect::<Vec<_>>().join("; ")
            }
        }
    }

    fn counts(&self) -> (FrameCounts, usize) {
        let (mut all, mut held) = (FrameCounts::default(), 0);
        for shot in self.folder.shots.values() {
            let counts = shot.frames.counts(&shot.rules);
            all.landed += counts.landed;
            all.done += counts.done;
            all.of_gone += counts.of_gone;
            all.failed += counts.failed;
            all.waiting += counts.waiting;
            all.partial += counts.partial;
            held += shot.frames.held(self.now());
        }
        (all, held)
    }

    /// Reports how far the watch is, where that changed, and which files have stayed incomplete.
    fn report_waiting(&mut self) {
        let now = self.now();
        self.report_incomplete(|since| now.saturating_sub(since) >= REPORT_AFTER);
        let (counts, held) = self.counts();
        let waiting = Waiting {
            input: self.folder.is_there(),
            landed: counts.landed,
            denoised: counts.done - counts.of_gone,
            waiting: counts.waiting.saturating_sub(held),
            incomplete: counts.partial,
            elsewhere: held,
            failed: counts.failed,
        };
        if self.reported.as_ref() != Some(&waiting) {
            (self.report)(WatchEvent::Waiting(&waiting));
            self.reported = Some(waiting);
        }
    }

    fn report_incomplete(&mut self, long: impl Fn(Duration) -> bool) {
        for shot in self.folder.shots.values_mut() {
            let partial: Vec<(i64, String)> =
                shot.frames.partial().filter(|(_, _, since)| long(*since)).map(|(n, why, _)| (n, why.into())).collect();
            for (frame, reason) in partial {
                let Some(stamp) = shot.frames.stamp(frame) else { continue };
                if shot.reported_incomplete.insert(frame, stamp) != Some(stamp) {
                    let source = shot.source(&self.folder.tree, frame);
                    (self.report)(WatchEvent::Incomplete { shot: &shot.name, frame, source, reason });
                }
            }
        }
    }

    fn finish(mut self) -> Result<WatchSummary> {
        self.folder.close();
        if self.options.once {
            self.report_incomplete(|_| true);
        }
        let mut done = WatchSummary { interrupted: self.cancel.is_cancelled(), ..WatchSummary::default() };
        for shot in self.folder.shots.values() {
            let counts = shot.frames.counts(&shot.rules);
            done.frames += counts.landed;
            done.written += shot.written;
            done.skipped += counts.done.saturating_sub(shot.own.len());
            let mut failed: BTreeSet<i64> = shot.frames.failed().collect();
            if self.options.once {
                failed.extend(shot.frames.partial().map(|(n, ..)| n));
            }
            done.failed.extend(failed);
            done.degraded.extend(&shot.degraded);
        }
        done.missing = self.missing();
        done.stopped = self.worker.stopped.as_ref().map(ToString::to_string);
        done.seconds = self.now().as_secs_f64();
        self.worker.tidy();
        if let (Some((by, _)), false) = (self.folder.switched_off(), done.interrupted) {
            return Err(Error::SwitchedOff { by: by.to_owned() });
        }
        if self.options.once && self.folder.shots.is_empty() && !done.interrupted {
            let input = &self.folder.tree.input;
            std::fs::read_dir(input).map_err(|e| Error::io(input, e))?;
            let reason = "holds no .exr files with a frame number in their names".into();
            return Err(Error::BadInput { input: self.folder.tree.input.display().to_string(), reason });
        }
        (self.report)(WatchEvent::Done(&done));
        Ok(done)
    }
}
