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
        let row = |image: usize, channel: usize, phase: usize| images[image].row(channel * FULL_PHASES + phase, y);
        let mut counts = vec![[0.0; FULL_PHASES]; columns];
        for image in 0..images.len() {
            for phase in 0..FULL_PHASES {
                let mask = row(image, channels.mask(), phase);
                counts.iter_mut().zip(mask).for_each(|(count, m)| count[phase] += m);
            }
        }
        let mut sums = [[0.0, 0.0, 0.0]; 2].map(|zero: [f32; 3]| vec![zero; columns]);
        for (guide, channel) in guides.into_iter().enumerate() {
            let share = if guide < 3 { 1.0 / 3.0 } else { 1.0 };
            let mut means = vec![[0.0; FULL_PHASES]; columns];
            let mut between = vec![[0.0; FULL_PHASES]; columns];
            for image in 0..images.len() {
                for phase in 0..FULL_PHASES {
                    let (values, mask) = (row(image, channel, phase), row(image, channels.mask(), phase));
                    let usable = values.iter().zip(mask);
                    means.iter_mut().zip(usable).for_each(|(mean, (v, m))| mean[phase] += v * m);
                }
            }
            for (mean, count) in means.iter_mut().zip(&counts) {
                (0..FULL_PHASES).for_each(|p| mean[p] /= count[p].max(1.0));
            }
            for image in 0..images.len() {
                for phase in 0..FULL_PHASES {
                    let (values, mask) = (row(image, channel, phase), row(image, channels.mask(), phase));
                    let usable = values.iter().zip(mask).zip(&means);
                    between.iter_mut().zip(usable).for_each(|(sum, ((v, m), mean))| sum[phase] += (v - mean[phase]).powi(2) * m);
                }
            }
            let own: [&[f32]; FULL_PHASES] = std::array::from_fn(|phase| row(0, channel, phase));
            for (x, sum) in sums[guide / 3].iter_mut().enumerate() {
                let over: f32 = (0..FULL_PHASES).map(|p| between[x][p] / counts[x][p].max(1.0)).sum();
                sum[0] += share * over / FULL_PHASES as f32;
                sum[1] += share * within(own.map(|phase| phase[x]));
                sum[2] += share * within(means[x]);
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
        share
            .iter_mut()
            .zip(&counts)
            .for_each(|(to, count)| *to = 1.0 / (count.iter().sum::<f32>() / FULL_PHASES as f32).max(1.0));
    });
    out
}

/// The variance of four pixels.
fn within(pixels: [f32; FULL_PHASES]) -> f32 {
    let mean = pixels.iter().sum::<f32>() / FULL_PHASES as f32;
    pixels.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / FULL_PHASES as f32
}
