//! The one answer to "is this frame current?": whether a denoised frame is what denoising now would give. The run, the watch, the
//! check of a sequence and, through it, everything that shows or composites a frame ask here.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::events::Status;
use super::file_state::FileMemory;
use super::frame_settings::{Change, FrameSettings};
use super::job::Job;
use super::manifest::{Entry, Manifest, NeighbourEntry};
use super::output::real_folder;
use super::sources::Sources;
use crate::io::sequence::Sequence;
use crate::rules::window::{Availability, Unused, neighbours};

/// What is not as it was when a frame was denoised.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum StaleKind {
    /// More than one setting.
    Several,
    /// The rendered frame is another one.
    InputChanged,
    /// The rendered frame is gone.
    InputMissing,
    /// The rendered frame is damaged.
    InputDamaged,
    /// This Hush makes another frame of the same input, weights and settings.
    Revision,
    /// The image that is the mask of λ is another one, came or went.
    LambdaImage,
    /// A frame beside it changed, came or went, or its λ did where the second pass takes its result.
    Neighbours,
    /// The denoised file is damaged.
    OutputDamaged,
    /// The denoised file is not the one that was written.
    OutputChanged,
    /// The run that was to make it again was stopped.
    Unfinished,
    /// Denoising it failed.
    Failed,
    /// Hush did not write it.
    Foreign,
    /// A setting, by its name or its table's.
    #[serde(untagged)]
    Setting(&'static str),
}

/// Why a denoised frame is not current.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Stale {
    /// What is different.
    pub kind: StaleKind,
    /// In words, after a colon: `the input changed`.
    pub reason: String,
}

impl Stale {
    /// Of this kind, for this reason.
    pub(super) fn new(kind: StaleKind, reason: impl Into<String>) -> Self {
        Self { kind, reason: reason.into() }
    }
}

/// What a frame would be made from and with now.
pub(super) struct Wanted<'a> {
    /// The rendered frames, and the dials of those around it.
    pub job: &'a Job,
    /// The settings, λ that of the frame.
    pub settings: &'a FrameSettings,
    /// The files of the shot.
    pub sources: &'a Sources,
    /// The image that is the mask of λ.
    pub lambda_image: Option<&'a Path>,
}

/// Why the output that `entry` describes is not current; None where it is.
pub(super) fn why_stale(
    entry: &Entry,
    output: &Path,
    wanted: &Wanted<'_>,
    manifest: &Manifest,
    files: &mut FileMemory,
) -> Option<Stale> {
    let stale = |kind, reason: &str| Some(Stale::new(kind, reason));
    match entry.status {
        Status::Planned => return stale(StaleKind::Unfinished, "it was not finished"),
        Status::Failed => return stale(StaleKind::Failed, "it failed before"),
        Status::Denoised | Status::Skipped => {}
    }
    let then = manifest.settings.get(&entry.settings);
    if then.is_some_and(|then| then.engine.revision != wanted.settings.engine.revision) {
        return stale(StaleKind::Revision, &format!("this Hush denoises it differently from Hush {}, which made it", entry.hush));
    }
    if then != Some(wanted.settings) {
        return Some(settings_changed(then, wanted.settings));
    }
    let path = wanted.job.sequence.path(entry.frame);
    if entry.stamp.is_none() || !files.is_same(path, entry.stamp) {
        return stale(StaleKind::InputChanged, "the input changed");
    }
    if !files.is_same(wanted.lambda_image, entry.lambda_image) {
        return stale(StaleKind::LambdaImage, "the lambda image changed");
    }
    if !same_window(entry, wanted, files) {
        return stale(StaleKind::Neighbours, "frames beside it changed");
    }
    if !files.is_complete(output) {
        return stale(StaleKind::OutputDamaged, "the output is damaged");
    }
    if entry.output.is_some() && !files.is_same(Some(output), entry.output) {
        return stale(StaleKind::OutputChanged, "the output is not the one that was written");
    }
    None
}

/// Whether the input of a frame is the one that it was made from.
pub(super) fn same_input(entry: &Entry, sequence: &Sequence, files: &mut FileMemory) -> bool {
    entry.stamp.is_some() && files.is_same(sequence.path(entry.frame), entry.stamp)
}

/// Whether an output was made from a frame of another shot: one under another path, still there as it was then. Not where rendered and
/// denoised frames were copied together, as with the folder of a project or of a version.
pub(super) fn is_of_another_shot(entry: &Entry, source: &Path, output: &Path, files: &mut FileMemory) -> bool {
    let elsewhere = std::path::absolute(source).is_ok_and(|source| source != entry.source);
    let recorded = elsewhere && entry.stamp.is_some();
    let is_other = recorded && !files.is_same(Some(source), entry.stamp) && files.is_same(Some(&entry.source), entry.stamp);
    is_other && !came_along(&real_file(&entry.source), &real_file(source), &real_file(output))
}

/// Whether the output lies below the folder that tells where the frame is now from where it was, and that folder is beside the other one.
fn came_along(then: &Path, now: &Path, output: &Path) -> bool {
    let alike = then.components().rev().zip(now.components().rev()).take_while(|(then, now)| then == now).count();
    let (Some(old), Some(new)) = (then.ancestors().nth(alike), now.ancestors().nth(alike)) else { return false };
    output.starts_with(new) && !output.starts_with(old) && !old.starts_with(new)
}

/// A file's path with its folder's links followed.
fn real_file(path: &Path) -> PathBuf {
    real_folder(path.parent().unwrap_or(path)).join(path.file_name().unwrap_or_default())
}

fn same_window(entry: &Entry, wanted: &Wanted<'_>, files: &mut FileMemory) -> bool {
    // What turned out to be damaged when it was decoded still is, whatever its header says.
    let mut damaged = |n: &&NeighbourEntry| {
        let bad = n.reason == Some(Unused::Bad) && !n.is_unknown();
        bad && n.dial.is_none() && files.is_same(wanted.job.sequence.path(n.frame), n.stamp)
    };
    let damaged: BTreeSet<i64> = entry.neighbours.iter().filter(&mut damaged).map(|n| n.frame).collect();
    let window = neighbours(entry.frame, wanted.settings.context(), |n| match damaged.contains(&n) {
        true => Availability::Bad,
        false => wanted.sources.known(n),
    });
    entry.neighbours.len() == window.len()
        && window.iter().zip(&entry.neighbours).all(|(now, then)| {
            let same = now.offset == then.offset && helps_as_before(now.unused, then);
            same && files.is_same(wanted.job.sequence.path(now.number), then.stamp)
                && then.dial.as_ref().is_none_or(|dial| dial.is_same(wanted.job, now.number, files))
        })
}

/// Whether a neighbour is used, bad or neither, as it was. At the end of what was there, a frame may have been missing or not to come.
fn helps_as_before(now: Option<Unused>, then: &NeighbourEntry) -> bool {
    // A result that could not be had for its dial could not be had now.
    let failed = then.dial.is_some() && !then.used && !then.is_unknown();
    failed || (now.is_none() == then.used && (now == Some(Unused::Bad)) == (then.reason == Some(Unused::Bad)))
}

fn settings_changed(old: Option<&FrameSettings>, new: &FrameSettings) -> Stale {
    let changes = old.map(|old| new.changes_since(old)).unwrap_or_default();
    match changes.as_slice() {
        [] => Stale::new(StaleKind::Several, "the settings changed"),
        [one] => Stale::new(StaleKind::Setting(one.setting.table()), one.to_string()),
        some => Stale::new(StaleKind::Several, some.iter().map(Change::to_string).collect::<Vec<_>>().join(", ")),
    }
}
