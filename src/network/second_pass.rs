//! The second pass over time: a frame's result averaged with those of the frames around it (`training/network/second_pass.py`).
//!
//! A band of rows at a time: what is warped stays in the cache until it is averaged.

use ndarray::Array3;
use rayon::prelude::*;

use super::levels::SEEN;
use super::motion::Motion;
use super::predictor::SECOND;
use super::warp::Corners;
use crate::simd::math::{exp, ln_1p};
use crate::simd::{Isa, LANES, Simd, dispatch};

/// Relative difference of two results that the logits measure in (`ALIKE` in `second_pass.py`).
const ALIKE: f32 = 0.1;
/// Light, after exposure, below which differences do not count (`EPSILON`).
const EPSILON: f32 = 0.01;
/// The least and the greatest log of a weight (`LOG_WEIGHTS`).
const LOG_WEIGHTS: (f32, f32) = (-20.0, 6.0);
/// Half-resolution rows of a band.
const BAND: usize = 16;

/// A frame after the first pass, of padded size.
#[derive(Clone, Copy)]
pub struct Own<'a> {
    /// (rows, columns, values), the colour first.
    pub image: &'a Array3<f32>,
    pub exposure: f32,
    /// [half-resolution row][neighbour][[`SEEN`]][column], as [`super::levels::Levels::full`] says.
    pub seen: &'a [f32],
    /// Neighbours in `seen`.
    pub count: usize,
}

/// A frame around it, after the first pass, of the same size and channels.
pub struct Near<'a> {
    pub image: &'a Array3<f32>,
    /// From the own frame to this one.
    pub motion: Motion<'a>,
    /// Whether nothing moves, so that pixels are copied instead of sampled.
    pub still: bool,
    /// Its place among the neighbours of [`Own::seen`].
    pub index: usize,
}

/// The weighted average of a frame's result and those around it, (rows, columns, values).
pub fn second_pass(isa: Isa, own: Own, near: &[Near]) -> Array3<f32> {
    let mut out = own.image.clone();
    let (_, columns, values) = out.dim();
    if let Some(out) = out.as_slice_mut() {
        let bands = out.par_chunks_mut((2 * BAND * columns * values).max(1)).enumerate();
        bands.for_each(|(index, out)| average_band(isa, own, near, index * BAND, out));
    }
    out
}

/// What one band is worked on in: rows of the band and one more on each side, where there is one.
struct Scratch {
    /// The first half-resolution row that is there, and the end.
    rows: (usize, usize),
    /// The own colours, exposed, (half row, half column, 3).
    own: Vec<f32>,
    /// The neighbour's pixels where the own ones lie in it, (row, column, value).
    warped: Vec<f32>,
    /// How unlike the two are at each half-resolution pixel.
    unlike: Vec<f32>,
    /// Sums of the weights, (row, column) of the band.
    totals: Vec<f32>,
}

#[inline(always)]
fn average_band_body<S: Simd>(s: S, own: Own, near: &[Near], first: usize, out: &mut [f32]) {
    let (rows, columns, values) = own.image.dim();
    let (half_rows, half_columns) = (rows / 2, columns / 2);
    let end = (first + BAND).min(half_rows);
    let there = (first.saturating_sub(1), (end + 1).min(half_rows));
    let count = there.1 - there.0;
    let mut scratch = Scratch {
        rows: there,
        own: vec![0.0; count * half_columns * 3],
        warped: vec![0.0; 2 * count * columns * values],
        unlike: vec![0.0; count * half_columns],
        totals: vec![1.0; 2 * (end - first) * columns],
    };
    let Some(image) = own.image.as_slice() else { return };
    halves(
        &image[2 * there.0 * columns * values..2 * there.1 * columns * values],
        columns,
        values,
        own.exposure,
        &mut scratch.own,
    );
    let mut weights = vec![0.0; half_columns.next_multiple_of(LANES)];
    let mut lines = [(); 2].map(|()| weights.clone());
    let mut any = false;
    for near in near {
        let row = |y: usize| &own.seen[(y * own.count + near.index) * SEEN * half_columns..][..SEEN * half_columns];
        let usable = |y: usize| &row(y)[SECOND * half_columns..];
        if !(first..end).any(|y| usable(y).iter().any(|bits| *bits > 0.0)) {
            continue;
        }
        any = true;
        match values {
            3 => warp_rows(near, 3, &mut scratch),
            4 => warp_rows(near, 4, &mut scratch),
            _ => warp_rows(near, values, &mut scratch),
        }
        differ(&mut scratch, (columns, values), own.exposure);
        for y in first..end {
            lines
                .iter_mut()
                .zip(row(y).chunks_exact(half_columns))
                .for_each(|(to, from)| to[..half_columns].copy_from_slice(from));
            around(&scratch, y, half_rows, &mut weights[..half_columns]);
            weigh(s, &lines, &mut weights);
            for dy in 0..2 {
                let at = 2 * (y - first) + dy;
                let warped = &scratch.warped[(2 * (y - there.0) + dy) * columns * values..][..columns * values];
                let sums =
                    (&mut out[at * columns * values..][..columns * values], &mut scratch.totals[at * columns..][..columns]);
                let by = (&weights[..half_columns], usable(y), dy);
                match values {
                    3 => add(warped, by, 3, sums),
                    4 => add(warped, by, 4, sums),
                    _ => add(warped, by, values, sums),
                }
            }
        }
    }
    if any {
        for (pixel, total) in out.chunks_exact_mut(values).zip(&scratch.totals) {
            pixel.iter_mut().for_each(|value| *value /= total);
        }
    }
}

/// Means over 2×2 pixels of the colours of whole rows, exposed: (half row, half column, 3).
#[inline(always)]
fn halves(image: &[f32], columns: usize, values: usize, exposure: f32, out: &mut [f32]) {
    let width = columns * values;
    for (rows, out) in image.chunks_exact(2 * width).zip(out.chunks_exact_mut(columns / 2 * 3)) {
        for (x, out) in out.chunks_exact_mut(3).enumerate() {
            let (upper, lower) = (&rows[2 * x * values..][..values + 3], &rows[width + 2 * x * values..][..values + 3]);
            for c in 0..3 {
                out[c] = (upper[c] + upper[values + c] + lower[c] + lower[values + c]) * (0.25 * exposure);
            }
        }
    }
}

/// Fetches a neighbour's pixels along the motion.
#[inline(always)]
fn warp_rows(near: &Near, values: usize, scratch: &mut Scratch) {
    let (rows, columns, _) = near.image.dim();
    let Some(image) = near.image.as_slice() else { return };
    let width = columns * values;
    for (i, out) in scratch.warped.chunks_exact_mut(width).enumerate() {
        let y = 2 * scratch.rows.0 + i;
        if near.still {
            out.copy_from_slice(&image[y * width..][..width]);
            continue;
        }
        for (x, out) in out.chunks_exact_mut(values).enumerate() {
            let (column, row) = near.motion.position(y, x);
            let corners = Corners::new(column, row, rows, columns);
            let weights = Corners::weights(corners.fraction);
            let upper = &image[corners.index * values..][..2 * values];
            let lower = &image[(corners.index + columns) * values..][..2 * values];
            for c in 0..values {
                out[c] = weights[0] * upper[c]
                    + weights[1] * upper[values + c]
                    + weights[2] * lower[c]
                    + weights[3] * lower[values + c];
            }
        }
    }
}

/// How unlike the warped pixels and the own ones are, 0…1, at half resolution.
#[inline(always)]
fn differ(scratch: &mut Scratch, (columns, values): (usize, usize), exposure: f32) {
    let mut line = vec![0.0; columns / 2 * 3];
    let rows = scratch.warped.chunks_exact(2 * columns * values);
    let each = rows.zip(scratch.own.chunks_exact(line.len())).zip(scratch.unlike.chunks_exact_mut(columns / 2));
    for ((warped, own), unlike) in each {
        halves(warped, columns, values, exposure, &mut line);
        for ((unlike, a), b) in unlike.iter_mut().zip(line.chunks_exact(3)).zip(own.chunks_exact(3)) {
            let part = |c: usize| (a[c] - b[c]).abs() / (a[c] + b[c] + EPSILON);
            *unlike = (part(0) + part(1) + part(2)) / 3.0;
        }
    }
}

/// Means over 3×3 half-resolution pixels of how unlike the two are, of one row; what is outside the frame is as its border.
#[inline(always)]
fn around(scratch: &Scratch, y: usize, half_rows: usize, out: &mut [f32]) {
    let columns = out.len();
    let row = |y: usize| &scratch.unlike[(y - scratch.rows.0) * columns..][..columns];
    let (above, here, below) = (row(y.saturating_sub(1)), row(y), row((y + 1).min(half_rows - 1)));
    let sum = |x: usize| above[x] + here[x] + below[x];
    let mut last = sum(0);
    let mut this = last;
    for (x, to) in out.iter_mut().enumerate() {
        let next = if x + 1 < columns { sum(x + 1) } else { this };
        *to = (last + this + next) / 9.0;
        (last, this) = (this, next);
    }
}

/// From how unlike the two are to the neighbour's weights, by the two logits.
#[inline(always)]
fn weigh<S: Simd>(s: S, logits: &[Vec<f32>; 2], weights: &mut [f32]) {
    let (low, high, zero) = (s.splat(LOG_WEIGHTS.0), s.splat(LOG_WEIGHTS.1), s.splat(0.0));
    for x in (0..weights.len()).step_by(LANES) {
        let slope = s.mul(s.load(&logits[1], x), s.splat(2.0));
        // ln(1 + eˣ) without overflow.
        let small = s.max(s.min(slope, s.sub(zero, slope)), s.splat(-80.0));
        let slope = s.add(s.max(slope, zero), ln_1p(s, exp(s, small)));
        let unlike = s.mul(s.load(weights, x), s.splat(1.0 / ALIKE));
        let fall = s.mul(s.mul(slope, s.splat(-0.5)), s.mul(unlike, unlike));
        let log = s.add(s.load(&logits[0], x), fall);
        s.store(exp(s, s.min(s.max(log, low), high)), weights, x);
    }
}

/// Adds a row of weighted pixels to the sums of pixels and of weights; `by` is the weights, the usable pixels as bits, and which of the
/// two rows of a half-resolution row it is.
#[inline(always)]
fn add(warped: &[f32], by: (&[f32], &[f32], usize), values: usize, (out, totals): (&mut [f32], &mut [f32])) {
    let (weights, usable, dy) = by;
    for (x, ((out, total), pixel)) in
        out.chunks_exact_mut(values).zip(totals.iter_mut()).zip(warped.chunks_exact(values)).enumerate()
    {
        let bit = 1 << (2 * dy + x % 2);
        let weight = if usable[x / 2] as u32 & bit > 0 { weights[x / 2] } else { 0.0 };
        *total += weight;
        for c in 0..values {
            out[c] += weight * pixel[c];
        }
    }
}

dispatch! {
    fn average_band(own: Own<'_>, near: &[Near<'_>], first: usize, out: &mut [f32]) = average_band_body
}
