//! The work: frames that are ready, a few at a time, claimed, denoised, and taken note of.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::claims::{Claim, Claims, tidy};
use super::events::WatchEvent;
use super::shots::Shot;
use super::tree::{ShotKey, Tree};
use crate::engine::Engine;
use crate::error::{Error, Result};
use crate::rules::checks::WarningKind;
use crate::shot::{self, CancelToken, Manifest, Runner, Status, Summary};

/// Frames of one run at most; what lands meanwhile waits for its end.
const BATCH: usize = 16;
/// A frame that another process is at is looked at again after this long.
const THEIRS: Duration = Duration::from_secs(1);
/// A frame that was made with a mask that is another one by now is made again after this long.
const MAKE_AGAIN: Duration = Duration::from_secs(5);
/// Where nothing can be written, the wait is this long at first and doubles up to `LAST_PAUSE`.
const FIRST_PAUSE: Duration = Duration::from_secs(2);
const LAST_PAUSE: Duration = Duration::from_secs(60);

/// Denoises frames that are ready.
pub(super) struct Worker<'a> {
    once: bool,
    report: &'a dyn Fn(WatchEvent<'_>),
    cancel: &'a CancelToken,
    runner: Runner<'a>,
    claims: Claims,
    /// Output folders whose leftovers were cleared.
    swept: BTreeSet<PathBuf>,
    /// The shot that had its turn last.
    turn: Option<ShotKey>,
    /// Nothing can be written before then, and the wait after the next failure.
    pause: (Duration, Duration),
    /// What ended the work early, with `once`.
    pub stopped: Option<Error>,
    began: Instant,
}

impl<'a> Worker<'a> {
    /// With `once` an output folder that cannot be written to ends the work; times count from `began`.
    pub fn new(
        once: bool,
        engine: &'a Engine,
        report: &'a dyn Fn(WatchEvent<'_>),
        cancel: &'a CancelToken,
        began: Instant,
    ) -> Self {
        Self {
            once,
            report,
            cancel,
            runner: Runner::new(engine),
            claims: Claims::new(),
            swept: BTreeSet::new(),
            turn: None,
            pause: (Duration::ZERO, FIRST_PAUSE),
            stopped: None,
            began,
        }
    }

    fn now(&self) -> Duration {
        self.began.elapsed()
    }

    /// Leaves nothing of the claims behind.
    pub fn tidy(&self) {
        self.swept.iter().for_each(|output| tidy(output));
    }

    /// Denoises some frames of one shot. False where there is nothing to do.
    pub fn work(&mut self, shots: &mut BTreeMap<ShotKey, Shot>, tree: &Tree) -> bool {
        if self.now() < self.pause.0 {
            return false;
        }
        // The shots take turns.
        let after = |k: &&ShotKey| self.turn.as_ref().is_none_or(|turn| *k > turn);
        let keys: Vec<ShotKey> = shots.keys().filter(after).chain(shots.keys().filter(|k| !after(k))).cloned().collect();
        for key in keys {
            let Some(shot) = shots.get_mut(&key) else { continue };
            match self.work_on(shot, tree) {
                Ok(false) => continue,
                Ok(true) => self.turn = Some(key),
                Err(error) => self.pause(error),
            }
            return true;
        }
        false
    }

    /// Says what is wrong with the output folder and waits.
    fn pause(&mut self, error: Error) {
        if self.once {
            (self.report)(WatchEvent::Warning { kind: WarningKind::Note, message: format!("stopped: {error}") });
            self.stopped = Some(error);
            return;
        }
        let wait = self.pause.1;
        self.pause = (self.now() + wait, (wait * 2).min(LAST_PAUSE));
        let message = format!("{error}: free space or allow writing there; the next attempt is in {} s", wait.as_secs());
        (self.report)(WatchEvent::Paused { message, seconds: wait.as_secs_f64() });
    }

    /// Denoises some frames of a shot. False where none is ready. The error is about the output folder.
    fn work_on(&mut self, shot: &mut Shot, tree: &Tree) -> Result<bool> {
        let ready = shot.frames.ready(&shot.rules, self.now());
        if ready.is_empty() {
            return Ok(false);
        }
        let output = shot.output().to_path_buf();
        if self.swept.insert(output.clone()) {
            self.claims.sweep(&output);
        }
        let mut held = None;
        let mut todo = Vec::new();
        for some in ready.chunks(BATCH) {
            for number in self.still_to_do(shot, some) {
                let held = match &mut held {
                    Some(held) => held,
                    None => held.insert(self.claims.open(&output)?),
                };
                let file = shot.file(number);
                match self.claims.claim(held, &file, self.now())? {
                    Claim::Theirs => shot.frames.hold(number, self.now() + THEIRS),
                    // Another process may have done it right before.
                    Claim::Ours if self.still_to_do(shot, &[number]).is_empty() => held.release(&file),
                    Claim::Ours => todo.push(number),
                }
                if todo.len() == BATCH {
                    break;
                }
            }
            if todo.len() == BATCH || self.cancel.is_cancelled() {
                break;
            }
        }
        if todo.is_empty() {
            return Ok(false);
        }
        let done = self.denoise(shot, tree, &todo, &output);
        drop(held);
        done.map(|()| true)
    }

    /// Those of the frames that no process has done meanwhile.
    fn still_to_do(&mut self, shot: &mut Shot, numbers: &[i64]) -> Vec<i64> {
        let empty = Manifest::default();
        let manifest = match self.runner.ledger(shot.output()).read() {
            Ok(manifest) => manifest,
            Err(error) => {
                if shot.warned.insert("manifest".into()) {
                    let message = format!("{error}: what it says about the frames there is not known");
                    (self.report)(WatchEvent::Warning { kind: WarningKind::Manifest, message });
                }
                &empty
            }
        };
        let mut todo = Vec::new();
        for &number in numbers {
            match shot.learn(number, manifest) {
                Ok(()) if shot.frames.needs_work(number, &shot.rules) => todo.push(number),
                Ok(()) => {}
                Err(error) => {
                    let event = shot::Event::Error { frame: Some(number), message: error.to_string() };
                    (self.report)(WatchEvent::Shot { shot: &shot.name, event });
                    shot.give_up(number);
                }
            }
        }
        todo
    }

    /// Runs over frames that are claimed; where they cannot be done together, one by one.
    fn denoise(&mut self, shot: &mut Shot, tree: &Tree, numbers: &[i64], output: &Path) -> Result<()> {
        match self.run_over(shot, tree, numbers) {
            Ok(summary) => self.take_note(shot, numbers, summary, output),
            Err(Error::Io { path, source }) if path.starts_with(output) => Err(Error::Io { path, source }),
            Err(_) if numbers.len() > 1 => numbers.iter().try_for_each(|n| self.denoise(shot, tree, &[*n], output)),
            Err(error) => {
                for &number in numbers {
                    let event = shot::Event::Error { frame: Some(number), message: error.to_string() };
                    (self.report)(WatchEvent::Shot { shot: &shot.name, event });
                    shot.give_up(number);
                    // The input may be gone, or back in a moment.
                    if let Error::Io { .. } = error {
                        shot.frames.set_unread(number, &error.to_string(), self.now());
                    }
                }
                Ok(())
            }
        }
    }

    fn run_over(&mut self, shot: &mut Shot, tree: &Tree, numbers: &[i64]) -> Result<Summary> {
        let job = shot.job_for(tree, numbers);
        let counts = shot.frames.counts(&shot.rules);
        let (name, warned, started) = (shot.name.clone(), RefCell::new(&mut shot.warned), shot.started);
        let report = |event: shot::Event<'_>| {
            let event = match event {
                shot::Event::Start { .. } if started => return,
                shot::Event::Start { sequence, output, todo, window, lambda, .. } => {
                    shot::Event::Start { sequence, output, frames: counts.landed, todo, window, lambda }
                }
                // What is done so far, of what has landed so far.
                shot::Event::Frame { frame, status, lambda, source, output, neighbours, reason, seconds, finished, .. } => {
                    let done = counts.done - counts.of_gone;
                    let (finished, frames) = ((done + finished).min(counts.landed), counts.landed);
                    shot::Event::Frame { frame, status, lambda, source, output, neighbours, reason, seconds, finished, frames }
                }
                // Which frames are made again is reported each time, the rest once a shot.
                shot::Event::Warning(w)
                    if w.kind != WarningKind::Redone && !warned.borrow_mut().insert(format!("{:?}", w.kind)) =>
                {
                    return;
                }
                shot::Event::Error { frame: None, .. } | shot::Event::Done(_) => return,
                event => event,
            };
            (self.report)(WatchEvent::Shot { shot: &name, event });
        };
        let summary = self.runner.run(&job, &report, self.cancel)?;
        shot.started = true;
        Ok(summary)
    }

    /// Learns what a run has done.
    fn take_note(&mut self, shot: &mut Shot, numbers: &[i64], summary: Summary, output: &Path) -> Result<()> {
        let manifest = self.runner.ledger(output).read()?;
        for &number in numbers {
            let file = output.join(shot.file(number));
            let Some(entry) = manifest.entry(&file) else { continue };
            if entry.status == Status::Denoised {
                shot.own.insert(number);
            }
            let made = shot.made(number, entry, manifest);
            let made = match entry.status {
                // The folder was at fault, not the frame.
                Status::Failed if summary.stopped.is_some() => continue,
                Status::Planned => continue,
                Status::Failed | Status::Skipped => made.or_else(|| Shot::as_made(entry, manifest)),
                Status::Denoised if self.once => made.or_else(|| Shot::as_made(entry, manifest)),
                Status::Denoised => made,
            };
            match made {
                Some(made) => {
                    shot.frames.set_made(number, Some(made));
                    shot.degraded.remove(&number);
                }
                // A mask changed meanwhile, or one of a frame beside it could not be read.
                None => shot.frames.hold(number, self.began.elapsed() + MAKE_AGAIN),
            }
        }
        for (number, reason) in &summary.unreadable {
            shot.frames.set_unread(*number, reason, self.began.elapsed());
        }
        shot.written += summary.written;
        shot.degraded.extend(summary.degraded);
        match summary.stopped {
            Some(error) => Err(error),
            None => {
                self.pause = (Duration::ZERO, FIRST_PAUSE);
                Ok(())
            }
        }
    }
}
