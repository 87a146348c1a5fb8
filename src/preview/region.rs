//! Rectangles of a frame, and what of the window's frames a rectangle needs.

use std::collections::BTreeMap;
use std::fmt::{self, Display, Formatter};
use std::ops::Range;
use std::str::FromStr;

use ndarray::ArrayView3;

use crate::error::{Error, Result};

/// Cuts lie on multiples of this many pixels, where the network's coarsest resolution has its own.
const GRID: usize = 8;

/// A rectangle of pixels; as text `X,Y,WIDTH,HEIGHT`, from the frame's upper left corner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// Column of the left edge.
    pub x: usize,
    /// Row of the upper edge.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Region {
    /// All of a frame of (rows, columns).
    pub fn whole((rows, columns): (usize, usize)) -> Self {
        Self { x: 0, y: 0, width: columns, height: rows }
    }

    /// Its rows.
    pub fn rows(&self) -> Range<usize> {
        self.y..self.y + self.height
    }

    /// Its columns.
    pub fn columns(&self) -> Range<usize> {
        self.x..self.x + self.width
    }

    /// Itself, if it lies in a frame of (rows, columns).
    ///
    /// # Errors
    /// It reaches beyond the frame.
    pub fn within(self, (rows, columns): (usize, usize)) -> Result<Self> {
        let inside =
            self.width <= columns && self.height <= rows && self.x <= columns - self.width && self.y <= rows - self.height;
        let reason = || format!("{self} reaches beyond the frame of {columns}×{rows}");
        inside.then_some(self).ok_or_else(|| Error::BadSetting { name: "region", reason: reason() })
    }

    /// The smallest rectangle that holds both.
    pub fn joined(self, other: Self) -> Self {
        let (x, y) = (self.x.min(other.x), self.y.min(other.y));
        let end = (self.columns().end.max(other.columns().end), self.rows().end.max(other.rows().end));
        Self { x, y, width: end.0 - x, height: end.1 - y }
    }

    /// With `by` pixels more on each side, as far as there are any, and ends on the grid.
    pub fn grown(self, by: usize, (rows, columns): (usize, usize)) -> Self {
        let begin = |at: usize| at.saturating_sub(by) / GRID * GRID;
        let end = |at: usize, most: usize| (at + by).next_multiple_of(GRID).min(most);
        let (x, y) = (begin(self.x), begin(self.y));
        Self { x, y, width: end(self.columns().end, columns) - x, height: end(self.rows().end, rows) - y }
    }

    /// The same rectangle as seen from the corner of another one that holds it.
    pub fn inside(self, outer: Self) -> Self {
        Self { x: self.x - outer.x, y: self.y - outer.y, ..self }
    }

    /// Where its pixels lie in the next frame (`later`) or the last, by the Vector pass of its own frame, (rows, columns, 4);
    /// places outside the frame count for nothing. None where there are no others.
    pub fn moved(self, vectors: ArrayView3<f32>, later: bool) -> Option<Self> {
        let (rows, columns, _) = vectors.dim();
        let (mut low, mut high) = ((f32::INFINITY, f32::INFINITY), (f32::NEG_INFINITY, f32::NEG_INFINITY));
        for row in self.rows() {
            for column in self.columns() {
                let v = |c: usize| vectors[(row, column, c)];
                let (dx, dy) = if later { (-v(2), v(3)) } else { (v(0), -v(1)) };
                let (x, y) = (column as f32 + dx, row as f32 + dy);
                // Written so that NaN is outside.
                if x >= -0.5 && x <= columns as f32 - 0.5 && y >= -0.5 && y <= rows as f32 - 0.5 {
                    (low, high) = ((low.0.min(x), low.1.min(y)), (high.0.max(x), high.1.max(y)));
                }
            }
        }
        // A place is sampled from the four pixels around it, and its own motion is read at the nearest one.
        let begin = |at: f32| (at.floor() as usize).saturating_sub(1);
        let end = |at: f32, most: usize| (at.ceil() as usize + 2).min(most);
        (low.0 <= high.0).then(|| {
            let (x, y) = (begin(low.0), begin(low.1));
            Self { x, y, width: end(high.0, columns) - x, height: end(high.1, rows) - y }
        })
    }
}

impl Display for Region {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{},{},{},{}", self.x, self.y, self.width, self.height)
    }
}

impl FromStr for Region {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let bad = || Error::BadSetting { name: "region", reason: format!("{text} is not X,Y,WIDTH,HEIGHT in pixels") };
        let numbers: Vec<usize> = text.split(',').map(|n| n.trim().parse().map_err(|_| bad())).collect::<Result<_>>()?;
        match numbers[..] {
            [x, y, width, height] if width > 0 && height > 0 && [x, y, width, height].iter().all(|v| *v <= 1 << 20) => {
                Ok(Self { x, y, width, height })
            }
            _ => Err(bad()),
        }
    }
}

/// What denoising `region` of frame `centre` reads of the frames around it: the region with `reach` pixels around, and where those
/// lie in the neighbours, along the motion there and back. `vectors` are whole frames' Vector passes; `around` (offset, frame).
pub fn needed(
    region: Region,
    reach: usize,
    size: (usize, usize),
    vectors: &BTreeMap<i64, ArrayView3<f32>>,
    (centre, around): (i64, &[(i32, i64)]),
) -> Region {
    let own = region.grown(reach, size);
    let mut all = own;
    for later in [false, true] {
        let step = if later { 1 } else { -1 };
        let mut place = Some(own);
        let most = around.iter().filter(|(offset, _)| (*offset > 0) == later).map(|(offset, _)| offset.abs()).max().unwrap_or(0);
        for k in 1..=i64::from(most) {
            let towards = |frame: i64, from: Region, later: bool| from.moved(*vectors.get(&frame)?, later);
            place = place.and_then(|p| towards(centre + step * (k - 1), p, later));
            let Some(there) = place else { break };
            all = all.joined(there);
            // The way home, which tells how far to trust the neighbour.
            let mut home = Some(there);
            for back in (2..=k).rev() {
                home = home.and_then(|h| towards(centre + step * back, h, !later));
                all = home.map_or(all, |h| all.joined(h));
            }
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;

    fn region(text: &str) -> Region {
        text.parse().unwrap()
    }

    #[test]
    fn regions_are_read_and_refused() {
        assert_eq!(region("1, 2,30,40").to_string(), "1,2,30,40");
        for bad in ["", "1,2,3", "1,2,3,4,5", "1,2,0,4", "a,2,3,4", "-1,2,3,4", "1,2,3,99999999999"] {
            assert!(bad.parse::<Region>().is_err(), "{bad}");
        }
        assert!(region("10,0,30,20").within((20, 40)).is_ok());
        assert!(region("11,0,30,20").within((20, 40)).is_err() && region("0,0,41,2").within((20, 40)).is_err());
    }

    #[test]
    fn growing_keeps_to_the_grid_and_the_frame() {
        assert_eq!(region("20,20,10,10").grown(3, (100, 50)), region("16,16,24,24"));
        assert_eq!(region("20,20,10,10").grown(50, (33, 47)), region("0,0,47,33"));
        assert_eq!(region("20,24,10,10").inside(region("16,16,24,24")), region("4,8,10,10"));
        assert_eq!(region("1,2,3,4").joined(region("10,0,1,1")), region("1,0,10,6"));
    }

    #[test]
    fn motion_has_cycles_signs_and_what_leaves_the_frame_does_not_count() {
        let mut v = Array3::zeros((40, 60, 4));
        v.slice_mut(ndarray::s![.., .., 0]).fill(5.0);
        v.slice_mut(ndarray::s![.., .., 3]).fill(7.0);
        assert_eq!(region("10,10,4,4").moved(v.view(), false), Some(region("14,9,6,6")));
        assert_eq!(region("10,10,4,4").moved(v.view(), true), Some(region("9,16,6,6")));
        v.slice_mut(ndarray::s![.., 12.., 0]).fill(1e9);
        v[(10, 10, 0)] = f32::NAN;
        assert_eq!(region("10,10,4,4").moved(v.view(), false), Some(region("14,9,4,6")));
        v.fill(1e9);
        assert_eq!(region("10,10,4,4").moved(v.view(), false), None);
    }

    #[test]
    fn the_chain_of_motion_is_followed_both_ways() {
        let moving = |x: f32| Array3::from_shape_fn((80, 200, 4), |(_, _, c)| if c == 0 { x } else { 0.0 });
        let passes: BTreeMap<i64, Array3<f32>> = [(4, moving(0.0)), (5, moving(-24.0)), (6, moving(-16.0))].into();
        let vectors = passes.iter().map(|(n, v)| (*n, v.view())).collect();
        let window = (6, &[(-1, 5), (-2, 4)][..]);
        // 6 → 5 goes 16 pixels to the left, 5 → 4 another 24; the way home from 4 goes nowhere. Each step wants a pixel more around.
        let all = needed(region("96,32,16,16"), 8, (80, 200), &vectors, window);
        assert_eq!(all, region("45,21,38,38").joined(region("88,24,32,32")));
    }
}
