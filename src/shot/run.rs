//! The run over a shot: a decoder thread ahead, the engine here, a writer thread behind, a window of encoded frames between.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, channel, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

use super::cancel::CancelToken;
use super::events::{Event, Status, Summary};
use super::file_state::FileState;
use super::job::Job;
use super::lambda_image::LambdaImage;
use super::ledger::Ledger;
use super::manifest::Manifest;
use super::output::prepare_folder;
use super::prepare::{Action, Plan, PlannedFrame, is_degraded, missing_text};
use super::progress::FrameProgress;
use super::threads::{Decoded, Work, Written, decode, ends_the_run, write};
use super::window_cache::{Slot, WindowCache};
use crate::engine::{Denoised, Dial, EncodedFrame, Engine, LambdaMask, Listener};
use crate::error::{Error, Result};
use crate::frame::LambdaMap;
use crate::rules::checks::{Warning, WarningKind};
use crate::rules::skip::LeftOut;
use crate::rules::window::{Availability, WindowFrame, neighbours};

/// Frames of more bytes than this are decoded one ahead instead of two.
const BIG_FRAME: usize = 128 << 20;
/// The manifest is written at most this often.
const SAVE_EVERY: Duration = Duration::from_secs(1);

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
        cache.prepare(&sequence_key(job), &plan);
        let mut run = Run::new(job, &plan, report, cache, ledger);
        run.start();
        run.save()?;
        run.denoise_all(engine, cancel);
        if let Err(error) = run.save() {
            run.stop(error);
        }
        let mut summary = run.summary;
        summary.seconds = began.elapsed().as_secs_f64();
        report(Event::Done(&summary));
        Ok(summary)
    }
}

/// The state of a run.
struct Run<'a> {
    job: &'a Job,
    plan: &'a Plan,
    report: &'a dyn Fn(Event<'_>),
    cache: &'a mut WindowCache,
    ledger: &'a mut Ledger,
    /// The frames of this run.
    manifest: Manifest,
    summary: Summary,
    /// Frames that turned out to be bad when they were decoded.
    bad: BTreeMap<i64, String>,
    /// What was odd about a frame, until it is written.
    notes: BTreeMap<i64, Vec<String>>,
    finished: usize,
    /// Whether it was told that a mask has odd values.
    mask_noted: bool,
    saved: Instant,
}

impl<'a> Run<'a> {
    fn new(
        job: &'a Job,
        plan: &'a Plan,
        report: &'a dyn Fn(Event<'_>),
        cache: &'a mut WindowCache,
        ledger: &'a mut Ledger,
    ) -> Self {
        let summary = Summary { frames: plan.frames.len(), missing: missing_text(plan), ..Summary::default() };
        let (bad, notes, mask_noted) = (BTreeMap::new(), BTreeMap::new(), false);
        let manifest = Manifest::default();
        Self { job, plan, report, cache, ledger, manifest, summary, bad, notes, finished: 0, mask_noted, saved: Instant::now() }
    }

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
        for (number, message) in &plan.sources.bad {
            (self.report)(Event::Error { frame: Some(*number), message: message.clone() });
        }
        for (index, frame) in plan.frames.iter().enumerate() {
            let key = self.manifest.settings_key(&plan.settings_of(frame));
            let mut entry = plan.entry(frame, &key);
            let before = plan.before.get(&frame.frame);
            if let (Action::Skip, Some(before)) = (&frame.action, before) {
                entry = plan.skipped(before, frame);
            }
            self.manifest.frames.insert(file_name(&frame.output), entry);
            match &frame.action {
                Action::Denoise(_) => {}
                Action::Skip => self.finish(index, Status::Skipped, Some("already done".into()), 0.0),
                Action::Fail(reason) => self.finish(index, Status::Failed, Some(reason.clone()), 0.0),
            }
        }
    }

    fn denoise_all(&mut self, engine: &Engine, cancel: &CancelToken) {
        let plan = self.plan;
        let order = decode_order(&plan.frames, &self.cache.ring);
        let left = order.clone();
        let ahead = usize::from(plan.sources.good.values().map(|s| s.bytes()).max().unwrap_or(0) <= BIG_FRAME);
        let keep_noisy = self.job.settings.keep_noisy.unwrap_or_default();
        thread::scope(|scope| {
            let (decoded_in, decoded) = sync_channel(ahead);
            let (work, work_out) = sync_channel(0);
            let (written_in, written) = channel();
            scope.spawn(move || decode(&order, plan, engine, decoded_in));
            scope.spawn(move || write(plan, keep_noisy, engine, &work_out, &written_in));
            self.compute(engine, cancel, left, &decoded, &work, &written);
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
        left: Vec<i64>,
        decoded: &Receiver<Decoded>,
        work: &SyncSender<Work>,
        written: &Receiver<Written>,
    ) {
        let plan = self.plan;
        let radius = plan.settings.window as i64;
        let mut left = left.into_iter().peekable();
        for (index, target) in plan.frames.iter().enumerate().filter(|(_, f)| matches!(f.action, Action::Denoise(_))) {
            if self.must_end(cancel, written) {
                return;
            }
            self.cache.ring.retain(|n, _| *n >= target.frame - radius);
            (self.report)(Event::Working { frame: target.frame });
            let reads = left.clone().take_while(|n| *n <= target.frame + radius).count();
            let mut progress = FrameProgress::new(self.report, target.frame, reads);
            while left.next_if(|n| *n <= target.frame + radius).is_some() {
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
            let Some(centre) = self.cache.ring.get(&target.frame) else {
                let reason = self.bad.get(&target.frame).cloned().unwrap_or_else(|| "could not be read".into());
                self.finish(index, Status::Failed, Some(reason), 0.0);
                continue;
            };
            let began = Instant::now();
            let window = neighbours(target.frame, plan.settings.window, |n| match self.bad.contains_key(&n) {
                true => Availability::Bad,
                false => plan.sources.known(n),
            });
            let used = window.iter().filter(|n| n.unused.is_none());
            let around: Vec<(i32, &Slot)> =
                used.filter_map(|n| self.cache.ring.get(&n.number).map(|slot| (n.offset, slot))).collect();
            let image = engine.in_pool(|| LambdaImage::read(plan, target)).transpose();
            let result = image.and_then(|image| {
                let mask = image.as_ref().map(|image| &image.mask);
                let denoised = progress.follow(|listener| denoise_views(engine, centre, &around, (target, mask), listener))?;
                Ok((denoised, image))
            });
            let seconds = centre.seconds + began.elapsed().as_secs_f64();
            self.note_window(target, &window);
            match result {
                // A writer that is gone has said why in `written`.
                Ok((views, image)) => {
                    let (denoised, left_out) = views.into_iter().unzip();
                    self.note_left_out(target, left_out);
                    self.note_mask(target, image);
                    _ = work.send(Work { index, denoised, seconds });
                }
                Err(error) => self.fail(index, error, seconds),
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

    /// Checks and encodes a frame that was decoded.
    fn take_in(&mut self, decoded: Decoded, engine: &Engine) {
        let Decoded { number, frame, content } = decoded;
        let began = Instant::now();
        let encoded = frame.and_then(|(views, glance)| {
            let seen = self.cache.pixels.look(number, glance);
            self.notes.entry(number).or_default().extend(seen.note);
            if let Some(warning) = seen.warning {
                (self.report)(Event::Warning(&warning));
            }
            views.into_iter().map(|frame| engine.encode(frame)).collect()
        });
        match encoded {
            Ok(encoded) => {
                let slot = Slot::new(self.plan, number, encoded, began.elapsed().as_secs_f64(), content);
                self.cache.ring.insert(number, slot);
            }
            Err(error) => {
                self.bad.insert(number, error.to_string());
                (self.report)(Event::Error { frame: Some(number), message: error.to_string() });
                if self.job.strict {
                    self.stop(error);
                }
            }
        }
    }

    /// Puts the window that a frame really had into the manifest.
    fn note_window(&mut self, target: &PlannedFrame, window: &[WindowFrame]) {
        let mut neighbours = self.plan.neighbour_entries(window);
        let content = |frame: i64| self.cache.ring.get(&frame).and_then(|slot| slot.content);
        for neighbour in &mut neighbours {
            let content = content(neighbour.frame);
            neighbour.stamp = neighbour.stamp.map(|state| FileState { content, ..state });
        }
        let content = content(target.frame);
        let notes = self.notes.remove(&target.frame).unwrap_or_default();
        self.notes.retain(|n, _| *n > target.frame);
        if let Some(entry) = self.manifest.frames.get_mut(&file_name(&target.output)) {
            entry.neighbours = neighbours;
            entry.stamp = entry.stamp.map(|state| FileState { content, ..state });
            entry.warnings.extend(notes);
        }
    }

    /// Puts what was left out of a frame into the manifest.
    fn note_left_out(&mut self, target: &PlannedFrame, left_out: Vec<LeftOut>) {
        if let Some(entry) = self.manifest.frames.get_mut(&file_name(&target.output)) {
            entry.left_out = left_out;
        }
    }

    /// Puts the image that was the mask into the manifest, and tells once what is odd about a mask.
    fn note_mask(&mut self, target: &PlannedFrame, image: Option<LambdaImage>) {
        let own =
            self.cache.ring.get(&target.frame).and_then(|slot| slot.encoded.iter().find_map(|frame| frame.lambda_mask()?.note()));
        let note = image.as_ref().map_or(own, |image| image.mask.note());
        if let (Some(note), false) = (note, std::mem::replace(&mut self.mask_noted, true)) {
            let message = format!("the mask of lambda in frame {} {note}", target.frame);
            (self.report)(Event::Warning(&Warning::new(WarningKind::LambdaMask, message)));
        }
        if let Some(entry) = self.manifest.frames.get_mut(&file_name(&target.output)) {
            entry.lambda_image = image.and_then(|image| image.state);
        }
    }

    /// Takes note of what the writer did.
    fn settle(&mut self, written: Written) {
        match written.result {
            Ok(state) => {
                let file = self.plan.frames.get(written.index).map(|frame| file_name(&frame.output)).unwrap_or_default();
                if let Some(entry) = self.manifest.frames.get_mut(&file) {
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
    fn fail(&mut self, index: usize, error: Error, seconds: f64) {
        let number = self.plan.frames.get(index).map(|f| f.frame);
        (self.report)(Event::Error { frame: number, message: error.to_string() });
        self.finish(index, Status::Failed, Some(error.to_string()), seconds);
        if self.job.strict || ends_the_run(&error, &self.job.output) {
            self.stop(error);
        }
    }

    fn stop(&mut self, error: Error) {
        if self.summary.stopped.is_none() {
            (self.report)(Event::Error { frame: None, message: format!("stopped: {error}; run again to continue") });
            self.summary.stopped = Some(error);
        }
    }

    /// Counts a frame and tells about it.
    fn finish(&mut self, index: usize, status: Status, reason: Option<String>, seconds: f64) {
        let Some(frame) = self.plan.frames.get(index) else { return };
        self.finished += 1;
        let mut used = Vec::new();
        if let Some(entry) = self.manifest.frames.get_mut(&file_name(&frame.output)) {
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

    fn save(&mut self) -> Result<()> {
        self.saved = Instant::now();
        self.ledger.merge(&self.manifest)
    }
}

/// Denoises each view with the same views of the frames around it; `image` is the mask where it is not in the frame itself.
fn denoise_views(
    engine: &Engine,
    centre: &Slot,
    around: &[(i32, &Slot)],
    (target, image): (&PlannedFrame, Option<&LambdaMask>),
    listener: Listener<'_>,
) -> Result<Vec<(Denoised, LeftOut)>> {
    let views = centre.encoded.len() as f64;
    let view = |(index, centre): (usize, &EncodedFrame)| {
        let neighbours: Vec<(i32, &EncodedFrame)> =
            around.iter().filter_map(|(offset, slot)| Some((*offset, slot.encoded.get(index)?))).collect();
        let map = LambdaMap::of_mask(image.or(centre.lambda_mask()), target.lambda, target.lambda_masked)?;
        let dial = Dial::new(target.lambda, map.as_ref());
        engine.denoise_with(centre, &neighbours, dial, engine.skip(), &|fraction| listener((index as f64 + fraction) / views))
    };
    centre.encoded.iter().enumerate().map(view).collect()
}

/// The frames to decode: those to do and the neighbours that they use, ascending, without those that are there.
fn decode_order(frames: &[PlannedFrame], there: &BTreeMap<i64, Slot>) -> Vec<i64> {
    let mut order: Vec<i64> = frames
        .iter()
        .filter(|f| matches!(f.action, Action::Denoise(_)))
        .flat_map(|f| f.neighbours.iter().filter(|n| n.unused.is_none()).map(|n| n.number).chain([f.frame]))
        .filter(|n| !there.contains_key(n))
        .collect();
    order.sort_unstable();
    order.dedup();
    order
}

/// Tells one sequence from another: its folder and its name.
fn sequence_key(job: &Job) -> String {
    let folder = job.sequence.frames.first().and_then(|f| f.path.parent()).unwrap_or(Path::new(""));
    folder.join(&job.sequence.name).to_string_lossy().into_owned()
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
