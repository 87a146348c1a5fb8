//! Images as planes of contiguous rows, so that a tap is one unaligned vector load.

/// Columns after the last that a load of a whole segment may touch.
const SLACK: usize = 32;

/// Planes of one size with a zero margin around them: `[row][plane][column]`, so that a row of all planes is one chunk.
#[derive(Default)]
pub struct Planes {
    data: Vec<f32>,
    planes: usize,
    rows: usize,
    columns: usize,
    margin: usize,
    stride: usize,
}

impl Planes {
    /// Zeroed planes; `margin` rows and columns may be read around them.
    pub fn new(planes: usize, rows: usize, columns: usize, margin: usize) -> Self {
        let stride = columns.next_multiple_of(32) + 2 * margin + SLACK;
        Self { data: vec![0.0; planes * (rows + 2 * margin) * stride], planes, rows, columns, margin, stride }
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
        &self.data
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
        &self.data[at..at + self.columns]
    }

    /// The rows without the margin as disjoint mutable chunks.
    pub fn rows_mut(&mut self) -> impl rayon::iter::IndexedParallelIterator<Item = RowMut<'_>> {
        use rayon::prelude::*;
        let (chunk, margin, stride, columns) = (self.planes * self.stride, self.margin, self.stride, self.columns);
        let inner = &mut self.data[margin * chunk..(margin + self.rows) * chunk];
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

    /// The row of one plane with room for a whole last segment.
    #[inline(always)]
    pub fn plane_with_slack(&mut self, plane: usize) -> &mut [f32] {
        let at = plane * self.stride + self.margin;
        &mut self.data[at..(plane + 1) * self.stride]
    }
}
