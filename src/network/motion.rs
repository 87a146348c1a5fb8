//! Where a pixel of the centre frame lies in a neighbour: chained motion vectors (`training/data/geometry.py`).

use crate::frame::pixels::Pixels;

/// A way back that misses its start by this many pixels is as bad as any.
pub const AGREEMENT_LIMIT: f32 = 4.0;

/// Where a pixel of the centre frame lies in a neighbour.
#[derive(Clone, Copy)]
pub struct Place {
    pub column: f32,
    pub row: f32,
    /// Whether it is inside the neighbour, and was in every frame on the way.
    pub trusted: bool,
    /// By how many pixels the way back misses its start.
    pub miss: f32,
}

impl Place {
    /// Where nothing moves.
    #[inline(always)]
    pub fn of(y: usize, x: usize) -> Self {
        Self { column: x as f32, row: y as f32, trusted: true, miss: 0.0 }
    }
}

/// The vectors of the frames from the centre to a neighbour, one step of motion each, both ends included.
pub struct Motion<'a> {
    pub vectors: Vec<Option<&'a Pixels<4>>>,
    /// Whether the neighbour is later than the centre.
    pub later: bool,
    pub rows: usize,
    pub columns: usize,
}

impl Motion<'_> {
    /// One step from a position by the vectors of frame `k`, towards the neighbour (`out`) or home.
    #[inline(always)]
    fn advance(&self, k: usize, out: bool, column: f32, row: f32) -> (f32, f32) {
        let Some(vectors) = self.vectors[k] else { return (column, row) };
        let x = ((column + 0.5).floor().max(0.0) as usize).min(self.columns - 1);
        let y = ((row + 0.5).floor().max(0.0) as usize).min(self.rows - 1);
        let [vx, vy, vz, vw] = vectors[y * self.columns + x];
        if self.later == out { (column - vz, row + vw) } else { (column + vx, row - vy) }
    }

    /// The position of a pixel in the neighbour, and whether it is inside on the whole way.
    #[inline(always)]
    fn there(&self, y: usize, x: usize) -> (f32, f32, bool) {
        let (mut column, mut row, mut trusted) = (x as f32, y as f32, true);
        for k in 0..self.vectors.len() - 1 {
            (column, row) = self.advance(k, true, column, row);
            let across = column >= -0.5 && column <= self.columns as f32 - 0.5;
            trusted &= across && row >= -0.5 && row <= self.rows as f32 - 0.5;
        }
        (column, row, trusted)
    }

    /// Where a pixel lies, without the way back: (column, row), 0 for what is no number.
    #[inline(always)]
    pub fn position(&self, y: usize, x: usize) -> (f32, f32) {
        let (column, row, _) = self.there(y, x);
        (safe(column), safe(row))
    }

    /// Where a pixel lies, and how far that can be trusted.
    #[inline(always)]
    pub fn place(&self, y: usize, x: usize) -> Place {
        let (column, row, trusted) = self.there(y, x);
        let (mut home_column, mut home_row) = (column, row);
        for k in (1..self.vectors.len()).rev() {
            (home_column, home_row) = self.advance(k, false, home_column, home_row);
        }
        let (dx, dy) = ((home_column - x as f32).abs(), (home_row - y as f32).abs());
        let miss = if dx.is_nan() || dy.is_nan() { AGREEMENT_LIMIT } else { dx.max(dy).min(AGREEMENT_LIMIT) };
        Place { column: safe(column), row: safe(row), trusted, miss }
    }
}

#[inline(always)]
fn safe(value: f32) -> f32 {
    if value.is_nan() { 0.0 } else { value }
}
