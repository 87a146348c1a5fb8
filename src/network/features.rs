//! A frame's features as they wait in the window.

use half::f16;
use half::slice::HalfFloatSliceExt;

use crate::layers::Activation;
use crate::memory::BufferPool;

/// Half-resolution pixels from which on features are kept as half floats: frames of more than about four megapixels.
const COMPACT_FROM: usize = 1 << 20;

/// Features of a whole frame, [row][column][channel] at half resolution.
///
/// Those of very large frames are rounded to half floats (at most 2⁻¹¹ of each value), so that a 4K window fits into 4 GB. That
/// depends on the frame's size alone, so the same frame gives the same bits everywhere.
pub struct Features {
    rows: usize,
    columns: usize,
    channels: usize,
    values: Values,
}

enum Values {
    Full(Activation),
    Compact(Vec<f16>),
}

/// The values in the kind of storage that they are in.
#[derive(Clone, Copy)]
pub enum Stored<'a> {
    Full(&'a [f32]),
    Compact(&'a [f16]),
}

impl Features {
    /// Room for features of `rows` × `columns` half-resolution pixels, to be filled with [`Self::put`]; in memory from `pool`.
    pub fn new(rows: usize, columns: usize, channels: usize, pool: &BufferPool) -> Self {
        let values = if rows * columns > COMPACT_FROM {
            Values::Compact(vec![f16::ZERO; rows * columns * channels])
        } else {
            let mut full = Activation::in_pool(pool);
            full.reset(rows, columns, channels);
            Values::Full(full)
        };
        Self { rows, columns, channels, values }
    }

    /// Copies the rows `from`… of `strip`, `count` of them, to the rows `to`….
    pub fn put(&mut self, strip: &Activation, from: usize, count: usize, to: usize) {
        let width = self.columns * self.channels;
        let from = &strip.as_slice()[from * width..(from + count) * width];
        match &mut self.values {
            Values::Full(full) => full.as_mut_slice()[to * width..(to + count) * width].copy_from_slice(from),
            Values::Compact(half) => half[to * width..(to + count) * width].convert_from_f32_slice(from),
        }
    }

    /// (rows, columns, channels).
    pub fn shape(&self) -> (usize, usize, usize) {
        (self.rows, self.columns, self.channels)
    }

    /// All values.
    #[inline(always)]
    pub fn stored(&self) -> Stored<'_> {
        match &self.values {
            Values::Full(full) => Stored::Full(full.as_slice()),
            Values::Compact(half) => Stored::Compact(half),
        }
    }

    /// Bytes that they take.
    pub fn bytes(&self) -> usize {
        let each = if matches!(self.values, Values::Full(_)) { 4 } else { 2 };
        self.rows * self.columns * self.channels * each
    }
}
