//! The errors of a frame's results: against its reference where there is one, else estimated from noisy frames around it.

use std::collections::BTreeMap;
use std::path::PathBuf;

use ndarray::Array3;

use super::candidates::{Candidate, CandidateKind, Method};
use super::estimate::{ErrorEstimate, Observed, Unseen};
use super::record::{Basis, ERRORS, EstimateCheck, EstimateNote};
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::metrics::images::{FilePasses, read};
use crate::metrics::pair::{REFERENCE_MEAN, has_finite_pixel};
use crate::metrics::{ImageChoice, Pair, Scaling, denoised_references, flicker, relmse, smape};
use crate::rules::window::MAX_WINDOW;
use crate::shot::Scope;
use crate::words;

/// The farthest frame that an estimate looks at: one behind the widest window.
pub const REACH: usize = MAX_WINDOW + 1;

/// The errors of one candidate's frame, as [`Basis::titles`] says.
pub struct Verdict {
    pub errors: [Option<f64>; ERRORS],
}

/// A frame being judged, or the one before it.
struct Current {
    number: i64,
    reference: Option<Array3<f32>>,
    vector: Option<Array3<f32>>,
    observed: Option<Observed>,
    gain: f32,
    outputs: Vec<Option<Array3<f32>>>,
}

/// What was estimated of one candidate.
#[derive(Default, Clone)]
struct Estimates {
    estimates: Vec<ErrorEstimate>,
    measured: Vec<f64>,
}

/// Judges frame after frame.
pub struct Judge<'a> {
    scope: &'a Scope,
    references: Option<BTreeMap<i64, PathBuf>>,
    images: ImageChoice,
    distance: Option<usize>,
    /// The frames on each side that each candidate's results depend on.
    reaches: Vec<usize>,
    /// The candidate whose pictures all estimates are relative to.
    brightness: Option<usize>,
    current: Option<Current>,
    previous: Option<Current>,
    seen: Vec<Estimates>,
    unseen: Option<Unseen>,
    denoised_references: Vec<i64>,
}

impl<'a> Judge<'a> {
    /// For these frames and candidates.
    pub fn new(
        scope: &'a Scope,
        references: Option<BTreeMap<i64, PathBuf>>,
        images: ImageChoice,
        frames: &[i64],
        candidates: &[Candidate],
    ) -> Self {
        let reaches: Vec<usize> = candidates.iter().map(Candidate::reach).collect();
        let farthest = reaches.iter().max().map_or(1, |reach| (reach + 1).min(REACH));
        let reached = |k: usize| frames.iter().filter(|n| scope.around(**n, k).len() == 2 * k).count();
        // One frame alone says little: rather two judged from nearer by, and the widest windows not at all.
        let distance = [2, 1].into_iter().find_map(|least| (1..=farthest).rev().find(|k| reached(*k) >= least));
        // The widest window that looks at neither of the frames that an estimate is made from.
        let windows = (0..candidates.len()).filter(|i| candidates[*i].kind == CandidateKind::Window);
        let brightness = windows.filter(|i| distance.is_some_and(|k| reaches[*i] < k)).max_by_key(|i| reaches[*i]);
        Self {
            scope,
            references,
            images,
            distance,
            brightness,
            seen: vec![Estimates::default(); candidates.len()],
            reaches,
            current: None,
            previous: None,
            unseen: None,
            denoised_references: Vec::new(),
        }
    }

    /// What the errors mean.
    pub fn basis(&self) -> Basis {
        if self.references.is_some() { Basis::Reference } else { Basis::Estimate }
    }

    /// The reference of the frame being judged.
    pub fn reference(&self) -> Option<&Array3<f32>> {
        self.current.as_ref()?.reference.as_ref()
    }

    /// Begins with a frame.
    ///
    /// # Errors
    /// Its reference cannot be read, has another size, or no finite pixel.
    pub fn open(&mut self, number: i64, frame: &Frame) -> Result<()> {
        self.previous = self.current.take().filter(|c| c.number + 1 == number);
        let mut reference = None;
        if let Some(path) = self.references.as_ref().and_then(|r| r.get(&number)) {
            let FilePasses { colour, denoised, .. } = read(path, false, &self.images)?;
            let ((rows, columns), (found_rows, found_columns, _)) = (frame.size(), colour.dim());
            if (rows, columns) != (found_rows, found_columns) {
                let what = path.display().to_string();
                return Err(Error::SizeMismatch { what, columns, rows, found_columns, found_rows });
            }
            if !has_finite_pixel(colour.view()) {
                return Err(Error::bad_file(path, "holds no finite pixel: render it again"));
            }
            self.denoised_references.extend(denoised.then_some(number));
            reference = Some(colour);
        }
        let observed = self.look(number, frame).map_err(|why| self.unseen = self.unseen.or(why)).ok();
        let sum: f64 = frame.colour.iter().filter(|v| v.is_finite()).map(|v| f64::from(v.max(0.0))).sum();
        let gain = (REFERENCE_MEAN / (sum / frame.colour.len() as f64).max(1e-6)) as f32;
        let vector = frame.vector.clone();
        self.current = Some(Current { number, reference, vector, observed, gain, outputs: Vec::new() });
        Ok(())
    }

    /// The frame seen from the noisy frames around it.
    fn look(&self, number: i64, centre: &Frame) -> Result<Observed, Option<Unseen>> {
        let k = self.distance.ok_or_else(|| (!self.scope.has_vectors()).then_some(Unseen::NoMotion))? as i64;
        if self.scope.around(number, k as usize).len() as i64 != 2 * k {
            return Err(None);
        }
        let mut frames = Vec::new();
        for n in number - k..=number + k {
            if n == number {
                frames.push(centre.clone());
                continue;
            }
            let read = self.scope.read(n).ok().and_then(|views| views.into_iter().next());
            let mut frame = read.ok_or(None)?;
            if (n - number).abs() < k {
                // Only the way leads through it.
                (frame.albedo, frame.normal, frame.depth) = (None, None, None);
            }
            frames.push(frame);
        }
        Observed::new(&frames).map_err(Some)
    }

    /// The errors of every candidate's picture.
    pub fn judge(&mut self, outputs: &[Option<Array3<f32>>]) -> Result<Vec<Verdict>> {
        let Some(current) = &self.current else { return Ok(Vec::new()) };
        let brightness = self.brightness.and_then(|i| Some(outputs.get(i)?.as_ref()?.view()));
        let mut verdicts = Vec::with_capacity(outputs.len());
        for (i, output) in outputs.iter().enumerate() {
            let Some(output) = output else {
                verdicts.push(Verdict { errors: [None; ERRORS] });
                continue;
            };
            let near = self.distance.is_some_and(|k| self.reaches[i] < k);
            let seen_beside = current.observed.as_ref().zip(brightness).filter(|_| near);
            let estimate = seen_beside.map(|(observed, brightness)| observed.estimate(output.view(), brightness));
            if let (Some(estimate), Some((observed, brightness))) = (estimate, seen_beside) {
                let seen = &mut self.seen[i];
                seen.estimates.push(estimate);
                if let Some(reference) = &current.reference {
                    seen.measured.push(observed.measure(output.view(), reference.view(), brightness));
                }
            }
            let before = self.previous.as_ref().and_then(|p| Some((p, p.outputs.get(i)?.as_ref()?)));
            let before = before.filter(|(_, picture)| picture.dim() == output.dim());
            let errors = match &current.reference {
                Some(reference) => against(reference, output, current, before)?,
                None => [None, estimate.map(|e| e.relmse), change(output, current, before)?],
            };
            verdicts.push(Verdict { errors });
        }
        Ok(verdicts)
    }

    /// Ends with a frame; its pictures are the ones before the next one's.
    pub fn close(&mut self, outputs: Vec<Option<Array3<f32>>>) {
        if let Some(current) = &mut self.current {
            current.outputs = outputs;
        }
    }

    /// How the estimates were made, how far off they were, and what is to be said.
    pub fn finish(&self, candidates: &[Candidate]) -> (Option<EstimateNote>, Vec<EstimateCheck>, Vec<String>) {
        let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
        let deviation =
            |s: &Estimates| s.estimates.iter().map(|e| e.deviation.powi(2)).sum::<f64>().sqrt() / s.estimates.len() as f64;
        let estimated =
            || candidates.iter().zip(&self.seen).filter(|(c, s)| c.method != Method::Noisy && !s.estimates.is_empty());
        let checks = estimated().filter(|(_, s)| !s.measured.is_empty()).map(|(candidate, s)| EstimateCheck {
            name: candidate.name.clone(),
            estimated: mean(&s.estimates.iter().map(|e| e.relmse).collect::<Vec<_>>()),
            deviation: deviation(s),
            measured: mean(&s.measured),
        });
        let note = estimated().next().map(|(_, first)| EstimateNote {
            distance: self.distance.unwrap_or(0),
            frames: first.estimates.len(),
            share: mean(&first.estimates.iter().map(|e| e.share).collect::<Vec<_>>()),
            deviation: estimated().map(|(_, s)| deviation(s)).fold(0.0, f64::max),
        });
        let mut remarks = Vec::new();
        if !self.denoised_references.is_empty() {
            remarks.push(denoised_references(words::frames(&self.denoised_references)));
        }
        if self.basis() == Basis::Estimate {
            let why = match self.unseen {
                _ if note.is_some() => None,
                Some(Unseen::SameNoise) => Some("the frames share one noise pattern: animate the seed"),
                Some(Unseen::Lost) => Some("hardly any pixel can be followed through the frames"),
                Some(Unseen::NoMotion) => Some("there are no motion vectors to follow"),
                None => Some("no frame has enough readable frames before and after it"),
            };
            remarks.extend(why.map(|why| format!("The error could not be estimated: {why}.")));
            let unjudged = candidates.iter().zip(&self.reaches).filter(|(_, reach)| self.distance.is_some_and(|k| **reach >= k));
            let (second, wide): (Vec<_>, Vec<_>) = unjudged.partition(|(c, _)| c.kind == CandidateKind::SecondPass);
            if note.is_some() {
                let reaches = || wide.iter().map(|(_, reach)| **reach);
                remarks.extend(reaches().min().zip(reaches().max()).map(|(least, most)| {
                    let which = match least == most {
                        true => format!("Window {most} has no estimate"),
                        false => format!("Windows {least} to {most}, and the settings that use them, have no estimate"),
                    };
                    format!("{which}: the shot is too short to leave frames outside to judge by.")
                }));
                let why = "The second pass has no estimate: it looks at the frames by which the others are judged.";
                remarks.extend(second.first().map(|_| why.into()));
            }
        }
        (note, checks.collect(), remarks)
    }
}

/// SMAPE, relMSE and flicker.
fn against(
    reference: &Array3<f32>,
    output: &Array3<f32>,
    current: &Current,
    before: Option<(&Current, &Array3<f32>)>,
) -> Result<[Option<f64>; ERRORS]> {
    let pair = Pair::new(reference.view(), output.view(), Scaling::ReferenceMean)?;
    let mut unsteady = None;
    if let Some((previous, picture)) = before
        && let Some(reference) = &previous.reference
    {
        let previous = Pair::new(reference.view(), picture.view(), Scaling::ReferenceMean)?;
        unsteady = flicker(&previous, &pair, current.vector.as_ref().map(|v| v.view()))?;
    }
    Ok([Some(smape(&pair)), Some(relmse(&pair)), unsteady])
}

/// How much the picture changes along the motion: flicker beside a black reference.
fn change(output: &Array3<f32>, current: &Current, before: Option<(&Current, &Array3<f32>)>) -> Result<Option<f64>> {
    let Some((_, picture)) = before else { return Ok(None) };
    let (black, gain) = (Array3::zeros(output.dim()), current.gain);
    let (now, then) = (output.mapv(|v| v * gain), picture.mapv(|v| v * gain));
    let previous = Pair::new(black.view(), then.view(), Scaling::None)?;
    let pair = Pair::new(black.view(), now.view(), Scaling::None)?;
    flicker(&previous, &pair, current.vector.as_ref().map(|v| v.view()))
}
