//! What holds for several frames of an evaluation.

use super::evaluation::{FrameEvaluation, Motion};
use crate::words::{self, counted};

/// The frames that something holds for.
#[derive(Default)]
pub(super) struct Traits {
    /// The Vector pass is zero everywhere.
    pub still: Vec<i64>,
    /// The reference's Combined went through a denoiser.
    pub denoised_reference: Vec<i64>,
    /// The reference and the denoised file are cropped at different places of the picture.
    pub cropped_apart: Vec<i64>,
    /// The second reference or the brightness is missing.
    pub one_reference: Vec<i64>,
    /// Of the two references and the brightness two are the same picture.
    pub same_pictures: Vec<i64>,
}

/// That the references of some frames are no truth, in a sentence.
pub(crate) fn denoised_references(frames: String) -> String {
    format!("The references of {frames} are denoised themselves: they hold a Noisy Image beside Combined.")
}

/// What holds for several frames, a sentence each.
pub(super) fn remarks(frames: &[FrameEvaluation], traits: &Traits, vectors_given: bool) -> Vec<String> {
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
    remark(&traits.denoised_reference, &denoised_references);
    remark(&traits.cropped_apart, &|n| {
        format!("The two files of {n} are cropped at different places of the picture: they are compared corner by corner.")
    });
    remark(&traits.still, &|n| format!("The Vector pass is all zero in {n}: nothing moved, or motion blur was on."));
    remark(&traits.one_reference, &|n| {
        format!("The second reference or the brightness is missing for {n}: the unbiased errors leave it out.")
    });
    remark(&traits.same_pictures, &|n| {
        format!(
            "Two of the references and the brightness are the same picture in {n}: the unbiased errors hold the noise that they \
             should be rid of."
        )
    });
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
