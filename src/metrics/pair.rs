//! A reference and a denoised image of one size, their common scale, and which pixels count.

use ndarray::{ArrayView3, Axis};
use rayon::prelude::*;
use serde::Serialize;

use crate::error::{Error, Result};

/// The mean that [`Scaling::ReferenceMean`] gives the reference.
pub const REFERENCE_MEAN: f64 = 0.4;

/// A reference darker than this is scaled as if its mean were this.
const DARKEST_MEAN: f64 = 1e-6;

/// What both images are multiplied by before they are compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Scaling {
    /// [`REFERENCE_MEAN`] over the mean of the reference's finite pixels, so that ε and the tone curve mean the same in
    /// every shot.
    #[default]
    ReferenceMean,
    /// One.
    None,
}

/// Two images to compare, views of (rows, columns, 3), scene-linear.
#[derive(Clone, Copy, Debug)]
pub struct Pair<'a> {
    reference: ArrayView3<'a, f32>,
    denoised: ArrayView3<'a, f32>,
    gain: f64,
    non_finite: (usize, usize),
}

impl<'a> Pair<'a> {
    /// Pairs two images. [`Error::SizeMismatch`] if their sizes differ, [`Error::BadInput`] if they have no pixels, not three
    /// channels, or no pixel that is finite in both.
    pub fn new(reference: ArrayView3<'a, f32>, denoised: ArrayView3<'a, f32>, scaling: Scaling) -> Result<Self> {
        let (rows, columns, _) = reference.dim();
        let (found_rows, found_columns, _) = denoised.dim();
        if (rows, columns) != (found_rows, found_columns) {
            return Err(Error::SizeMismatch { what: "denoised image".into(), columns, rows, found_columns, found_rows });
        }
        for (what, channels) in [("reference", reference.dim().2), ("denoised image", denoised.dim().2)] {
            if channels != 3 {
                return Err(Error::BadInput { input: what.into(), reason: format!("has {channels} channels, expected 3") });
            }
        }
        let pair = Self { reference, denoised, gain: 1.0, non_finite: (0, 0) };
        let tally = pair.tally();
        if tally.both == 0 {
            let reason = if rows * columns == 0 { "has no pixels" } else { "shares no finite pixel with the reference" };
            return Err(Error::BadInput { input: "denoised image".into(), reason: reason.into() });
        }
        let gain = match scaling {
            Scaling::ReferenceMean => REFERENCE_MEAN / (tally.sum / (3 * tally.reference) as f64).max(DARKEST_MEAN),
            Scaling::None => 1.0,
        };
        let pixels = rows * columns;
        Ok(Self { gain, non_finite: (pixels - tally.reference, pixels - tally.denoised), ..pair })
    }

    /// Rows and columns.
    pub fn size(&self) -> (usize, usize) {
        (self.reference.dim().0, self.reference.dim().1)
    }

    /// What both images are multiplied by.
    pub fn gain(&self) -> f64 {
        self.gain
    }

    /// How many pixels have a channel that is NaN or infinite: in the reference, in the denoised image.
    pub fn non_finite(&self) -> (usize, usize) {
        self.non_finite
    }

    /// The unscaled colours (reference, denoised) of a pixel, None if either is not finite.
    pub(super) fn raw(&self, row: usize, column: usize) -> Option<([f64; 3], [f64; 3])> {
        let r = colour(&self.reference, row, column);
        let d = colour(&self.denoised, row, column);
        (finite(r) && finite(d)).then_some((r, d))
    }

    /// The scaled colours (reference, denoised) of a pixel, None if either is not finite.
    pub(super) fn pixel(&self, row: usize, column: usize) -> Option<([f64; 3], [f64; 3])> {
        let (r, d) = self.raw(row, column)?;
        Some((r.map(|v| v * self.gain), d.map(|v| v * self.gain)))
    }

    /// The mean over pixels and channels of `error(reference, denoised)`.
    pub(super) fn mean_error(&self, error: impl Fn(f64, f64) -> f64 + Sync) -> f64 {
        let (rows, columns) = self.size();
        let row_sum = |row| {
            let (mut sum, mut count) = (0.0, 0);
            for (r, d) in (0..columns).filter_map(|column| self.pixel(row, column)) {
                sum += error(r[0], d[0]) + error(r[1], d[1]) + error(r[2], d[2]);
                count += 3;
            }
            (sum, count)
        };
        // `new` has made sure that a pixel counts.
        mean_by_rows(rows, row_sum).unwrap_or(0.0)
    }

    fn tally(&self) -> Tally {
        let (rows, columns) = self.size();
        let by_row = |row| {
            let mut t = Tally::default();
            for column in 0..columns {
                let (r, d) = (colour(&self.reference, row, column), colour(&self.denoised, row, column));
                t.both += usize::from(finite(r) && finite(d));
                t.denoised += usize::from(finite(d));
                if finite(r) {
                    t.reference += 1;
                    t.sum += r[0] + r[1] + r[2];
                }
            }
            t
        };
        let all: Vec<Tally> = (0..rows).into_par_iter().map(by_row).collect();
        all.into_iter().fold(Tally::default(), |a, b| Tally {
            reference: a.reference + b.reference,
            denoised: a.denoised + b.denoised,
            both: a.both + b.both,
            sum: a.sum + b.sum,
        })
    }
}

/// Counts of finite pixels, and the sum of the reference's finite channels.
#[derive(Default)]
struct Tally {
    reference: usize,
    denoised: usize,
    both: usize,
    sum: f64,
}

/// Whether there is anything to compare an image by: (rows, columns, 3).
pub(crate) fn has_finite_pixel(image: ArrayView3<f32>) -> bool {
    image.lanes(Axis(2)).into_iter().any(|pixel| pixel.iter().all(|v| v.is_finite()))
}

fn colour(image: &ArrayView3<f32>, row: usize, column: usize) -> [f64; 3] {
    [0, 1, 2].map(|channel| f64::from(image[(row, column, channel)]))
}

fn finite(colour: [f64; 3]) -> bool {
    colour.iter().all(|v| v.is_finite())
}

/// The mean of what `row_sum` returns as (sum, count), rows in parallel, added from top to bottom; None if nothing counts.
pub(super) fn mean_by_rows(rows: usize, row_sum: impl Fn(usize) -> (f64, usize) + Sync) -> Option<f64> {
    mean_of((0..rows).into_par_iter().map(&row_sum).collect())
}

/// The mean of what these sums, each with its number of pixels, are the sums of; None of no pixel. In order, so that threads do not show.
pub(super) fn mean_of(sums: Vec<(f64, usize)>) -> Option<f64> {
    let (sum, count) = sums.into_iter().fold((0.0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
    (count > 0).then(|| sum / count as f64)
}

/// Images that the metrics' tests share.
#[cfg(test)]
pub(super) mod samples {
    use ndarray::Array3;

    use super::{Pair, Scaling};

    /// A reference and a denoised image given by a formula; tests/golden/metrics.py builds the same.
    pub fn formula(rows: usize, columns: usize) -> (Array3<f32>, Array3<f32>) {
        let value = |(y, x, c): (usize, usize, usize)| ((x * 7 + y * 13 + c * 29 + x * y) % 64) as f32 / 32.0;
        let error = |(y, x, c): (usize, usize, usize)| ((x * 31 + y * 17 + c * 5) % 11) as f32 - 5.0;
        let reference = Array3::from_shape_fn((rows, columns, 3), value);
        let denoised = Array3::from_shape_fn((rows, columns, 3), |i| value(i) * (1.0 + error(i) / 50.0));
        (reference, denoised)
    }

    /// A smooth reference and, for each strength, the reference with that much of one noise added.
    pub fn noisy(strengths: &[f32]) -> (Array3<f32>, Vec<Array3<f32>>) {
        let reference = Array3::from_shape_fn((40, 50, 3), |(y, x, c)| 0.2 + (y + x + 10 * c) as f32 / 100.0);
        let noise = |(y, x, c): (usize, usize, usize)| {
            let mixed = ((y * 50 + x) * 3 + c).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            ((mixed >> 40) & 0xFFFF) as f32 / 65535.0 - 0.5
        };
        let images = strengths.iter().map(|s| Array3::from_shape_fn((40, 50, 3), |i| reference[i] + s * noise(i))).collect();
        (reference, images)
    }

    /// A metric with the default scaling.
    pub fn score(metric: impl Fn(&Pair) -> f64, reference: &Array3<f32>, denoised: &Array3<f32>) -> f64 {
        metric(&Pair::new(reference.view(), denoised.view(), Scaling::ReferenceMean).unwrap())
    }

    /// What every metric promises: the same bits for any number of threads and for any strides, a sane value on tiny images,
    /// pixels left out where either image is not finite, and a value that moves one way as noise grows.
    pub fn check_promises(metric: impl Fn(&Pair) -> f64 + Sync, perfect: f64, grows_with_noise: bool) {
        let (reference, denoised) = formula(70, 33);
        let with_threads = |n| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
            pool.install(|| score(&metric, &reference, &denoised))
        };
        let one = with_threads(1);
        assert_eq!(one.to_bits(), with_threads(2).to_bits());
        assert_eq!(one.to_bits(), with_threads(5).to_bits());

        let planar = |a: &Array3<f32>| a.view().permuted_axes([2, 0, 1]).as_standard_layout().into_owned();
        let (r, d) = (planar(&reference), planar(&denoised));
        let strided = Pair::new(r.view().permuted_axes([1, 2, 0]), d.view().permuted_axes([1, 2, 0]), Scaling::ReferenceMean);
        assert_eq!(one.to_bits(), metric(&strided.unwrap()).to_bits());

        for size in [(1, 1), (1, 9), (3, 1), (2, 2), (11, 11), (10, 40)] {
            let (r, d) = formula(size.0, size.1);
            assert_eq!(score(&metric, &r, &r), perfect, "{size:?}");
            assert!(score(&metric, &r, &d).is_finite() || perfect.is_infinite(), "{size:?}");
        }

        let (r, images) = noisy(&[0.0, 0.05, 0.1, 0.2, 0.4]);
        let scores: Vec<f64> = images.iter().map(|d| score(&metric, &r, d)).collect();
        assert!(scores.windows(2).all(|w| (w[1] > w[0]) == grows_with_noise), "{scores:?}");

        // A pixel that is only wrong by being NaN must not count, neither for nor against.
        let mut hole = r.clone();
        hole[(20, 20, 1)] = f32::NAN;
        hole[(3, 4, 0)] = f32::INFINITY;
        assert_eq!(score(&metric, &r, &hole), perfect);
        assert!(score(&metric, &hole, &images[3]).is_finite());
        let mut broken = images[3].clone();
        broken[(20, 20, 1)] = f32::NAN;
        assert!((score(&metric, &r, &broken) / scores[3] - 1.0).abs() < 0.01);
    }
}

#[cfg(test)]
mod tests {
    use ndarray::{Array3, array};

    use super::*;

    #[test]
    fn scales_the_references_mean_to_two_fifths() {
        let r = array![[[1.0, 2.0, 3.0], [2.0, 2.0, 2.0]]];
        let d = array![[[f32::NAN, 0.0, 0.0], [1.0, 1.0, 1.0]]];
        let pair = Pair::new(r.view(), d.view(), Scaling::ReferenceMean).unwrap();
        assert!((pair.gain() - 0.2).abs() < 1e-12);
        assert_eq!(pair.non_finite(), (0, 1));
        assert_eq!(pair.pixel(0, 0), None);
        assert_eq!(Pair::new(r.view(), d.view(), Scaling::None).unwrap().gain(), 1.0);
    }

    #[test]
    fn an_infinite_pixel_leaves_the_scale_alone() {
        let mut r = Array3::from_elem((4, 4, 3), 0.8);
        r[(1, 1, 0)] = f32::INFINITY;
        let pair = Pair::new(r.view(), r.view(), Scaling::ReferenceMean).unwrap();
        assert!((pair.gain() - 0.5).abs() < 1e-6);
        assert_eq!(pair.non_finite(), (1, 1));
    }

    #[test]
    fn a_black_reference_has_a_finite_scale() {
        let r = Array3::<f32>::zeros((2, 2, 3));
        let pair = Pair::new(r.view(), r.view(), Scaling::ReferenceMean).unwrap();
        assert!((pair.gain() - 4e5).abs() < 1.0);
    }

    #[test]
    fn refuses_what_cannot_be_compared() {
        let zeros = |rows, columns, channels| Array3::<f32>::zeros((rows, columns, channels));
        let new = |r: &Array3<f32>, d: &Array3<f32>| Pair::new(r.view(), d.view(), Scaling::ReferenceMean).map(|_| ());
        assert!(matches!(new(&zeros(2, 3, 3), &zeros(3, 2, 3)), Err(Error::SizeMismatch { .. })));
        assert!(matches!(new(&zeros(2, 3, 4), &zeros(2, 3, 4)), Err(Error::BadInput { .. })));
        assert!(matches!(new(&zeros(0, 3, 3), &zeros(0, 3, 3)), Err(Error::BadInput { .. })));
        let nan = Array3::from_elem((2, 3, 3), f32::NAN);
        assert!(matches!(new(&zeros(2, 3, 3), &nan), Err(Error::BadInput { .. })));
    }
}
