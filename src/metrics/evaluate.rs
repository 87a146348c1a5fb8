//! Compares the frames of a denoised shot with their references.

use std::path::{Path, PathBuf};

use ndarray::Array3;

use super::evaluation::{Evaluation, FrameEvaluation, Motion, Scores, mean};
use super::images::{ImageChoice, Images, read};
use super::pairing::{Item, pair_up};
use super::{Pair, Scaling, flicker, flip, psnr, relmse, smape, ssim};
use crate::error::{Error, Result};
use crate::words::{self, counted};

/// How to compare.
#[derive(Clone, Debug, Default)]
pub struct EvaluateOptions {
    /// What images are multiplied by first.
    pub scaling: Scaling,
    /// Folder, pattern or file whose Vector passes flicker follows, such as the noisy shot. Without it, and for frames that it
    /// lacks, those of the denoised files, then of the references.
    pub vectors: Option<PathBuf>,
    /// What to read of every file.
    pub images: ImageChoice,
}

/// Compares `denoised` with `reference`: folders, patterns (`####`, `%04d`, globs) or files of one frame each.
///
/// Frames are paired by number; two single files are paired whatever their numbers. The beauty pass is read (Combined, also
/// where the file keeps a Noisy Image beside it), and for flicker the Vector pass.
///
/// # Errors
/// Inputs that name no sequence, or sequences without a common frame. A frame that is missing or cannot be read or compared is
/// no error: it has a row that says why, and counts in [`Evaluation::failed`].
pub fn evaluate(reference: &Path, denoised: &Path, options: &EvaluateOptions) -> Result<Evaluation> {
    let (items, mut warnings) = pair_up(reference, denoised, options.vectors.as_deref())?;
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
                warnings.extend(outcome.warning);
                traits.still.extend(outcome.still.then_some(item.frame));
                traits.denoised_reference.extend(outcome.denoised_reference.then_some(item.frame));
                previous = Some((item.frame, outcome.images));
            }
            Err(e) => row.error = Some(e.to_string()),
        }
        frames.push(row);
    }
    warnings.extend(remarks(&frames, &traits, options.vectors.is_some()));
    Ok(Evaluation { scaling: options.scaling, mean: mean(&frames), frames, warnings })
}

struct Outcome {
    images: Images,
    /// Why there is no flicker although the frame before is there.
    warning: Option<String>,
    still: bool,
    denoised_reference: bool,
}

/// The frames that something holds for.
#[derive(Default)]
struct Traits {
    /// The Vector pass is zero everywhere.
    still: Vec<i64>,
    /// The reference's Combined went through a denoiser.
    denoised_reference: Vec<i64>,
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
    let images = Images { reference: reference.colour, denoised: result.colour };
    let pair = images.pair(options.scaling).map_err(|e| name_file(e, denoised))?;
    (row.non_finite_reference, row.non_finite_denoised) = pair.non_finite();
    let mut scores = Scores {
        smape: smape(&pair),
        relmse: relmse(&pair),
        psnr: psnr(&pair),
        ssim: ssim(&pair),
        flip: flip(&pair)?,
        flicker: None,
    };
    let (mut warning, mut still) = (None, false);
    if let Some(previous) = previous {
        let before = previous.pair(options.scaling)?;
        let change = follow(item, result.vector, options).and_then(|vectors| FlickerChange::between(&before, &pair, vectors));
        match change {
            Ok(found) => {
                (row.motion, scores.flicker, still) = (Some(found.motion), found.flicker, found.still);
                if found.flicker.is_none() {
                    warning = Some(format!("Frame {} has no flicker: no motion vector points inside the frame.", item.frame));
                }
            }
            Err(e) => warning = Some(format!("Frame {} has no flicker: {e}.", item.frame)),
        }
    }
    row.scores = Some(scores);
    Ok(Outcome { images, warning, still, denoised_reference })
}

/// Flicker, and whose vectors it followed.
struct FlickerChange {
    flicker: Option<f64>,
    motion: Motion,
    /// Whether the vectors are zero everywhere.
    still: bool,
}

impl FlickerChange {
    fn between(previous: &Pair, current: &Pair, vectors: Option<(Motion, Array3<f32>)>) -> Result<Self> {
        let flicker = flicker(previous, current, vectors.as_ref().map(|(_, v)| v.view()))?;
        let still = vectors.as_ref().is_some_and(|(_, v)| v.iter().all(|&x| x == 0.0));
        Ok(Self { flicker, motion: vectors.map_or(Motion::Plain, |(motion, _)| motion), still })
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

/// What holds for several frames, a sentence each.
fn remarks(frames: &[FrameEvaluation], traits: &Traits, vectors_given: bool) -> Vec<String> {
    let with = |wanted: &dyn Fn(&FrameEvaluation) -> bool| -> Vec<i64> {
        frames.iter().filter(|f| wanted(f)).map(|f| f.frame).collect()
    };
    let mut out = Vec::new();
    let mut remark = |numbers: &[i64], text: &dyn Fn(String) -> String| {
        if !numbers.is_empty() {
            out.push(text(words::frames(numbers)));
        }
    };
    remark(&with(&|f| f.motion == Some(Motion::Plain)), &|n| {
        format!("Flicker compares {n} without following motion: there is no Vector pass.")
    });
    remark(&traits.denoised_reference, &|n| {
        format!("The references of {n} are denoised themselves: they hold a Noisy Image beside Combined.")
    });
    remark(&traits.still, &|n| format!("The Vector pass is all zero in {n}: nothing moved, or motion blur was on."));
    if vectors_given {
        remark(&with(&|f| matches!(f.motion, Some(Motion::Denoised | Motion::Reference))), &|n| {
            format!("The files given for vectors have none for {n}: the shot's own were used.")
        });
    }
    for (what, count) in [
        ("references", (|f| f.non_finite_reference) as fn(&FrameEvaluation) -> usize),
        ("denoised images", |f| f.non_finite_denoised),
    ] {
        let pixels: usize = frames.iter().map(count).sum();
        remark(&with(&|f| count(f) > 0), &|n| {
            let (pixels, verb) = (counted(pixels, "pixel"), if pixels == 1 { "is" } else { "are" });
            format!("{pixels} {verb} NaN or infinite in the {what} of {n}, which does not count.")
        });
    }
    out
}

#[cfg(test)]
mod tests {
    use exr::prelude::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, SmallVec, WritableImage};

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
