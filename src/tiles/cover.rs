//! Few rectangles over the active blocks of a frame, so that little else is computed.

use super::active::Blocks;
use super::cut::Rect;
use crate::frame::ranges::BLOCK;

/// A block in half-resolution pixels.
const HALF_BLOCK: usize = BLOCK / 2;
/// A cut must save this share of the pixels computed.
const WORTH: f64 = 0.1;

/// Rows and columns of blocks, ends included.
#[derive(Clone, Copy, PartialEq)]
struct Span {
    rows: (usize, usize),
    columns: (usize, usize),
}

/// Rectangles in half-resolution pixels that hold all active blocks and do not overlap. Each will be computed with a halo of
/// `halo`, so it is cut in two only where that pays. `rows` and `columns` are the frame's, at half resolution.
pub fn cover(blocks: &Blocks, rows: usize, columns: usize, halo: usize) -> Vec<Rect> {
    let mut found = Vec::new();
    if blocks.rows > 0 && blocks.columns > 0 {
        let cover = Cover { blocks, rows, columns, halo };
        let whole = Span { rows: (0, blocks.rows - 1), columns: (0, blocks.columns - 1) };
        if let Some(all) = cover.shrunk(whole) {
            cover.split(all, &mut found);
        }
    }
    found
}

struct Cover<'a> {
    blocks: &'a Blocks,
    rows: usize,
    columns: usize,
    halo: usize,
}

impl Cover<'_> {
    /// Without empty rows and columns at the edges; None where nothing is active.
    fn shrunk(&self, b: Span) -> Option<Span> {
        let row = |row: &usize| self.blocks.any((*row, *row), b.columns);
        let rows = ((b.rows.0..=b.rows.1).find(row)?, (b.rows.0..=b.rows.1).rfind(row)?);
        let column = |column: &usize| self.blocks.any(rows, (*column, *column));
        Some(Span { rows, columns: ((b.columns.0..=b.columns.1).find(column)?, (b.columns.0..=b.columns.1).rfind(column)?) })
    }

    fn rect(&self, b: Span) -> Rect {
        let (row, column) = (b.rows.0 * HALF_BLOCK, b.columns.0 * HALF_BLOCK);
        let end = (((b.rows.1 + 1) * HALF_BLOCK).min(self.rows), ((b.columns.1 + 1) * HALF_BLOCK).min(self.columns));
        Rect { row, column, rows: end.0 - row, columns: end.1 - column }
    }

    fn cost(&self, b: Span) -> usize {
        self.rect(b).grown(self.halo, self.rows, self.columns).area()
    }

    fn split(&self, b: Span, found: &mut Vec<Rect>) {
        let by_row = (b.rows.0..b.rows.1).map(|r| (Span { rows: (b.rows.0, r), ..b }, Span { rows: (r + 1, b.rows.1), ..b }));
        let by_column = (b.columns.0..b.columns.1)
            .map(|c| (Span { columns: (b.columns.0, c), ..b }, Span { columns: (c + 1, b.columns.1), ..b }));
        let halves = by_row.chain(by_column).filter_map(|(one, other)| Some((self.shrunk(one)?, self.shrunk(other)?)));
        let best = halves.min_by_key(|(one, other)| self.cost(*one) + self.cost(*other));
        match best {
            Some((one, other)) if ((self.cost(one) + self.cost(other)) as f64) < (1.0 - WORTH) * self.cost(b) as f64 => {
                self.split(one, found);
                self.split(other, found);
            }
            _ => found.push(self.rect(b)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn blocks(rows: usize, columns: usize, active: impl Fn(usize, usize) -> bool) -> Blocks {
        let flags = (0..rows * columns).map(|i| active(i / columns, i % columns)).collect();
        Blocks { rows, columns, active: flags }
    }

    #[test]
    fn nothing_everything_and_one_corner() {
        assert_eq!(cover(&blocks(5, 7, |_, _| false), 40, 56, 8), []);
        assert_eq!(cover(&blocks(5, 7, |_, _| true), 36, 52, 8), [Rect { row: 0, column: 0, rows: 36, columns: 52 }]);
        assert_eq!(cover(&blocks(5, 7, |r, c| r == 4 && c == 6), 36, 52, 8), [Rect { row: 32, column: 48, rows: 4, columns: 4 }]);
    }

    #[test]
    fn far_parts_are_cut_apart_and_near_ones_are_not() {
        let far = cover(&blocks(68, 120, |r, c| (r < 10 && c < 10) || (r > 60 && c > 100)), 540, 960, 48);
        assert_eq!(far.len(), 2);
        let near = cover(&blocks(68, 120, |r, c| r < 10 && (c < 10 || (12..20).contains(&c))), 540, 960, 48);
        assert_eq!(near.len(), 1);
    }

    #[test]
    fn every_active_block_is_covered_once() {
        for seed in 1..40usize {
            let is_active = |r: usize, c: usize| (r / 9 * 31 + c / 11 * 17 + seed * 7).is_multiple_of(5);
            let rects = cover(&blocks(40, 60, is_active), 316, 476, 12);
            for r in 0..40 {
                for c in 0..60 {
                    let inside = |t: &&Rect| {
                        let (y, x) = (r * HALF_BLOCK, c * HALF_BLOCK);
                        (t.row..t.row + t.rows).contains(&y) && (t.column..t.column + t.columns).contains(&x)
                    };
                    let count = rects.iter().filter(inside).count();
                    assert!(count == 1 || (count == 0 && !is_active(r, c)), "block {r} {c} in {count}");
                }
            }
        }
    }
}
