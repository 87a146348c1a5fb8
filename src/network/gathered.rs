//! The neighbours' features and extras at quarter and eighth resolution, made once: the temporal extractor has them at hand.

use rayon::prelude::*;

use super::warp::EXTRAS;
use crate::layers::SEGMENT;
use crate::memory::{Buffer, BufferPool};

/// [row][segment of 32 columns][neighbour][feature or extra][32] at one resolution. Pixels past a row's end mean nothing.
pub struct Gathered {
    values: Buffer,
    rows: usize,
    columns: usize,
    neighbours: usize,
    /// Floats of one neighbour's segment.
    size: usize,
}

impl Gathered {
    /// Unspecified values for `neighbours` with so many features, in memory from `pool`.
    pub fn new(rows: usize, columns: usize, neighbours: usize, features: usize, pool: &BufferPool) -> Self {
        Self::filling(Buffer::in_pool(pool), (rows, columns), neighbours, (features + EXTRAS) * SEGMENT)
    }

    fn filling(mut values: Buffer, (rows, columns): (usize, usize), neighbours: usize, size: usize) -> Self {
        values.reset(rows * columns.div_ceil(SEGMENT) * neighbours * size);
        Self { values, rows, columns, neighbours, size }
    }

    /// Neighbours that are there.
    pub fn neighbours(&self) -> usize {
        self.neighbours
    }

    /// A neighbour's values, [feature or extra][32], in row `y`, columns `x`…, a multiple of 32.
    #[inline(always)]
    pub fn segment(&self, y: usize, x: usize, neighbour: usize) -> &[f32] {
        let at = (y * self.columns.div_ceil(SEGMENT) + x / SEGMENT) * self.neighbours + neighbour;
        &self.values.as_slice()[at * self.size..][..self.size]
    }

    /// The rows, each [segment][neighbour][feature or extra][32].
    pub fn rows_mut(&mut self) -> impl IndexedParallelIterator<Item = &mut [f32]> {
        let row = self.columns.div_ceil(SEGMENT) * self.neighbours * self.size;
        self.values.as_mut_slice().par_chunks_mut(row.max(1))
    }

    /// 2×2 means: half the resolution.
    pub fn halved(&self) -> Self {
        let (rows, columns) = (self.rows / 2, self.columns / 2);
        let mut out = Self::filling(self.values.same_pool(), (rows, columns), self.neighbours, self.size);
        out.rows_mut().enumerate().for_each(|(y, row)| {
            for x in (0..self.columns).step_by(SEGMENT) {
                for n in 0..self.neighbours {
                    let to = &mut row[(x / 2 / SEGMENT * self.neighbours + n) * self.size..][..self.size];
                    halve([self.segment(2 * y, x, n), self.segment(2 * y + 1, x, n)], x / SEGMENT % 2, to);
                }
            }
        });
        out
    }
}

/// 2×2 means of a segment of two rows: the first (`part` 0) or last sixteen pixels of `to`.
#[inline(always)]
pub fn halve(rows: [&[f32]; 2], part: usize, to: &mut [f32]) {
    let channels = rows[0].chunks_exact(SEGMENT).zip(rows[1].chunks_exact(SEGMENT));
    for (to, (upper, lower)) in to.chunks_exact_mut(SEGMENT).zip(channels) {
        for (p, to) in to[part * SEGMENT / 2..][..SEGMENT / 2].iter_mut().enumerate() {
            *to = 0.25 * (upper[2 * p] + upper[2 * p + 1] + lower[2 * p] + lower[2 * p + 1]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halving_averages_two_by_two_across_segments() {
        let (rows, columns, features) = (4, 72, 1);
        let mut fine = Gathered::new(rows, columns, 2, features, &BufferPool::default());
        let value = |y: usize, x: usize, n: usize, c: usize| (1000 * n + 100 * c + 10 * y + x) as f32;
        fine.rows_mut().enumerate().for_each(|(y, row)| {
            for (i, v) in row.iter_mut().enumerate() {
                let (segment, rest) = (i / (2 * 8 * SEGMENT), i % (2 * 8 * SEGMENT));
                *v = value(y, segment * SEGMENT + rest % SEGMENT, rest / (8 * SEGMENT), rest / SEGMENT % 8);
            }
        });
        let coarse = fine.halved();
        for (y, x, n, c) in [(0, 0, 0, 0), (1, 17, 1, 3), (0, 31, 0, 7), (1, 35, 1, 0)] {
            let found = coarse.segment(y, x / SEGMENT * SEGMENT, n)[c * SEGMENT + x % SEGMENT];
            assert_eq!(found, value(2 * y, 2 * x, n, c) + 5.5, "{y} {x} {n} {c}");
        }
    }
}
