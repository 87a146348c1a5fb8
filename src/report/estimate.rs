//! The error against a truth that nobody has, from noisy frames before and after.
//!
//! Let d be the denoised frame, and a and b the noisy frames k before and k after it, carried to it along the motion vectors,
//! where d was made without either. Each is the truth r plus noise that has nothing to do with the other's or with d, so that
//! E[(d − a)(d − b)] = E[(d − r)²]: the noise drops out of the mean by itself, no variance has to be known. What is left is
//! what the light itself changed within k frames, and what sampling between pixels blurs; to keep that small the noisy light is
//! carried without its albedo, and only pixels count whose way forth and back agrees and whose albedo, normal and depth stay
//! the same. Those are the easier ones: the whole frame's error is higher. And what d lacks of r that a and b lack too, such as a
//! reflection that moves otherwise than its surface, cannot be seen: the estimate is too low by it. It is relative to the brightness g of
//! one result that was made without a and b, the same for every d that is compared: a firefly that d leaves must not be divided by itself.

use ndarray::{Array2, Array3, ArrayView3};

use crate::frame::Frame;
use crate::frame::sanitise::front;
use crate::metrics::pair::REFERENCE_MEAN;
use crate::metrics::relmse;

/// A way forth and back that misses its start by this many pixels is not trusted.
const MISS: f32 = 0.5;
/// How far albedo (each channel), normal (each component) and depth (relative) may differ.
const ALBEDO: f32 = 0.05;
const NORMAL: f32 = 0.1;
const DEPTH: f32 = 0.03;
/// Keeps dark albedo from blowing the light up.
const DARK: f32 = 0.01;
/// The sides of the blocks whose sums tell how sure the mean is.
const BLOCK: usize = 16;
/// Share of trusted pixels that may be bit-equal in both frames before the noise counts as repeated.
const REPEATED: f64 = 0.25;

/// What was seen of a frame from frames before and after it.
pub struct Observed {
    before: Array3<f32>,
    after: Array3<f32>,
    trusted: Array2<bool>,
    gain: f64,
}

/// A mean and how sure it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorEstimate {
    /// The relMSE over the trusted pixels, with one result's brightness in place of the true one below the line. It may be a little below 0.
    pub relmse: f64,
    /// Its standard error.
    pub deviation: f64,
    /// The share of the frame's pixels that are trusted, 0…1.
    pub share: f64,
}

/// Why there is no estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unseen {
    /// A frame on the way lacks motion vectors, or is of another size.
    NoMotion,
    /// Hardly any pixel can be followed both ways.
    Lost,
    /// The frames have the same noise.
    SameNoise,
}

impl Observed {
    /// Looks at the middle one of an odd number of consecutive frames from the first and the last of them.
    pub fn new(frames: &[Frame]) -> Result<Self, Unseen> {
        let k = frames.len() / 2;
        let centre = &frames[k];
        let size = centre.size();
        if k == 0 || frames.iter().any(|f| f.size() != size || f.vector.is_none()) {
            return Err(Unseen::NoMotion);
        }
        let light = [&frames[0].colour, &frames[2 * k].colour].map(|colour| colour.view());
        let mut trusted = Array2::from_elem(size, true);
        let mut carry = |path: Vec<&Frame>, light: ArrayView3<f32>, later: bool| {
            let mut out = Array3::zeros((size.0, size.1, 3));
            for ((y, x), trusted) in trusted.indexed_iter_mut() {
                match seen(&path, light, later, y, x) {
                    Some(colour) => (0..3).for_each(|c| out[[y, x, c]] = colour[c]),
                    None => *trusted = false,
                }
            }
            out
        };
        let before = carry(frames[..=k].iter().rev().collect(), light[0], false);
        let after = carry(frames[k..].iter().collect(), light[1], true);
        let mean = centre.colour.iter().filter(|v| v.is_finite()).map(|v| f64::from(v.max(0.0))).sum::<f64>();
        let gain = REFERENCE_MEAN / (mean / centre.colour.len() as f64).max(1e-6);
        let counted = trusted.iter().filter(|t| **t).count();
        if counted < (size.0 * size.1 / 50).max(BLOCK) {
            return Err(Unseen::Lost);
        }
        let equal = |y: usize, x: usize| (0..3).all(|c| light[0][[y, x, c]] == light[1][[y, x, c]]) && light[0][[y, x, 0]] > 0.0;
        let repeated = trusted.indexed_iter().filter(|((y, x), t)| **t && equal(*y, *x)).count();
        if repeated as f64 > REPEATED * counted as f64 {
            return Err(Unseen::SameNoise);
        }
        Ok(Self { before, after, trusted, gain })
    }

    /// The error of a denoised frame that was made without the two frames that this was seen from, relative to `brightness`, which was
    /// as well.
    pub fn estimate(&self, denoised: ArrayView3<f32>, brightness: ArrayView3<f32>) -> ErrorEstimate {
        let error = |y: usize, x: usize, c: usize| {
            let d = f64::from(denoised[[y, x, c]]);
            (d - f64::from(self.before[[y, x, c]])) * (d - f64::from(self.after[[y, x, c]]))
        };
        self.mean(brightness, error)
    }

    /// The same error against a picture of the truth, on the same pixels.
    pub fn measure(&self, denoised: ArrayView3<f32>, truth: ArrayView3<f32>, brightness: ArrayView3<f32>) -> f64 {
        self.mean(brightness, |y, x, c| (f64::from(denoised[[y, x, c]]) - f64::from(truth[[y, x, c]])).powi(2)).relmse
    }

    fn mean(&self, brightness: ArrayView3<f32>, error: impl Fn(usize, usize, usize) -> f64) -> ErrorEstimate {
        let (rows, columns) = self.trusted.dim();
        let across = columns.div_ceil(BLOCK);
        let mut blocks = vec![(0.0, 0.0); across * rows.div_ceil(BLOCK)];
        for ((y, x), _) in self.trusted.indexed_iter().filter(|(_, t)| **t) {
            let block = &mut blocks[y / BLOCK * across + x / BLOCK];
            for c in 0..3 {
                let g = f64::from(brightness[[y, x, c]]) * self.gain;
                let e = error(y, x, c) * self.gain * self.gain / (g * g + relmse::EPSILON);
                if e.is_finite() {
                    *block = (block.0 + e, block.1 + 1.0);
                }
            }
        }
        let (sum, count) = blocks.iter().fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        let mean = if count > 0.0 { sum / count } else { f64::NAN };
        // Each block's part in the mean is one draw: neighbouring pixels are not independent, blocks nearly are.
        let variance: f64 = blocks.iter().map(|b| (b.0 - mean * b.1).powi(2)).sum();
        ErrorEstimate { relmse: mean, deviation: variance.sqrt() / count.max(1.0), share: count / (3 * rows * columns) as f64 }
    }
}

/// One step of motion from a place, by the vectors of `frame`.
fn step(frame: &Frame, later: bool, (x, y): (f32, f32)) -> Option<(f32, f32)> {
    let v = frame.vector.as_ref()?;
    let nearest = |at: f32, most: usize| ((at + 0.5).floor().max(0.0) as usize).min(most - 1);
    let at = |c: usize| v[[nearest(y, v.dim().0), nearest(x, v.dim().1), c]];
    let to = if later { (x - at(2), y + at(3)) } else { (x + at(0), y - at(1)) };
    (to.0.is_finite() && to.1.is_finite()).then_some(to)
}

/// The last frame's light at the place that pixel (y, x) of the first has there, with the first's albedo; None if not trusted.
fn seen(path: &[&Frame], light: ArrayView3<f32>, later: bool, y: usize, x: usize) -> Option<[f32; 3]> {
    let (first, last) = (path.first()?, path.last()?);
    let (rows, columns) = first.size();
    let start = (x as f32, y as f32);
    let inside = |(x, y): (f32, f32)| x >= 0.0 && y >= 0.0 && x <= (columns - 1) as f32 && y <= (rows - 1) as f32;
    let mut place = start;
    for frame in &path[..path.len() - 1] {
        place = step(frame, later, place).filter(|p| inside(*p))?;
    }
    let mut home = place;
    for frame in path[1..].iter().rev() {
        home = step(frame, !later, home)?;
    }
    if (home.0 - start.0).abs().max((home.1 - start.1).abs()) > MISS {
        return None;
    }
    let around = Bilinear::new(place, rows, columns);
    if let (Some(a), Some(b)) = (&first.albedo, &last.albedo) {
        (0..3).all(|c| (a[[y, x, c]] - around.sample(|y, x| b[[y, x, c]])).abs() < ALBEDO).then_some(())?;
    }
    if let (Some(a), Some(b)) = (&first.normal, &last.normal) {
        (0..3).all(|c| (a[[y, x, c]] - around.sample(|y, x| b[[y, x, c]])).abs() < NORMAL).then_some(())?;
    }
    if let (Some(a), Some(b)) = (&first.depth, &last.depth) {
        same_depth(front(a[[y, x]]), around.sample(|y, x| front(b[[y, x]]))).then_some(())?;
    }
    let reflects =
        |f: &Frame, y: usize, x: usize, c: usize| f.albedo.as_ref().map_or(1.0, |a| a[[y, x, c]].clamp(0.0, 1.0) + DARK);
    let colour = [0, 1, 2].map(|c| {
        let bare = |y: usize, x: usize| light[[y, x, c]] / reflects(last, y, x, c);
        around.sample(bare) * reflects(first, y, x, c)
    });
    colour.iter().all(|v| v.is_finite()).then_some(colour)
}

fn same_depth(own: f32, other: f32) -> bool {
    own == other || (own - other).abs() <= DEPTH * own.abs()
}

/// The four pixels around a place.
struct Bilinear {
    row: [usize; 2],
    column: [usize; 2],
    weights: [f32; 4],
}

impl Bilinear {
    fn new((x, y): (f32, f32), rows: usize, columns: usize) -> Self {
        let (left, top) = (x as usize, y as usize);
        let (fx, fy) = (x - left as f32, y - top as f32);
        Self {
            row: [top, (top + 1).min(rows - 1)],
            column: [left, (left + 1).min(columns - 1)],
            weights: [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy],
        }
    }

    fn sample(&self, value: impl Fn(usize, usize) -> f32) -> f32 {
        // A weight of zero must not let a NaN in.
        let part =
            |i: usize| if self.weights[i] > 0.0 { self.weights[i] * value(self.row[i / 2], self.column[i % 2]) } else { 0.0 };
        (0..4).map(part).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 0…1 by position and seed.
    fn random(seed: u64, y: usize, x: usize, c: usize) -> f32 {
        let mut z = seed;
        for i in [y, x, c] {
            z = (z ^ (i as u64 + 0x9e37)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z ^= z >> 31;
        }
        (z >> 40) as f32 / (1u64 << 24) as f32
    }

    const SIZE: (usize, usize) = (96, 128);

    /// The light that moves two pixels to the right a frame over a surface of changing albedo, and what was rendered of it.
    fn truth(t: usize) -> (Array3<f32>, Array3<f32>) {
        let albedo = Array3::from_shape_fn((SIZE.0, SIZE.1, 3), |(y, x, c)| {
            let at = x as f32 - 2.0 * t as f32;
            0.4 + 0.3 * (at * 0.9 + c as f32).sin() * (y as f32 * 0.7).cos()
        });
        let colour = albedo.mapv(|a| (a + DARK) * 1.5);
        (colour, albedo)
    }

    fn frame(t: usize, seed: u64) -> Frame {
        let (colour, albedo) = truth(t);
        // Uniform noise of mean 1, as heavy as Cycles' at few samples.
        let noisy = Array3::from_shape_fn(colour.dim(), |(y, x, c)| colour[[y, x, c]] * 2.0 * random(seed + t as u64, y, x, c));
        let mut frame = Frame::new(noisy);
        frame.albedo = Some(albedo);
        frame.vector = Some(Array3::from_shape_fn((SIZE.0, SIZE.1, 4), |(_, _, c)| [-2.0, 0.0, -2.0, 0.0][c]));
        frame
    }

    fn observed(k: usize, seed: u64) -> Observed {
        let frames: Vec<Frame> = (0..=2 * k).map(|t| frame(t, seed)).collect();
        Observed::new(&frames).ok().unwrap()
    }

    #[test]
    fn the_estimate_is_the_true_error_within_its_deviation() {
        for (k, level) in [(1, 0.0), (1, 0.1), (3, 0.3), (4, 0.05)] {
            let (clean, _) = truth(k);
            let wrong =
                Array3::from_shape_fn(clean.dim(), |(y, x, c)| clean[[y, x, c]] * (1.0 + level * (random(9, y, x, c) - 0.4)));
            let mut misses = Vec::new();
            for seed in 0..12 {
                let seen = observed(k, 1000 * seed + 7);
                let g = wrong.view();
                let (found, expected) = (seen.estimate(wrong.view(), g), seen.measure(wrong.view(), clean.view(), g));
                assert!(found.share > 0.7 && found.deviation > 0.0, "{found:?}");
                misses.push((found.relmse - expected) / found.deviation);
            }
            let (mean, worst) = (misses.iter().sum::<f64>() / 12.0, misses.iter().fold(0.0f64, |m, v| m.max(v.abs())));
            assert!(mean.abs() < 1.0 && worst < 3.5, "k {k}, level {level}: {misses:?}");
        }
    }

    #[test]
    fn the_noisy_frame_itself_has_its_variance() {
        let seen = observed(1, 3);
        let noisy = frame(1, 999);
        let (clean, noisy) = (truth(1).0, noisy.colour.view());
        let (found, expected) = (seen.estimate(noisy, clean.view()), seen.measure(noisy, clean.view(), clean.view()));
        assert!((found.relmse / expected - 1.0).abs() < 0.1, "{found:?} {expected}");
    }

    #[test]
    fn a_firefly_that_is_left_is_not_divided_by_itself() {
        let (seen, (clean, _)) = (observed(1, 3), truth(1));
        let mut left = clean.clone();
        let ((y, x), _) = seen.trusted.indexed_iter().find(|(_, trusted)| **trusted).unwrap();
        left.slice_mut(ndarray::s![y, x, ..]).fill(1000.0);
        let counted = 3.0 * seen.trusted.iter().filter(|t| **t).count() as f64;
        let found = seen.estimate(left.view(), clean.view());
        // Divided by itself it would count as 1.
        assert!(found.relmse * counted > 1e5, "{found:?}");
    }

    #[test]
    fn what_cannot_be_followed_is_not_trusted() {
        let frames = |change: &dyn Fn(&mut [Frame])| {
            let mut frames: Vec<Frame> = (0..3).map(|t| frame(t, 5)).collect();
            change(&mut frames);
            Observed::new(&frames).map(|o| o.estimate(frames[1].colour.view(), frames[1].colour.view()))
        };
        assert_eq!(frames(&|f| f[1].vector = None).err(), Some(Unseen::NoMotion));
        assert_eq!(frames(&|f| f[0].vector.as_mut().unwrap().fill(9.0)).err(), Some(Unseen::Lost));
        assert_eq!(frames(&|f| f[2].albedo.as_mut().unwrap().fill(0.9)).err(), Some(Unseen::Lost));
        let whole = frames(&|_| ()).unwrap().share;
        let holed = frames(&|f| f[2].colour.slice_mut(ndarray::s![20..40, 20..40, ..]).fill(f32::NAN)).unwrap();
        assert!(holed.share < whole && holed.relmse.is_finite());
        // As far away as Blender 5.2 says, which depends on a frame's samples, the background is the background.
        let sky = |depths: [f32; 3]| {
            let set = |f: &mut [Frame]| f.iter_mut().zip(depths).for_each(|(f, z)| f.depth = Some(Array2::from_elem(SIZE, z)));
            frames(&set).unwrap().share
        };
        assert_eq!((sky([0.0; 3]), sky([64.0, 48.0, 16.0].map(|samples| f32::MAX / samples))), (whole, whole));
        let still = frames(&|f| {
            f.iter_mut().for_each(|f| f.vector.as_mut().unwrap().fill(0.0));
            let first = f[0].clone();
            f[1..].iter_mut().for_each(|f| *f = first.clone());
        });
        assert_eq!(still.err(), Some(Unseen::SameNoise));
    }
}
