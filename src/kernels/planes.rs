//! Images as planes of contiguous rows, so that a tap is one unaligned vector load.

use rayon::prelude::*;

use crate::memory::{Buffer, BufferPool};

/// Columns after the last that a load of a whole segment may touch.
const SLACK: usize = 32;

/// Planes of one size with a zero margin around them: `[row][plane][column]`, so that a row of all planes is one chunk.
pub struct Planes {
    data: Buffer,
    planes: usize,
    rows: usize,
    columns: usize,
    margin: usize,
    stride: usize,
}

impl Planes {
    /// Planes whose values are unspecified, with `margin` zero rows and columns around them that may be read, in memory from `pool`.
    pub fn new(planes: usize, rows: usize, columns: usize, margin: usize, pool: &BufferPool) -> Self {
        Self::filling(Buffer::in_pool(pool), planes, rows, columns, margin)
    }

    /// As [`Planes::new`], in memory from this one's pool.
    pub fn same_pool(&self, planes: usize, rows: usize, columns: usize, margin: usize) -> Self {
        Self::filling(self.data.same_pool(), planes, rows, columns, margin)
    }

    fn filling(mut data: Buffer, planes: usize, rows: usize, columns: usize, margin: usize) -> Self {
        let stride = columns.next_multiple_of(32) + 2 * margin + SLACK;
        data.reset(planes * (rows + 2 * margin) * stride);
        let chunk = planes * stride;
        data.as_mut_slice().par_chunks_mut(chunk.max(1)).enumerate().for_each(|(y, row)| {
            if y < margin || y >= margin + rows {
                return row.fill(0.0);
            }
            for plane in row.chunks_exact_mut(stride) {
                plane[..margin].fill(0.0);
                plane[margin + columns..].fill(0.0);
            }
        });
        Self { data, planes, rows, columns, margin, stride }
    }

    /// Rows without the margin.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Columns without the margin.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Planes.
    pub fn planes(&self) -> usize {
        self.planes
    }

    /// All values, to be indexed with [`Self::at`].
    pub fn data(&self) -> &[f32] {
        self.data.as_slice()
    }

    /// The index of column `x` of row `y` of a plane; margin positions are negative or beyond the size.
    #[inline(always)]
    pub fn at(&self, plane: usize, y: isize, x: isize) -> usize {
        let row = (y + self.margin as isize) as usize;
        (row * self.planes + plane) * self.stride + (x + self.margin as isize) as usize
    }

    /// Row `y` of a plane, without the margin.
    pub fn row(&self, plane: usize, y: usize) -> &[f32] {
        let at = self.at(plane, y as isize, 0);
        &self.data.as_slice()[at..at + self.columns]
    }

    /// The rows without the margin as disjoint mutable chunks.
    pub fn rows_mut(&mut self) -> impl IndexedParallelIterator<Item = RowMut<'_>> {
        let (chunk, margin, stride, columns) = (self.planes * self.stride, self.margin, self.stride, self.columns);
        let inner = &mut self.data.as_mut_slice()[margin * chunk..(margin + self.rows) * chunk];
        inner.par_chunks_mut(chunk).map(move |data| RowMut { data, margin, stride, columns })
    }
}

/// One row of all planes.
pub struct RowMut<'a> {
    data: &'a mut [f32],
    margin: usize,
    stride: usize,
    columns: usize,
}

impl RowMut<'_> {
    /// The row of one plane, without the margin.
    #[inline(always)]
    pub fn plane(&mut self, plane: usize) -> &mut [f32] {
        let at = plane * self.stride + self.margin;
        &mut self.data[at..at + self.columns]
    }
}
