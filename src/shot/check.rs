//! Which frames of a shot are current, which are stale and why, without denoising anything: for all that shows, lists or
//! composites denoised frames.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::currency::{Stale, StaleKind, Wanted, why_stale};
use super::events::Status;
use super::file_state::FileMemory;
use super::frame_settings::FrameSettings;
use super::job::Job;
use super::ledger::Ledger;
use super::manifest::{Entry, Manifest};
use super::output::{check_output, output_path};
use super::prepare::resolve_window;
use super::sources::{Sources, open_sources};
use crate::error::{Error, Result};
use crate::io::{NumberPattern, split_number};
use crate::rules::checks::Header;
use crate::rules::window::DEFAULT_WINDOW;

/// More frames than this are not listed one by one.
const MOST: usize = 1_000_000;

/// How a frame stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FrameState {
    /// The denoised file is what denoising now would give.
    Current,
    /// There is a denoised file, but it is not.
    Stale,
    /// It is rendered and not denoised.
    Missing,
    /// It is neither.
    Unrendered,
}

/// One frame of a check.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct CheckedFrame {
    /// Frame number.
    pub frame: i64,
    /// How it stands.
    pub state: FrameState,
    /// What makes it stale, or kept it from being denoised.
    pub kind: Option<StaleKind>,
    /// The same in words.
    pub reason: Option<String>,
    /// The rendered file, where it is there.
    pub source: Option<PathBuf>,
    /// The denoised file, where it is there.
    pub output: Option<PathBuf>,
    /// Width of the denoised file in pixels.
    pub columns: Option<usize>,
    /// Its height.
    pub rows: Option<usize>,
}

/// How many frames stand how.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// [`FrameState::Current`].
    pub current: usize,
    /// [`FrameState::Stale`].
    pub stale: usize,
    /// [`FrameState::Missing`].
    pub missing: usize,
    /// [`FrameState::Unrendered`].
    pub unrendered: usize,
}

/// The result of a check.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Checked {
    /// The frames that were asked for, else those that are rendered or denoised; ascending.
    pub frames: Vec<CheckedFrame>,
    /// Their numbers.
    pub counts: Counts,
}

/// Checks sequences and remembers what it saw: asked again, a file that did not change costs a `stat`.
#[derive(Debug, Default)]
pub struct SequenceCheck {
    ledgers: BTreeMap<PathBuf, Ledger>,
    files: FileMemory,
}

impl SequenceCheck {
    /// One that has seen nothing yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// How the frames of a job stand. The job's sequence may be empty, where nothing is rendered. Writes nothing.
    ///
    /// # Errors
    /// A setting out of range, an output folder that holds the inputs, a manifest that cannot be read.
    pub fn check(&mut self, job: &Job) -> Result<Checked> {
        check_output(job)?;
        let identity = job.settings.identity()?;
        let Self { ledgers, files } = self;
        let ledger = ledgers.entry(job.output.clone()).or_insert_with(|| Ledger::new(&job.output));
        let advise = |error| match error {
            Error::BadFile { path, reason } => {
                let advice = "put a copy of it back, or denoise again and set overwrite to true";
                Error::BadFile { path, reason: format!("{reason}: what it says about the frames there is not known: {advice}") }
            }
            other => other,
        };
        let manifest = ledger.read().map_err(advise)?;
        let recorded = recorded(job, manifest);
        let numbers = job.sequence.numbers();
        let targets = targets(job, &numbers, &recorded)?;
        let reach = job.reach()?;
        let sources = open_sources(job, &numbers, |n| is_near(&targets, n, identity.context(reach)), files);
        let headers: Vec<Header> = targets.iter().filter_map(|t| sources.good.get(t)).map(|s| s.header.clone()).collect();
        let settings = resolve_window(job, &sources, &headers, reach).and_then(|window| job.frame_settings(window, 0, &identity));
        let mut look = Look { job, manifest, sources: &sources, settings: settings.as_ref(), files };
        let mut checked = Checked::default();
        for number in targets {
            let frame = look.at(number, recorded.get(&number));
            let counts = &mut checked.counts;
            *match frame.state {
                FrameState::Current => &mut counts.current,
                FrameState::Stale => &mut counts.stale,
                FrameState::Missing => &mut counts.missing,
                FrameState::Unrendered => &mut counts.unrendered,
            } += 1;
            checked.frames.push(frame);
        }
        Ok(checked)
    }
}

/// What one check looks with.
struct Look<'a> {
    job: &'a Job,
    manifest: &'a Manifest,
    sources: &'a Sources,
    /// The settings now, λ aside; or why the frames could not be denoised with them.
    settings: Result<&'a FrameSettings, &'a Error>,
    files: &'a mut FileMemory,
}

impl Look<'_> {
    /// At a frame; `recorded` is its output and what the manifest says about it.
    fn at(&mut self, number: i64, recorded: Option<&(PathBuf, &Entry)>) -> CheckedFrame {
        let input = self.job.sequence.path(number).filter(|path| path.exists());
        let named = input.map(|path| output_path(self.job, path)).or(recorded.map(|(output, _)| output.clone()));
        let output = named.filter(|output| output.exists());
        let entry = recorded.map(|(_, entry)| *entry);
        let damaged = self.damage(number, input);
        let (state, stale) = match (&output, input) {
            (Some(_), None) => (
                FrameState::Stale,
                Some(Stale::new(StaleKind::InputMissing, "the input is gone: render it again, or delete the denoised frame")),
            ),
            (Some(output), Some(_)) => match self.why_stale(number, output, entry, damaged) {
                None => (FrameState::Current, None),
                stale => (FrameState::Stale, stale),
            },
            (None, Some(_)) => (FrameState::Missing, why_missing(entry, damaged)),
            (None, None) => (FrameState::Unrendered, None),
        };
        let size = output.as_deref().and_then(|output| self.files.layout(output).ok());
        CheckedFrame {
            frame: number,
            state,
            kind: stale.as_ref().map(|s| s.kind),
            reason: stale.map(|s| s.reason),
            source: input.map(Path::to_path_buf),
            output,
            columns: size.as_ref().map(|layout| layout.columns),
            rows: size.as_ref().map(|layout| layout.rows),
        }
    }

    /// What is wrong with the rendered file, if anything.
    fn damage(&mut self, number: i64, input: Option<&Path>) -> Option<String> {
        let path = input?;
        let bad = self.sources.bad.get(&number).map(ToString::to_string);
        bad.or_else(|| (!self.files.is_complete(path)).then(|| format!("{} is cut short", path.display())))
    }

    fn why_stale(&mut self, number: i64, output: &Path, entry: Option<&Entry>, damaged: Option<String>) -> Option<Stale> {
        let Some(entry) = entry else {
            return Some(Stale::new(StaleKind::Foreign, "the manifest does not say that Hush wrote it"));
        };
        if let Some(reason) = damaged {
            return Some(Stale::new(StaleKind::InputDamaged, reason));
        }
        let settings = match self.settings {
            Ok(settings) => FrameSettings {
                lambda: self.job.lambda().at(number),
                lambda_masked: self.job.lambda_masked(number),
                window: self.window_of(number, entry, settings.window),
                ..settings.clone()
            },
            Err(error) => return Some(Stale::new(StaleKind::Setting("window"), error.to_string())),
        };
        let image = self.job.lambda_image(number);
        let wanted = Wanted { job: self.job, settings: &settings, sources: self.sources, lambda_image: image.as_deref() };
        why_stale(entry, output, &wanted, self.manifest, self.files)
    }

    /// The window of a frame. Without vectors of its own a frame has the window of its shot, of which not every frame is looked at.
    fn window_of(&self, number: i64, entry: &Entry, window: usize) -> usize {
        let vector = self.sources.good.get(&number).is_some_and(|source| source.header.vector);
        let then = self.manifest.settings.get(&entry.settings).map(|settings| settings.window);
        let same = then.filter(|then| *then == 0 || *then == DEFAULT_WINDOW);
        if self.job.settings.window.is_none() && !vector { same.unwrap_or(window) } else { window }
    }
}

fn why_missing(entry: Option<&Entry>, damaged: Option<String>) -> Option<Stale> {
    if let Some(reason) = damaged {
        return Some(Stale::new(StaleKind::InputDamaged, reason));
    }
    let failed = entry.filter(|entry| entry.status == Status::Failed)?;
    Some(Stale::new(StaleKind::Failed, failed.reason.clone().unwrap_or_else(|| "it failed before".into())))
}

/// The frames to look at, ascending.
fn targets(job: &Job, numbers: &[i64], recorded: &BTreeMap<i64, (PathBuf, &Entry)>) -> Result<Vec<i64>> {
    let mut targets: Vec<i64> = match &job.settings.frames {
        Some(frames) if frames.count() > MOST => {
            let reason = format!("are more than {MOST}: name those that the shot has");
            return Err(Error::BadSetting { name: "frames", reason });
        }
        Some(frames) => frames.iter().collect(),
        None => {
            let all = numbers.iter().chain(recorded.keys()).copied();
            all.filter(|n| job.sequence.is_named(*n)).collect()
        }
    };
    targets.sort_unstable();
    targets.dedup();
    Ok(targets)
}

/// Whether one of the ascending targets is at most so many frames away.
fn is_near(targets: &[i64], number: i64, reach: usize) -> bool {
    let at = targets.partition_point(|t| *t < number);
    let close = |t: Option<&i64>| t.is_some_and(|t| t.abs_diff(number) <= reach as u64);
    close(targets.get(at)) || close(at.checked_sub(1).and_then(|before| targets.get(before)))
}

/// What the manifest says about the frames of this sequence, by number, with the outputs' paths.
fn recorded<'m>(job: &Job, manifest: &'m Manifest) -> BTreeMap<i64, (PathBuf, &'m Entry)> {
    let pattern = NumberPattern::parse(&job.sequence.name).ok().flatten();
    let ours = |name: &str| match &pattern {
        Some(pattern) => pattern.number(name).map(|(number, _)| number),
        None if job.sequence.name.is_empty() => split_number(name).map(|(_, number, ..)| number),
        None => (name == job.sequence.name).then_some(1),
    };
    let entries = manifest.frames.iter();
    entries.filter_map(|(name, entry)| Some((ours(name)?, (job.output.join(name), entry)))).collect()
}
