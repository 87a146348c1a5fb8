//! The plan of a run, made from headers alone: what to write, with which neighbours, what to skip and why.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::actions::plan_frames;
use super::events::Status;
use super::file_state::{FileMemory, FileState};
use super::frame_settings::FrameSettings;
use super::job::Job;
use super::ledger::Ledger;
use super::manifest::{DAMAGED, Entry, MANIFEST, Manifest, NeighbourEntry};
use super::output::check_output;
use super::planned_frame::{Action, PlannedFrame};
use super::sources::{Sources, open_sources};
use crate::engine::Identity;
use crate::error::{Error, Result};
use crate::rules::checks::{self, Header, Warning, WarningKind};
use crate::rules::frames::FrameSet;
use crate::rules::window::{Unused, WindowFrame};
use crate::words;

/// The plan of a run.
#[derive(Debug, Serialize)]
pub struct Plan {
    /// The settings of every frame, but for λ, which is the first frame's.
    pub settings: FrameSettings,
    /// The frames of the range that have a file, ascending.
    pub frames: Vec<PlannedFrame>,
    /// What the headers give reason to say.
    pub warnings: Vec<Warning>,
    /// Frames asked for by number that have no file, both ends included.
    pub missing: Vec<(i64, i64)>,
    #[serde(skip)]
    pub(super) sources: Sources,
    /// What the manifest says about the frames, by number.
    #[serde(skip)]
    pub(super) before: BTreeMap<i64, Entry>,
}

impl Plan {
    /// Reads the headers of the range and its neighbours, and the output folder's manifest. Writes nothing.
    ///
    /// # Errors
    /// A setting out of range, a path that is not UTF-8, an output folder that holds the inputs or foreign files of the same names, a manifest that
    /// cannot be read or is of a later version, no usable frame, a window asked for without a Vector pass; with `strict` any
    /// missing or bad frame and a changing resolution.
    pub fn new(job: &Job) -> Result<Self> {
        Self::with(job, &job.settings.identity()?, &mut Ledger::new(&job.output))
    }

    /// As [`Plan::new`], for an engine, with a manifest that may have been read before.
    pub(super) fn with(job: &Job, engine: &Identity, ledger: &mut Ledger) -> Result<Self> {
        check_output(job)?;
        check_paths(job)?;
        let mut files = FileMemory::default();
        let reach = job.reach()?;
        let numbers = job.sequence.numbers();
        let targets: Vec<i64> = numbers.iter().copied().filter(|n| job.wants(*n)).collect();
        if targets.is_empty() {
            let reason = format!("none of the frames asked for is there; the sequence has {}", words::spans(&numbers));
            return Err(Error::BadInput { input: job.sequence.name.clone(), reason });
        }
        let context = engine.context(reach) as u64;
        let near = |n: i64| targets.iter().any(|t| t.abs_diff(n) <= context);
        let mut sources = open_sources(job, &numbers, near, &mut files);
        if (job.strict || !targets.iter().any(|t| sources.good.contains_key(t)))
            && let Some((_, first)) = sources.bad.pop_first()
        {
            return Err(first);
        }
        let headers: Vec<Header> = targets.iter().filter_map(|t| sources.good.get(t)).map(|s| s.header.clone()).collect();
        let window = resolve_window(job, &sources, &headers, reach)?;
        let settings = job.frame_settings(window, targets.first().copied().unwrap_or_default(), engine)?;
        let step = checks::frame_step(&numbers);
        let gaps = match &job.settings.frames {
            Some(asked) => asked.missing(&numbers),
            None if job.sequence.named.is_some() => Vec::new(),
            None => FrameSet::every(step, &numbers).missing(&numbers),
        };
        let mut warnings = header_warnings(job, &headers, &gaps)?;
        // Of a shot that is still being rendered, nobody knows the step.
        warnings.extend(checks::apart(step).filter(|_| window > 0 && job.whole.is_none()));
        let (empty, mut damage) = (Manifest::default(), None);
        let manifest = match ledger.read() {
            // A run replaces it.
            Err(e @ Error::BadFile { .. }) => {
                let lost = "what it says about the frames there is not known";
                warnings.push(Warning::new(WarningKind::Manifest, format!("{e}: {lost}; a run keeps it as {DAMAGED}")));
                damage = Some(e);
                &empty
            }
            known => known?,
        };
        let frames = plan_frames(job, &targets, &settings, &sources, (manifest, damage.as_ref()), &mut files)?;
        let entry = |f: &PlannedFrame| manifest.entry(&f.output).map(|e| (f.frame, e.clone()));
        let before = frames.iter().filter_map(entry).collect();
        warnings.extend(redone_warnings(&frames));
        let missing = if job.settings.frames.is_some() { gaps } else { Vec::new() };
        Ok(Self { settings, frames, warnings, missing, sources, before })
    }

    /// The settings of one frame.
    pub(super) fn settings_of(&self, frame: &PlannedFrame) -> FrameSettings {
        FrameSettings { lambda: frame.lambda, lambda_masked: frame.lambda_masked, ..self.settings.clone() }
    }

    /// The entry of a frame in the manifest before anything is done.
    pub(super) fn entry(&self, frame: &PlannedFrame, settings: &str) -> Entry {
        Entry {
            frame: frame.frame,
            source: absolute(&frame.source),
            stamp: self.sources.stamp(frame.frame),
            lambda_image: None,
            output: None,
            status: Status::Planned,
            reason: None,
            settings: settings.into(),
            hush: env!("CARGO_PKG_VERSION").into(),
            neighbours: self.neighbour_entries(&frame.neighbours),
            warnings: Vec::new(),
            left_out: Vec::new(),
            seconds: 0.0,
        }
    }

    /// The entry of a frame that is current. Files that were only copied or touched since are known by their new dates.
    pub(super) fn skipped(&self, before: &Entry, frame: &PlannedFrame) -> Entry {
        let (output, image) = (&frame.output, frame.lambda_image.as_deref());
        let dated = |then: Option<FileState>, now: Option<FileState>| {
            then.map(|then| FileState { content: then.content, ..now.unwrap_or(then) })
        };
        let mut entry = Entry { status: Status::Skipped, reason: Some("already done".into()), ..before.clone() };
        entry.stamp = dated(entry.stamp, self.sources.stamp(entry.frame));
        entry.output = dated(entry.output, FileState::of(output));
        entry.lambda_image = dated(entry.lambda_image, image.and_then(FileState::of));
        for neighbour in &mut entry.neighbours {
            neighbour.stamp = dated(neighbour.stamp, self.sources.stamp(neighbour.frame));
        }
        entry
    }

    /// A window as the manifest tells it.
    pub(super) fn neighbour_entries(&self, window: &[WindowFrame]) -> Vec<NeighbourEntry> {
        window.iter().map(|n| neighbour_entry(n, &self.sources)).collect()
    }
}

/// The manifest is text, and names the rendered files by their paths.
fn check_paths(job: &Job) -> Result<()> {
    let mut paths = job.sequence.frames.iter().map(|frame| absolute(&frame.path));
    let Some(odd) = paths.find(|path| path.to_str().is_none()) else { return Ok(()) };
    let reason = format!("its path is not UTF-8, and {MANIFEST} can hold no other: rename the file or its folder");
    Err(Error::BadInput { input: odd.display().to_string(), reason })
}

fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf())
}

fn neighbour_entry(n: &WindowFrame, sources: &Sources) -> NeighbourEntry {
    let stamp = sources.stamp(n.number);
    NeighbourEntry { offset: n.offset, frame: n.number, used: n.unused.is_none(), reason: n.unused, stamp, dial: None }
}

/// The window: what was asked for, which then needs vectors; else what the vectors allow.
pub(super) fn resolve_window(job: &Job, sources: &Sources, headers: &[Header], reach: usize) -> Result<usize> {
    let without = headers.iter().find(|h| !h.vector);
    match (job.settings.window, without) {
        (Some(window), Some(h)) if window > 0 => {
            let path = sources.good.get(&h.number).map(|s| s.path.clone()).unwrap_or_default();
            Err(Error::MissingPass { path, pass: checks::VECTOR.into(), advice: checks::vector_advice(h) })
        }
        (Some(window), _) => Ok(window),
        (None, _) => {
            let vector = job.whole.is_some_and(|w| w.vector) || headers.iter().any(|h| h.vector);
            Ok(if vector { reach } else { 0 })
        }
    }
}

fn header_warnings(job: &Job, headers: &[Header], gaps: &[(i64, i64)]) -> Result<Vec<Warning>> {
    let odd = job.lambda_notes().into_iter().chain(job.notes.iter().cloned());
    let mut warnings: Vec<Warning> = odd.map(|n| Warning::new(WarningKind::Setting, n)).collect();
    for warning in [checks::missing_frames(gaps), checks::resolution(headers)].into_iter().flatten() {
        if job.strict {
            return Err(Error::BadInput { input: job.sequence.name.clone(), reason: warning.message });
        }
        warnings.push(warning);
    }
    let vectors_wanted = job.vectors() && job.settings.window != Some(0);
    warnings.extend(vectors_wanted.then(|| checks::no_vector(headers)).flatten());
    warnings.extend(checks::noisy_image(headers));
    warnings.extend(checks::maybe_denoised(headers));
    warnings.extend(checks::missing_guides(headers));
    warnings.extend(checks::notes(headers));
    if !job.sequence.ignored.is_empty() {
        let names = job.sequence.ignored.iter().take(3).map(|p| p.display().to_string()).collect::<Vec<_>>().join(", ");
        let message = format!("left out {names}: no frame number in the name (files left out: {})", job.sequence.ignored.len());
        warnings.push(Warning::new(WarningKind::Ignored, message));
    }
    Ok(warnings)
}

/// Frames that are made again, by reason.
fn redone_warnings(frames: &[PlannedFrame]) -> Vec<Warning> {
    // Keyframed λ changes from another value to another value in each frame; that is one reason.
    let kind = |why: &'_ str| match other_than_dials(why) {
        (true, rest) => (true, (!rest.is_empty()).then(|| rest.to_owned())),
        (false, _) => (false, Some(why.to_owned())),
    };
    let mut reasons: BTreeMap<_, Vec<(i64, &str)>> = BTreeMap::new();
    for frame in frames {
        if let Action::Denoise(Some(why)) = &frame.action {
            reasons.entry(kind(why)).or_default().push((frame.frame, why));
        }
    }
    let mut warnings = Vec::new();
    for ((_, rest), some) in reasons {
        let numbers: Vec<i64> = some.iter().map(|(number, _)| *number).collect();
        let verb = if numbers.len() == 1 { "is" } else { "are" };
        let why = match some.as_slice() {
            [(_, first), others @ ..] if others.iter().all(|(_, why)| why == first) => (*first).to_owned(),
            _ => format!("lambda has changed{}", rest.map(|rest| format!(", {rest}")).unwrap_or_default()),
        };
        let message = format!("{} {verb} made again: {why}", words::frames(&numbers));
        warnings.push(Warning::new(WarningKind::Redone, message));
    }
    warnings
}

/// Whether a reason begins with values of the dials, and what comes after them.
fn other_than_dials(why: &str) -> (bool, &str) {
    let mut rest = why;
    for dial in ["lambda ", "lambda masked "] {
        let value = rest.strip_prefix(dial).filter(|value| value.starts_with(|c: char| c.is_ascii_digit()));
        rest = value.map_or(rest, |value| value.split_once(", ").map_or("", |(_, rest)| rest));
    }
    (rest.len() < why.len(), rest)
}

/// Whether a frame was done without a neighbour that should have helped.
pub(super) fn is_degraded<'a>(reasons: impl IntoIterator<Item = &'a Option<Unused>>) -> bool {
    reasons.into_iter().any(|r| *r == Some(Unused::Bad))
}

/// The missing frames of a plan, for the summary.
pub(super) fn missing_text(plan: &Plan) -> String {
    words::ranges(&plan.missing)
}
