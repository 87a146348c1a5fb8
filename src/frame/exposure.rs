//! How bright a frame is: the scale that brings it to the network's brightness (`exposure` in `training/data/geometry.py`).

use ndarray::ArrayView3;
use rayon::prelude::*;

use super::sanitise::radiance;

/// Pixels a block is wide and high, and its parts.
const BLOCK: usize = 16;
const PART: usize = 4;
const PARTS: usize = (BLOCK / PART) * (BLOCK / PART);
/// A block counts at most this many times what the steadiest light in the frame has.
const FIREFLY: f64 = 1000.0;
/// A block counts where it has more than this share of the brightest.
const LIT: f64 = 1e-6;

/// Mean luminance of a block, and of its darkest part; zero where no pixel is finite.
struct BlockLight {
    mean: f64,
    least: f64,
}

/// The scale that brings the log-average luminance over 16×16 blocks to 0.18; 1 for a black frame.
///
/// A few pixels that are absurdly bright do not matter: the brightest block is one that has its light in all its parts.
pub fn exposure(colour: ArrayView3<f32>) -> f32 {
    let (rows, columns, _) = colour.dim();
    let blocks: Vec<BlockLight> = (0..rows.div_ceil(BLOCK))
        .into_par_iter()
        .flat_map_iter(|by| (0..columns.div_ceil(BLOCK)).map(move |bx| (by, bx)))
        .map(|(by, bx)| block(colour, by * BLOCK, bx * BLOCK))
        .collect();
    let steady = blocks.iter().map(|b| b.least).fold(0.0, f64::max);
    let most = if steady > 0.0 { FIREFLY * steady } else { f64::INFINITY };
    let means = || blocks.iter().map(|b| b.mean.min(most));
    let threshold = means().fold(0.0, f64::max) * LIT;
    let (sum, count) = means().filter(|m| *m > threshold).fold((0.0, 0u32), |(s, n), m| (s + m.log2(), n + 1));
    if count == 0 { 1.0 } else { (0.18 / (sum / f64::from(count)).exp2()).clamp(1e-35, 1e35) as f32 }
}

fn block(colour: ArrayView3<f32>, row: usize, column: usize) -> BlockLight {
    let (rows, columns, _) = colour.dim();
    let (mut sums, mut counts) = ([0.0f64; PARTS], [0u32; PARTS]);
    for y in row..rows.min(row + BLOCK) {
        for x in column..columns.min(column + BLOCK) {
            let [r, g, b] = std::array::from_fn(|c| colour[[y, x, c]]);
            if r.is_finite() && g.is_finite() && b.is_finite() {
                let part = (y - row) / PART * (BLOCK / PART) + (x - column) / PART;
                sums[part] += f64::from(0.2126 * radiance(r) + 0.7152 * radiance(g) + 0.0722 * radiance(b));
                counts[part] += 1;
            }
        }
    }
    let means = sums.iter().zip(counts).filter(|(_, n)| *n > 0).map(|(sum, n)| sum / f64::from(n));
    let least = means.reduce(f64::min).unwrap_or(0.0);
    BlockLight { mean: sums.iter().sum::<f64>() / f64::from(counts.iter().sum::<u32>().max(1)), least }
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;

    fn scene() -> Array3<f32> {
        Array3::from_shape_fn((40, 50, 3), |(y, x, _)| 0.1 + ((y * 7 + x * 3) % 13) as f32 * 0.02)
    }

    #[test]
    fn exposure_follows_brightness_and_ignores_bad_pixels() {
        let mut colour = scene();
        let plain = exposure(colour.view());
        let brighter = exposure((&colour * 1024.0).view());
        assert!((plain / brighter / 1024.0 - 1.0).abs() < 1e-6);
        colour[[3, 3, 0]] = f32::INFINITY;
        assert!((exposure(colour.view()) / plain - 1.0).abs() < 0.01);
        assert_eq!(exposure(Array3::zeros((4, 4, 3)).view()), 1.0);
    }

    #[test]
    fn one_huge_pixel_moves_the_exposure_by_a_stop_and_a_lone_light_sets_it() {
        let mut colour = scene();
        let plain = exposure(colour.view());
        colour[[20, 20, 1]] = 1e30;
        let stops = (plain / exposure(colour.view())).log2();
        assert!((0.0..=1.0).contains(&stops), "{stops} stops");
        let mut lone = Array3::zeros((40, 50, 3));
        lone[[20, 20, 1]] = 256.0 / 0.7152;
        assert!((exposure(lone.view()) / 0.18 - 1.0).abs() < 1e-5);
    }
}
