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
}

/// Reads and compares one frame; writes what it finds into `row`.
fn compare(item: &Item, previous: Option<&Images>, options: &EvaluateOptions, row: &mut FrameEvaluation) -> Result<Outcome> {
    let Some(denoised) = &item.denoised else {
        let reason = "there is no denoised frame with this number".into();
        return Err(Error::BadInput { input: format!("frame {}", item.frame), reason });
    };
    let reference = read(&item.reference, false, &options.images)?;
    let result = read(denoised, previous.is_some(), &options.images)?;
    let denoised_reference = reference.denoised;
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
    Ok(Outcome { images, warnings, still, denoised_reference })
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

#[cfg(test)]
mod tests {
    use exr::prelude::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, SmallVec, WritableImage};

    use super::super::TwoReferences;
    use super::super::pair::samples::formula;
    use super::*;

    const LIGHT: [&str; 3] = ["ViewLayer.Combined.R", "ViewLayer.Combined.G", "ViewLayer.Combined.B"];
    const VECTOR: [&str; 4] = ["ViewLayer.Vector.X", "ViewLayer.Vector.Y", "ViewLayer.Vector.Z", "ViewLayer.Vector.W"];

    /// Writes images with their channels' names.
    fn write(path: &Path, images: &[(&[&str], &Array3<f32>)]) {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        let (rows, columns, _) = images[0].1.dim();
        let mut channels: Vec<_> = Vec::new();
        for (names, image) in images {
            for (i, name) in names.iter().enumerate() {
                let plane = image.index_axis(ndarray::Axis(2), i).iter().copied().collect();
                channels.push(AnyChannel::new(*name, FlatSamples::F32(plane)));
            }
        }
        let list = AnyChannels::sort(SmallVec::from_vec(channels));
        let layer = Layer::new((columns, rows), LayerAttributes::default(), Encoding::FAST_LOSSLESS, list);
        Image::from_layer(layer).write().to_file(path).unwrap();
    }

    /// Three frames, references in ref/, denoised in out/; the vectors point one pixel to the right.
    fn shot(with_vectors: bool) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let (r, d) = formula(14, 17);
        let vector = Array3::from_shape_fn((14, 17, 4), |(_, _, c)| if c == 0 { 1.0 } else { 0.0 });
        for frame in 1..=3 {
            write(&folder.path().join(format!("ref/clean_{frame:04}.exr")), &[(&LIGHT, &r)]);
            let mut passes: Vec<(&[&str], &Array3<f32>)> = vec![(&LIGHT, &d)];
            passes.extend(with_vectors.then_some((&VECTOR[..], &vector)));
            write(&folder.path().join(format!("out/shot.{frame}.exr")), &passes);
        }
        folder
    }

    fn run(folder: &tempfile::TempDir) -> Evaluation {
        evaluate(&folder.path().join("ref"), &folder.path().join("out"), &EvaluateOptions::default()).unwrap()
    }

    #[test]
    fn scores_every_frame() {
        let report = run(&shot(true));
        let (r, d) = formula(14, 17);
        let pair = Pair::new(r.view(), d.view(), Scaling::ReferenceMean).unwrap();
        let vector = Array3::from_shape_fn((14, 17, 4), |(_, _, c)| if c == 0 { 1.0 } else { 0.0 });
        assert_eq!(report.frames.iter().map(|f| f.frame).collect::<Vec<_>>(), [1, 2, 3]);
        for row in &report.frames {
            let scores = row.scores.unwrap();
            assert_eq!(scores.smape, smape(&pair));
            assert_eq!(scores.relmse, relmse(&pair));
            assert_eq!(scores.psnr, psnr(&pair));
            assert_eq!(scores.ssim, ssim(&pair));
            assert_eq!(scores.flip, flip(&pair).unwrap());
            let expected = flicker(&pair, &pair, Some(vector.view())).unwrap();
            assert!(expected > Some(0.0));
            assert_eq!(scores.flicker, if row.frame == 1 { None } else { expected });
            assert_eq!(row.motion, (row.frame > 1).then_some(Motion::Denoised));
        }
        assert_eq!(report.warnings, Vec::<String>::new());
        assert_eq!(report.failed(), 0);
        assert_eq!(report.mean.unwrap().smape, smape(&pair));
    }

    #[test]
    fn a_second_reference_adds_errors_and_changes_none() {
        let folder = shot(true);
        let (r, d) = formula(14, 17);
        let (b, g) = (r.mapv(|v| v + 0.01), r.mapv(|v| v + 0.1));
        for frame in 1..=3 {
            write(&folder.path().join(format!("b/{frame}.exr")), &[(&LIGHT, &b)]);
            write(&folder.path().join(format!("g/{frame}.exr")), &[(&LIGHT, &g)]);
        }
        let with = |reference: &str, brightness: &str| {
            let at = |name: &str| folder.path().join(name);
            let unbiased = Some(UnbiasedOptions { reference: at(reference), brightness: at(brightness) });
            evaluate(&at("ref"), &at("out"), &EvaluateOptions { unbiased, ..Default::default() }).unwrap()
        };
        let (report, plain) = (with("b", "g"), run(&folder));
        let pair = Pair::new(r.view(), d.view(), Scaling::ReferenceMean).unwrap();
        let two = TwoReferences::new(pair, b.view(), g.view()).unwrap();
        let vector = Array3::from_shape_fn((14, 17, 4), |(_, _, c)| if c == 0 { 1.0 } else { 0.0 });
        let square = unbiased_flicker_squared(&two, &two, Some(vector.view())).unwrap();
        assert!(square > Some(0.0));
        for (row, without) in report.frames.iter().zip(&plain.frames) {
            let found = row.scores.unwrap();
            let square = square.filter(|_| row.frame > 1);
            assert_eq!(found.unbiased, Some(UnbiasedScores::new(unbiased_relmse(&two).unwrap(), square)));
            assert_eq!(without.scores, Some(Scores { unbiased: None, ..found }));
        }
        assert!(report.standard_errors.unwrap().relmse < Some(1e-12), "all frames are alike");
        assert!(report.warnings.is_empty() && plain.standard_errors.is_none() && plain.mean.unwrap().unbiased.is_none());

        let twins = with("ref", "g").warnings;
        assert!(twins[0].contains("the same picture in frames 1-3"), "{twins:?}");
        std::fs::remove_file(folder.path().join("b/2.exr")).unwrap();
        std::fs::write(folder.path().join("g/3.exr"), b"not an image").unwrap();
        let broken = with("b", "g");
        assert_eq!(broken.failed(), 0);
        assert!(broken.frames[0].scores.unwrap().unbiased.is_some());
        assert!(broken.frames[1..].iter().all(|f| f.scores.unwrap().unbiased.is_none()));
        assert!(broken.warnings[0].starts_with("Frame 3 has no unbiased errors") && broken.warnings[0].contains("3.exr"));
        assert!(broken.warnings[1].contains("missing for frame 2:"), "{:?}", broken.warnings);
        write(&folder.path().join("g/3.exr"), &[(&LIGHT, &formula(3, 4).0)]);
        assert!(with("b", "g").warnings[0].contains("brightness is 4×3, expected 17×14"), "{:?}", with("b", "g").warnings);
    }

    #[test]
    fn without_vectors_flicker_is_plain_and_said_to_be() {
        let report = run(&shot(false));
        assert_eq!(report.frames[1].motion, Some(Motion::Plain));
        assert_eq!(report.frames[1].scores.unwrap().flicker, Some(0.0));
        assert_eq!(report.warnings.len(), 1);
        assert!(report.warnings[0].contains("frames 2-3"), "{}", report.warnings[0]);
    }

    #[test]
    fn vectors_may_come_from_elsewhere() {
        let folder = shot(true);
        let still = Array3::zeros((14, 17, 4));
        write(&folder.path().join("noisy/n0002.exr"), &[(&LIGHT, &formula(14, 17).0), (&VECTOR, &still)]);
        let options = EvaluateOptions { vectors: Some(folder.path().join("noisy")), ..Default::default() };
        let report = evaluate(&folder.path().join("ref"), &folder.path().join("out"), &options).unwrap();
        assert_eq!(report.frames[1].motion, Some(Motion::Vectors));
        assert_eq!(report.frames[1].scores.unwrap().flicker, Some(0.0));
        assert_eq!(report.frames[2].motion, Some(Motion::Denoised));
        assert_eq!(report.warnings.len(), 2, "{:?}", report.warnings);
        assert!(report.warnings[0].contains("all zero in frame 2:"));
        assert!(report.warnings[1].contains("none for frame 3:"));
    }

    #[test]
    fn reads_combined_beside_a_noisy_image_and_follows_the_references_vectors() {
        let folder = tempfile::tempdir().unwrap();
        let (r, d) = formula(14, 17);
        let noise = r.mapv(|v| 3.0 * v);
        let vector = Array3::from_elem((14, 17, 4), 0.5);
        let noisy = ["ViewLayer.Noisy Image.R", "ViewLayer.Noisy Image.G", "ViewLayer.Noisy Image.B"];
        let second = ["Motion.Vector.X", "Motion.Vector.Y", "Motion.Vector.Z", "Motion.Vector.W"];
        for frame in 1..=2 {
            let reference: [(&[&str], _); 3] = [(&LIGHT, &r), (&noisy, &noise), (&second, &vector)];
            write(&folder.path().join(format!("ref/{frame}.exr")), &reference);
            write(&folder.path().join(format!("out/{frame}.exr")), &[(&LIGHT, &d), (&noisy, &noise)]);
        }
        let pair = Pair::new(r.view(), d.view(), Scaling::ReferenceMean).unwrap();
        let with = |vector_layer: Option<String>| {
            let images = ImageChoice { vector_layer, ..Default::default() };
            let options = EvaluateOptions { images, ..Default::default() };
            evaluate(&folder.path().join("ref"), &folder.path().join("out"), &options).unwrap()
        };
        let report = with(Some("Motion".into()));
        assert_eq!(report.frames[1].scores.unwrap().smape, smape(&pair));
        assert_eq!(report.frames[1].motion, Some(Motion::Reference));
        assert_eq!(report.frames[1].scores.unwrap().flicker, flicker(&pair, &pair, Some(vector.view())).unwrap());
        assert_eq!(report.warnings.len(), 1, "{:?}", report.warnings);
        assert!(report.warnings[0].contains("references of frames 1-2 are denoised themselves"));
        assert_eq!(with(None).frames[1].motion, Some(Motion::Plain));
    }

    #[test]
    fn a_change_of_size_costs_one_flicker() {
        let folder = shot(true);
        let (r, d) = formula(8, 9);
        write(&folder.path().join("ref/clean_0003.exr"), &[(&LIGHT, &r)]);
        write(&folder.path().join("out/shot.3.exr"), &[(&LIGHT, &d)]);
        let report = run(&folder);
        assert_eq!(report.failed(), 0);
        assert!(report.frames[1].scores.unwrap().flicker.is_some());
        assert_eq!(report.frames[2].scores.unwrap().flicker, None);
        assert!(report.warnings[0].starts_with("Frame 3 has no flicker: previous frame is 17×14"), "{:?}", report.warnings);
    }

    #[test]
    fn missing_broken_and_odd_frames_have_rows() {
        let folder = shot(true);
        let out = folder.path().join("out");
        std::fs::remove_file(out.join("shot.2.exr")).unwrap();
        std::fs::write(out.join("shot.3.exr"), b"not an image").unwrap();
        let (small, _) = formula(3, 4);
        let mut nan = formula(14, 17).1;
        nan[(4, 4, 1)] = f32::NAN;
        write(&out.join("shot.4.exr"), &[(&LIGHT, &small)]);
        write(&out.join("shot.5.exr"), &[(&LIGHT, &nan)]);
        write(&out.join("shot.6.exr"), &[(&VECTOR[..3], &nan)]);
        write(&out.join("shot.9.exr"), &[(&LIGHT, &nan)]);
        let r = formula(14, 17).0;
        for frame in 4..=6 {
            write(&folder.path().join(format!("ref/clean_{frame:04}.exr")), &[(&LIGHT, &r)]);
        }
        let report = run(&folder);
        assert_eq!(report.failed(), 4);
        let error = |i: usize| report.frames[i].error.clone().unwrap();
        assert!(error(1).contains("frame 2: there is no denoised frame"), "{}", error(1));
        assert!(error(2).contains("shot.3.exr"), "{}", error(2));
        assert!(error(3).contains("shot.4.exr is 4×3, expected 17×14"), "{}", error(3));
        assert!(error(5).contains("shot.6.exr"), "{}", error(5));
        let fifth = &report.frames[4];
        assert_eq!((fifth.non_finite_reference, fifth.non_finite_denoised), (0, 1));
        assert!(fifth.scores.unwrap().smape.is_finite());
        assert_eq!(fifth.scores.unwrap().flicker, None);
        assert!(report.warnings.iter().any(|w| w.contains("denoised frame 9.")), "{:?}", report.warnings);
        assert!(report.warnings.iter().any(|w| w.contains("1 pixel is NaN or infinite")), "{:?}", report.warnings);
    }

    #[test]
    fn two_files_pair_whatever_their_numbers() {
        let folder = shot(true);
        let at = |name: &str| folder.path().join(name);
        let report = evaluate(&at("ref/clean_0001.exr"), &at("out/shot.3.exr"), &EvaluateOptions::default()).unwrap();
        assert_eq!(report.frames.len(), 1);
        assert_eq!(report.frames[0].denoised.as_deref(), Some(at("out/shot.3.exr").as_path()));
        assert!(report.frames[0].scores.is_some());
    }

    #[test]
    fn the_image_scale_can_be_left_alone() {
        let folder = shot(true);
        let options = EvaluateOptions { scaling: Scaling::None, ..Default::default() };
        let raw = evaluate(&folder.path().join("ref"), &folder.path().join("out"), &options).unwrap();
        assert_ne!(raw.mean.unwrap().smape, run(&folder).mean.unwrap().smape);
    }

    #[test]
    fn nothing_in_common_is_an_error() {
        let folder = shot(true);
        std::fs::create_dir(folder.path().join("empty")).unwrap();
        write(&folder.path().join("late/x0101.exr"), &[(&LIGHT, &formula(14, 17).0)]);
        let to = |name: &str| evaluate(&folder.path().join("ref"), &folder.path().join(name), &EvaluateOptions::default());
        assert!(to("late").unwrap_err().to_string().contains("frame 101 here, frames 1-3 in"));
        assert!(to("empty").is_err());
        assert!(to("nowhere").is_err());
    }
}
