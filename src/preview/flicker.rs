//! What changes from the last frame to this one along the motion: noise that was left, and what really changes.

use std::ops::Range;

use ndarray::{Array2, Array3, ArrayView3, s};
use rayon::prelude::*;

use crate::metrics::flicker::EPSILON;
use crate::metrics::sample::sample;

/// The change that has the brightest false colour.
pub const MOST_CHANGE: f64 = 0.25;

/// A frame against the last one, seen from here.
#[derive(Debug)]
pub struct Flicker {
    /// The last frame along the motion, (rows, columns, 3), linear; NaN where nothing comes from it.
    pub previous: Array3<f32>,
    /// Mean over the channels of |now − before| / (|now| + |before| + ε), (rows, columns), 0…1; NaN where `previous` is.
    pub change: Array2<f32>,
    /// The mean change; None where there is none.
    pub mean: Option<f64>,
}

impl Flicker {
    /// Of (rows, columns, 3) images and this frame's Vector pass, (rows, columns, 4), all cut alike. `exposure` brings the frame to
    /// the brightness that ε is meant for.
    pub fn new(now: ArrayView3<f32>, last: ArrayView3<f32>, vectors: ArrayView3<f32>, exposure: f32) -> Self {
        let (rows, columns, _) = now.dim();
        let gain = f64::from(exposure);
        let before = |row: usize, column: usize| {
            let here: [f64; 3] = std::array::from_fn(|c| f64::from(last[(row, column, c)]));
            here.iter().all(|v| v.is_finite()).then_some(here)
        };
        let pixel = |row: usize, column: usize| -> Option<([f64; 3], f64)> {
            let (x, y) = (f64::from(vectors[(row, column, 0)]), f64::from(vectors[(row, column, 1)]));
            let before = sample((rows, columns), column as f64 + x, row as f64 - y, before)?;
            let change = |c: usize| {
                let (a, b) = (f64::from(now[(row, column, c)]) * gain, before[c] * gain);
                (a - b).abs() / (a.abs() + b.abs() + EPSILON)
            };
            let mean = (change(0) + change(1) + change(2)) / 3.0;
            mean.is_finite().then_some((before, mean))
        };
        let mut previous = Array3::from_elem((rows, columns, 3), f32::NAN);
        let mut change = Array2::from_elem((rows, columns), f32::NAN);
        let lines = previous.outer_iter_mut().into_par_iter().zip(change.outer_iter_mut().into_par_iter());
        lines.enumerate().for_each(|(row, (mut previous, mut change))| {
            for column in 0..columns {
                if let Some((before, mean)) = pixel(row, column) {
                    (0..3).for_each(|c| previous[(column, c)] = before[c] as f32);
                    change[column] = mean as f32;
                }
            }
        });
        Self::of(previous, change)
    }

    /// A part of it.
    pub fn part(&self, rows: Range<usize>, columns: Range<usize>) -> Self {
        let previous = self.previous.slice(s![rows.clone(), columns.clone(), ..]).to_owned();
        Self::of(previous, self.change.slice(s![rows, columns]).to_owned())
    }

    fn of(previous: Array3<f32>, change: Array2<f32>) -> Self {
        let seen = change.iter().filter(|v| v.is_finite());
        let (sum, count) = seen.fold((0.0, 0usize), |(sum, count), v| (sum + f64::from(*v), count + 1));
        Self { previous, change, mean: (count > 0).then(|| sum / count as f64) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_moves_along_does_not_flicker_and_noise_does() {
        let picture = |at: usize| ((at * 7919) % 101) as f32 / 50.0;
        let last = Array3::from_shape_fn((9, 20, 3), |(y, x, c)| picture(y * 20 + x + c));
        // Two pixels to the right and one up.
        let now = Array3::from_shape_fn((9, 20, 3), |(y, x, c)| if x >= 2 && y < 8 { last[(y + 1, x - 2, c)] } else { 9.0 });
        let v = Array3::from_shape_fn((9, 20, 4), |(_, _, c)| [-2.0, -1.0, 0.0, 0.0][c]);
        let along = Flicker::new(now.view(), last.view(), v.view(), 1.0);
        assert_eq!(along.mean, Some(0.0));
        assert!(along.change[(4, 1)].is_nan() && along.previous[(4, 1, 0)].is_nan() && along.change[(8, 9)].is_nan());
        assert_eq!(along.previous[(4, 5, 1)], last[(5, 3, 1)]);
        let still = Flicker::new(now.view(), last.view(), Array3::zeros((9, 20, 4)).view(), 1.0);
        assert!(still.mean.unwrap() > 0.1);
        assert_eq!(still.part(0..8, 2..20).change.dim(), (8, 18));
    }

    #[test]
    fn known_by_hand_at_an_exposure() {
        let (now, last) = (Array3::from_elem((1, 1, 3), 3.0), Array3::from_elem((1, 1, 3), 1.0));
        let flicker = Flicker::new(now.view(), last.view(), Array3::zeros((1, 1, 4)).view(), 0.5);
        assert!((flicker.mean.unwrap() - 1.0 / 2.01).abs() < 1e-7);
    }
}
