//! Compares the frames of a denoised shot with their references.

use std::path::{Path, PathBuf};

use ndarray::{Array3, ArrayView3};

use super::evaluation::{Evaluation, FrameEvaluation, Motion, Scores, UnbiasedScores, mean, standard_errors};
use super::images::{ImageChoice, Images, Independent, read};
use super::pairing::{Item, pair_up};
use super::remarks::{Traits, remarks};
use super::{Pair, Scaling, flicker, flip, psnr, relmse, smape, ssim, unbiased_flicker_squared, unbiased_relmse};
use crate::error::{Error, Result};

/// How to compare.
#[derive(Clone, Debug, Default)]
pub struct EvaluateOptions {
    /// What images are multiplied by first.
    pub scaling: Scaling,
    /// Folder, pattern or file whose Vector passes flicker follows, such as the noisy shot. Without it, and for frames that it
    /// lacks, those of the denoised files, then of the references.
    pub vectors: Option<PathBuf>,
    /// What the unbiased errors need; without it there are none.
    pub unbiased: Option<UnbiasedOptions>,
    /// What to read of every file.
    pub images: ImageChoice,
}

/// Where the unbiased errors take their images from, frames named alike.
#[derive(Clone, Debug)]
pub struct UnbiasedOptions {
    /// A second reference, rendered with another seed.
    pub reference: PathBuf,
    /// Images as bright as the truth that know nothing of either reference, the same for all that is compared.
    pub brightness: PathBuf,
}

/// Compares `denoised` with `reference`: folders, patterns (`####`, `%04d`, globs) or files of one frame each.
///
/// Frames are paired by number; two single files are paired whatever their numbers. The beauty pass is read (Combined, also
/// where the file keeps a Noisy Image beside it), and for flicker the Vector pass. All but the unbiased errors are against `reference`
/// alone.
///
/// # Errors
/// Inputs that name no sequence, or sequences without a common frame. A frame that is missing or cannot be read or compared is
/// no error: it has a row that says why, and counts in [`Evaluation::failed`].
pub fn evaluate(reference: &Path, denoised: &Path, options: &EvaluateOptions) -> Result<Evaluation> {
    let (items, mut warnings) = pair_up(reference, denoised, options)?;
    let mut frames: Vec<FrameEvaluation> = Vec::with_capacity(items.len());
    let mut traits = Traits::default();
    let mut previous: Option<(i64, Images)> = None;
    for item in items {
        let before = previous.take().filter(|(number, _)| number + 1 == item.frame).map(|(_, images)| images);
        let mut row = FrameEvaluation {
            frame: item.frame,
            reference: item.reference.clone(),
            denoised: item.denoised.clone(),
            scores: None,
            motion: None,
            non_finite_reference: 0,
            non_finite_denoised: 0,
            error: None,
        };
        match compare(&item, before.as_ref(), options, &mut row) {
            Ok(outcome) => {
                warnings.extend(outcome.warnings);
                traits.still.extend(outcome.still.then_some(item.frame));
                traits.denoised_reference.extend(outcome.denoised_reference.then_some(item.frame));
                traits.cropped_apart.extend(outcome.cropped_apart.then_some(item.frame));
                traits.same_pictures.extend(outcome.images.has_twins().then_some(item.frame));
                let alone = options.unbiased.is_some() && (item.second.is_none() || item.brightness.is_none());
                traits.one_reference.extend(alone.then_some(item.frame));
                previous = Some((item.frame, outcome.images));
            }
            Err(e) => row.error = Some(e.to_string()),
        }
        frames.push(row);
    }
    warnings.extend(remarks(&frames, &traits, options.vectors.is_some()));
    let standard_errors = standard_errors(&frames);
    Ok(Evaluation { scaling: options.scaling, mean: mean(&frames), standard_errors, frames, warnings })
}

struct Outcome {
    images: Images,
    /// Why there is no flicker although the frame before is there, or no unbiased error although the second reference is.
    warnings: Vec<String>,
    still: bool,
    denoised_reference: bool,
    /// Whether the two files are cropped at different places.
    cropped_apart: bool,
}

/// Reads and compares one frame; writes what it finds into `row`.
fn compare(item: &Item, previous: Option<&Images>, options: &EvaluateOptions, row: &mut FrameEvaluation) -> Result<Outcome> {
    let Some(denoised) = &item.denoised else {
        let reason = "there is no denoised frame with this number".into();
        return Err(Error::BadInput { input: format!("frame {}", item.frame), reason });
    };
    let reference = read(&item.reference, false, &options.images)?;
    let result = read(denoised, previous.is_some(), &options.images)?;
    let (denoised_reference, cropped_apart) = (reference.denoised, reference.origin != result.origin);
    let mut warnings = Vec::new();
    let independent = independent(item, options).unwrap_or_else(|e| {
        warnings.push(format!("Frame {} has no unbiased errors: {e}.", item.frame));
        None
    });
    let images = Images { reference: reference.colour, denoised: result.colour, independent };
    let pair = images.pair(options.scaling).map_err(|e| name_file(e, denoised))?;
    (row.non_finite_reference, row.non_finite_denoised) = pair.non_finite();
    let mut scores = Scores {
        smape: smape(&pair),
        relmse: relmse(&pair),
        psnr: psnr(&pair),
        ssim: ssim(&pair),
        flip: flip(&pair)?,
        flicker: None,
        unbiased: None,
    };
    let (mut vectors, mut still) = (None, false);
    if let Some(previous) = previous {
        let before = previous.pair(options.scaling)?;
        let change = follow(item, result.vector, options).and_then(|vectors| FlickerChange::between(&before, &pair, vectors));
        match change {
            Ok(found) => {
                (row.motion, scores.flicker, still) = (Some(found.motion), found.flicker, found.still);
                vectors = Some(found.vectors);
                if found.flicker.is_none() {
                    warnings.push(format!("Frame {} has no flicker: no motion vector points inside the frame.", item.frame));
                }
            }
            Err(e) => warnings.push(format!("Frame {} has no flicker: {e}.", item.frame)),
        }
    }
    let followed = previous.zip(vectors.as_ref()).map(|(previous, vectors)| (previous, vectors.as_ref().map(|v| v.view())));
    match unbiased(&images, followed, options.scaling) {
        Ok(found) => scores.unbiased = found,
        Err(e) => warnings.push(format!("Frame {} has no unbiased errors: {}.", item.frame, e)),
    }
    row.scores = Some(scores);
    Ok(Outcome { images, warnings, still, denoised_reference, cropped_apart })
}

/// The second reference and the brightness of a frame that has both.
fn independent(item: &Item, options: &EvaluateOptions) -> Result<Option<Independent>> {
    let (Some(second), Some(brightness)) = (&item.second, &item.brightness) else { return Ok(None) };
    let colour = |path: &Path| Ok(read(path, false, &options.images)?.colour);
    Ok(Some(Independent { second: colour(second)?, brightness: colour(brightness)? }))
}

/// The unbiased errors, where there are two references; `followed` is the frame before with the vectors to it.
fn unbiased(
    images: &Images,
    followed: Option<(&Images, Option<ArrayView3<f32>>)>,
    scaling: Scaling,
) -> Result<Option<UnbiasedScores>> {
    let Some(current) = images.between(scaling).transpose()? else { return Ok(None) };
    let mut change = None;
    if let Some((previous, vectors)) = followed
        && let Some(before) = previous.between(scaling).transpose()?
    {
        change = unbiased_flicker_squared(&before, &current, vectors)?;
    }
    Ok(unbiased_relmse(&current).map(|relmse| UnbiasedScores::new(relmse, change)))
}

/// Flicker, and whose vectors it followed.
struct FlickerChange {
    flicker: Option<f64>,
    motion: Motion,
    vectors: Option<Array3<f32>>,
    /// Whether the vectors are zero everywhere.
    still: bool,
}

impl FlickerChange {
    fn between(previous: &Pair, current: &Pair, vectors: Option<(Motion, Array3<f32>)>) -> Result<Self> {
        let flicker = flicker(previous, current, vectors.as_ref().map(|(_, v)| v.view()))?;
        let still = vectors.as_ref().is_some_and(|(_, v)| v.iter().all(|&x| x == 0.0));
        let (motion, vectors) = vectors.map_or((Motion::Plain, None), |(motion, vectors)| (motion, Some(vectors)));
        Ok(Self { flicker, motion, vectors, still })
    }
}

/// The Vector pass that flicker follows: of the file given for it, of the denoised file, of the reference.
fn follow(item: &Item, denoised: Option<Array3<f32>>, options: &EvaluateOptions) -> Result<Option<(Motion, Array3<f32>)>> {
    let given = item.vectors.as_ref().map(|path| read(path, true, &options.images)).transpose()?;
    if let Some(vector) = given.and_then(|passes| passes.vector) {
        return Ok(Some((Motion::Vectors, vector)));
    }
    if let Some(vector) = denoised {
        return Ok(Some((Motion::Denoised, vector)));
    }
    Ok(read(&item.reference, true, &options.images)?.vector.map(|vector| (Motion::Reference, vector)))
}

/// Says which file a comparison failed on.
fn name_file(error: Error, path: &Path) -> Error {
    match error {
        Error::SizeMismatch { columns, rows, found_columns, found_rows, .. } => {
            Error::SizeMismatch { what: path.display().to_string(), columns, rows, found_columns, found_rows }
        }
        Error::BadInput { reason, .. } => Error::BadInput { input: path.display().to_string(), reason },
        other => other,
    }
}
