//! What the network knows of a neighbour at a pixel: its features warped to the centre frame, and the extras.

use super::warp::{Corners, EXTRAS, Warped};
use crate::plan::tiles::Rect;
use crate::simd::Activation;
use crate::simd::dense::SEGMENT;
use crate::simd::lanes::Lanes;

/// A neighbour in a region.
#[derive(Clone, Copy)]
pub struct Neighbour<'a> {
    /// The neighbour's features over its whole frame.
    pub features: &'a Activation,
    pub warped: &'a Warped,
}

/// Copies 32 pixels of an image to [channel][32]; pixels past the row's end repeat its last. ReLU where asked.
#[inline(always)]
pub fn segment_of<L: Lanes>(l: L, row: &[f32], channels: usize, x: usize, relu: bool, out: &mut [f32]) {
    let last = row.len() / channels - 1;
    let low = l.splat(if relu { 0.0 } else { f32::NEG_INFINITY });
    let mut block = [low; 16];
    for part in (0..SEGMENT).step_by(16) {
        for first in (0..channels).step_by(16) {
            for p in 0..16 {
                block[p] = l.max(l.load(row, (x + part + p).min(last) * channels + first), low);
            }
            store_columns(l, block, first, part, out);
        }
    }
}

/// Writes sixteen pixels of sixteen channels to channels `first`… and pixels `part`… of [channel][32].
#[inline(always)]
fn store_columns<L: Lanes>(l: L, pixels: [L::V; 16], first: usize, part: usize, out: &mut [f32]) {
    let columns = l.transpose(pixels);
    for c in 0..16 {
        l.store(columns[c], out, (first + c) * SEGMENT + part);
    }
}

/// [features + EXTRAS][32] of the neighbour at the region's half-resolution row `y`, columns `x`….
#[inline(always)]
pub fn gather<L: Lanes>(l: L, neighbour: Neighbour, region: Rect, y: usize, x: usize, out: &mut [f32]) {
    let (_, columns, channels) = neighbour.features.shape();
    let features = neighbour.features.as_slice();
    let mut block = [l.splat(0.0); 16];
    let mut index = [0; 16];
    let mut weight = [[0.0; 4]; 16];
    for part in (0..SEGMENT).step_by(16) {
        for p in 0..16 {
            let pixel = y * region.columns + (x + part + p).min(region.columns - 1);
            let corners = neighbour.warped.corners[pixel];
            (index[p], weight[p]) = (corners.index * channels, Corners::weights(corners.fraction));
            let extras = &neighbour.warped.extras.as_slice()[pixel * EXTRAS..][..EXTRAS];
            for e in 0..EXTRAS {
                out[(channels + e) * SEGMENT + part + p] = extras[e];
            }
        }
        for first in (0..channels).step_by(16) {
            for p in 0..16 {
                let [upper, lower] = [index[p] + first, index[p] + columns * channels + first];
                let sum = l.mul(l.splat(weight[p][0]), l.load(features, upper));
                let sum = l.fma(l.splat(weight[p][1]), l.load(features, upper + channels), sum);
                let sum = l.fma(l.splat(weight[p][2]), l.load(features, lower), sum);
                block[p] = l.fma(l.splat(weight[p][3]), l.load(features, lower + channels), sum);
            }
            store_columns(l, block, first, part, out);
        }
    }
}

/// [features + EXTRAS][32] at quarter resolution: 2×2 means of [`gather`]. `scratch` takes four times the size of `out`.
#[inline(always)]
pub fn gather_quarter<L: Lanes>(
    l: L,
    neighbour: Neighbour,
    region: Rect,
    y: usize,
    x: usize,
    scratch: &mut [f32],
    out: &mut [f32],
) {
    let size = out.len();
    for (i, part) in scratch[..4 * size].chunks_exact_mut(size).enumerate() {
        gather(l, neighbour, region, 2 * y + i / 2, 2 * x + i % 2 * SEGMENT, part);
    }
    for (i, to) in out.iter_mut().enumerate() {
        let (c, p) = (i / SEGMENT, i % SEGMENT);
        let at = p / 16 * size + c * SEGMENT + 2 * (p % 16);
        *to = 0.25 * (scratch[at] + scratch[at + 1] + scratch[at + 2 * size] + scratch[at + 2 * size + 1]);
    }
}
