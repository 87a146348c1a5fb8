//! Flicker: how much the error changes from one frame to the next along the motion.

use ndarray::ArrayView3;

use super::Pair;
use super::pair::mean_by_rows;
use super::sample::sample;
use crate::error::{Error, Result};

/// As in [`super::smape::EPSILON`].
pub const EPSILON: f64 = 1e-2;

/// Mean |Δd − Δr| / (|dₜ| + |rₜ| + ε) over pixels and channels, ε = 0.01, where Δd = dₜ − W(dₜ₋₁) and Δr = rₜ − W(rₜ₋₁) are the
/// motion-compensated frame differences: 0 for a denoiser whose error, whatever it is, moves with the surfaces.
///
/// W samples frame t−1 bilinearly where the point was: `vectors` is frame t's Vector pass, (rows, columns, 4), X and Y in
/// pixels, y up, so the point at (column, row) was at (column + X, row − Y). Without vectors W is the identity. A pixel counts
/// if it is finite, its source lies inside the frame, and so are the pixels that are sampled; so surfaces that come into view
/// count, with the error of what hid them in the frame before. Both frames are scaled by frame t's gain. None if no pixel counts; [`Error::SizeMismatch`] if the frames or the vectors differ in size.
pub fn flicker(previous: &Pair, current: &Pair, vectors: Option<ArrayView3<f32>>) -> Result<Option<f64>> {
    let (rows, columns) = current.size();
    check_sizes(previous.size(), (rows, columns), vectors)?;
    let error_at = |row: usize, column: usize| {
        let (r, d) = current.raw(row, column)?;
        let (x, y) = source(vectors, row, column);
        let before = sampled_error(previous, x, y)?;
        // Δd − Δr is the error of this frame less the warped error of the last one, as W is linear.
        let gain = current.gain();
        let change = |i: usize| (d[i] - r[i] - before[i]).abs() * gain / ((d[i].abs() + r[i].abs()) * gain + EPSILON);
        Some(change(0) + change(1) + change(2))
    };
    let row_sum = |row| {
        let errors = (0..columns).filter_map(|column| error_at(row, column));
        errors.fold((0.0, 0), |(sum, count), e| (sum + e, count + 3))
    };
    Ok(mean_by_rows(rows, row_sum))
}

/// Whether the frame before (rows, columns) and the vectors belong to a frame of this size.
pub(super) fn check_sizes(previous: (usize, usize), size: (usize, usize), vectors: Option<ArrayView3<f32>>) -> Result<()> {
    let (rows, columns) = size;
    let mut sizes = vec![("previous frame", previous)];
    sizes.extend(vectors.map(|v| ("Vector pass", (v.dim().0, v.dim().1))));
    for (what, (found_rows, found_columns)) in sizes {
        if (found_rows, found_columns) != (rows, columns) {
            return Err(Error::SizeMismatch { what: what.into(), columns, rows, found_columns, found_rows });
        }
    }
    match vectors.map(|v| v.dim().2).filter(|&c| c < 2) {
        Some(channels) => {
            let reason = format!("has {channels} channels, expected X and Y");
            Err(Error::BadInput { input: "Vector pass".into(), reason })
        }
        None => Ok(()),
    }
}

/// Where the point at a pixel was in the frame before: column and row, in pixels.
pub(super) fn source(vectors: Option<ArrayView3<f32>>, row: usize, column: usize) -> (f64, f64) {
    let (x, y) = vectors.map_or((0.0, 0.0), |v| (f64::from(v[(row, column, 0)]), f64::from(v[(row, column, 1)])));
    (column as f64 + x, row as f64 - y)
}

/// d − r, unscaled, at a position in pixels.
fn sampled_error(pair: &Pair, x: f64, y: f64) -> Option<[f64; 3]> {
    sample(pair.size(), x, y, |row, column| {
        let (r, d) = pair.raw(row, column)?;
        Some([d[0] - r[0], d[1] - r[1], d[2] - r[2]])
    })
}

#[cfg(test)]
mod tests {
    use ndarray::{Array3, array, s};

    use super::super::pair::samples::{check_promises, formula, noisy};
    use super::super::{Pair, Scaling};
    use super::*;

    fn raw<'a>(r: &'a Array3<f32>, d: &'a Array3<f32>) -> Pair<'a> {
        Pair::new(r.view(), d.view(), Scaling::None).unwrap()
    }

    /// X and Y everywhere the same.
    fn uniform(rows: usize, columns: usize, x: f32, y: f32) -> Array3<f32> {
        Array3::from_shape_fn((rows, columns, 4), |(_, _, c)| [x, y, 0.0, 0.0][c])
    }

    #[test]
    fn known_by_hand() {
        let r = Array3::from_elem((1, 2, 3), 1.0);
        let before = array![[[1.0, 1.0, 1.0], [1.5, 1.5, 1.5]]];
        let now = array![[[1.25, 1.25, 1.25], [1.0, 1.0, 1.0]]];
        let expected = (0.25 / 2.26 + 0.5 / 2.01) / 2.0;
        assert!((flicker(&raw(&r, &before), &raw(&r, &now), None).unwrap().unwrap() - expected).abs() < 1e-7);
        // The left one lay half-way between the two; the right one on the rim, where the last pixel is continued.
        let v = uniform(1, 2, 0.5, 0.0);
        let halves = flicker(&raw(&r, &before), &raw(&r, &now), Some(v.view())).unwrap().unwrap();
        assert!((halves - (0.0 / 2.26 + 0.5 / 2.01) / 2.0).abs() < 1e-7);
        // The left one was at the right one's place, the right one outside.
        let v = uniform(1, 2, 1.0, 0.0);
        let left_only = flicker(&raw(&r, &before), &raw(&r, &now), Some(v.view())).unwrap().unwrap();
        assert!((left_only - 0.25 / 2.26).abs() < 1e-7);
    }

    #[test]
    fn both_frames_get_the_current_gain() {
        let r = Array3::from_elem((1, 1, 3), 0.8);
        let before = array![[[1.2, 1.2, 1.2]]];
        let dim = Array3::from_elem((1, 1, 3), 0.1);
        let scaled = |r, d| Pair::new(ArrayView3::from(r), ArrayView3::from(d), Scaling::ReferenceMean).unwrap();
        let score = flicker(&scaled(&r, &before), &scaled(&dim, &dim), None).unwrap().unwrap();
        assert!((score - 4.0 * 0.4 / 0.81).abs() < 1e-6);
    }

    #[test]
    fn follows_cycles_signs() {
        // A picture with its error, in a frame, and one pixel further right and two rows further up in the next.
        let (wide_r, wide_d) = formula(34, 41);
        let window = |a: &Array3<f32>, row: usize, column: usize| a.slice(s![row..row + 30, column..column + 40, ..]).to_owned();
        let (r0, d0) = (window(&wide_r, 0, 1), window(&wide_d, 0, 1));
        let (r1, d1) = (window(&wide_r, 2, 0), window(&wide_d, 2, 0));
        let score = |x, y| {
            let v = uniform(30, 40, x, y);
            flicker(&raw(&r0, &d0), &raw(&r1, &d1), Some(v.view())).unwrap().unwrap()
        };
        assert!(score(-1.0, -2.0) < 1e-6);
        assert!(score(1.0, 2.0) > 0.01);
        assert!(score(-1.0, 2.0) > 0.01);
        assert!(flicker(&raw(&r0, &d0), &raw(&r1, &d1), None).unwrap().unwrap() > 0.01);
    }

    #[test]
    fn a_steady_error_does_not_flicker() {
        let (r, d) = formula(12, 13);
        assert_eq!(flicker(&raw(&r, &d), &raw(&r, &d), None).unwrap(), Some(0.0));
    }

    #[test]
    fn a_moving_reference_is_not_flicker() {
        let (r0, r1) = formula(12, 13);
        assert_eq!(flicker(&raw(&r0, &r0), &raw(&r1, &r1), None).unwrap(), Some(0.0));
    }

    #[test]
    fn nothing_counts_far_outside_or_without_numbers() {
        let (r, d) = formula(5, 6);
        for (x, y) in [(1e9, 0.0), (0.0, -1e30), (f32::NAN, 0.0), (0.0, f32::INFINITY), (-7.0, 0.0)] {
            let v = uniform(5, 6, x, y);
            assert_eq!(flicker(&raw(&r, &d), &raw(&r, &d), Some(v.view())).unwrap(), None, "{x} {y}");
        }
    }

    #[test]
    fn a_broken_neighbour_spoils_only_what_samples_it() {
        let r = Array3::from_elem((3, 3, 3), 1.0);
        let mut before = r.clone();
        before[(1, 1, 0)] = f32::NAN;
        let mut now = r.clone();
        now[(1, 1, 0)] = 1e6;
        // The pixel whose source is NaN is the one that is wrong.
        assert_eq!(flicker(&raw(&r, &before), &raw(&r, &now), None).unwrap(), Some(0.0));
    }

    #[test]
    fn sizes_must_agree() {
        let (r, d) = formula(5, 6);
        let (r2, d2) = formula(6, 5);
        assert!(matches!(flicker(&raw(&r2, &d2), &raw(&r, &d), None), Err(Error::SizeMismatch { .. })));
        let v = uniform(6, 5, 0.0, 0.0);
        assert!(matches!(flicker(&raw(&r, &d), &raw(&r, &d), Some(v.view())), Err(Error::SizeMismatch { .. })));
        let v = Array3::zeros((5, 6, 1));
        assert!(matches!(flicker(&raw(&r, &d), &raw(&r, &d), Some(v.view())), Err(Error::BadInput { .. })));
    }

    #[test]
    fn keeps_the_promises() {
        // Against a clean frame before, flicker is the error of this frame.
        let clean = |pair: &Pair| {
            let (rows, columns) = pair.size();
            let flat = Array3::from_elem((rows, columns, 3), 1.0);
            let v = Array3::from_shape_fn((rows, columns, 4), |(_, x, c)| if c == 0 && x > 0 { -0.25 } else { 0.0 });
            flicker(&raw(&flat, &flat), pair, Some(v.view())).unwrap().unwrap()
        };
        check_promises(clean, 0.0, true);
        let (r, images) = noisy(&[0.1, 0.2]);
        assert!(flicker(&raw(&r, &images[0]), &raw(&r, &images[1]), None).unwrap().unwrap() > 0.0);
    }
}
