//! Which files of two shots belong together.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::EvaluateOptions;
use crate::error::{Error, Result};
use crate::io::sequence::Sequence;
use crate::words;

/// The files of one frame.
pub(super) struct Item {
    pub frame: i64,
    pub reference: PathBuf,
    /// None if the frame is missing.
    pub denoised: Option<PathBuf>,
    pub vectors: Option<PathBuf>,
    pub second: Option<PathBuf>,
    pub brightness: Option<PathBuf>,
}

/// Every reference's frame with its counterparts, and what was left over.
pub(super) fn pair_up(reference: &Path, denoised: &Path, options: &EvaluateOptions) -> Result<(Vec<Item>, Vec<String>)> {
    let references = files(reference)?;
    // Single files belong together whatever their numbers.
    let frame = references.keys().next().copied().filter(|_| reference.is_file() && denoised.is_file());
    let numbered = |path: &Path| -> Result<BTreeMap<i64, PathBuf>> {
        let found = files(path)?;
        Ok(match frame.filter(|_| path.is_file()) {
            Some(frame) => found.into_values().map(|path| (frame, path)).collect(),
            None => found,
        })
    };
    let others = |path: Option<&PathBuf>| path.map(|p| numbered(p)).transpose().map(Option::unwrap_or_default);
    let mut results = numbered(denoised)?;
    let mut guides = others(options.vectors.as_ref())?;
    let mut seconds = others(options.unbiased.as_ref().map(|u| &u.reference))?;
    let mut brightness = others(options.unbiased.as_ref().map(|u| &u.brightness))?;
    let numbers = |map: &BTreeMap<i64, PathBuf>| words::frames(&map.keys().copied().collect::<Vec<_>>());
    if !references.keys().any(|n| results.contains_key(n)) {
        return Err(Error::BadInput {
            input: denoised.display().to_string(),
            reason: format!(
                "no frame has a reference: {} here, {} in {}",
                numbers(&results),
                numbers(&references),
                reference.display()
            ),
        });
    }
    let mut warnings = Vec::new();
    let extra: Vec<i64> = results.keys().copied().filter(|n| !references.contains_key(n)).collect();
    if !extra.is_empty() {
        warnings.push(format!("Not compared, as they have no reference: denoised {}.", words::frames(&extra)));
    }
    let items = references
        .into_iter()
        .map(|(frame, reference)| Item {
            frame,
            reference,
            denoised: results.remove(&frame),
            vectors: guides.remove(&frame),
            second: seconds.remove(&frame),
            brightness: brightness.remove(&frame),
        })
        .collect();
    Ok((items, warnings))
}

/// The files that a path names, by frame number.
fn files(path: &Path) -> Result<BTreeMap<i64, PathBuf>> {
    Ok(Sequence::find(&[path])?.named_frames().map(|f| (f.number, f.path.clone())).collect())
}
