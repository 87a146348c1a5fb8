//! The pyramid's levels, coarse to fine: predict a segment's kernels and apply them while they are in the cache.

use ndarray::Array3;
use rayon::prelude::*;

use super::pairs::Neighbour;
use super::predictor::{Head, Predictor};
use crate::kernels::planes::Planes;
use crate::kernels::weigh::{Taps, offsets, weigh, weighted};
use crate::kernels::{Channels, FULL_PHASES, pyramid};
use crate::plan::tiles::Tile;
use crate::simd::dense::SEGMENT;
use crate::simd::lanes::{Lanes, dispatch};
use crate::simd::{Activation, Isa};

/// One pyramid level's images: the centre's and each neighbour's.
pub struct Level {
    pub centre: Planes,
    pub neighbours: Vec<Planes>,
}

/// The three levels' images.
pub struct Pyramid {
    pub full: Level,
    pub half: Level,
    pub quarter: Level,
}

/// Columns and rows that a level's planes need around them for kernels of `taps` taps.
#[derive(Clone, Copy)]
pub struct Margins {
    pub full: usize,
    pub coarse: usize,
}

impl Margins {
    /// For kernels up to `widest` taps wide that take in coarser pixels up to `coarse` taps wide.
    pub fn new(widest: usize, coarse: usize) -> Self {
        let (r, c) = (widest / 2, coarse / 2);
        Self { full: r.div_ceil(2).max(1), coarse: r.max(2 * c) }
    }
}

/// Everything that the levels of one tile read.
pub struct Levels<'a> {
    pub isa: Isa,
    pub predictor: &'a Predictor,
    pub channels: Channels,
    pub margins: Margins,
    pub pyramid: &'a Pyramid,
    pub half: &'a Activation,
    pub quarter: &'a Activation,
    pub neighbours: &'a [Neighbour<'a>],
    pub tile: Tile,
    /// Kernel widths: centre, neighbour, coarse, albedo.
    pub widths: [usize; 4],
}

/// Index distances to the taps of each image of a level.
struct Reach {
    centre: Vec<isize>,
    neighbours: Vec<Vec<isize>>,
    coarse: Option<Vec<isize>>,
}

impl Levels<'_> {
    /// The denoised quarter and half resolution of the region, demodulated, and the tile's core at full resolution.
    pub fn run(&self) -> (Planes, Planes, Array3<f32>) {
        let quarter = self.coarse_level(&self.predictor.quarter, self.quarter, &self.pyramid.quarter, None);
        let quarter_up = pyramid::up(&quarter, self.margins.coarse);
        let half = self.coarse_level(&self.predictor.half, self.half, &self.pyramid.half, Some(&quarter_up));
        let full = self.full_level(&half);
        (quarter, half, full)
    }

    fn reach(&self, level: &Level, phases: usize, phase: usize, coarse: Option<(&Planes, isize)>) -> Reach {
        let [centre, neighbour, coarse_width, _] = self.widths;
        Reach {
            centre: offsets(&level.centre, phases, phase, centre, 1),
            neighbours: level.neighbours.iter().map(|n| offsets(n, phases, phase, neighbour, 1)).collect(),
            coarse: coarse.map(|(image, step)| offsets(image, 1, 0, coarse_width, step)),
        }
    }

    /// Quarter and half resolution: values and mask over the whole region, zero outside it.
    fn coarse_level(&self, head: &Head, features: &Activation, level: &Level, coarser: Option<&Planes>) -> Planes {
        let reach = self.reach(level, 1, 0, coarser.map(|c| (c, 2)));
        let mut out = Planes::new(self.channels.coarse(), level.centre.rows(), level.centre.columns(), self.margins.coarse);
        let mask = self.channels.mask();
        out.rows_mut().enumerate().for_each(|(y, mut row)| {
            let values = self.channels.values;
            let mut line = vec![0.0; values * features.columns().next_multiple_of(SEGMENT)];
            coarse_row(self.isa, self, head, features, level, coarser, &reach, y, &mut line);
            let stride = line.len() / values;
            for (channel, from) in line.chunks_exact(stride).enumerate() {
                let to = row.plane(channel);
                let columns = to.len();
                to.copy_from_slice(&from[..columns]);
            }
            row.plane(mask).copy_from_slice(level.centre.row(mask, y));
        });
        out
    }

    fn full_level(&self, half: &Planes) -> Array3<f32> {
        let Tile { core, region } = self.tile;
        let values = self.channels.values;
        let level = &self.pyramid.full;
        let reach: Vec<Reach> = (0..FULL_PHASES).map(|phase| self.reach(level, FULL_PHASES, phase, Some((half, 1)))).collect();
        let [_, _, _, albedo] = self.widths;
        let albedo: Vec<Reach> = (0..FULL_PHASES)
            .map(|phase| Reach {
                centre: offsets(&level.centre, FULL_PHASES, phase, albedo, 1),
                neighbours: level.neighbours.iter().map(|n| offsets(n, FULL_PHASES, phase, 1, 1)).collect(),
                coarse: None,
            })
            .collect();
        let mut out = Array3::zeros((2 * core.rows, 2 * core.columns, values));
        let width = 2 * core.columns * values;
        if let Some(out) = out.as_slice_mut() {
            out.par_chunks_mut(2 * width).enumerate().for_each(|(i, rows)| {
                full_row(self.isa, self, half, &reach, &albedo, i + core.row - region.row, rows);
            });
        }
        out
    }
}

#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn coarse_row_body<L: Lanes>(
    l: L,
    levels: &Levels,
    head: &Head,
    features: &Activation,
    level: &Level,
    coarser: Option<&Planes>,
    reach: &Reach,
    y: usize,
    line: &mut [f32],
) {
    let values = levels.channels.values;
    let stride = line.len() / values;
    let mut logits = head.buffers(levels.neighbours.len());
    let counts = levels.predictor.taps;
    let mut weights = vec![0.0; 16 * (counts.centre + counts.coarse + counts.neighbour * levels.neighbours.len())];
    for x in (0..features.columns()).step_by(SEGMENT) {
        head.predict(l, features, levels.neighbours, levels.tile.region, y, x, &mut logits);
        let mut taps = vec![Taps { image: &level.centre, phases: 1, offsets: &reach.centre, logits: &logits.centre }];
        if let (Some(image), Some(offsets)) = (coarser, &reach.coarse) {
            taps.push(Taps { image, phases: 1, offsets, logits: &logits.centre[reach.centre.len() * SEGMENT..] });
        }
        for ((image, offsets), logits) in level.neighbours.iter().zip(&reach.neighbours).zip(&logits.pairs) {
            taps.push(Taps { image, phases: 1, offsets, logits });
        }
        for part in [0, 16] {
            weigh(l, &taps, levels.channels.mask(), y, x, part, &mut weights);
            for channel in 0..values {
                let value = weighted(l, &taps, channel, y, x, part, &weights);
                l.store(value, line, channel * stride + x + part);
            }
        }
    }
}

dispatch! {
    fn coarse_row(
        levels: &Levels,
        head: &Head,
        features: &Activation,
        level: &Level,
        coarser: Option<&Planes>,
        reach: &Reach,
        y: usize,
        line: &mut [f32],
    ) = coarse_row_body
}

/// Two full-resolution rows of the core, (2, columns, values); `y` counts half-resolution rows of the region.
#[inline(always)]
fn full_row_body<L: Lanes>(l: L, levels: &Levels, half: &Planes, reach: &[Reach], albedo: &[Reach], y: usize, out: &mut [f32]) {
    let Tile { core, region } = levels.tile;
    let (level, channels, counts) = (&levels.pyramid.full, levels.channels, levels.predictor.taps);
    let values = channels.values;
    let per_pixel = counts.centre + counts.coarse + counts.albedo;
    let first = core.column - region.column;
    let mut logits = levels.predictor.full.buffers(levels.neighbours.len());
    let most = per_pixel + (counts.neighbour + 1) * levels.neighbours.len();
    let mut weights = vec![0.0; 16 * most];
    let mut line = vec![0.0; values * FULL_PHASES * SEGMENT];
    for x in (first..first + core.columns).step_by(SEGMENT) {
        levels.predictor.full.predict(l, levels.half, levels.neighbours, region, y, x, &mut logits);
        for phase in 0..FULL_PHASES {
            let centre = &logits.centre[phase * per_pixel * SEGMENT..];
            let coarse = &centre[counts.centre * SEGMENT..];
            let pair = |n: usize| &logits.pairs[n][phase * (counts.neighbour + 1) * SEGMENT..];
            let mut taps =
                vec![Taps { image: &level.centre, phases: FULL_PHASES, offsets: &reach[phase].centre, logits: centre }];
            let mut albedo_taps = vec![Taps {
                image: &level.centre,
                phases: FULL_PHASES,
                offsets: &albedo[phase].centre,
                logits: &coarse[counts.coarse * SEGMENT..],
            }];
            for (n, image) in level.neighbours.iter().enumerate() {
                taps.push(Taps { image, phases: FULL_PHASES, offsets: &reach[phase].neighbours[n], logits: pair(n) });
                let logits = &pair(n)[counts.neighbour * SEGMENT..];
                albedo_taps.push(Taps { image, phases: FULL_PHASES, offsets: &albedo[phase].neighbours[n], logits });
            }
            let coarse_taps =
                reach[phase].coarse.as_deref().map(|offsets| Taps { image: half, phases: 1, offsets, logits: coarse });
            taps.extend(coarse_taps);
            for part in [0, 16] {
                weigh(l, &albedo_taps, channels.mask(), y, x, part, &mut weights);
                let mut modulation = [l.splat(0.0); 3];
                for (c, m) in modulation.iter_mut().enumerate() {
                    *m = weighted(l, &albedo_taps, channels.modulation() + c, y, x, part, &weights);
                }
                weigh(l, &taps, channels.mask(), y, x, part, &mut weights);
                for channel in 0..values {
                    let value = weighted(l, &taps, channel, y, x, part, &weights);
                    let value = match channels.modulated_by(channel) {
                        Some(c) => l.mul(value, modulation[c]),
                        None => value,
                    };
                    l.store(value, &mut line, (channel * FULL_PHASES + phase) * SEGMENT + part);
                }
            }
        }
        interleave(&line, values, x - first, core.columns, out);
    }
}

/// Writes a segment's [value][phase][32] to two rows of (columns, values).
#[inline(always)]
fn interleave(line: &[f32], values: usize, x: usize, columns: usize, out: &mut [f32]) {
    let width = 2 * columns * values;
    for p in 0..SEGMENT.min(columns - x) {
        for phase in 0..FULL_PHASES {
            let to = phase / 2 * width + (2 * (x + p) + phase % 2) * values;
            for channel in 0..values {
                out[to + channel] = line[(channel * FULL_PHASES + phase) * SEGMENT + p];
            }
        }
    }
}

dispatch! {
    fn full_row(levels: &Levels, half: &Planes, reach: &[Reach], albedo: &[Reach], y: usize, out: &mut [f32]) = full_row_body
}

/// The images of all levels of a region.
pub fn pyramid_of(centre: Planes, neighbours: Vec<Planes>, channels: &Channels, margins: Margins) -> Pyramid {
    let half = Level {
        centre: pyramid::down_from_full(&centre, channels, margins.coarse),
        neighbours: neighbours.iter().map(|n| pyramid::down_from_full(n, channels, margins.coarse)).collect(),
    };
    let quarter = Level {
        centre: pyramid::down(&half.centre, channels, margins.coarse),
        neighbours: half.neighbours.iter().map(|n| pyramid::down(n, channels, margins.coarse)).collect(),
    };
    Pyramid { full: Level { centre, neighbours }, half, quarter }
}

/// Half-resolution pixels around a core whose logits and pixels its kernels reach.
pub fn kernel_reach(widths: [usize; 4]) -> usize {
    let [centre, neighbour, coarse, albedo] = widths.map(|w| w / 2);
    (1 + 2 * coarse + coarse) + 2 * centre.max(neighbour).max(albedo) + 2
}
