//! The pyramid's levels, coarse to fine: predict a segment's kernels and apply them while they are in the cache.

use std::ops::Range;

use ndarray::Array3;
use rayon::prelude::*;

use super::gathered::Gathered;
use super::pairs::{Neighbour, Pairs};
use super::predictor::{Head, Predictor, SECOND};
use super::specialisation::Codes;
use crate::kernels::planes::Planes;
use crate::kernels::weigh::{TapWeights, Taps, apply, offsets};
use crate::kernels::{Channels, FULL_PHASES, pyramid};
use crate::layers::{Activation, SEGMENT};
use crate::simd::{Isa, Simd, SimdOp};
use crate::tiles::Tile;

/// One pyramid level's images: the centre's and each neighbour's.
pub struct Level {
    pub centre: Planes,
    pub neighbours: Vec<Planes>,
}

/// The levels' images.
pub struct Pyramid {
    pub full: Level,
    /// Half resolution and coarser, as many as are used.
    pub coarse: Vec<Level>,
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

/// What the second pass takes of a neighbour at a half-resolution pixel: two logits, and which of the 2×2 pixels may be used, as bits.
pub const SEEN: usize = SECOND + 1;

/// Everything that the levels of one tile read.
pub struct Levels<'a> {
    pub isa: Isa,
    pub predictor: &'a Predictor,
    pub channels: Channels,
    pub margins: Margins,
    pub pyramid: &'a Pyramid,
    /// The body's features: half, quarter and eighth resolution.
    pub features: &'a [Activation; 3],
    pub neighbours: &'a [Neighbour<'a>],
    /// What the neighbours are at quarter and eighth resolution.
    pub gathered: &'a [Gathered; 2],
    pub tile: Tile,
    /// Kernel widths: centre, neighbour, coarse, albedo.
    pub widths: [usize; 4],
    /// λ of the region at half resolution, where the second pass is to follow.
    pub second: Option<Codes<'a>>,
}

/// Index distances to the taps of each image of a level, for each output phase.
struct Reach {
    centre: Vec<Vec<isize>>,
    neighbours: Vec<Vec<Vec<isize>>>,
    coarse: Vec<Vec<isize>>,
}

impl Levels<'_> {
    /// The region's denoised coarser levels that are used, demodulated; half resolution comes last.
    pub fn coarse(&self) -> Vec<Planes> {
        let mut out: Vec<Planes> = Vec::new();
        for (k, images) in self.pyramid.coarse.iter().enumerate().rev() {
            let coarser = out.last().map(|planes| pyramid::up(planes, self.margins.coarse));
            out.push(self.coarse_level(k, images, coarser.as_ref()));
        }
        out
    }

    /// Whether the albedo has kernels on a level, 0 the full resolution.
    fn filters_albedo(&self, level: usize) -> bool {
        level < self.predictor.albedo_levels
    }

    /// The neighbours at a resolution below the full one, half the first.
    fn pairs(&self, level: usize) -> Pairs<'_> {
        match level.checked_sub(1) {
            None => Pairs::Half(self.neighbours, self.tile.region),
            Some(coarser) => Pairs::Coarser(&self.gathered[coarser]),
        }
    }

    /// Distances for kernels of `centre` and `neighbour` taps, and to the coarser image, whose pixels are `step` apart.
    fn reach(&self, level: &Level, phases: usize, centre: usize, neighbour: usize, coarser: Option<(&Planes, isize)>) -> Reach {
        let each = |image: &Planes, size: usize| (0..phases).map(|phase| offsets(image, phases, phase, size, 1)).collect();
        Reach {
            centre: each(&level.centre, centre),
            neighbours: level.neighbours.iter().map(|n| each(n, neighbour)).collect(),
            coarse: coarser.map_or(Vec::new(), |(image, step)| vec![offsets(image, 1, 0, self.widths[2], step); phases]),
        }
    }

    /// A level below full resolution: values and mask over the whole region, zero outside it. What holds no usable pixel itself is
    /// usable where any of its taps was: that fills holes from afar.
    fn coarse_level(&self, k: usize, level: &Level, coarser: Option<&Planes>) -> Planes {
        let (head, known) = (&self.predictor.coarse[k], (&self.features[k], self.pairs(k)));
        let reach = self.reach(level, 1, self.widths[0], self.widths[1], coarser.map(|c| (c, 2)));
        let albedo = self.filters_albedo(k + 1).then(|| {
            let coarser = coarser.filter(|_| self.filters_albedo(k + 2));
            (self.reach(level, 1, self.widths[3], 1, coarser.map(|c| (c, 2))), coarser)
        });
        let (rows, columns) = (level.centre.rows(), level.centre.columns());
        let mut out = level.centre.same_pool(self.channels.denoised(), rows, columns, self.margins.coarse);
        out.rows_mut().enumerate().for_each(|(y, mut row)| {
            let mut line = vec![0.0; self.channels.denoised() * known.0.columns().next_multiple_of(SEGMENT)];
            let (reach, albedo) = (&reach, albedo.as_ref());
            self.isa.run(CoarseRow { levels: self, head, known, level, coarser, reach, albedo, y, line: &mut line });
            let stride = line.len() / self.channels.denoised();
            for (channel, from) in line.chunks_exact(stride).enumerate() {
                let to = row.plane(channel);
                let columns = to.len();
                to.copy_from_slice(&from[..columns]);
            }
        });
        out
    }

    /// The tile's core at full resolution, taking in the half resolution where there is one; and what the second pass takes of the
    /// neighbours there, [half-resolution row][neighbour][[`SEEN`]][column], where it is to follow.
    pub fn full(&self, half: Option<&Planes>) -> (Array3<f32>, Vec<f32>) {
        let Tile { core, region } = self.tile;
        let values = self.channels.values;
        let level = &self.pyramid.full;
        let [centre, neighbour, _, albedo] = self.widths;
        let reach = self.reach(level, FULL_PHASES, centre, neighbour, half.map(|h| (h, 1)));
        let albedo = self.reach(level, FULL_PHASES, albedo, 1, half.filter(|_| self.filters_albedo(1)).map(|h| (h, 1)));
        let mut out = Array3::zeros((2 * core.rows, 2 * core.columns, values));
        let width = 2 * core.columns * values;
        let seen_width = if self.second.is_some() { self.neighbours.len() * SEEN * core.columns } else { 0 };
        let mut seen = vec![0.0; core.rows * seen_width];
        if let Some(out) = out.as_slice_mut() {
            let row = |(i, rows, seen): (usize, &mut [f32], &mut [f32])| {
                let y = i + core.row - region.row;
                self.isa.run(FullRows { levels: self, half, reach: &reach, albedo: &albedo, y, out: rows, seen });
            };
            let rows = out.par_chunks_mut(2 * width).enumerate();
            if seen_width == 0 {
                rows.for_each(|(i, rows)| row((i, rows, &mut [])));
            } else {
                rows.zip(seen.par_chunks_mut(seen_width)).for_each(|((i, rows), seen)| row((i, rows, seen)));
            }
        }
        (out, seen)
    }
}

/// One row of a level below full resolution.
struct CoarseRow<'a, 'b> {
    levels: &'a Levels<'b>,
    head: &'a Head,
    known: (&'a Activation, Pairs<'a>),
    level: &'a Level,
    coarser: Option<&'a Planes>,
    reach: &'a Reach,
    /// Where the albedo has kernels on this level, and its coarser level where that has.
    albedo: Option<&'a (Reach, Option<&'a Planes>)>,
    y: usize,
    /// \[channel]\[column].
    line: &'a mut [f32],
}

impl SimdOp for CoarseRow<'_, '_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Self { levels, head, known: (features, pairs), level, coarser, reach, albedo, y, line } = self;
        let (channels, counts) = (levels.channels, levels.predictor.taps);
        let values = channels.values;
        let stride = line.len() / channels.denoised();
        let mut logits = head.buffers(levels.neighbours.len());
        let mut weights = TapWeights::default();
        let mut values_of = vec![0.0; values * SEGMENT];
        let mut modulation = vec![0.0; 4 * SEGMENT];
        for x in (0..features.columns()).step_by(SEGMENT) {
            head.predict(s, features, pairs, y, x, &mut logits);
            let centre = &logits.centre;
            let mask = channels.mask();
            let own =
                Taps { image: &level.centre, phases: 1, offsets: &reach.centre, logits: centre, pitch: 0, mask, queries: None };
            let mut taps = vec![Taps { queries: Some(&centre[head.starts.queries * SEGMENT..]), ..own }];
            if let Some(image) = coarser {
                let logits = &centre[counts.centre * SEGMENT..];
                taps.push(Taps { image, offsets: &reach.coarse, logits, ..own });
            }
            for ((image, offsets), logits) in level.neighbours.iter().zip(&reach.neighbours).zip(&logits.pairs) {
                taps.push(Taps { image, offsets, logits, queries: Some(&logits[head.pair_starts.queries * SEGMENT..]), ..own });
            }
            apply(s, &taps, channels.key(), channels.light(), y, x, &mut weights, &mut values_of);
            put(line, stride, channels.light(), mask, x, &values_of, &weights);
            let Some((reach, coarser)) = albedo else { continue };
            let logits_of = &centre[head.starts.albedo * SEGMENT..];
            let mut taps = vec![Taps { offsets: &reach.centre, logits: logits_of, ..own }];
            if let Some(image) = coarser {
                let (logits, mask) = (&logits_of[counts.albedo * SEGMENT..], channels.modulation_mask());
                taps.push(Taps { image, offsets: &reach.coarse, logits, mask, ..own });
            }
            for ((image, offsets), logits) in level.neighbours.iter().zip(&reach.neighbours).zip(&logits.pairs) {
                taps.push(Taps { image, offsets, logits: &logits[head.pair_starts.albedo * SEGMENT..], ..own });
            }
            apply(s, &taps, channels.key(), channels.modulated(), y, x, &mut weights, &mut modulation);
            put(line, stride, channels.modulated(), channels.modulation_mask(), x, &modulation, &weights);
        }
    }
}

/// Writes a segment's [channel][32] to these channels of a row, and to `mask` where any tap was usable.
#[inline(always)]
fn put(line: &mut [f32], stride: usize, channels: [Range<usize>; 2], mask: usize, x: usize, found: &[f32], weights: &TapWeights) {
    for (channel, from) in channels.into_iter().flatten().zip(found.chunks_exact(SEGMENT)) {
        line[channel * stride + x..][..SEGMENT].copy_from_slice(from);
    }
    let mask = &mut line[mask * stride + x..][..SEGMENT];
    mask.iter_mut().zip(weights.scales()).for_each(|(to, scale)| *to = f32::from(*scale > 0.0));
}

/// Two full-resolution rows of the core.
struct FullRows<'a, 'b> {
    levels: &'a Levels<'b>,
    half: Option<&'a Planes>,
    reach: &'a Reach,
    albedo: &'a Reach,
    /// Of half resolution, in the region.
    y: usize,
    /// (2, columns, values).
    out: &'a mut [f32],
    /// \[neighbour]\[[`SEEN`]]\[column], empty without a second pass.
    seen: &'a mut [f32],
}

impl SimdOp for FullRows<'_, '_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Self { levels, half, reach, albedo, y, out, seen } = self;
        let Tile { core, region } = levels.tile;
        let (level, channels, counts) = (&levels.pyramid.full, levels.channels, levels.predictor.taps);
        let values = channels.values;
        let (pitch, pair_pitch) = (counts.centre + counts.coarse + counts.albedo, counts.neighbour + 1);
        let first = core.column - region.column;
        let mut logits = levels.predictor.full.buffers(levels.neighbours.len());
        let mut weights = TapWeights::default();
        let mut modulation = vec![0.0; 4 * FULL_PHASES * SEGMENT];
        let mut line = vec![0.0; values * FULL_PHASES * SEGMENT];
        let (image, phases) = (&level.centre, FULL_PHASES);
        for x in (first..first + core.columns).step_by(SEGMENT) {
            let head = &levels.predictor.full;
            head.predict(s, &levels.features[0], levels.pairs(0), y, x, &mut logits);
            let coarse = &logits.centre[counts.centre * SEGMENT..];
            let of_albedo = &coarse[counts.coarse * SEGMENT..];
            let mask = channels.mask();
            let own = Taps { image, phases, offsets: &reach.centre, logits: &logits.centre, pitch, mask, queries: None };
            let mut taps = vec![Taps { queries: Some(&logits.centre[head.starts.queries * SEGMENT..]), ..own }];
            let mut albedo_taps = vec![Taps { offsets: &albedo.centre, logits: of_albedo, ..own }];
            for (n, (image, logits)) in level.neighbours.iter().zip(&logits.pairs).enumerate() {
                let near = Taps { image, offsets: &reach.neighbours[n], logits, pitch: pair_pitch, ..own };
                taps.push(Taps { queries: Some(&logits[head.pair_starts.queries * SEGMENT..]), ..near });
                let logits = &logits[counts.neighbour * SEGMENT..];
                albedo_taps.push(Taps { offsets: &albedo.neighbours[n], logits, ..near });
            }
            if let Some(image) = half {
                taps.push(Taps { image, phases: 1, offsets: &reach.coarse, logits: coarse, ..own });
                if levels.filters_albedo(1) {
                    let (logits, mask) = (&logits.centre[head.starts.albedo * SEGMENT..], channels.modulation_mask());
                    albedo_taps.push(Taps {
                        image,
                        phases: 1,
                        offsets: &albedo.coarse,
                        logits,
                        pitch: counts.coarse,
                        mask,
                        ..own
                    });
                }
            }
            apply(s, &albedo_taps, channels.key(), channels.modulated(), y, x, &mut weights, &mut modulation);
            own_where_none(&mut modulation, &weights, image, channels.modulated(), y, x);
            apply(s, &taps, channels.key(), channels.light(), y, x, &mut weights, &mut line);
            if channels.alpha_as_modulation {
                // The light passes make room for alpha, which comes before them.
                let (alpha, rest) = (3 * FULL_PHASES * SEGMENT, line.len() - FULL_PHASES * SEGMENT);
                line.copy_within(alpha..rest, alpha + FULL_PHASES * SEGMENT);
                line[alpha..alpha + FULL_PHASES * SEGMENT].copy_from_slice(&modulation[alpha..alpha + FULL_PHASES * SEGMENT]);
            }
            for (channel, line) in line.chunks_exact_mut(FULL_PHASES * SEGMENT).enumerate() {
                let Some(c) = channels.modulated_by(channel) else { continue };
                let modulation = &modulation[c * FULL_PHASES * SEGMENT..][..FULL_PHASES * SEGMENT];
                line.iter_mut().zip(modulation).for_each(|(v, m)| *v *= m);
            }
            interleave(&line, values, x - first, core.columns, out);
            let Some(codes) = levels.second else { continue };
            let code: [f32; SEGMENT] = std::array::from_fn(|p| codes.at(y, (x + p).min(region.columns - 1)));
            for (n, seen) in seen.chunks_exact_mut(SEEN * core.columns).enumerate() {
                let second = &logits.pairs[n][head.pair_starts.second * SEGMENT..];
                put_seen(second, &code, &level.neighbours[n], channels.mask(), (y, x, x - first), seen);
            }
        }
    }
}

/// Writes a segment's two logits of the second pass, and which of the 2×2 pixels may be used, to a row of [[`SEEN`]][columns].
#[inline(always)]
fn put_seen(
    logits: &[f32],
    code: &[f32; SEGMENT],
    image: &Planes,
    mask: usize,
    (y, x, to): (usize, usize, usize),
    seen: &mut [f32],
) {
    let columns = seen.len() / SEEN;
    let count = SEGMENT.min(columns - to);
    for (logit, seen) in seen.chunks_exact_mut(columns).take(SECOND).enumerate() {
        let (plain, moved) = (&logits[logit * SEGMENT..], &logits[(SECOND + logit) * SEGMENT..]);
        for (p, seen) in seen[to..to + count].iter_mut().enumerate() {
            *seen = plain[p] + code[p] * moved[p];
        }
    }
    let bits = &mut seen[SECOND * columns + to..][..count];
    for phase in 0..FULL_PHASES {
        let trusted = &image.row(mask * FULL_PHASES + phase, y)[x..][..count];
        bits.iter_mut().zip(trusted).for_each(|(bits, trusted)| *bits += trusted * (1 << phase) as f32);
    }
}

/// Where no tap's albedo was usable, inside a hole of bad pixels, the pixel's own serves: [channel][phase][32].
#[inline(always)]
fn own_where_none(modulation: &mut [f32], weights: &TapWeights, image: &Planes, channels: [Range<usize>; 2], y: usize, x: usize) {
    for (channel, modulation) in channels.into_iter().flatten().zip(modulation.chunks_exact_mut(FULL_PHASES * SEGMENT)) {
        for (i, (m, scale)) in modulation.iter_mut().zip(weights.scales()).enumerate() {
            if *scale == 0.0 {
                let column = (x + i % SEGMENT).min(image.columns() - 1);
                *m = image.row(channel * FULL_PHASES + i / SEGMENT, y)[column];
            }
        }
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

/// The images of a region at the `levels` finest levels. `exposure` is the centre frame's.
pub fn pyramid_of(isa: Isa, full: Level, channels: &Channels, margins: Margins, (levels, exposure): (usize, f32)) -> Pyramid {
    let mut coarse: Vec<Level> = Vec::new();
    for _ in 1..levels {
        let (finer, down) =
            coarse.last().map_or((&full, pyramid::down_from_full as Down), |level| (level, pyramid::down as Down));
        coarse.push(Level {
            centre: down(isa, &finer.centre, channels, margins.coarse, exposure),
            neighbours: finer.neighbours.iter().map(|n| down(isa, n, channels, margins.coarse, exposure)).collect(),
        });
    }
    Pyramid { full, coarse }
}

type Down = fn(Isa, &Planes, &Channels, usize, f32) -> Planes;

/// Half-resolution pixels around a core whose logits and pixels the kernels of a pyramid of `levels` levels reach.
pub fn kernel_reach(widths: [usize; 4], levels: usize) -> usize {
    let [centre, neighbour, coarse, albedo] = widths.map(|w| w / 2);
    // Coarse taps of every level, then the coarsest level's kernel and the rest of its pixels, and the full resolution's own.
    let coarsest = 1 << levels.saturating_sub(2);
    (2 * coarsest - 1) * coarse + coarsest * (centre.max(neighbour).max(albedo) + 1) + 1
}
