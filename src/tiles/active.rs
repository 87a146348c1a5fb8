//! Which blocks of a frame need computing: those where the pixels that could be averaged differ.

use rayon::prelude::*;

use crate::frame::ranges::{BLOCK, Range, Ranges};

/// How far apart values may lie, relative to the least: half a step of float16 at its coarsest.
const APART: f32 = 1.0 / 4096.0;

/// Where the motion around a block spreads over more than so many times the block's reach, nothing is left out there: to look at all
/// of it would take longer than to compute.
const MOST: f32 = 8.0;

/// The ranges of the frames from the centre to a neighbour.
pub struct RangePath<'a> {
    /// Centre first, one step of motion each, the neighbour last.
    pub frames: Vec<&'a Ranges>,
    /// Whether it comes later than the centre.
    pub later: bool,
}

/// One flag a block, row-major.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Blocks {
    pub rows: usize,
    pub columns: usize,
    pub active: Vec<bool>,
}

impl Blocks {
    /// Whether any is active in a rectangle, both ends included.
    pub fn any(&self, rows: (usize, usize), columns: (usize, usize)) -> bool {
        (rows.0..=rows.1).any(|row| self.active[row * self.columns..][columns.0..=columns.1].contains(&true))
    }
}

/// A rectangle of pixels, ends included.
#[derive(Clone, Copy)]
struct Area {
    rows: (f32, f32),
    columns: (f32, f32),
}

impl Area {
    /// The blocks that it touches, clamped to the frame: pixels outside it are used by nobody.
    fn blocks(&self, ranges: &Ranges) -> impl Iterator<Item = (usize, usize)> + use<> {
        let clamp = |v: f32, most: usize| ((v.max(0.0) as usize) / BLOCK).min(most - 1);
        let rows = clamp(self.rows.0.floor(), ranges.rows)..=clamp(self.rows.1.ceil(), ranges.rows);
        let columns = clamp(self.columns.0.floor(), ranges.columns)..=clamp(self.columns.1.ceil(), ranges.columns);
        rows.flat_map(move |row| columns.clone().map(move |column| (row, column)))
    }

    /// Pixels of it inside the frame, about.
    fn inside(&self, ranges: &Ranges) -> f32 {
        let part = |range: (f32, f32), blocks: usize| (range.1.min((blocks * BLOCK) as f32) - range.0.max(0.0)).max(0.0);
        part(self.rows, ranges.rows) * part(self.columns, ranges.columns)
    }

    /// Where its pixels lie one frame later or earlier; None where no vector is a number.
    fn moved(&self, ranges: &Ranges, later: bool) -> Option<Self> {
        let mut v = [Range::EMPTY; 4];
        for (row, column) in self.blocks(ranges) {
            let block = ranges.vectors(row, column)?;
            v.iter_mut().zip(block).for_each(|(all, one)| all.join(one));
        }
        let (across, down) = if later {
            ((-v[2].high, -v[2].low), (v[3].low, v[3].high))
        } else {
            ((v[0].low, v[0].high), (-v[1].high, -v[1].low))
        };
        let empty = |r: (f32, f32)| r.0 > r.1;
        // A pixel's vector is read at the nearest whole position, and its colour from the four pixels around the place.
        let wide = |range: (f32, f32), by: (f32, f32)| (range.0 + by.0 - 1.0, range.1 + by.1 + 1.0);
        (!empty(across) && !empty(down)).then(|| Self { rows: wide(self.rows, down), columns: wide(self.columns, across) })
    }
}

/// The blocks of `centre` that need computing: `reach` is how far from a pixel its taps go, in pixels.
pub fn active_blocks(centre: &Ranges, paths: &[RangePath], reach: usize) -> Blocks {
    let around = |block: usize| ((block * BLOCK) as f32 - reach as f32, ((block + 1) * BLOCK + reach) as f32 - 1.0);
    let row = |row: usize| {
        let mut joined = vec![Range::EMPTY; centre.channels];
        let active = move |column: usize| {
            joined.fill(Range::EMPTY);
            !uniform(centre, paths, Area { rows: around(row), columns: around(column) }, &mut joined)
        };
        (0..centre.columns).map(active).collect::<Vec<bool>>()
    };
    let active = (0..centre.rows).into_par_iter().flat_map_iter(row).collect();
    Blocks { rows: centre.rows, columns: centre.columns, active }
}

/// Whether all pixels that could be averaged from an area are alike.
fn uniform(centre: &Ranges, paths: &[RangePath], area: Area, joined: &mut [Range]) -> bool {
    let most = MOST * (area.rows.1 - area.rows.0) * (area.columns.1 - area.columns.0);
    let mut alike = |ranges: &Ranges, area: Area| {
        area.blocks(ranges).all(|(row, column)| {
            joined.iter_mut().zip(ranges.block(row, column)).for_each(|(all, one)| all.join(*one));
            are_close(joined)
        })
    };
    if !alike(centre, area) {
        return false;
    }
    paths.iter().all(|path| {
        let Some((last, steps)) = path.frames.split_last() else { return true };
        let mut place = area;
        for frame in steps {
            if place.inside(frame) > most {
                return false;
            }
            let Some(moved) = place.moved(frame, path.later) else { return true };
            place = moved;
        }
        place.inside(last) <= most && alike(last, place)
    })
}

/// Whether results anywhere within these ranges lie within the bound: a colour is its range times its modulation's.
fn are_close(ranges: &[Range]) -> bool {
    let (colour, rest) = ranges.split_at(3);
    let (modulation, extra) = rest.split_at(3);
    let near = |low: f32, high: f32| (high - low).is_finite() && high - low <= APART * low.abs().min(high.abs());
    let product = |v: &Range, m: &Range| near(v.low * m.low, v.high * m.high);
    let dark = |v: &Range| v.low == 0.0 && v.high == 0.0;
    colour.iter().zip(modulation).all(|(v, m)| dark(v) || product(v, m)) && {
        // Each extra channel belongs to one of the modulations or to none; the widest of them covers all.
        let widest = modulation.iter().map(|m| m.high / m.low).fold(1.0, f32::max);
        extra.iter().all(|v| dark(v) || near(v.low.min(v.low * widest), v.high.max(v.high * widest)))
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;
    use crate::frame::Frame;
    use crate::frame::packed::PackedFrame;
    use crate::memory::BufferPool;

    /// Of a black frame whose vectors reach so far at some pixels.
    fn ranges(far: f32) -> Ranges {
        let mut frame = Frame::new(Array3::zeros((512, 512, 3)));
        frame.vector = Some(Array3::from_shape_fn((512, 512, 4), |(y, x, _)| if (y + x) % 7 == 0 { far } else { -far }));
        Ranges::new(&PackedFrame::new(&frame.view(), 0.05, &BufferPool::default()).unwrap())
    }

    #[test]
    fn a_black_frame_needs_no_computing_unless_its_motion_goes_everywhere() {
        for (far, active) in [(0.0, false), (3.0, false), (3000.0, true)] {
            let ranges = ranges(far);
            let path = RangePath { frames: vec![&ranges, &ranges], later: true };
            let found = active_blocks(&ranges, &[path], 40);
            assert_eq!((found.rows, found.columns, found.active.len()), (32, 32, 1024));
            assert!(found.active.iter().all(|a| *a == active), "{far}");
        }
    }
}
