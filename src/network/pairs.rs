//! What the network knows of a neighbour at a pixel: its features warped to the centre frame, and the extras.

use super::features::{Channels16, Features, Stored};
use super::warp::{Corners, EXTRAS, Warped};
use crate::plan::tiles::Rect;
use crate::simd::dense::SEGMENT;
use crate::simd::lanes::Lanes;

/// A neighbour in a region.
#[derive(Clone, Copy)]
pub struct Neighbour<'a> {
    /// The neighbour's features over its whole frame.
    pub features: &'a Features,
    pub warped: &'a Warped,
}

/// Copies 32 pixels of a row to [channel][32]; pixels past the row's end repeat its last. ReLU where asked.
#[inline(always)]
pub fn segment_of<L: Lanes, S: Channels16>(l: L, row: Row<S>, channels: usize, x: usize, relu: bool, out: &mut [f32]) {
    let low = l.splat(if relu { 0.0 } else { f32::NEG_INFINITY });
    let mut block = [low; 16];
    for part in (0..SEGMENT).step_by(16) {
        for first in (0..channels).step_by(16) {
            for (p, pixel) in block.iter_mut().enumerate() {
                let at = (x + part + p).min(row.columns - 1);
                *pixel = l.max(row.values.lanes(l, row.start + at * channels + first), low);
            }
            store_columns(l, block, first, part, out);
        }
    }
}

/// A row of an image of many channels: `columns` pixels from `values[start]` on.
#[derive(Clone, Copy)]
pub struct Row<S> {
    pub values: S,
    pub start: usize,
    pub columns: usize,
}

/// [`segment_of`] a row of a frame's features, without ReLU: columns `x`… of the region, row `y`.
#[inline(always)]
pub fn features_of<L: Lanes>(l: L, features: &Features, region: Rect, y: usize, x: usize, out: &mut [f32]) {
    let (_, columns, channels) = features.shape();
    let start = ((region.row + y) * columns + region.column) * channels;
    match features.stored() {
        Stored::Full(values) => segment_of(l, Row { values, start, columns: region.columns }, channels, x, false, out),
        Stored::Compact(values) => segment_of(l, Row { values, start, columns: region.columns }, channels, x, false, out),
    }
}

/// Writes sixteen pixels of sixteen channels to channels `first`… and pixels `part`… of [channel][32].
#[inline(always)]
fn store_columns<L: Lanes>(l: L, pixels: [L::V; 16], first: usize, part: usize, out: &mut [f32]) {
    for (c, column) in l.transpose(pixels).into_iter().enumerate() {
        l.store(column, out, (first + c) * SEGMENT + part);
    }
}

/// [features + EXTRAS][32] of the neighbour at the region's half-resolution row `y`, columns `x`….
#[inline(always)]
pub fn gather<L: Lanes>(l: L, neighbour: Neighbour, region: Rect, y: usize, x: usize, out: &mut [f32]) {
    if neighbour.warped.still {
        features_of(l, neighbour.features, region, y, x, out);
        return extras_of(neighbour, region, y, x, out);
    }
    match neighbour.features.stored() {
        Stored::Full(values) => gather_from(l, values, neighbour, region, y, x, out),
        Stored::Compact(values) => gather_from(l, values, neighbour, region, y, x, out),
    }
}

/// The extras of a segment, after the features.
#[inline(always)]
fn extras_of(neighbour: Neighbour, region: Rect, y: usize, x: usize, out: &mut [f32]) {
    let first = neighbour.features.shape().2 * SEGMENT;
    for p in 0..SEGMENT {
        let pixel = y * region.columns + (x + p).min(region.columns - 1);
        let extras = &neighbour.warped.extras.as_slice()[pixel * EXTRAS..][..EXTRAS];
        for e in 0..EXTRAS {
            out[first + e * SEGMENT + p] = extras[e];
        }
    }
}

#[inline(always)]
fn gather_from<L: Lanes, S: Channels16>(
    l: L,
    features: S,
    neighbour: Neighbour,
    region: Rect,
    y: usize,
    x: usize,
    out: &mut [f32],
) {
    let (_, columns, channels) = neighbour.features.shape();
    let mut block = [l.splat(0.0); 16];
    let mut index = [0; 16];
    let mut weight = [[0.0; 4]; 16];
    for part in (0..SEGMENT).step_by(16) {
        for p in 0..16 {
            let pixel = y * region.columns + (x + part + p).min(region.columns - 1);
            let corners = neighbour.warped.corners[pixel];
            (index[p], weight[p]) = (corners.index * channels, Corners::weights(corners.fraction));
        }
        for first in (0..channels).step_by(16) {
            for p in 0..16 {
                let [upper, lower] = [index[p] + first, index[p] + columns * channels + first];
                let sum = l.mul(l.splat(weight[p][0]), features.lanes(l, upper));
                let sum = l.fma(l.splat(weight[p][1]), features.lanes(l, upper + channels), sum);
                let sum = l.fma(l.splat(weight[p][2]), features.lanes(l, lower), sum);
                block[p] = l.fma(l.splat(weight[p][3]), features.lanes(l, lower + channels), sum);
            }
            store_columns(l, block, first, part, out);
        }
    }
    extras_of(neighbour, region, y, x, out);
}

/// [features + EXTRAS][32] at row `y`, columns `x`… of half, quarter or eighth resolution: [`gather`], halved 0 to 2 times by 2×2
/// means. `scratch` takes four times the size of `out` for each halving.
#[inline(always)]
pub fn gather_at<L: Lanes>(
    l: L,
    halvings: usize,
    neighbour: Neighbour,
    region: Rect,
    (y, x): (usize, usize),
    scratch: &mut [f32],
    out: &mut [f32],
) {
    match halvings {
        0 => gather(l, neighbour, region, y, x, out),
        1 => gather_quarter(l, neighbour, region, y, x, scratch, out),
        _ => {
            let size = out.len();
            let (parts, inner) = scratch.split_at_mut(4 * size);
            for (i, part) in parts.chunks_exact_mut(size).enumerate() {
                gather_quarter(l, neighbour, region, 2 * y + i / 2, 2 * x + i % 2 * SEGMENT, inner, part);
            }
            halve(parts, out);
        }
    }
}

/// [features + EXTRAS][32] at quarter resolution: 2×2 means of [`gather`].
#[inline(always)]
fn gather_quarter<L: Lanes>(l: L, neighbour: Neighbour, region: Rect, y: usize, x: usize, scratch: &mut [f32], out: &mut [f32]) {
    let size = out.len();
    for (i, part) in scratch[..4 * size].chunks_exact_mut(size).enumerate() {
        gather(l, neighbour, region, 2 * y + i / 2, 2 * x + i % 2 * SEGMENT, part);
    }
    halve(scratch, out);
}

/// 2×2 means of four segments, two above and two below: each as large as `out`.
#[inline(always)]
fn halve(parts: &[f32], out: &mut [f32]) {
    let size = out.len();
    for (i, to) in out.iter_mut().enumerate() {
        let (c, p) = (i / SEGMENT, i % SEGMENT);
        let at = p / 16 * size + c * SEGMENT + 2 * (p % 16);
        *to = 0.25 * (parts[at] + parts[at + 1] + parts[at + 2 * size] + parts[at + 2 * size + 1]);
    }
}
