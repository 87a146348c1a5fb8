//! The run over a shot: a decoder thread ahead, the engine here, a writer thread behind, a window of encoded frames between.

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, channel, sync_channel};
use std::thread;
use std::time::Instant;

use super::cancel::CancelToken;
use super::events::{Event, Status, Summary};
use super::job::Job;
use super::ledger::Ledger;
use super::output::prepare_folder;
use super::passes::{decode_order, first_passes};
use super::planned_frame::Action;
use super::prepare::Plan;
use super::progress::FrameProgress;
use super::run_state::Run;
use super::threads::{Decoded, Work, Written, decode, state_of, write};
use super::window_cache::WindowCache;
use crate::engine::Engine;
use crate::error::{Error, Result};
use crate::rules::checks::{Warning, WarningKind};

/// Frames of more bytes than this are decoded one ahead instead of two.
const BIG_FRAME: usize = 128 << 20;

/// Denoises a shot. Events are reported on the calling thread, in order. Outputs appear whole or not at all; a run that was
/// stopped or killed is continued by running the same job again.
///
/// # Errors
/// As [`Plan::new`], and where the output folder cannot be made. What goes wrong later stands in the [`Summary`].
pub fn run(job: &Job, engine: &Engine, report: &dyn Fn(Event<'_>), cancel: &CancelToken) -> Result<Summary> {
    Runner::new(engine).run(job, report, cancel)
}

/// Runs one job after another. What two runs over parts of the same shot have in common is read and encoded once: one window
/// of frames is kept from run to run, and the manifests.
pub struct Runner<'e> {
    engine: &'e Engine,
    cache: WindowCache,
    ledgers: BTreeMap<PathBuf, Ledger>,
}

impl<'e> Runner<'e> {
    /// A runner that has nothing yet.
    pub fn new(engine: &'e Engine) -> Self {
        Self { engine, cache: WindowCache::default(), ledgers: BTreeMap::new() }
    }

    /// The manifest of an output folder.
    pub fn ledger(&mut self, output: &Path) -> &mut Ledger {
        self.ledgers.entry(output.to_path_buf()).or_insert_with(|| Ledger::new(output))
    }

    /// As [`run`].
    ///
    /// # Errors
    /// As [`run`].
    pub fn run(&mut self, job: &Job, report: &dyn Fn(Event<'_>), cancel: &CancelToken) -> Result<Summary> {
        let began = Instant::now();
        let Self { engine, cache, ledgers } = self;
        let ledger = ledgers.entry(job.output.clone()).or_insert_with(|| Ledger::new(&job.output));
        let plan = Plan::with(job, engine.identity(), ledger)?;
        prepare_folder(&job.output)?;
        cache.prepare(&sequence_key(job), job, &plan);
        let mut run = Run::new(job, &plan, report, cache, ledger);
        run.start();
        match run.save() {
            // A shot that is done may lie where nobody may write any more.
            Err(error) if run.is_idle() => run.warn(WarningKind::Manifest, format!("{error}: it is left as it is")),
            Err(error) => return Err(error),
            Ok(()) => {
                run.denoise_all(engine, cancel);
                if let Err(error) = run.save() {
                    run.stop(error);
                }
            }
        }
        let refused = |(n, e): (&i64, &Error)| matches!(e, Error::Io { .. }).then(|| (*n, e.to_string()));
        run.summary.unreadable.extend(plan.sources.bad.iter().chain(&run.bad).filter_map(refused));
        let mut summary = run.summary;
        summary.seconds = began.elapsed().as_secs_f64();
        report(Event::Done(&summary));
        Ok(summary)
    }
}

impl Run<'_> {
    /// Says what the plan says, and settles the frames that need no work.
    fn start(&mut self) {
        let plan = self.plan;
        let todo = plan.frames.iter().filter(|f| matches!(f.action, Action::Denoise(_))).count();
        (self.report)(Event::Start {
            sequence: &self.job.sequence.name,
            output: &self.job.output,
            frames: plan.frames.len(),
            todo,
            window: plan.settings.window,
            lambda: plan.settings.lambda,
        });
        plan.warnings.iter().for_each(|w| (self.report)(Event::Warning(w)));
        for (number, error) in &plan.sources.bad {
            (self.report)(Event::Error { frame: Some(*number), message: error.to_string() });
            let state = self.job.sequence.path(*number).and_then(|path| state_of(path, Err(error), plan.sources.stamp(*number)));
            self.cache.saw(*number, state);
        }
        for (index, frame) in plan.frames.iter().enumerate() {
            let key = self.manifest.settings_key(&plan.settings_of(frame));
            let mut entry = plan.entry(frame, &key);
            let before = plan.before.get(&frame.frame);
            if let (Action::Skip, Some(before)) = (&frame.action, before) {
                entry = plan.skipped(before, frame);
            }
            self.manifest.insert(&frame.output, entry);
            match &frame.action {
                Action::Denoise(_) => {}
                Action::Skip => self.finish(index, Status::Skipped, Some("already done".into()), 0.0),
                Action::Fail(reason) => {
                    if !plan.sources.bad.contains_key(&frame.frame) {
                        (self.report)(Event::Error { frame: Some(frame.frame), message: reason.clone() });
                    }
                    self.finish(index, Status::Failed, Some(reason.clone()), 0.0);
                }
            }
        }
    }

    /// Whether no frame is to be made.
    fn is_idle(&self) -> bool {
        !self.plan.frames.iter().any(|f| matches!(f.action, Action::Denoise(_)))
    }

    fn warn(&self, kind: WarningKind, message: String) {
        (self.report)(Event::Warning(&Warning::new(kind, message)));
    }

    fn denoise_all(&mut self, engine: &Engine, cancel: &CancelToken) {
        let plan = self.plan;
        let passes = first_passes(plan, self.cache);
        let order = decode_order(plan, &passes, &self.cache.ring);
        let left = order.clone();
        let ahead = usize::from(plan.sources.good.values().map(|s| s.bytes()).max().unwrap_or(0) <= BIG_FRAME);
        let keep_noisy = self.job.settings.keep_noisy.unwrap_or_default();
        thread::scope(|scope| {
            let (decoded_in, decoded) = sync_channel(ahead);
            let (work, work_out) = sync_channel(0);
            let (written_in, written) = channel();
            scope.spawn(move || decode(&order, plan, engine, decoded_in));
            scope.spawn(move || write(plan, keep_noisy, engine, &work_out, &written_in));
            self.compute(engine, cancel, (passes, left), &decoded, &work, &written);
            // Both threads end when their channels do; what the writer holds is written whole.
            drop((decoded, work));
            written.iter().for_each(|w| self.settle(w));
        });
        self.summary.interrupted = cancel.is_cancelled() && self.finished < plan.frames.len();
    }

    /// Slides the window over the frames to do. Ends early when cancelled or stopped.
    fn compute(
        &mut self,
        engine: &Engine,
        cancel: &CancelToken,
        (passes, left): (Vec<i64>, Vec<i64>),
        decoded: &Receiver<Decoded>,
        work: &SyncSender<Work>,
        written: &Receiver<Written>,
    ) {
        let plan = self.plan;
        let (radius, reach) = (plan.settings.window as i64, plan.settings.second_reach() as i64);
        let (mut passes, mut left) = (passes.into_iter().peekable(), left.into_iter().peekable());
        for (index, target) in plan.frames.iter().enumerate().filter(|(_, f)| matches!(f.action, Action::Denoise(_))) {
            if self.must_end(cancel, written) {
                return;
            }
            self.cache.slide(plan, target.frame);
            (self.report)(Event::Working { frame: target.frame });
            let due: Vec<i64> = std::iter::from_fn(|| passes.next_if(|n| *n <= target.frame + reach)).collect();
            let last = due.last().map_or(target.frame, |n| *n) + radius;
            let reads = left.clone().take_while(|n| *n <= last).count();
            let mut progress = FrameProgress::new(self.report, target.frame, reads, due.len());
            for number in due {
                self.cache.ring.retain(|n, _| *n >= number - radius);
                while left.next_if(|n| *n <= number + radius).is_some() {
                    // A frame that was told to be in hand is finished, whoever cancels.
                    if self.has_stopped(written) {
                        return;
                    }
                    let Ok(next) = decoded.recv() else { return };
                    self.take_in(next, engine);
                    progress.read_one();
                }
                if self.has_stopped(written) {
                    return;
                }
                self.first_pass(number, engine, &mut progress);
            }
            if let Some(reason) = self.bad.get(&target.frame).map(ToString::to_string) {
                self.finish(index, Status::Failed, Some(reason), 0.0);
                continue;
            }
            let window = self.window(target.frame, plan.settings.context());
            self.note_window(target, &window);
            self.note_pass(target, &window);
            match (self.result(target.frame, &window, engine), self.failed.remove(&target.frame)) {
                // A writer that is gone has said why in `written`.
                (Some((denoised, seconds)), _) => _ = work.send(Work { index, denoised, seconds }),
                (None, Some((error, seconds))) => self.fail(index, error, seconds),
                (None, None) => self.finish(index, Status::Failed, Some("could not be read".into()), 0.0),
            }
        }
        if let Some(warning) = self.cache.pixels.finish() {
            (self.report)(Event::Warning(&warning));
        }
    }

    /// Whether to begin nothing more; settles what the writer has done.
    fn must_end(&mut self, cancel: &CancelToken, written: &Receiver<Written>) -> bool {
        self.has_stopped(written) || cancel.is_cancelled()
    }

    /// Whether the run cannot go on; settles what the writer has done.
    fn has_stopped(&mut self, written: &Receiver<Written>) -> bool {
        written.try_iter().for_each(|w| self.settle(w));
        self.summary.stopped.is_some()
    }
}

impl fmt::Debug for Runner<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Runner").field("engine", self.engine).finish_non_exhaustive()
    }
}

/// Tells one sequence from another: its folder and its name.
fn sequence_key(job: &Job) -> String {
    let folder = job.sequence.frames.first().and_then(|f| f.path.parent()).unwrap_or(Path::new(""));
    folder.join(&job.sequence.name).to_string_lossy().into_owned()
}
