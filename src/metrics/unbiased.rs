//! relMSE and flicker without the references' noise, from two references rendered independently of each other.
//!
//! With references a = t + n and b = t + m of one truth t, noises n and m of mean 0 that have nothing to do with each other nor with
//! the denoised d, E[(d − a)(d − b)] = (d − t)²: the noise is in neither. What divides it must know nothing of a and b, or their noise
//! comes back through it; so it is a third image g, their *brightness*, the same for every d that is compared.

use ndarray::ArrayView3;

use super::flicker::{check_sizes, source};
use super::pair::mean_by_rows;
use super::sample::sample;
use super::{Pair, flicker, relmse};
use crate::error::{Error, Result};

/// A denoised image between two independent references.
#[derive(Clone, Copy, Debug)]
pub struct TwoReferences<'a> {
    pair: Pair<'a>,
    second: ArrayView3<'a, f32>,
    brightness: ArrayView3<'a, f32>,
}

impl<'a> TwoReferences<'a> {
    /// `pair` holds the denoised image, the first reference and the scale; `second` is the other reference, `brightness` an image as
    /// bright as the truth, used as it is: (rows, columns, 3), scene-linear. [`Error::SizeMismatch`] and [`Error::BadInput`] as
    /// [`Pair::new`] has them.
    pub fn new(pair: Pair<'a>, second: ArrayView3<'a, f32>, brightness: ArrayView3<'a, f32>) -> Result<Self> {
        let (rows, columns) = pair.size();
        for (what, image) in [("second reference", second), ("brightness", brightness)] {
            let (found_rows, found_columns, channels) = image.dim();
            if (found_rows, found_columns) != (rows, columns) {
                return Err(Error::SizeMismatch { what: what.into(), columns, rows, found_columns, found_rows });
            }
            if channels != 3 {
                return Err(Error::BadInput { input: what.into(), reason: format!("has {channels} channels, expected 3") });
            }
        }
        Ok(Self { pair, second, brightness })
    }

    /// d − a and d − b, unscaled, of a pixel that is finite in all three.
    fn errors(&self, row: usize, column: usize) -> Option<([f64; 3], [f64; 3])> {
        let (a, d) = self.pair.raw(row, column)?;
        let b = finite(self.second, row, column)?;
        Some(([0, 1, 2].map(|i| d[i] - a[i]), [0, 1, 2].map(|i| d[i] - b[i])))
    }

    /// The mean over pixels and channels of the product of two changes over what `divisor` makes of the scaled brightness; None if no
    /// pixel has both.
    fn mean_product(
        &self,
        changes: impl Fn(usize, usize) -> Option<([f64; 3], [f64; 3])> + Sync,
        divisor: impl Fn(f64) -> f64 + Sync,
    ) -> Option<f64> {
        let ((rows, columns), gain) = (self.pair.size(), self.pair.gain());
        let row_sum = |row| {
            let of_pixel = |column| {
                let ((a, b), g) = (changes(row, column)?, finite(self.brightness, row, column)?);
                Some((0..3).map(|i| a[i] * b[i] * gain * gain / divisor(g[i] * gain)).sum::<f64>())
            };
            (0..columns).filter_map(of_pixel).fold((0.0, 0), |(sum, count), e| (sum + e, count + 3))
        };
        mean_by_rows(rows, row_sum)
    }
}

/// Mean (d − a)(d − b) / (g² + ε) over pixels and channels, with the ε of [`relmse()`]. Its expectation over the references is the
/// mean of (d − t)² / (g² + ε); below 0 where that is less than the noise of the estimate. None if no pixel is finite in all images.
pub fn unbiased_relmse(of: &TwoReferences) -> Option<f64> {
    of.mean_product(|row, column| of.errors(row, column), |g| g * g + relmse::EPSILON)
}

/// Mean (Δd − Δa)(Δd − Δb) / (2 |g| + ε)² over pixels and channels, with Δ, the vectors, the scale and the ε of
/// [`super::flicker()`], whose |d| + |r| + ε is 2 |g| + ε where the result and the reference are right. Its root stands beside
/// flicker: that one is a mean of magnitudes, this one of squares, so for the same errors the root is at least as large.
///
/// Its expectation over the references is the mean of (Δd − Δt)² / (2 |g| + ε)²; below 0 where that is less than the noise of the
/// estimate, so take means over frames first and the root of the mean. `brightness` is the current frame's. None and errors as in
/// [`super::flicker()`].
pub fn unbiased_flicker_squared(
    previous: &TwoReferences,
    current: &TwoReferences,
    vectors: Option<ArrayView3<f32>>,
) -> Result<Option<f64>> {
    check_sizes(previous.pair.size(), current.pair.size(), vectors)?;
    let changes = |row: usize, column: usize| {
        let (a, b) = current.errors(row, column)?;
        let (x, y) = source(vectors, row, column);
        let size = previous.pair.size();
        let before_a = sample(size, x, y, |row, column| Some(previous.errors(row, column)?.0))?;
        let before_b = sample(size, x, y, |row, column| Some(previous.errors(row, column)?.1))?;
        Some(([0, 1, 2].map(|i| a[i] - before_a[i]), [0, 1, 2].map(|i| b[i] - before_b[i])))
    };
    Ok(current.mean_product(changes, |g| (2.0 * g.abs() + flicker::EPSILON).powi(2)))
}

fn finite(image: ArrayView3<f32>, row: usize, column: usize) -> Option<[f64; 3]> {
    let colour = [0, 1, 2].map(|channel| f64::from(image[(row, column, channel)]));
    colour.iter().all(|v| v.is_finite()).then_some(colour)
}

#[cfg(test)]
mod tests {
    use ndarray::{Array3, array, s};

    use super::super::Scaling;
    use super::super::pair::samples::formula;
    use super::*;

    const SIZE: (usize, usize, usize) = (96, 128, 3);
    /// Standard deviation of the references' noise.
    const NOISE: f64 = 0.08;

    /// Independent uniform numbers of mean 0 and standard deviation [`NOISE`], other ones for each seed.
    fn noise(seed: u64) -> Array3<f32> {
        // Far apart on the one sequence that all seeds are parts of.
        let mut state = seed << 40;
        Array3::from_shape_simple_fn(SIZE, || {
            // SplitMix64.
            state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
            let mut z = state;
            z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            let unit = ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64;
            (NOISE * 12f64.sqrt() * (unit - 0.5)) as f32
        })
    }

    fn truth() -> Array3<f32> {
        Array3::from_shape_fn(SIZE, |(y, x, c)| 0.3 + 0.2 * ((x + 2 * y + 9 * c) as f32 / 17.0).sin())
    }

    /// The truth with an error of some 0.02 that is another one in each frame.
    fn wrong(frame: usize) -> Array3<f32> {
        let error = |(y, x, c): (usize, usize, usize)| 0.02 * (((x * 5 + y * 3 + c + 7 * frame) % 13) as f32 / 6.0 - 1.0);
        truth() + Array3::from_shape_fn(SIZE, error)
    }

    fn two<'a>(a: &'a Array3<f32>, b: &'a Array3<f32>, d: &'a Array3<f32>, g: &'a Array3<f32>) -> TwoReferences<'a> {
        TwoReferences::new(Pair::new(a.view(), d.view(), Scaling::None).unwrap(), b.view(), g.view()).unwrap()
    }

    /// Half a pixel to the right everywhere.
    fn half_a_pixel() -> Array3<f32> {
        Array3::from_shape_fn((SIZE.0, SIZE.1, 4), |(_, _, c)| if c == 0 { 0.5 } else { 0.0 })
    }

    /// relMSE and the square of flicker of `d` in two frames, with these references in each.
    fn both(d: &[Array3<f32>; 2], a: &[Array3<f32>; 2], b: &[Array3<f32>; 2]) -> [f64; 2] {
        let (g, v) = (truth(), half_a_pixel());
        let (before, now) = (two(&a[0], &b[0], &d[0], &g), two(&a[1], &b[1], &d[1], &g));
        let change = unbiased_flicker_squared(&before, &now, Some(v.view())).unwrap().unwrap();
        [unbiased_relmse(&now).unwrap(), change]
    }

    /// Mean and standard error of the mean over references of `pairs` different noises.
    fn over_noises(d: &[Array3<f32>; 2], pairs: u64) -> ([f64; 2], [f64; 2]) {
        let reference = |seed: u64| [0, 1].map(|frame| truth() + noise(seed + frame));
        let found: Vec<[f64; 2]> = (0..pairs).map(|k| both(d, &reference(4 * k + 1), &reference(4 * k + 3))).collect();
        let n = pairs as f64;
        let mean = [0, 1].map(|i| found.iter().map(|f| f[i]).sum::<f64>() / n);
        let error = [0, 1].map(|i| (found.iter().map(|f| (f[i] - mean[i]).powi(2)).sum::<f64>() / (n - 1.0) / n).sqrt());
        (mean, error)
    }

    #[test]
    fn the_truth_is_found_where_the_plain_metrics_see_noise() {
        let (d, clean) = ([wrong(0), wrong(1)], [truth(), truth()]);
        let exact = both(&d, &clean, &clean);
        let (mean, error) = over_noises(&d, 24);
        for i in 0..2 {
            assert!(exact[i] > 8.0 * error[i], "the error is larger than what it is told by: {exact:?} {error:?}");
            assert!((mean[i] - exact[i]).abs() < 4.0 * error[i], "{mean:?} {exact:?} {error:?}");
        }
        // One noisy reference alone: its noise is counted as an error, many times what there is.
        let single = [0, 1].map(|frame| truth() + noise(99 + frame));
        let plain = both(&d, &single, &single);
        assert!((0..2).all(|i| plain[i] > 5.0 * exact[i]), "{plain:?} {exact:?}");
        let pairs = [0, 1].map(|i| Pair::new(single[i].view(), d[i].view(), Scaling::None).unwrap());
        let truths = [0, 1].map(|i| Pair::new(clean[i].view(), d[i].view(), Scaling::None).unwrap());
        let v = half_a_pixel();
        let seen = flicker::flicker(&pairs[0], &pairs[1], Some(v.view())).unwrap().unwrap();
        assert!(seen > 2.0 * flicker::flicker(&truths[0], &truths[1], Some(v.view())).unwrap().unwrap());
    }

    #[test]
    fn a_perfect_result_is_0_and_often_below() {
        let perfect = [truth(), truth()];
        let (mean, error) = over_noises(&perfect, 24);
        assert!((0..2).all(|i| mean[i].abs() < 4.0 * error[i]), "{mean:?} {error:?}");
        let reference = |seed: u64| [0, 1].map(|frame| truth() + noise(seed + frame));
        let found: Vec<[f64; 2]> = (0..12).map(|k| both(&perfect, &reference(4 * k + 1), &reference(4 * k + 3))).collect();
        for i in 0..2 {
            assert!(found.iter().any(|f| f[i] < 0.0) && found.iter().any(|f| f[i] > 0.0), "{found:?}");
        }
    }

    #[test]
    fn known_by_hand() {
        let grey = |v: f32| Array3::from_elem((1, 1, 3), v);
        let (a, b, d, g) = (grey(0.9), grey(1.2), grey(1.0), grey(0.5));
        assert!((unbiased_relmse(&two(&a, &b, &d, &g)).unwrap() - 0.1 * -0.2 / 0.26).abs() < 1e-7);
        let (a0, b0, d0) = (grey(1.0), grey(1.0), grey(1.3));
        let before = two(&a0, &b0, &d0, &d0);
        let square = unbiased_flicker_squared(&before, &two(&a, &b, &d, &g), None).unwrap().unwrap();
        assert!((square - (0.1 - 0.3) * (-0.2 - 0.3) / 1.01f64.powi(2)).abs() < 1e-6);
        // Twice the light in all images is the same picture.
        let double = |image: &Array3<f32>| image.mapv(|v| 2.0 * v);
        let (a2, b2, d2, g2) = (double(&a), double(&b), double(&d), double(&g));
        let scaled = |a: &Array3<f32>, b: &Array3<f32>, d: &Array3<f32>, g: &Array3<f32>| {
            let pair = Pair::new(a.view(), d.view(), Scaling::ReferenceMean).unwrap();
            unbiased_relmse(&TwoReferences::new(pair, b.view(), g.view()).unwrap()).unwrap()
        };
        assert!((scaled(&a, &b, &d, &g) - scaled(&a2, &b2, &d2, &g2)).abs() < 1e-9);
    }

    #[test]
    fn agrees_with_numpy() {
        let (r, d) = formula(48, 64);
        let b = Array3::from_shape_fn(r.dim(), |(y, x, c)| (r[(y, 63 - x, c)] + 3.0 * r[(y, x, c)]) / 4.0);
        let g = (&r + &d) / 2.0;
        let upside_down = |image: &Array3<f32>| image.slice(s![..;-1, .., ..]).to_owned();
        let (r0, b0, d0) = (upside_down(&r), upside_down(&b), upside_down(&d));
        let of = |r, b, d| TwoReferences::new(Pair::new(r, d, Scaling::ReferenceMean).unwrap(), b, g.view()).unwrap();
        let (before, now) = (of(r0.view(), b0.view(), d0.view()), of(r.view(), b.view(), d.view()));
        assert!((unbiased_relmse(&now).unwrap() - 0.003_188_337_103).abs() < 1e-9);
        let v = Array3::from_shape_fn((48, 64, 4), |(_, _, c)| if c == 0 { 0.25 } else { 0.0 });
        let square = unbiased_flicker_squared(&before, &now, Some(v.view())).unwrap().unwrap();
        assert!((square - 0.091_161_423_882).abs() < 1e-7);
    }

    #[test]
    fn flicker_follows_the_vectors() {
        // What was one pixel further right: an error that moves along does not flicker.
        let (a, d) = (truth(), wrong(0));
        let moved = |image: &Array3<f32>| Array3::from_shape_fn(SIZE, |(y, x, c)| image[(y, (x + 1).min(SIZE.1 - 1), c)]);
        let (a1, d1, g) = (moved(&a), moved(&d), truth());
        let v = Array3::from_shape_fn((SIZE.0, SIZE.1, 4), |(_, _, c)| if c == 0 { 1.0 } else { 0.0 });
        let (before, now) = (two(&a, &a, &d, &g), two(&a1, &a1, &d1, &g));
        assert!(unbiased_flicker_squared(&before, &now, Some(v.view())).unwrap().unwrap() < 1e-12);
        assert!(unbiased_flicker_squared(&before, &now, None).unwrap().unwrap() > 1e-5);
    }

    #[test]
    fn pixels_count_where_all_images_are_finite() {
        let (a, b, d, g) =
            (array![[[1.0, 1.0, 1.0], [1.0, 1.0, 1.0]]], array![[[2.0, 2.0, 2.0], [1.0, f32::NAN, 1.0]]], 3.0, 1.0);
        let (d, mut g) = (Array3::from_elem((1, 2, 3), d), Array3::from_elem((1, 2, 3), g));
        assert!((unbiased_relmse(&two(&a, &b, &d, &g)).unwrap() - 2.0 / 1.01).abs() < 1e-9);
        assert_eq!(unbiased_flicker_squared(&two(&a, &b, &d, &g), &two(&a, &b, &d, &g), None).unwrap(), Some(0.0));
        g[(0, 0, 2)] = f32::INFINITY;
        assert_eq!(unbiased_relmse(&two(&a, &b, &d, &g)), None);
    }

    #[test]
    fn sizes_and_channels_must_agree() {
        let image = |rows, channels| Array3::from_elem((rows, 5, channels), 0.5f32);
        let (four, five, thin) = (image(4, 3), image(5, 3), image(4, 2));
        let pair = Pair::new(four.view(), four.view(), Scaling::None).unwrap();
        assert!(matches!(TwoReferences::new(pair, five.view(), four.view()), Err(Error::SizeMismatch { .. })));
        assert!(matches!(TwoReferences::new(pair, four.view(), thin.view()), Err(Error::BadInput { .. })));
        let (small, large) = (two(&four, &four, &four, &four), two(&five, &five, &five, &five));
        assert!(unbiased_flicker_squared(&small, &large, None).is_err());
    }
}
