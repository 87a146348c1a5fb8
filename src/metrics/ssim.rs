//! Structural similarity on the display.

use std::ops::Range;

use rayon::prelude::*;

use super::Pair;
use super::pair::mean_of;
use super::tonemap::{display, luma};

/// Standard deviation of the Gaussian window, in pixels.
const SIGMA: f64 = 1.5;
/// The window has 2·RADIUS + 1 = 11 pixels a side.
const RADIUS: usize = 5;
/// (K₁·L)² with K₁ = 0.01 and L = 1.
const C1: f64 = 0.01 * 0.01;
/// (K₂·L)² with K₂ = 0.03 and L = 1.
const C2: f64 = 0.03 * 0.03;
/// What is summed under the window: the weight that is there, x, y, x², y², xy.
const MOMENTS: usize = 6;
/// Rows in hand at a time on each thread: the moments of a whole 4K image would take 0.8 GB.
const BAND: usize = 32;

/// Of the pixels of a row.
type Moments = Vec<[f64; MOMENTS]>;

/// Mean structural similarity of the luma of the tone-mapped images ([`display`], [`luma`]), 1 for equal images.
///
/// (2μₓμᵧ + C₁)(2σₓᵧ + C₂) / ((μₓ² + μᵧ² + C₁)(σₓ² + σᵧ² + C₂)) under an 11×11 Gaussian window with σ = 1.5, averaged over the
/// pixels whose window lies inside the image. Wang et al. 2004, "Image Quality Assessment: From Error Visibility to Structural
/// Similarity". Pixels that are not finite leave the window, and along a side shorter than 11 pixels the window is cut off;
/// the remaining weights are scaled to sum to 1.
pub fn ssim(pair: &Pair) -> f64 {
    let (rows, columns) = pair.size();
    // All pixels count only where the inner ones are all broken; `Pair` has made sure that one is not.
    mean(pair, inner(rows), inner(columns)).or_else(|| mean(pair, 0..rows, 0..columns)).unwrap_or(1.0)
}

/// The mean over the pixels of these rows and columns that are finite.
fn mean(pair: &Pair, rows: Range<usize>, columns: Range<usize>) -> Option<f64> {
    let bands: Vec<Range<usize>> = rows.clone().step_by(BAND).map(|row| row..rows.end.min(row + BAND)).collect();
    mean_of(bands.into_par_iter().flat_map_iter(|band| row_sums(pair, band, columns.clone())).collect())
}

/// The sum over each row of a band, and how many pixels are in it.
fn row_sums(pair: &Pair, band: Range<usize>, columns: Range<usize>) -> Vec<(f64, usize)> {
    let (rows, _) = pair.size();
    let window = window();
    let first = band.start.saturating_sub(RADIUS);
    let across: Vec<Moments> = (first..rows.min(band.end + RADIUS)).map(|row| along_the_row(pair, row, &window)).collect();
    let down = |row, column: usize| weighted_sum(taps(&window, row, rows).map(|(p, w)| (&across[p - first][column], w)));
    let sum = |row| {
        let inside = columns.clone().filter(|&column| pair.raw(row, column).is_some());
        inside.fold((0.0, 0), |(sum, count), column| (sum + similarity(&down(row, column)), count + 1))
    };
    band.map(sum).collect()
}

/// The positions whose window lies inside, all of them along a short side.
fn inner(length: usize) -> Range<usize> {
    if length > 2 * RADIUS { RADIUS..length - RADIUS } else { 0..length }
}

fn similarity(m: &[f64; MOMENTS]) -> f64 {
    let [x, y, xx, yy, xy] = [1, 2, 3, 4, 5].map(|i| m[i] / m[0]);
    let (vx, vy, cov) = (xx - x * x, yy - y * y, xy - x * y);
    (2.0 * x * y + C1) * (2.0 * cov + C2) / ((x * x + y * y + C1) * (vx + vy + C2))
}

fn window() -> [f64; 2 * RADIUS + 1] {
    std::array::from_fn(|i| (-0.5 * ((i as f64 - RADIUS as f64) / SIGMA).powi(2)).exp())
}

/// The window's positions around `at` that lie inside `length`, with their weights.
fn taps(window: &[f64; 2 * RADIUS + 1], at: usize, length: usize) -> impl Iterator<Item = (usize, f64)> {
    let inside = move |(i, weight): (usize, &f64)| Some(((at + i).checked_sub(RADIUS).filter(|&p| p < length)?, *weight));
    window.iter().enumerate().filter_map(inside)
}

/// The moments of every pixel of a row, summed along it.
fn along_the_row(pair: &Pair, row: usize, window: &[f64; 2 * RADIUS + 1]) -> Moments {
    let (_, columns) = pair.size();
    let moments = |column| match pair.pixel(row, column) {
        Some((r, d)) => {
            let (x, y) = (luma(r.map(display)), luma(d.map(display)));
            [1.0, x, y, x * x, y * y, x * y]
        }
        None => [0.0; MOMENTS],
    };
    let line: Moments = (0..columns).map(moments).collect();
    (0..columns).map(|c| weighted_sum(taps(window, c, columns).map(|(p, w)| (&line[p], w)))).collect()
}

fn weighted_sum<'a>(taps: impl Iterator<Item = (&'a [f64; MOMENTS], f64)>) -> [f64; MOMENTS] {
    let mut sum = [0.0; MOMENTS];
    for (moments, weight) in taps {
        for (s, m) in sum.iter_mut().zip(moments) {
            *s += weight * m;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::super::pair::samples::{check_promises, formula, score};
    use super::super::{Pair, Scaling};
    use super::*;

    #[test]
    fn known_by_hand() {
        // Two flat images: only the means' term remains.
        let r = Array3::from_elem((20, 20, 3), 1.0);
        let d = Array3::zeros((20, 20, 3));
        let pair = Pair::new(r.view(), d.view(), Scaling::None).unwrap();
        let x = display(1.0);
        assert!((ssim(&pair) - C1 / (x * x + C1)).abs() < 1e-9);
    }

    #[test]
    fn agrees_with_scikit_image() {
        let (r, d) = formula(48, 64);
        assert!((score(ssim, &r, &d) - 0.997_882_928_208).abs() < 1e-9);
    }

    #[test]
    fn bands_do_not_show() {
        let (r, d) = formula(2 * BAND + 2 * RADIUS + 3, 14);
        let pair = Pair::new(r.view(), d.view(), Scaling::None).unwrap();
        let (rows, _) = pair.size();
        let row_by_row: Vec<_> = inner(rows).flat_map(|row| row_sums(&pair, row..row + 1, inner(14))).collect();
        assert_eq!(row_by_row.len(), rows - 2 * RADIUS);
        assert_eq!(Some(ssim(&pair)), mean_of(row_by_row));
    }

    #[test]
    fn symmetric_without_scaling() {
        let (a, b) = formula(16, 15);
        let of = |r: &Array3<f32>, d: &Array3<f32>| ssim(&Pair::new(r.view(), d.view(), Scaling::None).unwrap());
        assert!((of(&a, &b) - of(&b, &a)).abs() < 1e-12);
    }

    #[test]
    fn keeps_the_promises() {
        check_promises(ssim, 1.0, false);
    }
}
