//! What flows between layers: an image of many channels.

use ndarray::ArrayView3;

use crate::memory::{Buffer, BufferPool};

/// Pixels after the last that the inner loops may read: the widest register tile, and a multiple of the others.
pub(super) const SPARE_PIXELS: usize = 24;

/// f32 values \[row\]\[column\]\[channel\], contiguous, on a 64-byte boundary.
#[derive(Clone)]
pub struct Activation {
    rows: usize,
    columns: usize,
    channels: usize,
    /// The pixels, then room for SPARE_PIXELS more, which the inner loops may read.
    data: Buffer,
}

impl Activation {
    /// All zero, in memory of its own.
    pub fn new(rows: usize, columns: usize, channels: usize) -> Self {
        Self { rows, columns, channels, data: Buffer::zeroed(Self::size(rows, columns, channels)) }
    }

    /// No pixels yet, for `reset` to change; in memory of its own.
    pub fn empty() -> Self {
        Self { rows: 0, columns: 0, channels: 0, data: Buffer::empty() }
    }

    /// As [`Activation::empty`], in memory from `pool`.
    pub fn in_pool(pool: &BufferPool) -> Self {
        Self { rows: 0, columns: 0, channels: 0, data: Buffer::in_pool(pool) }
    }

    /// As [`Activation::empty`], in memory from this one's pool.
    pub fn same_pool(&self) -> Self {
        Self { rows: 0, columns: 0, channels: 0, data: self.data.same_pool() }
    }

    /// Takes a new shape and reuses the memory, which only grows. What the values are afterwards is unspecified.
    pub fn reset(&mut self, rows: usize, columns: usize, channels: usize) {
        self.data.reset(Self::size(rows, columns, channels));
        (self.rows, self.columns, self.channels) = (rows, columns, channels);
    }

    /// Rows of pixels.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Columns of pixels.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Channels of a pixel.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// (rows, columns, channels).
    pub fn shape(&self) -> (usize, usize, usize) {
        (self.rows, self.columns, self.channels)
    }

    /// Row `r`: columns × channels values. Panics where there is no such row.
    pub fn row(&self, r: usize) -> &[f32] {
        let width = self.columns * self.channels;
        &self.as_slice()[r * width..][..width]
    }

    /// Row `r` for writing.
    pub fn row_mut(&mut self, r: usize) -> &mut [f32] {
        let width = self.columns * self.channels;
        &mut self.as_mut_slice()[r * width..][..width]
    }

    /// All values.
    pub fn as_slice(&self) -> &[f32] {
        &self.data.as_slice()[..self.rows * self.columns * self.channels]
    }

    /// All values for writing.
    pub fn as_mut_slice(&mut self) -> &mut [f32] {
        let len = self.rows * self.columns * self.channels;
        &mut self.data.as_mut_slice()[..len]
    }

    /// As an array (rows, columns, channels).
    pub fn view(&self) -> ArrayView3<'_, f32> {
        ArrayView3::from_shape(self.shape(), self.as_slice()).expect("the buffer is as long as the shape says")
    }

    /// Everything from a pixel on, SPARE_PIXELS unspecified pixels after the last included.
    pub(super) fn pixels_from(&self, row: usize, column: usize) -> &[f32] {
        &self.data.as_slice()[(row * self.columns + column) * self.channels..]
    }

    /// Floats that an image takes with the spare pixels.
    fn size(rows: usize, columns: usize, channels: usize) -> usize {
        let pixels = rows.checked_mul(columns).and_then(|n| n.checked_add(SPARE_PIXELS));
        pixels.and_then(|n| n.checked_mul(channels)).expect("an image of more values than can be counted")
    }
}

impl std::fmt::Debug for Activation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Activation {}×{}×{}", self.rows, self.columns, self.channels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_and_views_agree() {
        let mut a = Activation::new(2, 3, 4);
        assert!(a.as_slice().iter().all(|v| *v == 0.0));
        a.row_mut(1)[2 * 4 + 3] = 7.0;
        assert_eq!(a.view()[[1, 2, 3]], 7.0);
        assert_eq!(a.clone().row(1)[11], 7.0);
        assert_eq!(a.as_slice().as_ptr() as usize % 64, 0);
    }

    #[test]
    fn reset_keeps_memory_and_grows() {
        let mut a = Activation::new(4, 4, 4);
        let start = a.as_slice().as_ptr();
        a.reset(2, 2, 3);
        assert_eq!((a.shape(), a.as_slice().len(), a.as_slice().as_ptr()), ((2, 2, 3), 12, start));
        a.reset(8, 8, 8);
        assert_eq!(a.as_slice().len(), 512);
        a.reset(0, 8, 8);
        assert!(a.as_slice().is_empty());
    }
}
