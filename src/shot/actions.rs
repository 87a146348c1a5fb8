//! What is to be done with each frame of the range, and when a run is refused because of what is there.

use std::path::PathBuf;

use super::currency::{Wanted, is_of_another_shot, same_input, why_stale};
use super::dial::FrameDial;
use super::events::Status;
use super::file_state::FileMemory;
use super::frame_settings::FrameSettings;
use super::input_file::InputFile;
use super::job::Job;
use super::manifest::{Entry, MANIFEST, Manifest};
use super::output::output_path;
use super::planned_frame::{Action, PlannedFrame};
use super::sources::Sources;
use crate::error::{Error, Result};
use crate::rules::window::{Unused, WindowFrame, neighbours};
use crate::words::{self, counted};

/// The frames of the range. The manifest is an empty one where `damage` says why it cannot be read.
///
/// # Errors
/// What is there is not Hush's, was made from another shot, or is better than what this run would make; with `strict` a mask image that
/// is not there.
pub(super) fn plan_frames(
    job: &Job,
    targets: &[i64],
    settings: &FrameSettings,
    sources: &Sources,
    (manifest, damage): (&Manifest, Option<&Error>),
    files: &mut FileMemory,
) -> Result<Vec<PlannedFrame>> {
    let mut frames = Vec::with_capacity(targets.len());
    let mut foreign: Vec<PathBuf> = Vec::new();
    let mut others: Vec<(PathBuf, PathBuf)> = Vec::new();
    let mut worse: Vec<(i64, String)> = Vec::new();
    for &number in targets {
        let Some(source) = job.sequence.path(number) else { continue };
        let output = output_path(job, source);
        let FrameDial { lambda, lambda_masked, lambda_image } = FrameDial::of(job, number);
        let settings = &FrameSettings { lambda, lambda_masked, ..settings.clone() };
        let window = neighbours(number, settings.context(), |n| sources.known(n));
        let entry = manifest.entry(&output);
        let no_image = lambda_image.as_ref().and_then(|image| std::fs::metadata(image).map_err(|e| Error::io(image, e)).err());
        let no_image = match no_image {
            Some(error) if job.strict => return Err(error),
            other => other.map(|error| error.to_string()),
        };
        let action = match sources.bad.get(&number) {
            Some(error) => Action::Fail(error.to_string()),
            None => match entry {
                _ if let Some(reason) = no_image => Action::Fail(reason),
                _ if job.overwrite || !output.exists() => Action::Denoise(None),
                Some(entry) if is_of_another_shot(entry, source, &output, files) => {
                    others.push((output.clone(), entry.source.clone()));
                    Action::Denoise(None)
                }
                Some(entry) => {
                    let image = lambda_image.as_deref();
                    let wanted = Wanted { job, settings, sources, lambda_image: image };
                    match why_stale(entry, &output, &wanted, manifest, files) {
                        None => Action::Skip,
                        Some(stale) => {
                            let vectors = sources.good.get(&number).and_then(InputFile::vector_layer);
                            let loss = why_older(entry, settings, manifest)
                                .or_else(|| why_worse(job, entry, manifest, vectors, &window));
                            worse.extend(loss.filter(|_| same_input(entry, &job.sequence, files)).map(|why| (number, why)));
                            Action::Denoise(Some(stale.reason))
                        }
                    }
                }
                None => {
                    foreign.push(output.clone());
                    Action::Denoise(None)
                }
            },
        };
        let source = source.into();
        frames.push(PlannedFrame {
            frame: number,
            source,
            output,
            lambda,
            lambda_masked,
            lambda_image,
            action,
            neighbours: window,
        });
    }
    if let Some(first) = foreign.first() {
        let silent = match damage {
            Some(damage) => format!("{damage}, so that nobody knows who wrote it"),
            None => format!("{MANIFEST} does not say that Hush wrote it"),
        };
        let reason = format!(
            "is there already, and {silent} ({}): choose another output folder or set overwrite to true to replace what is there",
            counted(foreign.len(), "such file")
        );
        return Err(Error::io(first, std::io::Error::new(std::io::ErrorKind::AlreadyExists, reason)));
    }
    if let Some((first, source)) = others.first() {
        let reason = format!(
            "was made from {}, which is another frame and still there ({}): choose another output folder or set overwrite to true to \
             replace what is there",
            source.display(),
            counted(others.len(), "such file")
        );
        return Err(Error::BadInput { input: first.display().to_string(), reason });
    }
    if let Some((_, why)) = worse.first() {
        let numbers: Vec<i64> = worse.iter().map(|(n, _)| *n).collect();
        return Err(Error::BadInput {
            input: job.output.display().to_string(),
            reason: format!(
                "holds {} better than this run would make {} of the same files: {why}",
                words::frames(&numbers),
                if numbers.len() == 1 { "it" } else { "them" }
            ),
        });
    }
    Ok(frames)
}

/// Why a frame that a later Hush made is not made again by this one: two versions on a farm would make each other's frames for ever.
fn why_older(entry: &Entry, now: &FrameSettings, manifest: &Manifest) -> Option<String> {
    let done = matches!(entry.status, Status::Denoised | Status::Skipped);
    let later = manifest.settings.get(&entry.settings).is_some_and(|then| then.engine.revision > now.engine.revision);
    (done && later)
        .then(|| format!("made by Hush {}, a later one than this: use that version, or set overwrite to true", entry.hush))
}

/// Why a frame that is there is better than the one that would take its place; only what was not asked for counts.
fn why_worse(job: &Job, entry: &Entry, manifest: &Manifest, vectors: Option<&str>, window: &[WindowFrame]) -> Option<String> {
    if job.settings.window.is_some() || !job.vectors() || !matches!(entry.status, Status::Denoised | Status::Skipped) {
        return None;
    }
    let old = manifest.settings.get(&entry.settings)?;
    if !entry.neighbours.iter().any(|n| n.used) {
        return None;
    }
    let lost = old.vector_layer().filter(|layer| job.settings.vector_layer.is_none() && Some(*layer) != vectors);
    if let Some(layer) = lost {
        return Some(format!(
            "made with the motion vectors of view layer {layer}, which is not named any more: set vector layer to '{layer}', or set \
             overwrite to true"
        ));
    }
    let alone = !window.iter().any(|n| n.unused.is_none());
    let (why, mend) = match window.iter().any(|n| n.unused == Some(Unused::NoVector)) {
        true => ("frames beside helped, and now there are no motion vectors for that", ""),
        false => ("frames beside helped, which now are missing, damaged or of another size", "render those again, or "),
    };
    alone.then(|| format!("{why}: {mend}set window to 0, or set overwrite to true"))
}
