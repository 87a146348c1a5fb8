//! Temporal extractor: the centre's features and its neighbours', mixed to the body's input (Vogels et al. 2018, section 4.2).
//!
//! Every neighbour goes through the same weights, so that any number of them, before and after, works with one network.

use rayon::prelude::*;

use super::features::Features;
use super::gathered::{Gathered, halve};
use super::pairs::{Neighbour, features_of, gather};
use super::variance::VARIANCES;
use super::warp::EXTRAS;
use super::weights::Weights;
use crate::error::Result;
use crate::kernels::planes::Planes;
use crate::layers::{Activation, Dense, SEGMENT};
use crate::memory::BufferPool;
use crate::simd::{Isa, Simd, dispatch};
use crate::tiles::Rect;

/// Three 1×1 layers.
pub struct Temporal {
    centre: Dense,
    neighbour: Dense,
    mix: Dense,
    features: usize,
    width: usize,
    variances: usize,
}

impl Temporal {
    /// Takes the layers `mix*` of the weights.
    pub fn new(weights: &Weights) -> Result<Self> {
        let (features, width) = (weights.architecture.features, weights.architecture.half);
        let variances = weights.architecture.variance * VARIANCES;
        Ok(Self {
            centre: weights.dense("mix_centre", width, features, true)?,
            neighbour: weights.dense("mix_neighbour", width, features + EXTRAS, false)?,
            mix: weights.dense("mix", width, features + width + variances, true)?,
            features,
            width,
            variances,
        })
    }

    /// Whether it is told how noisy a pixel is.
    pub fn wants_variances(&self) -> bool {
        self.variances > 0
    }

    /// The body's input over `region`, of even size, from the centre's features over the whole frame and the variances of the region where they are wanted; and what the neighbours are at
    /// quarter resolution. Both in memory from `pool`.
    pub fn run(
        &self,
        isa: Isa,
        centre: &Features,
        neighbours: &[Neighbour],
        variances: Option<&Planes>,
        region: Rect,
        pool: &BufferPool,
    ) -> (Activation, Gathered) {
        let mut out = Activation::in_pool(pool);
        out.reset(region.rows, region.columns, self.width);
        let mut quarter = Gathered::new(region.rows / 2, region.columns / 2, neighbours.len(), self.features, pool);
        let rows = out.as_mut_slice().par_chunks_mut(2 * region.columns * self.width).enumerate();
        if neighbours.is_empty() {
            rows.for_each(|(y, rows)| temporal_rows(isa, self, centre, neighbours, variances, region, y, rows, &mut []));
        } else {
            rows.zip(quarter.rows_mut()).for_each(|((y, rows), quarter)| {
                temporal_rows(isa, self, centre, neighbours, variances, region, y, rows, quarter)
            });
        }
        (out, quarter)
    }
}

/// Two rows of the region, 2·`y` and the next, and row `y` of the neighbours at quarter resolution.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn rows_body<S: Simd>(
    s: S,
    layers: &Temporal,
    centre: &Features,
    neighbours: &[Neighbour],
    variances: Option<&Planes>,
    region: Rect,
    y: usize,
    out: &mut [f32],
    quarter: &mut [f32],
) {
    let (features, width) = (layers.features, layers.width);
    let size = (features + EXTRAS) * SEGMENT;
    let mut joined = vec![0.0; (features + width + layers.variances) * SEGMENT];
    let mut pairs = vec![0.0; 2 * neighbours.len() * size];
    let mut base = vec![0.0; layers.centre.output_len()];
    let mut each = vec![0.0; layers.neighbour.output_len()];
    let mut mixed = vec![0.0; layers.mix.output_len()];
    for x in (0..region.columns).step_by(SEGMENT) {
        for (dy, out) in out.chunks_exact_mut(region.columns * width).enumerate() {
            features_of(s, centre, region, 2 * y + dy, x, &mut joined);
            layers.centre.run(s, &joined, None, false, &mut base);
            let (around, noise) = joined[features * SEGMENT..].split_at_mut(width * SEGMENT);
            around.fill(0.0);
            if let Some(variances) = variances {
                let count = SEGMENT.min(region.columns - x);
                for (channel, to) in noise.chunks_exact_mut(SEGMENT).enumerate() {
                    to[..count].copy_from_slice(&variances.row(channel, 2 * y + dy)[x..x + count]);
                }
            }
            let mut trust = [1.0f32; SEGMENT];
            for (n, neighbour) in neighbours.iter().enumerate() {
                let pair = &mut pairs[(2 * n + dy) * size..][..size];
                gather(s, *neighbour, region, 2 * y + dy, x, pair);
                layers.neighbour.run(s, pair, Some(&base), true, &mut each);
                let share = &pair[features * SEGMENT..][..SEGMENT];
                for (sum, value) in around.chunks_exact_mut(SEGMENT).zip(each.chunks_exact(SEGMENT)) {
                    for p in 0..SEGMENT {
                        sum[p] += share[p] * value[p];
                    }
                }
                trust.iter_mut().zip(share).for_each(|(sum, v)| *sum += v);
            }
            for sum in around.chunks_exact_mut(SEGMENT) {
                for p in 0..SEGMENT {
                    sum[p] /= trust[p];
                }
            }
            layers.mix.run(s, &joined, None, false, &mut mixed);
            put(s, &mixed, width, x, region.columns, out);
        }
        for n in 0..neighbours.len() {
            let (upper, lower) = pairs[2 * n * size..][..2 * size].split_at(size);
            let to = &mut quarter[(x / 2 / SEGMENT * neighbours.len() + n) * size..][..size];
            halve([upper, lower], x / SEGMENT % 2, to);
        }
    }
}

/// Writes a segment's [channel][32] to a row of (columns, width), as far as the row goes.
#[inline(always)]
fn put<S: Simd>(s: S, mixed: &[f32], width: usize, x: usize, columns: usize, out: &mut [f32]) {
    for part in (0..SEGMENT).step_by(16) {
        for first in (0..width).step_by(16) {
            let mut block = [s.splat(0.0); 16];
            for (c, channel) in block.iter_mut().enumerate() {
                *channel = s.load(mixed, (first + c) * SEGMENT + part);
            }
            let inside = columns.saturating_sub(x + part);
            for (p, pixel) in s.transpose(block).into_iter().enumerate().take(inside) {
                s.store(pixel, out, (x + part + p) * width + first);
            }
        }
    }
}

dispatch! {
    fn temporal_rows(
        layers: &Temporal,
        centre: &Features,
        neighbours: &[Neighbour<'_>],
        variances: Option<&Planes>,
        region: Rect,
        y: usize,
        out: &mut [f32],
        quarter: &mut [f32],
    ) = rows_body
}
