//! Lays a tile of the input out for the inner loops: padded with zeros, ReLU applied, inputs joined channel by channel.

use super::activation::Activation;
use crate::memory::Buffer;
use crate::simd::{LANES, Simd};

/// One of the inputs whose channels are joined.
#[derive(Clone, Copy, Debug)]
pub struct Source<'a> {
    /// The image.
    pub activation: &'a Activation,
    /// Read at half the resolution: pixel (r, c) is the activation's (r / 2, c / 2).
    pub upsample: bool,
}

impl<'a> Source<'a> {
    /// At its own resolution.
    pub fn new(activation: &'a Activation) -> Self {
        Self { activation, upsample: false }
    }

    /// At twice its resolution, each pixel repeated.
    pub fn upsampled(activation: &'a Activation) -> Self {
        Self { activation, upsample: true }
    }

    /// (rows, columns) as it is read.
    pub(super) fn size(&self) -> (usize, usize) {
        let scale = 1 + usize::from(self.upsample);
        (self.activation.rows() * scale, self.activation.columns() * scale)
    }
}

/// A rectangle of input pixels, whose corner may lie outside the image.
#[derive(Clone, Copy)]
pub(super) struct Window {
    pub row: isize,
    pub column: isize,
    pub rows: usize,
    pub columns: usize,
}

/// Writes `window` of the joined `sources` to `packed`: [row][column][channel] without gaps, then room for `spare` pixels.
#[inline(always)]
pub(super) fn pack<S: Simd>(s: S, sources: &[Source], relu: bool, window: Window, packed: &mut Buffer, spare: usize) {
    let Some(first) = sources.first() else { return };
    let channels: usize = sources.iter().map(|source| source.activation.channels()).sum();
    packed.reset((window.rows * window.columns + spare) * channels);
    let (rows, columns) = first.size();
    // The part of the window's columns that lies inside the image.
    let inside = |at: isize| at.clamp(0, columns as isize);
    let from = inside(window.column);
    let to = inside(window.column + window.columns as isize).max(from);
    let before = (from - window.column).min(window.columns as isize) as usize * channels;
    let (from, to) = (from as usize, to as usize);
    for (r, line) in packed.as_mut_slice().chunks_exact_mut((window.columns * channels).max(1)).take(window.rows).enumerate() {
        let row = window.row + r as isize;
        if row < 0 || row >= rows as isize {
            line.fill(0.0);
            continue;
        }
        let end = before + (to - from) * channels;
        line[..before].fill(0.0);
        line[end..].fill(0.0);
        let line = &mut line[before..end];
        match sources {
            [Source { activation, upsample: false }] => {
                copy(s, &activation.row(row as usize)[from * channels..to * channels], line, relu);
            }
            _ => join(s, sources, row as usize, from, relu, line, channels),
        }
    }
}

/// One row of several inputs, pixel by pixel from column `from` on.
#[inline(always)]
fn join<S: Simd>(s: S, sources: &[Source], row: usize, from: usize, relu: bool, line: &mut [f32], channels: usize) {
    let mut offset = 0;
    for source in sources {
        let shift = usize::from(source.upsample);
        let width = source.activation.channels();
        let input = source.activation.row(row >> shift);
        for (x, pixel) in line.chunks_exact_mut(channels).enumerate() {
            copy(s, &input[((from + x) >> shift) * width..][..width], &mut pixel[offset..offset + width], relu);
        }
        offset += width;
    }
}

#[inline(always)]
fn copy<S: Simd>(s: S, from: &[f32], to: &mut [f32], relu: bool) {
    if !relu {
        return to.copy_from_slice(from);
    }
    let (whole, rest) = from.as_chunks::<LANES>();
    let (whole_out, rest_out) = to.as_chunks_mut::<LANES>();
    for (input, output) in whole.iter().zip(whole_out) {
        s.store(s.relu(s.load(input, 0)), output, 0);
    }
    for (input, output) in rest.iter().zip(rest_out) {
        *output = if *input > 0.0 { *input } else { 0.0 };
    }
}
