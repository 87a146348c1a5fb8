//! What the network knows of a neighbour at a pixel: its features warped to the centre frame, and the extras.

use super::features::{Features, Stored};
use super::gathered::Gathered;
use super::warp::{Corners, EXTRAS, Warped};
use crate::layers::SEGMENT;
use crate::simd::{Element, Simd};
use crate::tiles::Rect;

/// A neighbour in a region.
#[derive(Clone, Copy)]
pub struct Neighbour<'a> {
    /// The neighbour's features over its whole frame.
    pub features: &'a Features,
    pub warped: &'a Warped,
}

/// The neighbours as the kernel predictor of a resolution finds them.
#[derive(Clone, Copy)]
pub enum Pairs<'a> {
    /// At half resolution in a region: gathered as they are needed.
    Half(&'a [Neighbour<'a>], Rect),
    /// At a coarser one.
    Coarser(&'a Gathered),
}

impl Pairs<'_> {
    pub fn len(&self) -> usize {
        match self {
            Self::Half(neighbours, _) => neighbours.len(),
            Self::Coarser(gathered) => gathered.neighbours(),
        }
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Copies 32 pixels of a row to [channel][32]; pixels past the row's end repeat its last. ReLU where asked.
#[inline(always)]
pub fn segment_of<S: Simd, E: Element>(s: S, row: Row<E>, channels: usize, x: usize, relu: bool, out: &mut [f32]) {
    let low = s.splat(if relu { 0.0 } else { f32::NEG_INFINITY });
    let mut block = [low; 16];
    for part in (0..SEGMENT).step_by(16) {
        for first in (0..channels).step_by(16) {
            for (p, pixel) in block.iter_mut().enumerate() {
                let at = (x + part + p).min(row.columns - 1);
                *pixel = s.max(E::load(s, row.values, row.start + at * channels + first), low);
            }
            store_columns(s, block, first, part, out);
        }
    }
}

/// A row of an image of many channels: `columns` pixels from `values[start]` on.
#[derive(Clone, Copy)]
pub struct Row<'a, E> {
    pub values: &'a [E],
    pub start: usize,
    pub columns: usize,
}

/// [`segment_of`] a row of a frame's features, without ReLU: columns `x`… of the region, row `y`.
#[inline(always)]
pub fn features_of<S: Simd>(s: S, features: &Features, region: Rect, y: usize, x: usize, out: &mut [f32]) {
    let (_, columns, channels) = features.shape();
    let start = ((region.row + y) * columns + region.column) * channels;
    match features.stored() {
        Stored::Full(values) => segment_of(s, Row { values, start, columns: region.columns }, channels, x, false, out),
        Stored::Compact(values) => segment_of(s, Row { values, start, columns: region.columns }, channels, x, false, out),
    }
}

/// Writes sixteen pixels of sixteen channels to channels `first`… and pixels `part`… of [channel][32].
#[inline(always)]
fn store_columns<S: Simd>(s: S, pixels: [S::V; 16], first: usize, part: usize, out: &mut [f32]) {
    for (c, column) in s.transpose(pixels).into_iter().enumerate() {
        s.store(column, out, (first + c) * SEGMENT + part);
    }
}

/// [features + EXTRAS][32] of the neighbour at the region's half-resolution row `y`, columns `x`….
#[inline(always)]
pub fn gather<S: Simd>(s: S, neighbour: Neighbour, region: Rect, y: usize, x: usize, out: &mut [f32]) {
    if neighbour.warped.still {
        features_of(s, neighbour.features, region, y, x, out);
        return extras_of(neighbour, region, y, x, out);
    }
    match neighbour.features.stored() {
        Stored::Full(values) => gather_from(s, values, neighbour, region, y, x, out),
        Stored::Compact(values) => gather_from(s, values, neighbour, region, y, x, out),
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
fn gather_from<S: Simd, E: Element>(
    s: S,
    features: &[E],
    neighbour: Neighbour,
    region: Rect,
    y: usize,
    x: usize,
    out: &mut [f32],
) {
    let (_, columns, channels) = neighbour.features.shape();
    let mut block = [s.splat(0.0); 16];
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
                let sum = s.mul(s.splat(weight[p][0]), E::load(s, features, upper));
                let sum = s.fma(s.splat(weight[p][1]), E::load(s, features, upper + channels), sum);
                let sum = s.fma(s.splat(weight[p][2]), E::load(s, features, lower), sum);
                block[p] = s.fma(s.splat(weight[p][3]), E::load(s, features, lower + channels), sum);
            }
            store_columns(s, block, first, part, out);
        }
    }
    extras_of(neighbour, region, y, x, out);
}
