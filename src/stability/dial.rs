//! The dial λ: what it refuses, and that turning it up never takes out more noise.

use ndarray::Array3;

use super::cases::Case;
use super::row::{CheckRow, Worst};
use super::scene;
use super::suite::Suite;
use crate::{Engine, Error, Frame, Result};

/// Where the dial is looked at.
pub const STEPS: [f32; 7] = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0];
/// What keeps a relative error finite where an image is dark.
const DARK: f32 = 0.01;

/// All rows about λ.
pub(super) fn rows(suite: &Suite) -> Result<Vec<CheckRow>> {
    let mut out = vec![limits(suite)?];
    for (name, window) in [("noisy scene, one frame alone", 0), ("noisy scene, window 2", 2)] {
        out.push(monotone(&suite.exact, name, window)?);
    }
    Ok(out)
}

/// Counts λ outside 1…64 that are not refused (below, NaN) or not the same as 64 (above).
fn limits(suite: &Suite) -> Result<CheckRow> {
    let case = Case { window: 1, frames: 3, centre: 1, ..Case::random(3) };
    let frames = case.build();
    let most = case.denoise(&suite.exact, &frames, 64.0)?.colour;
    let mut worst = Worst::new();
    for lambda in [f32::NAN, f32::NEG_INFINITY, -1.0, 0.0, 0.5, 1.0 - f32::EPSILON] {
        if !matches!(case.denoise(&suite.exact, &frames, lambda), Err(Error::BadSetting { name: "lambda", .. })) {
            worst.count(|| format!("λ {lambda} was not refused"));
        }
    }
    for lambda in [64.0 + 1e-5, 65.0, 1e30, f32::INFINITY] {
        if !case.denoise(&suite.exact, &frames, lambda).is_ok_and(|d| d.colour == most) {
            worst.count(|| format!("λ {lambda} is not 64"));
        }
    }
    Ok(worst.row("λ outside 1…64", "refused or clamped", 0.0))
}

/// How much noise falls from one step of λ to the next, at most, as a share of the noise at λ 1.
///
/// The noise left is what differs between the results of two renders that differ in nothing but their seed.
fn monotone(engine: &Engine, name: &str, window: usize) -> Result<CheckRow> {
    let (rows, columns) = (96, 120);
    let case = Case { name: name.into(), rows, columns, frames: 5, centre: 2, window, seed: 0, hazards: Vec::new() };
    let shot = |seed: u64| -> Vec<Frame> { (0..case.frames).map(|t| scene::frame(seed, t, rows, columns)).collect() };
    let clean = scene::clean(case.centre, rows, columns);
    let (one, other) = (shot(11), shot(12));
    let mut left = Vec::new();
    for lambda in STEPS {
        let (a, b) = (case.denoise(engine, &one, lambda)?.colour, case.denoise(engine, &other, lambda)?.colour);
        left.push(noise(&a, &b, &clean));
    }
    Ok(falls(name, &left))
}

/// Root mean square of what differs between two images, relative to a third.
fn noise(a: &Array3<f32>, b: &Array3<f32>, clean: &Array3<f32>) -> f64 {
    let sum: f64 = a.indexed_iter().map(|(i, a)| f64::from((a - b[i]) / (clean[i] + DARK)).powi(2)).sum();
    (sum / (2 * a.len()) as f64).sqrt()
}

/// The row for residual noise at each of [`STEPS`].
fn falls(name: &str, left: &[f64]) -> CheckRow {
    let all = left.iter().map(|v| format!("{v:.4}")).collect::<Vec<_>>().join(" ");
    let mut worst = Worst::new();
    for (pair, steps) in left.windows(2).zip(STEPS.windows(2)) {
        worst.take((pair[0] - pair[1]).max(0.0) / left[0], || {
            format!("λ {} to {}; noise left at 1…64: {all}", steps[0], steps[1])
        });
    }
    let mut row = worst.row(name, "noise falls as λ rises", 0.0);
    if row.place.is_empty() {
        row.place = format!("noise left at 1…64: {all}");
    }
    row
}

/// The same for rendered frames: noise left is the share of a noisy frame's error that is still in the result.
///
/// `frames[centre]` is denoised with up to `window` frames on each side; `reference` is its image with hardly any noise.
///
/// # Errors
/// Frames that the engine refuses.
#[cfg(any(feature = "internals", test))]
pub fn rendered(
    engine: &Engine,
    name: &str,
    frames: &[Frame],
    centre: usize,
    window: usize,
    reference: &Array3<f32>,
) -> Result<CheckRow> {
    let (rows, columns) = frames[centre].size();
    let case = Case { name: name.into(), rows, columns, frames: frames.len(), centre, window, seed: 0, hazards: Vec::new() };
    let error = |image: &Array3<f32>| {
        Array3::from_shape_fn(image.dim(), |i| f64::from((image[i] - reference[i]) / (reference[i] + DARK)))
    };
    let noisy = error(&frames[centre].colour);
    let all: f64 = noisy.iter().map(|v| v * v).sum();
    let mut left = Vec::new();
    for lambda in STEPS {
        let found = error(&case.denoise(engine, frames, lambda)?.colour);
        left.push(found.iter().zip(&noisy).map(|(a, b)| a * b).sum::<f64>() / all.max(1e-30));
    }
    Ok(falls(name, &left))
}
