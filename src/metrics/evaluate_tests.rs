//! What `evaluate` finds in files.

use std::path::Path;

use exr::prelude::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, SmallVec, WritableImage};
use ndarray::Array3;

use super::evaluation::{Evaluation, Motion, Scores, UnbiasedScores};
use super::pair::samples::formula;
use super::*;

const LIGHT: [&str; 3] = ["ViewLayer.Combined.R", "ViewLayer.Combined.G", "ViewLayer.Combined.B"];
const VECTOR: [&str; 4] = ["ViewLayer.Vector.X", "ViewLayer.Vector.Y", "ViewLayer.Vector.Z", "ViewLayer.Vector.W"];

/// Writes images with their channels' names.
fn write(path: &Path, images: &[(&[&str], &Array3<f32>)]) {
    write_at((0, 0), path, images);
}

/// The same, for files whose upper left corner lies elsewhere in the picture.
fn write_at(origin: (i32, i32), path: &Path, images: &[(&[&str], &Array3<f32>)]) {
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
    let place = LayerAttributes { layer_position: origin.into(), ..LayerAttributes::default() };
    let layer = Layer::new((columns, rows), place, Encoding::FAST_LOSSLESS, list);
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
fn files_that_are_cropped_elsewhere_are_told() {
    let folder = shot(true);
    write_at((5, 2), &folder.path().join("out/shot.2.exr"), &[(&LIGHT, &formula(14, 17).1)]);
    let report = run(&folder);
    assert_eq!(report.failed(), 0);
    let told = |w: &String| w.starts_with("The two files of frame 2 are cropped at different places");
    assert_eq!(report.warnings.iter().filter(|w| told(w)).count(), 1, "{:?}", report.warnings);
    write_at((5, 2), &folder.path().join("ref/clean_0002.exr"), &[(&LIGHT, &formula(14, 17).0)]);
    assert!(!run(&folder).warnings.iter().any(|w| w.contains("cropped")));
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
