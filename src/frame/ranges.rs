//! The least and greatest value of every channel in each block of a frame: what the plan looks at to leave pixels out.

use rayon::prelude::*;

use super::packed::{COLOUR, INVALID, MODULATION, PackedFrame};

/// Pixels a block is wide and high; at the frame's right and lower edge blocks may be smaller.
pub const BLOCK: usize = 16;
/// Channels of group 0 that pixels of the result depend on: demodulated colour, modulation.
const BASE: usize = 6;

/// Least and greatest values; empty where the least is above the greatest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    pub low: f32,
    pub high: f32,
}

impl Range {
    /// Of no values.
    pub const EMPTY: Self = Self { low: f32::INFINITY, high: f32::NEG_INFINITY };
    /// Of a block that must not be left out.
    pub const ANY: Self = Self { low: f32::NEG_INFINITY, high: f32::INFINITY };

    /// Widened to hold another range.
    pub fn join(&mut self, other: Self) {
        self.low = self.low.min(other.low);
        self.high = self.high.max(other.high);
    }

    /// Widened to hold a value; NaN changes nothing.
    fn take(&mut self, value: f32) {
        self.low = self.low.min(value);
        self.high = self.high.max(value);
    }
}

/// The blocks of one frame, over its padded size.
pub struct Ranges {
    /// Blocks down and across.
    pub rows: usize,
    pub columns: usize,
    /// Ranges a block: colour 3, modulation 3, extra channels.
    pub channels: usize,
    /// Row-major, the channels of a block together.
    values: Vec<Range>,
    /// Of X, Y, Z, W in each block.
    vectors: Option<Vec<[Range; 4]>>,
    /// Whether every motion vector is zero; true without a Vector pass.
    pub still: bool,
    /// Whether alpha is 1 everywhere; true without alpha.
    pub opaque: bool,
}

impl Ranges {
    /// Looks at every pixel of a frame once. A block with a pixel that was not finite has [`Range::ANY`].
    pub fn new(frame: &PackedFrame) -> Self {
        let (rows, columns) = (frame.padded_rows.div_ceil(BLOCK), frame.padded_columns.div_ceil(BLOCK));
        let channels = BASE + frame.extra;
        let mut values = vec![Range::EMPTY; rows * columns * channels];
        values.par_chunks_mut(columns * channels).enumerate().for_each(|(by, out)| {
            for y in by * BLOCK..((by + 1) * BLOCK).min(frame.padded_rows) {
                take_row(frame, y, channels, out);
            }
        });
        let vectors = frame.vectors.as_ref().map(|pixels| {
            let mut blocks = vec![[Range::EMPTY; 4]; rows * columns];
            blocks.par_chunks_mut(columns).enumerate().for_each(|(by, out)| {
                for y in by * BLOCK..((by + 1) * BLOCK).min(frame.padded_rows) {
                    let row = &pixels[y * frame.padded_columns..][..frame.padded_columns];
                    for (block, pixels) in out.iter_mut().zip(row.chunks(BLOCK)) {
                        for pixel in pixels {
                            block.iter_mut().zip(pixel).for_each(|(range, v)| range.take(*v));
                        }
                    }
                }
            });
            blocks
        });
        let still = frame.vectors.as_ref().is_none_or(|v| v.par_iter().all(|v| *v == [0.0; 4]));
        // Not by the ranges: a bad colour says nothing about alpha. One that is itself bad is 0 here.
        let opaque = !frame.has_alpha || frame.groups[1].par_iter().all(|extra| extra[0] == 1.0);
        Self { rows, columns, channels, values, vectors, still, opaque }
    }

    /// The ranges of a block's channels.
    pub fn block(&self, row: usize, column: usize) -> &[Range] {
        &self.values[(row * self.columns + column) * self.channels..][..self.channels]
    }

    /// The ranges of a block's motion vectors; without a Vector pass none.
    pub fn vectors(&self, row: usize, column: usize) -> Option<[Range; 4]> {
        self.vectors.as_ref().map(|v| v[row * self.columns + column])
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.values.len() * size_of::<Range>() + self.vectors.as_ref().map_or(0, |v| v.len() * size_of::<[Range; 4]>())
    }
}

/// Widens the blocks of a block row by one row of pixels.
fn take_row(frame: &PackedFrame, y: usize, channels: usize, out: &mut [Range]) {
    let start = y * frame.padded_columns;
    let first = &frame.groups[0][start..][..frame.padded_columns];
    for (bx, pixels) in first.chunks(BLOCK).enumerate() {
        let block = &mut out[bx * channels..][..channels];
        let (mut low, mut high) = ([f32::INFINITY; 8], [f32::NEG_INFINITY; 8]);
        for (i, pixel) in pixels.iter().enumerate() {
            if pixel[INVALID] != 0.0 && y < frame.rows && bx * BLOCK + i < frame.columns {
                block.fill(Range::ANY);
            }
            for lane in 0..8 {
                low[lane] = low[lane].min(pixel[lane]);
                high[lane] = high[lane].max(pixel[lane]);
            }
        }
        for c in 0..3 {
            block[c].join(Range { low: low[COLOUR + c], high: high[COLOUR + c] });
            block[3 + c].join(Range { low: low[MODULATION + c], high: high[MODULATION + c] });
        }
        for (group, ranges) in frame.groups[1..].iter().zip(block[BASE..].chunks_mut(8)) {
            for pixel in &group[start + bx * BLOCK..][..pixels.len()] {
                ranges.iter_mut().zip(pixel).for_each(|(range, v)| range.take(*v));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use ndarray::{Array2, Array3};

    use super::*;
    use crate::frame::Frame;

    fn ranges(change: impl Fn(&mut Frame)) -> Ranges {
        let mut frame = Frame::new(Array3::from_elem((20, 37, 3), 0.5));
        frame.alpha = Some(Array2::from_elem((20, 37), 1.0));
        change(&mut frame);
        Ranges::new(&PackedFrame::new(&frame.view(), 0.05, &crate::memory::BufferPool::default()).unwrap())
    }

    #[test]
    fn blocks_know_their_values_and_the_padding_adds_none() {
        let r = ranges(|f| {
            f.colour[[17, 33, 1]] = 0.75;
            f.alpha.as_mut().unwrap()[[0, 20]] = 0.25;
        });
        assert_eq!((r.rows, r.columns, r.channels), (2, 3, 7));
        assert_eq!(r.block(1, 2)[1], Range { low: 0.5, high: 0.75 });
        assert_eq!(r.block(0, 2)[1], Range { low: 0.5, high: 0.5 });
        assert_eq!((r.block(0, 1)[6], r.block(0, 0)[6]), (Range { low: 0.25, high: 1.0 }, Range { low: 1.0, high: 1.0 }));
        assert!(r.vectors(0, 0).is_none() && r.still && !r.opaque);
        assert!(ranges(|_| {}).opaque && ranges(|f| f.alpha = None).opaque);
    }

    #[test]
    fn a_pixel_that_is_not_finite_may_be_anything() {
        let r = ranges(|f| f.colour[[3, 3, 0]] = f32::NAN);
        assert_eq!(r.block(0, 0)[2], Range::ANY);
        assert_eq!(r.block(0, 1)[2], Range { low: 0.5, high: 0.5 });
    }

    #[test]
    fn vectors_that_are_not_numbers_count_for_nothing() {
        let r = ranges(|f| {
            let mut v = Array3::zeros((20, 37, 4));
            v[[1, 1, 0]] = f32::NAN;
            v[[1, 2, 0]] = -3.0;
            f.vector = Some(v);
        });
        assert_eq!(r.vectors(0, 0).unwrap()[0], Range { low: -3.0, high: 0.0 });
        assert_eq!(r.vectors(1, 1).unwrap()[3], Range { low: 0.0, high: 0.0 });
        assert!(!r.still && ranges(|f| f.vector = Some(Array3::zeros((20, 37, 4)))).still);
    }
}
