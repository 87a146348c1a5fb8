//! The measurement: every frame with every candidate, in turn and repeated, so that what disturbs the machine meets all alike.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use ndarray::Array3;

use super::candidates::{Candidate, CandidateKind, Method, OidnMode, candidates};
use super::crops::{CropSet, Crops};
use super::hush_runs::{HushRun, HushRuns};
use super::judge::{Judge, Verdict};
use super::machine::Machine;
use super::oidn::Oidn;
use super::record::{ERRORS, FrameErrors, Report, SettingRow};
use super::statistics::{Spread, pareto};
use crate::engine::{Engine, STAGES};
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::io::sequence::Sequence;
use crate::metrics::ImageChoice;
use crate::rules::checks::WarningKind;
use crate::shot::{CancelToken, Scope};
use crate::words;

/// Frames that are measured where nobody says which.
pub const FRAMES: usize = 16;

/// What to measure.
#[derive(Clone, Debug)]
pub struct MeasureOptions {
    /// Folder, pattern or file with the frames as they should be.
    pub reference: Option<PathBuf>,
    /// How often each frame is timed with each candidate, at least 1.
    pub repeats: usize,
    /// Whether the frames were chosen by the user; else at most [`FRAMES`] in the middle of the shot are measured.
    pub chosen: bool,
    /// The peer, and whether the user named it.
    pub oidn: Option<(Oidn, bool)>,
    /// The view layer of the references to read.
    pub layer: Option<String>,
    /// Their stereo view.
    pub view: Option<String>,
}

/// A report's numbers and pictures.
pub struct Measured {
    /// The numbers.
    pub report: Report,
    /// Tiles to look at.
    pub crops: Vec<CropSet>,
}

/// Measures a shot. `progress` hears (done, all) steps.
///
/// # Errors
/// No frame has a reference, a reference of another size, no frame can be read; [`Error::Cancelled`]. A frame that cannot be
/// read while others can is named in [`Report::failed`].
pub fn measure(
    scope: &Scope,
    engine: &Engine,
    options: &MeasureOptions,
    progress: &dyn Fn(usize, usize),
    cancel: &CancelToken,
) -> Result<Measured> {
    let mut remarks = Vec::new();
    let references = options.reference.as_deref().map(|path| references(path, &scope.frames, &mut remarks)).transpose()?;
    let mut frames = scope.frames.clone();
    if let Some(references) = &references {
        frames.retain(|n| references.contains_key(n));
    }
    let of_frames = frames.len();
    if !options.chosen && frames.len() > FRAMES {
        frames = frames.split_off((of_frames - FRAMES) / 2);
        frames.truncate(FRAMES);
        let text = format!("Measured were {FRAMES} of {of_frames} frames, in the middle of the shot.");
        remarks.push(text);
    }
    let candidates = candidates(scope.has_vectors(), engine.has_second_pass(), options.oidn.is_some());
    if !scope.has_vectors() {
        remarks.push("There is no Vector pass in every frame, so neighbours cannot help and all windows are 0.".into());
    }
    // What makes the shot a poor one to measure, such as guides that Hush and its peer do without.
    let odd = scope.warnings().into_iter().filter(|w| w.kind != WarningKind::NoVector);
    remarks.extend(odd.map(|w| sentence(&w.message)));
    let scratch = tempfile::Builder::new().prefix("hush-report-").tempdir().map_err(|e| Error::io(std::env::temp_dir(), e))?;
    let images = ImageChoice { layer: options.layer.clone(), view: options.view.clone(), ..Default::default() };
    let judge = Judge::new(scope, references, images, &frames, &candidates);
    let mut run = Measurement {
        scope,
        engine,
        repeats: options.repeats.max(1),
        oidn: options.oidn.clone(),
        scratch: scratch.path(),
        tallies: candidates.iter().map(|_| CandidateTally::default()).collect(),
        candidates,
        hush: HushRuns::new(scope, engine),
        failed: scope.bad.clone(),
        encode: Vec::new(),
        crops: Crops::default(),
        judge,
        size: (0, 0),
        cancel,
        remarks,
        measured: Vec::new(),
        steps: 0,
    };
    let mut machine = Machine::new(engine.isa(), engine.threads());
    let (all, mut left) = (frames.len() * run.repeats * run.candidates.len(), frames.len());
    for &number in &frames {
        match run.frame(number, &|done| progress(done, all)) {
            Ok(()) => run.measured.push(number),
            Err(error @ (Error::Cancelled | Error::SizeMismatch { .. } | Error::BadSetting { .. })) => return Err(error),
            Err(_) if cancel.is_cancelled() => return Err(Error::Cancelled),
            Err(error) if left == 1 && run.measured.is_empty() => return Err(error),
            Err(error) => _ = run.failed.insert(number, error.to_string()),
        }
        left -= 1;
    }
    machine.finish();
    Ok(run.finish(machine, options, of_frames))
}

/// The references by frame number.
fn references(path: &Path, frames: &[i64], remarks: &mut Vec<String>) -> Result<BTreeMap<i64, PathBuf>> {
    let found: BTreeMap<i64, PathBuf> = Sequence::find(&[path])?.named_frames().map(|f| (f.number, f.path.clone())).collect();
    let (with, without): (Vec<i64>, Vec<i64>) = frames.iter().partition(|n| found.contains_key(n));
    if with.is_empty() {
        let numbers: Vec<i64> = found.keys().copied().collect();
        let reason = format!("no frame has a reference: {} here, {} in the shot", words::frames(&numbers), words::frames(frames));
        return Err(Error::BadInput { input: path.display().to_string(), reason });
    }
    if !without.is_empty() {
        remarks.push(format!("Not measured, as they have no reference: {}.", words::frames(&without)));
    }
    Ok(found)
}

/// What was measured of one candidate.
#[derive(Default)]
struct CandidateTally {
    /// Seconds by repeat, all frames together.
    times: Vec<f64>,
    stages: [f64; STAGES.len()],
    left_out: f64,
    window_bytes: usize,
    tile_bytes: usize,
    peak: u64,
    by_frame: Vec<FrameErrors>,
}

impl CandidateTally {
    fn take(&mut self, run: &HushRun, repeat: usize) {
        add(&mut self.times, repeat, run.seconds);
        self.stages.iter_mut().zip(run.stages).for_each(|(sum, stage)| *sum += stage);
        self.left_out += run.left_out;
        self.window_bytes = self.window_bytes.max(run.window_bytes);
        self.tile_bytes = self.tile_bytes.max(run.tile_bytes);
    }
}

struct Measurement<'a> {
    scope: &'a Scope,
    engine: &'a Engine,
    candidates: Vec<Candidate>,
    tallies: Vec<CandidateTally>,
    repeats: usize,
    oidn: Option<(Oidn, bool)>,
    scratch: &'a Path,
    hush: HushRuns<'a>,
    failed: BTreeMap<i64, String>,
    /// Seconds to encode by repeat, all frames together.
    encode: Vec<f64>,
    crops: Crops,
    judge: Judge<'a>,
    size: (usize, usize),
    cancel: &'a CancelToken,
    remarks: Vec<String>,
    measured: Vec<i64>,
    steps: usize,
}

impl Measurement<'_> {
    /// Measures one frame with all candidates.
    fn frame(&mut self, number: i64, progress: &dyn Fn(usize)) -> Result<()> {
        let reach = self.candidates.iter().map(Candidate::reach).max().unwrap_or(0);
        let frame = read(self.scope, self.cancel, number)?;
        self.judge.open(number, &frame)?;
        self.size = frame.size();
        let (scope, cancel) = (self.scope, self.cancel);
        self.hush.take_in(number, reach, |n| if n == number { Ok(frame.clone()) } else { read(scope, cancel, n) })?;
        let outputs = self.time(number, &frame, progress)?;
        let verdicts = self.judge.judge(&outputs)?;
        for (tally, Verdict { errors }) in self.tallies.iter_mut().zip(verdicts) {
            tally.by_frame.push(FrameErrors { frame: number, errors });
        }
        let pictures: Vec<_> = self.candidates.iter().zip(&outputs).filter_map(|(c, o)| Some((c, o.as_ref()?))).collect();
        self.crops.take(number, &pictures, self.judge.reference());
        self.judge.close(outputs);
        Ok(())
    }

    /// Times every candidate, `repeats` times in turn; their pictures.
    fn time(&mut self, number: i64, frame: &Frame, progress: &dyn Fn(usize)) -> Result<Vec<Option<Array3<f32>>>> {
        let mut outputs: Vec<Option<Array3<f32>>> = vec![None; self.candidates.len()];
        if self.measured.is_empty() {
            // The first run of all finds no buffers to take again.
            if let Some(setting) = self.candidates[1].hush() {
                self.hush.run(number, setting)?;
            }
        }
        for repeat in 0..self.repeats {
            let copy = frame.clone();
            let began = Instant::now();
            let before = self.engine.stage_seconds()[0];
            drop(self.engine.encode(copy)?);
            add(&mut self.encode, repeat, began.elapsed().as_secs_f64());
            let encoding = self.engine.stage_seconds()[0] - before;
            let count = self.candidates.len();
            for turn in 0..count {
                // Another one begins each time, and every second round runs backwards.
                let turn = if repeat % 2 == 0 { turn } else { count - 1 - turn };
                let i = (turn + repeat + self.measured.len()) % count;
                self.cancel.check()?;
                let candidate = &self.candidates[i];
                if let Some(setting) = candidate.hush() {
                    let run = self.hush.run(number, setting)?;
                    self.tallies[i].stages[0] += encoding;
                    self.tallies[i].take(&run, repeat);
                    outputs[i].get_or_insert(run.colour);
                } else if let Method::Oidn { mode } = candidate.method {
                    if let Some((seconds, colour)) = self.oidn(frame, mode, i)? {
                        add(&mut self.tallies[i].times, repeat, seconds);
                        outputs[i].get_or_insert(colour);
                    }
                } else {
                    outputs[i] = Some(frame.colour.mapv(|v| if v.is_finite() { v.max(0.0) } else { 0.0 }));
                }
                self.steps += 1;
                progress(self.steps);
            }
        }
        Ok(outputs)
    }

    /// One frame by the peer; None once it has failed, unless the user named it.
    fn oidn(&mut self, frame: &Frame, mode: OidnMode, i: usize) -> Result<Option<(f64, Array3<f32>)>> {
        let Some((oidn, named)) = &self.oidn else { return Ok(None) };
        match oidn.run(frame, mode, self.engine.threads(), self.scratch) {
            Ok(run) => {
                let tally = &mut self.tallies[i];
                tally.peak = tally.peak.max(run.peak.unwrap_or(0));
                self.candidates[i].name = mode.name(run.version.as_deref());
                Ok(Some((run.seconds, run.colour)))
            }
            Err(_) if self.cancel.is_cancelled() => Err(Error::Cancelled),
            Err(error) if *named => {
                Err(Error::BadSetting { name: "oidn", reason: format!("{error}: set oidn to false to do without it") })
            }
            Err(error) => {
                self.remarks.push(format!("OIDN is left out: {error}."));
                self.oidn = None;
                Ok(None)
            }
        }
    }

    fn finish(mut self, machine: Machine, options: &MeasureOptions, of_frames: usize) -> Measured {
        let (basis, count) = (self.judge.basis(), self.measured.len().max(1) as f64);
        if options.oidn.is_none() {
            self.remarks.push("OIDN was not measured: oidnDenoise is not installed, or was switched off.".into());
        }
        if machine.was_busy() {
            let text = "Other programs kept the machine busy: the times are longer than on an idle one, so do not quote them.";
            self.remarks.insert(0, text.into());
        }
        let runs = count * self.repeats as f64;
        let mut rows: Vec<SettingRow> = Vec::new();
        for (candidate, tally) in self.candidates.iter().zip(&self.tallies) {
            let is_hush = candidate.hush().is_some();
            let encode = |repeat: usize| if is_hush { self.encode.get(repeat).copied().unwrap_or(0.0) } else { 0.0 };
            let times: Vec<f64> = tally.times.iter().enumerate().map(|(r, t)| (t + encode(r)) / count).collect();
            if candidate.kind == CandidateKind::Oidn && self.oidn.is_none() {
                continue;
            }
            let errors = std::array::from_fn(|e| {
                Spread::quartiles(&tally.by_frame.iter().filter_map(|f| f.errors[e]).collect::<Vec<_>>())
            });
            rows.push(SettingRow {
                candidate: candidate.clone(),
                seconds: Spread::range(&times),
                times,
                errors,
                front: [false; ERRORS],
                by_frame: tally.by_frame.clone(),
                stages: is_hush.then(|| tally.stages.map(|s| s / runs)),
                left_out: is_hush.then_some(tally.left_out / runs),
                window_bytes: is_hush.then_some(tally.window_bytes),
                tile_bytes: is_hush.then_some(tally.tile_bytes),
                peak_bytes: (tally.peak > 0).then_some(tally.peak),
            });
        }
        for e in 0..ERRORS {
            let points: Vec<_> = rows.iter().map(|r| r.point(e, basis)).collect();
            rows.iter_mut().zip(pareto(&points)).for_each(|(row, on)| row.front[e] = on);
        }
        let (estimate, checks, more) = self.judge.finish(&self.candidates);
        self.remarks.extend(more);
        for (number, why) in std::mem::take(&mut self.hush.bad) {
            self.failed.entry(number).or_insert(why);
        }
        let report = Report {
            hush: env!("CARGO_PKG_VERSION"),
            sequence: self.scope.name.clone(),
            reference: options.reference.as_ref().map(|r| r.display().to_string()),
            columns: self.size.1,
            rows: self.size.0,
            frames: self.measured,
            of_frames,
            repeats: self.repeats,
            machine,
            basis,
            rows_by_setting: rows,
            estimate,
            checks,
            stability: Vec::new(),
            remarks: self.remarks,
            failed: self.failed,
        };
        Measured { report, crops: self.crops.finish() }
    }
}

/// The first view of a frame.
fn read(scope: &Scope, cancel: &CancelToken, number: i64) -> Result<Frame> {
    cancel.check()?;
    let first = scope.read(number)?.into_iter().next();
    first.ok_or_else(|| Error::BadInput { input: format!("frame {number}"), reason: "holds no image".into() })
}

/// A message as one of several sentences.
fn sentence(message: &str) -> String {
    let mut letters = message.chars();
    let first = letters.next().map(|c| c.to_uppercase().to_string()).unwrap_or_default();
    format!("{first}{}.", letters.as_str())
}

/// Adds to a list's element, which may be its next one.
fn add(list: &mut Vec<f64>, index: usize, value: f64) {
    if list.len() <= index {
        list.resize(index + 1, 0.0);
    }
    list[index] += value;
}
