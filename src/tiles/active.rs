//! Which blocks of a frame need computing: those where the pixels that could be averaged differ.

use crate::frame::ranges::{BLOCK, Range, Ranges};

/// How far apart values may lie, relative to the least: half a step of float16 at its coarsest.
const APART: f32 = 1.0 / 4096.0;

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
    let mut active = Vec::with_capacity(centre.rows * centre.columns);
    let mut joined = vec![Range::EMPTY; centre.channels];
    for row in 0..centre.rows {
        for column in 0..centre.columns {
            let around = |block: usize| ((block * BLOCK) as f32 - reach as f32, ((block + 1) * BLOCK + reach) as f32 - 1.0);
            let area = Area { rows: around(row), columns: around(column) };
            joined.fill(Range::EMPTY);
            active.push(!uniform(centre, paths, area, &mut joined));
        }
    }
    Blocks { rows: centre.rows, columns: centre.columns, active }
}

/// Whether all pixels that could be averaged from an area are alike.
fn uniform(centre: &Ranges, paths: &[RangePath], area: Area, joined: &mut [Range]) -> bool {
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
        let steps = path.frames.iter().take(path.frames.len() - 1);
        let place = steps.copied().try_fold(area, |area, frame| area.moved(frame, path.later));
        match (place, path.frames.last()) {
            (Some(place), Some(last)) => alike(last, place),
            _ => true,
        }
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
