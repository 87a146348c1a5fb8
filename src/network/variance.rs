//! How noisy a pixel is: variances over the frames and within 2×2 pixels, an input of the temporal extractor (`variances` in
//! `training/network/model.py`).

use rayon::prelude::*;

use super::levels::Level;
use crate::kernels::planes::Planes;
use crate::kernels::{Channels, FULL_PHASES};
use crate::simd::Isa;
use crate::simd::math::ln_1p_all;

/// Maps of a pixel: of the albedo and of the key over the frames, within 2×2 pixels of the centre, and within 2×2 of the mean; one over
/// the frames that may be used.
pub const VARIANCES: usize = 7;
/// What a variance is multiplied by before the logarithm.
const GAIN: f32 = 1e4;
/// What the logarithm is divided by.
const RANGE: f32 = 8.0;

/// The maps at half resolution, from the centre's and the neighbours' pixels at full resolution.
pub fn variances(isa: Isa, level: &Level, channels: &Channels) -> Planes {
    let (rows, columns) = (level.centre.rows(), level.centre.columns());
    let images: Vec<&Planes> = std::iter::once(&level.centre).chain(&level.neighbours).collect();
    let guides = [channels.modulation(), channels.modulation() + 1, channels.modulation() + 2, channels.key()];
    let mut out = level.centre.same_pool(VARIANCES, rows, columns, 0);
    out.rows_mut().enumerate().for_each(|(y, mut to)| {
        let own = |channel: usize, phase: usize| level.centre.row(channel * FULL_PHASES + phase, y);
        // Of each image a channel's pixels and whether they may be used.
        let each = |channel: usize, phase: usize| {
            images.iter().map(move |image| [channel, channels.mask()].map(|c| image.row(c * FULL_PHASES + phase, y)))
        };
        let counts: [Vec<f32>; FULL_PHASES] = std::array::from_fn(|phase| {
            let mut count = vec![0.0; columns];
            each(channels.mask(), phase).for_each(|[_, mask]| count.iter_mut().zip(mask).for_each(|(sum, m)| *sum += m));
            count
        });
        let mut sums = [(); 2].map(|()| vec![[0.0f32; 3]; columns]);
        for (guide, channel) in guides.into_iter().enumerate() {
            let share = if guide < 3 { 1.0 / 3.0 } else { 1.0 };
            let mut between = vec![0.0; columns];
            let means: [Vec<f32>; FULL_PHASES] = std::array::from_fn(|phase| {
                let (mut mean, mut squares) = (vec![0.0; columns], vec![0.0; columns]);
                for [values, mask] in each(channel, phase) {
                    mean.iter_mut().zip(values.iter().zip(mask)).for_each(|(mean, (v, m))| *mean += v * m);
                }
                mean.iter_mut().zip(&counts[phase]).for_each(|(mean, count)| *mean /= count.max(1.0));
                for [values, mask] in each(channel, phase) {
                    let off = values.iter().zip(&mean).map(|(v, mean)| (v - mean).powi(2));
                    squares.iter_mut().zip(off.zip(mask)).for_each(|(sum, (square, m))| *sum += square * m);
                }
                let variances = squares.iter().zip(&counts[phase]).map(|(sum, count)| sum / count.max(1.0));
                between.iter_mut().zip(variances).for_each(|(sum, v)| *sum += v);
                mean
            });
            for (x, sum) in sums[guide / 3].iter_mut().enumerate() {
                sum[0] += share * between[x] / FULL_PHASES as f32;
                sum[1] += share * within(std::array::from_fn(|phase| own(channel, phase)[x]));
                sum[2] += share * within(std::array::from_fn(|phase| means[phase][x]));
            }
        }
        for (guide, sums) in sums.iter().enumerate() {
            for part in 0..3 {
                let plane = to.plane(2 * part + guide);
                plane.iter_mut().zip(sums).for_each(|(to, sum)| *to = GAIN * sum[part]);
                ln_1p_all(isa, plane);
                plane.iter_mut().for_each(|v| *v /= RANGE);
            }
        }
        let share = to.plane(VARIANCES - 1);
        for (x, to) in share.iter_mut().enumerate() {
            *to = 1.0 / (counts.iter().map(|count| count[x]).sum::<f32>() / FULL_PHASES as f32).max(1.0);
        }
    });
    out
}

/// The variance of four pixels.
fn within(pixels: [f32; FULL_PHASES]) -> f32 {
    let mean = pixels.iter().sum::<f32>() / FULL_PHASES as f32;
    pixels.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / FULL_PHASES as f32
}
