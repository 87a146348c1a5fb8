//! Cutting a frame into tiles with halos, so that the network's buffers fit into the memory allowed.

/// Tile edges lie on multiples of this, in half-resolution pixels: eight pixels of the frame.
pub const STEP: usize = 4;

/// A rectangle in half-resolution pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rect {
    /// The first row.
    pub row: usize,
    /// The first column.
    pub column: usize,
    /// How many rows.
    pub rows: usize,
    /// How many columns.
    pub columns: usize,
}

impl Rect {
    /// Half-resolution pixels.
    pub fn area(&self) -> usize {
        self.rows * self.columns
    }

    /// With `by` pixels more on each side, as far as there are any.
    pub fn grown(&self, by: usize, rows: usize, columns: usize) -> Self {
        let (row, column) = (self.row.saturating_sub(by), self.column.saturating_sub(by));
        let end = ((self.row + self.rows + by).min(rows), (self.column + self.columns + by).min(columns));
        Self { row, column, rows: end.0 - row, columns: end.1 - column }
    }
}

/// What one pass of the network computes (`region`) and what of it is exact and kept (`core`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tile {
    /// Exact, and kept.
    pub core: Rect,
    /// With its halo.
    pub region: Rect,
}

/// Cuts a part of a frame of `rows` × `columns` (all multiples of [`STEP`]) into the fewest equal tiles whose regions, with a halo
/// of at least `halo`, have at most `area` pixels; where that cannot be, the smallest tiles that still make sense.
pub fn tiles(part: Rect, rows: usize, columns: usize, halo: usize, area: usize) -> Vec<Tile> {
    let halo = halo.next_multiple_of(STEP);
    let smallest = (2 * halo).max(STEP);
    let (mut down, mut across) = (1, 1);
    loop {
        let (r, c) = (step(part.rows, down), step(part.columns, across));
        let region = (r + 2 * halo).min(rows) * (c + 2 * halo).min(columns);
        let can_split = r > smallest || c > smallest;
        if region <= area || !can_split {
            return cut(part, (rows, columns), r, c, halo);
        }
        if r >= c { down += 1 } else { across += 1 }
    }
}

fn step(length: usize, parts: usize) -> usize {
    length.div_ceil(parts).next_multiple_of(STEP)
}

fn cut(part: Rect, frame: (usize, usize), r: usize, c: usize, halo: usize) -> Vec<Tile> {
    let (end_row, end_column) = (part.row + part.rows, part.column + part.columns);
    let mut out = Vec::new();
    for row in (part.row..end_row).step_by(r) {
        for column in (part.column..end_column).step_by(c) {
            let core = Rect { row, column, rows: r.min(end_row - row), columns: c.min(end_column - column) };
            out.push(Tile { core, region: core.grown(halo, frame.0, frame.1) });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_the_frame_once_and_respect_the_area() {
        for (rows, columns, area) in
            [(540, 960, usize::MAX), (1080, 1920, 600_000), (4, 8192, 9000), (4, 4, 1), (136, 240, 40_000)]
        {
            let all = tiles(Rect { row: 0, column: 0, rows, columns }, rows, columns, 48, area);
            assert_eq!(all.iter().map(|t| t.core.area()).sum::<usize>(), rows * columns);
            for t in &all {
                assert!(t.region.row <= t.core.row && t.region.column <= t.core.column);
                assert!(t.core.row % STEP == 0 && t.region.row % STEP == 0 && t.region.rows % STEP == 0);
                assert!(t.region.row == 0 || t.core.row - t.region.row >= 48);
                assert!(t.region.area() <= area.max((3 * 96 + STEP) * (3 * 96 + STEP)), "{t:?}");
            }
        }
        let part = Rect { row: 40, column: 800, rows: 100, columns: 160 };
        let all = tiles(part, 540, 960, 48, usize::MAX);
        assert_eq!(all, [Tile { core: part, region: Rect { row: 0, column: 752, rows: 188, columns: 208 } }]);
        assert!(tiles(part, 540, 960, 48, 1000).iter().map(|t| t.core.area()).sum::<usize>() == part.area());
    }
}
