//! A frame's pixels as the float64 reference sees them, made from the passes alone: sanitised, demodulated, reprojected.

use crate::Frame;
use crate::frame::pixels::ALIGNMENT;

/// The brightest radiance that the engine keeps, written out again: this reference shares no arithmetic with what it checks.
const MAX_RADIANCE: f64 = 1e35;

/// A value with what it may be: a pixel is all three of itself, an average lies between its taps' bounds.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct BoundedValue {
    pub value: f64,
    pub low: f64,
    pub high: f64,
    /// The same average of the magnitudes: what rounding is relative to.
    pub size: f64,
}

impl BoundedValue {
    pub fn of(value: f64) -> Self {
        Self { value, low: value, high: value, size: value.abs() }
    }
}

/// One image of a pyramid level, padded; channels are colour, alpha, light passes.
pub(super) struct LevelImage {
    pub rows: usize,
    pub columns: usize,
    pub channels: usize,
    /// [row][column][channel].
    pub cells: Vec<BoundedValue>,
    /// Whether a pixel may be used.
    pub mask: Vec<bool>,
    /// [row][column]: the albedo plus ε.
    pub modulation: Vec<[BoundedValue; 3]>,
    /// Whether a denoised level's modulation may be used; elsewhere `mask` says so.
    pub modulation_mask: Vec<bool>,
}

impl LevelImage {
    /// An image without its pixels yet.
    pub fn empty(rows: usize, columns: usize, channels: usize) -> Self {
        Self { rows, columns, channels, cells: Vec::new(), mask: Vec::new(), modulation: Vec::new(), modulation_mask: Vec::new() }
    }

    /// A pixel's index, None outside the image.
    pub fn index(&self, y: isize, x: isize) -> Option<usize> {
        let inside = (0..self.rows as isize).contains(&y) && (0..self.columns as isize).contains(&x);
        inside.then(|| y as usize * self.columns + x as usize)
    }

    /// A pixel's channels.
    pub fn pixel(&self, index: usize) -> &[BoundedValue] {
        &self.cells[index * self.channels..][..self.channels]
    }

    /// A frame's own pixels; `epsilon` is added to the albedo.
    pub fn new(frame: &Frame, epsilon: f64) -> Self {
        let (own_rows, own_columns) = frame.size();
        let (rows, columns) = (own_rows.next_multiple_of(ALIGNMENT), own_columns.next_multiple_of(ALIGNMENT));
        let alpha = usize::from(frame.alpha.is_some());
        let channels = 3 + alpha + 3 * frame.aovs.len();
        let mut out = Self::empty(rows, columns, channels);
        // What is not finite in a light pass is the mean of what is in the 5×5 pixels around it.
        let value = |pixel: &dyn Fn(usize, usize) -> f32, y: usize, x: usize| {
            let near = |at: usize, most: usize| at.saturating_sub(2)..(at + 3).min(most);
            let around = near(y, own_rows).flat_map(|y| near(x, own_columns).map(move |x| (y, x)));
            let found: Vec<f64> = around.map(|(y, x)| pixel(y, x)).filter(|v| v.is_finite()).map(f64::from).collect();
            match f64::from(pixel(y, x)) {
                own if own.is_finite() => own,
                _ if found.is_empty() => 0.0,
                _ => f64::from((found.iter().sum::<f64>() / found.len() as f64) as f32),
            }
        };
        for y in 0..rows {
            for x in 0..columns {
                let (iy, ix) = (y.min(own_rows - 1), x.min(own_columns - 1));
                let alpha = frame.alpha.as_ref().map(|a| a[[iy, ix]]);
                let finite = (0..3).all(|c| frame.colour[[iy, ix, c]].is_finite()) && alpha.is_none_or(f32::is_finite);
                let bounded = |v: f32| if v.is_nan() { 0.0 } else { f64::from(v).clamp(0.0, 1.0) };
                let modulation: [f64; 3] =
                    std::array::from_fn(|c| frame.albedo.as_ref().map_or(1.0, |a| bounded(a[[iy, ix, c]]) + epsilon));
                for (c, m) in modulation.iter().enumerate() {
                    let v = if finite { f64::from(frame.colour[[iy, ix, c]]).clamp(0.0, MAX_RADIANCE) } else { 0.0 };
                    out.cells.push(BoundedValue::of(v / m));
                }
                out.cells.extend(alpha.map(|a| BoundedValue::of(bounded(a))));
                for aov in &frame.aovs {
                    let at = |c: usize| value(&|y, x| aov.image[[y, x, c]], iy, ix).clamp(-MAX_RADIANCE, MAX_RADIANCE);
                    out.cells.extend((0..3).map(|c| BoundedValue::of(at(c) / modulation[c])));
                }
                out.mask.push(finite && y < own_rows && x < own_columns);
                out.modulation.push(modulation.map(BoundedValue::of));
            }
        }
        out
    }

    /// The last of `frames` (centre first, one step of motion each) where the centre's vectors lead, frame by frame; into the
    /// future where `later`. Positions are float32, as they are defined; pixels are float64.
    pub fn warped(frames: &[&Frame], later: bool, epsilon: f64) -> Self {
        let source = Self::new(frames[frames.len() - 1], epsilon);
        let (rows, columns, channels) = (source.rows, source.columns, source.channels);
        let mut out = Self::empty(rows, columns, channels);
        for y in 0..rows {
            for x in 0..columns {
                let (column, row, inside) = follow(&frames[..frames.len() - 1], later, y, x, (rows, columns));
                let (corners, weights) = bilinear(column, row, rows, columns);
                let unusable: f32 = corners.iter().zip(weights).map(|(i, w)| if source.mask[*i] { 0.0 } else { w }).sum();
                let mean = |of: &dyn Fn(usize) -> f64| {
                    let all: f64 = weights.iter().map(|w| f64::from(*w)).sum();
                    corners.iter().zip(weights).map(|(i, w)| of(*i) * f64::from(w)).sum::<f64>() / all
                };
                out.cells.extend((0..channels).map(|c| BoundedValue::of(mean(&|i| source.pixel(i)[c].value))));
                out.mask.push(inside && unusable == 0.0);
                out.modulation.push(std::array::from_fn(|c| BoundedValue::of(mean(&|i| source.modulation[i][c].value))));
            }
        }
        out
    }

    /// Half the size: means of the usable pixels of 2×2.
    pub fn down(&self) -> Self {
        let (rows, columns, channels) = (self.rows / 2, self.columns / 2, self.channels);
        let mut out = Self::empty(rows, columns, channels);
        for y in 0..rows {
            for x in 0..columns {
                let four = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(dy, dx)| (2 * y + dy) * self.columns + 2 * x + dx);
                let usable: Vec<usize> = four.into_iter().filter(|i| self.mask[*i]).collect();
                let count = usable.len().max(1) as f64;
                let mean = |of: &dyn Fn(usize) -> BoundedValue| {
                    let mean = |part: fn(BoundedValue) -> f64| usable.iter().map(|i| part(of(*i))).sum::<f64>() / count;
                    let value = mean(|cell| cell.value);
                    BoundedValue { value, low: value, high: value, size: mean(|cell| cell.size) }
                };
                out.cells.extend((0..channels).map(|c| mean(&|i| self.pixel(i)[c])));
                out.modulation.push(std::array::from_fn(|c| mean(&|i| self.modulation[i][c])));
                out.mask.push(!usable.is_empty());
            }
        }
        out
    }
}

/// Where a pixel of the centre lies after a step by each frame's vectors, and whether it stayed inside all the way.
fn follow(frames: &[&Frame], later: bool, y: usize, x: usize, (rows, columns): (usize, usize)) -> (f32, f32, bool) {
    let (mut column, mut row, mut inside) = (x as f32, y as f32, true);
    let nearest = |v: f32, most: usize| ((v + 0.5).floor().max(0.0) as usize).min(most - 1);
    for frame in frames {
        let Some(vectors) = &frame.vector else { continue };
        let (own_rows, own_columns) = frame.size();
        let (iy, ix) = (nearest(row, rows).min(own_rows - 1), nearest(column, columns).min(own_columns - 1));
        let v = |c: usize| vectors[[iy, ix, c]];
        (column, row) = if later { (column - v(2), row + v(3)) } else { (column + v(0), row - v(1)) };
        let within = |v: f32, most: usize| v >= -0.5 && v <= most as f32 - 0.5;
        inside &= within(column, columns) && within(row, rows);
    }
    let number = |v: f32| if v.is_nan() { 0.0 } else { v };
    (number(column), number(row), inside)
}

/// The four pixels around a position, clamped to the image, and their shares.
fn bilinear(column: f32, row: f32, rows: usize, columns: usize) -> ([usize; 4], [f32; 4]) {
    let (x, y) = (column.clamp(0.0, (columns - 1) as f32), row.clamp(0.0, (rows - 1) as f32));
    let (x0, y0) = ((x as usize).min(columns - 2), (y as usize).min(rows - 2));
    let (fx, fy) = (x - x0 as f32, y - y0 as f32);
    let first = y0 * columns + x0;
    let weights = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
    ([first, first + 1, first + columns, first + columns + 1], weights)
}
