//! The cases: a scene of a size, and what is done to its passes.

use ndarray::{Array3, s};

use super::scene::{self, random};
use crate::{Denoised, EncodedFrame, Engine, Frame, Result};

/// Something that a renderer should not do, or that is hard on numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hazard {
    /// Colours from 1e-30 to 1e30.
    HighRange,
    /// Colours below the least normal float.
    Subnormal,
    /// Suns: a pixel in a hundred is a million to a billion times too bright.
    Fireflies,
    /// One pixel of 1e30.
    OneHuge,
    Black,
    /// Every pass of one value.
    Constant,
    /// Black but for one pixel.
    OneLit,
    /// NaN, ±Inf, negative and largest values in a pixel in eight of a pass.
    BadColour,
    BadAlbedo,
    BadNormal,
    BadDepth,
    BadVector,
    BadAlpha,
    BadLight,
    /// A square of NaN, 31 pixels wide, in the centre frame alone.
    Hole,
    /// A square of NaN in every frame.
    HoleEverywhere,
    AlbedoZero,
    /// Albedo up to 3.
    AlbedoAbove,
    /// Albedo of 1e4 where something glows.
    AlbedoEmission,
    /// Depths of 0, 1e10 and Inf side by side.
    DepthOdd,
    /// Normals of length 0 and 100.
    NormalOdd,
    /// Vectors of ±1e9.
    VectorFar,
    VectorNan,
    /// Vectors that change by tens of pixels from block to block.
    VectorTorn,
    /// Every frame is the first.
    Identical,
    /// After the centre another, brighter shot.
    Cut,
}

use Hazard::*;

/// All hazards.
pub const HAZARDS: [Hazard; 26] = [
    HighRange,
    Subnormal,
    Fireflies,
    OneHuge,
    Black,
    Constant,
    OneLit,
    BadColour,
    BadAlbedo,
    BadNormal,
    BadDepth,
    BadVector,
    BadAlpha,
    BadLight,
    Hole,
    HoleEverywhere,
    AlbedoZero,
    AlbedoAbove,
    AlbedoEmission,
    DepthOdd,
    NormalOdd,
    VectorFar,
    VectorNan,
    VectorTorn,
    Identical,
    Cut,
];

/// From the middle of a hole to its edge, in pixels.
pub(super) const HOLE: usize = 15;

/// What bad pixels hold.
const BAD: [f32; 6] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -5.0, f32::MAX, f32::MIN];

/// A run of frames of which one is denoised.
#[derive(Clone, Debug)]
pub struct Case {
    /// What it is.
    pub name: String,
    /// Rows of each frame.
    pub rows: usize,
    /// Columns of each frame.
    pub columns: usize,
    /// Frames in the shot.
    pub frames: usize,
    /// The one that is denoised.
    pub centre: usize,
    /// Frames on each side that may help, 0…3.
    pub window: usize,
    /// Of its noise.
    pub seed: u64,
    /// Applied in order.
    pub hazards: Vec<Hazard>,
}

impl Case {
    /// Five frames with one hazard, the middle one denoised.
    fn of(name: &str, hazards: &[Hazard]) -> Self {
        Self { name: name.into(), rows: 44, columns: 53, frames: 5, centre: 2, window: 2, seed: 1, hazards: hazards.into() }
    }

    fn sized(name: &str, rows: usize, columns: usize) -> Self {
        Self { rows, columns, ..Self::of(name, &[]) }
    }

    /// The cases of the table.
    pub fn all() -> Vec<Self> {
        let mut out = vec![
            Self::of("nothing odd", &[]),
            Self::of("1e-30 to 1e30", &[HighRange]),
            Self::of("subnormals", &[Subnormal]),
            Self::of("fireflies", &[Fireflies]),
            Self::of("one pixel of 1e30", &[OneHuge]),
            Self::of("black", &[Black]),
            Self::of("constant", &[Constant]),
            Self::of("one lit pixel", &[OneLit]),
            Self::of("bad colour", &[BadColour]),
            Self::of("bad albedo", &[BadAlbedo]),
            Self::of("bad normal", &[BadNormal]),
            Self::of("bad depth", &[BadDepth]),
            Self::of("bad vector", &[BadVector]),
            Self::of("bad alpha", &[BadAlpha]),
            Self::of("bad light pass", &[BadLight]),
            Self::of("hole of NaN, centre frame", &[Hole]),
            Self::of("hole of NaN, every frame", &[HoleEverywhere]),
            Self::of("albedo 0", &[AlbedoZero]),
            Self::of("albedo above 1", &[AlbedoAbove]),
            Self::of("albedo 1e4", &[AlbedoEmission]),
            Self::of("depth 0, 1e10, Inf", &[DepthOdd]),
            Self::of("normals of 0 and 100", &[NormalOdd]),
            Self::of("vectors of ±1e9", &[VectorFar]),
            Self::of("vectors of NaN", &[VectorNan]),
            Self::of("torn vectors", &[VectorTorn]),
            Self::of("identical frames", &[Identical]),
            Self::of("cut in the window", &[Cut]),
            Self::of("much at once", &[HighRange, BadColour, BadAlbedo, BadNormal, BadDepth, BadVector, BadAlpha, BadLight]),
            Self { frames: 2, centre: 0, window: 3, ..Self::of("shot of 2, window 3", &[]) },
            Self { frames: 1, centre: 0, window: 3, ..Self::of("shot of 1, window 3", &[]) },
            Self { frames: 7, centre: 3, window: 3, ..Self::of("window 3", &[VectorTorn]) },
        ];
        let sizes = [("1×1", 1, 1), ("2×1", 1, 2), ("9×17", 17, 9), ("1×300", 300, 1), ("640×24", 24, 640)];
        out.extend(sizes.map(|(name, rows, columns)| Self::sized(name, rows, columns)));
        out.push(Self { frames: 3, centre: 1, window: 1, ..Self::sized("16384×8", 8, 16384) });
        out
    }

    /// A case that a seed makes up: size, place in the shot, hazards.
    pub fn random(seed: u64) -> Self {
        let pick = |salt: usize, below: usize| (random(seed, salt, 0, 0) * below as f32) as usize % below;
        let frames = 1 + pick(0, 6);
        let hazards = (0..pick(1, 5)).map(|i| HAZARDS[pick(10 + i, HAZARDS.len())]).collect();
        Self {
            name: format!("made up {seed}"),
            rows: 1 + pick(2, 47),
            columns: 1 + pick(3, 79),
            frames,
            centre: pick(4, frames),
            window: pick(5, 4),
            seed,
            hazards,
        }
    }

    /// The frames around the centre.
    pub(super) fn around<'a>(&self, encoded: &'a [EncodedFrame]) -> Vec<(i32, &'a EncodedFrame)> {
        let offset = |i: usize| i as i32 - self.centre as i32;
        let near = encoded.iter().enumerate().map(|(i, f)| (offset(i), f));
        near.filter(|(o, _)| *o != 0 && o.unsigned_abs() as usize <= self.window).collect()
    }

    /// The centre frame, denoised.
    pub(super) fn denoise(&self, engine: &Engine, frames: &[Frame], lambda: f32) -> Result<Denoised> {
        let encoded = frames.iter().map(|f| engine.encode(f.clone())).collect::<Result<Vec<_>>>()?;
        engine.denoise(&encoded[self.centre], &self.around(&encoded), lambda)
    }

    /// Its frames.
    pub fn build(&self) -> Vec<Frame> {
        (0..self.frames).map(|t| self.frame(t)).collect()
    }

    fn frame(&self, t: usize) -> Frame {
        let t = if self.hazards.contains(&Identical) { 0 } else { t };
        let mut frame = scene::frame(self.seed, t, self.rows, self.columns);
        for (i, hazard) in self.hazards.iter().enumerate() {
            self.spoil(*hazard, t, self.seed.wrapping_mul(31).wrapping_add(i as u64), &mut frame);
        }
        frame
    }

    fn spoil(&self, hazard: Hazard, t: usize, seed: u64, frame: &mut Frame) {
        let seed = seed ^ (t as u64) << 40;
        let chance = |y: usize, x: usize, share: f32| random(seed, y, x, 7) < share;
        let value = |y: usize, x: usize, c: usize| BAD[(random(seed, y, x, 20 + c) * 5.999) as usize];
        let bad = |pass: &mut Array3<f32>| {
            for ((y, x, c), v) in pass.indexed_iter_mut().filter(|((y, x, _), _)| chance(*y, *x, 0.125)) {
                *v = value(y, x, c);
            }
        };
        let middle = (self.rows / 2, self.columns / 2);
        match hazard {
            HighRange => frame.colour.indexed_iter_mut().for_each(|((y, x, c), v)| {
                *v = 10f32.powf(60.0 * random(seed, y, x, c) - 30.0);
            }),
            Subnormal => frame.colour.indexed_iter_mut().for_each(|((y, x, c), v)| {
                *v = f32::MIN_POSITIVE * random(seed, y, x, c);
            }),
            Fireflies => {
                frame.colour.indexed_iter_mut().filter(|((y, x, _), _)| chance(*y, *x, 0.01)).for_each(|((y, x, _), v)| {
                    *v *= 10f32.powf(6.0 + 3.0 * random(seed, y, x, 8));
                })
            }
            OneHuge => frame.colour.slice_mut(s![middle.0, middle.1, ..]).fill(1e30),
            Black => frame.colour.fill(0.0),
            Constant => {
                frame.colour.fill(0.5);
                frame.albedo.iter_mut().for_each(|a| a.fill(0.3));
                frame.alpha.iter_mut().for_each(|a| a.fill(1.0));
                frame.aovs.iter_mut().for_each(|a| a.image.fill(0.25));
            }
            OneLit => {
                frame.colour.fill(0.0);
                frame.colour[[middle.0, middle.1, 1]] = 50.0;
            }
            BadColour => bad(&mut frame.colour),
            BadAlbedo => frame.albedo.iter_mut().for_each(bad),
            BadNormal => frame.normal.iter_mut().for_each(bad),
            BadVector => frame.vector.iter_mut().for_each(bad),
            BadLight => frame.aovs.iter_mut().for_each(|a| bad(&mut a.image)),
            BadDepth | BadAlpha => {
                let pass = if hazard == BadDepth { &mut frame.depth } else { &mut frame.alpha };
                let spoilt = pass.iter_mut().flat_map(|p| p.indexed_iter_mut()).filter(|((y, x), _)| chance(*y, *x, 0.125));
                spoilt.for_each(|((y, x), v)| *v = value(y, x, 0));
            }
            Hole | HoleEverywhere => {
                if hazard == HoleEverywhere || t == self.centre {
                    let (rows, columns, _) = frame.colour.dim();
                    let around = |middle: usize, size: usize| middle.saturating_sub(HOLE)..(middle + HOLE + 1).min(size);
                    frame.colour.slice_mut(s![around(middle.0, rows), around(middle.1, columns), ..]).fill(f32::NAN);
                }
            }
            AlbedoZero => frame.albedo.iter_mut().for_each(|a| a.fill(0.0)),
            AlbedoAbove => frame.albedo.iter_mut().for_each(|a| *a *= 3.75),
            AlbedoEmission => {
                let glowing = frame.albedo.iter_mut().flat_map(|a| a.indexed_iter_mut());
                glowing.filter(|((y, x, _), _)| (y / 6 + x / 6) % 3 == 0).for_each(|(_, v)| *v = 1e4);
            }
            DepthOdd => frame.depth.iter_mut().flat_map(|d| d.indexed_iter_mut()).for_each(|((y, x), v)| {
                *v = [*v, 0.0, 1e10, f32::INFINITY][(y / 5 + x / 7) % 4];
            }),
            NormalOdd => frame.normal.iter_mut().flat_map(|n| n.indexed_iter_mut()).for_each(|((y, x, _), v)| {
                *v *= if (y / 4 + x / 4) % 2 == 0 { 0.0 } else { 100.0 };
            }),
            VectorFar => self.vectors(frame, |y, x, c, _| if random(seed, y, x, c) < 0.5 { 1e9 } else { -1e9 }),
            VectorNan => self.vectors(frame, |y, x, _, v| if chance(y, x, 0.5) { f32::NAN } else { v }),
            VectorTorn => self.vectors(frame, |y, x, c, v| v + 40.0 * (random(seed, y / 6, x / 6, c) - 0.5)),
            Identical => {}
            Cut => {
                if t > self.centre {
                    *frame = scene::frame(self.seed ^ 0xabc, t + 50, self.rows, self.columns);
                    frame.colour *= 1000.0;
                }
            }
        }
    }

    fn vectors(&self, frame: &mut Frame, of: impl Fn(usize, usize, usize, f32) -> f32) {
        let all = frame.vector.iter_mut().flat_map(|v| v.indexed_iter_mut());
        all.for_each(|((y, x, c), v)| *v = of(y, x, c, *v));
    }
}

/// A result as (rows, columns, values): colour, alpha, light passes.
pub(super) fn values(d: &Denoised) -> Array3<f32> {
    let (rows, columns, _) = d.colour.dim();
    let alpha = usize::from(d.alpha.is_some());
    Array3::from_shape_fn((rows, columns, 3 + alpha + 3 * d.aovs.len()), |(y, x, c)| match &d.alpha {
        _ if c < 3 => d.colour[[y, x, c]],
        Some(a) if c == 3 => a[[y, x]],
        _ => d.aovs[(c - 3 - alpha) / 3].image[[y, x, (c - 3 - alpha) % 3]],
    })
}
