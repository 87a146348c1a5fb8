//! The engine on small frames that no renderer should write: whatever comes in, an image comes out, and none of its pixels is
//! darker or brighter than what it was made of.

use std::path::Path;
use std::sync::LazyLock;

use arbitrary::Unstructured;
use hush::engine::Isa;
use hush::engine::Weights;
use hush::engine::{SILENT, Skip};
use hush::{Aov, Denoised, Engine, Frame, Settings};
use ndarray::{Array2, Array3, Axis, s};

/// A network of random weights: what is checked holds whatever they are.
const MODEL: &[u8] = include_bytes!("../../tests/data/golden_model.safetensors");
static ENGINES: LazyLock<Vec<Engine>> = LazyLock::new(|| {
    let weights = Weights::from_bytes("golden", MODEL).expect("the model loads");
    let with = |isa| Engine::from_weights(&weights, Settings { isa: Some(isa), ..Settings::default() }).expect("the model fits");
    Isa::available().into_iter().map(with).collect()
});

const NONE: Skip = Skip::NONE;
/// Radiance is clamped to this (`frame/packed.rs`).
const BRIGHTEST: f32 = 1e35;
/// Sides of a frame, most of them small: the cost grows with the area.
const SIDES: [usize; 16] = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 15, 16, 17, 24, 41];
/// Edges of what floats, Cycles and half-floats can say.
const ODD: [f32; 24] = [
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::MAX,
    f32::MIN,
    f32::MIN_POSITIVE,
    1e-40,
    -0.0,
    0.0,
    1.0,
    -1.0,
    0.5,
    -0.5,
    0.49999997,
    1.5,
    -40.0,
    65504.0,
    65520.0,
    1e9,
    9.99e8,
    1e10,
    1e-20,
    1e30,
    1e35,
];

type Read<T> = arbitrary::Result<T>;

/// The input is a description of frames and settings; bytes that are missing count as 0.
pub fn check(_folder: &Path, bytes: &[u8]) -> hush::Result<()> {
    let case = Case::read(&mut Unstructured::new(bytes)).expect("missing bytes are zeros");
    case.run()
}

/// Frames of a window, the middle one to be denoised.
struct Case {
    frames: Vec<Frame>,
    /// Which frames of the window are there.
    there: u8,
    lambda: f32,
    engine: usize,
    skip: Skip,
    /// Whether every pixel has the same albedo, or none.
    flat_albedo: bool,
}

impl Case {
    fn read(u: &mut Unstructured) -> Read<Self> {
        let lambda = match u.int_in_range(0..=7u8)? {
            7 => f32::from_bits(u.arbitrary()?),
            _ => 1.0 + f32::from(u.arbitrary::<u8>()?) / 4.0,
        };
        let (there, engine) = (u.arbitrary::<u8>()?, u.arbitrary::<u8>()?.into());
        let [constant, opaque, untrusted, still] = u.arbitrary()?;
        let skip = Skip { constant, opaque, untrusted, still };
        let (rows, columns) = (*u.choose(&SIDES)?, *u.choose(&SIDES)?);
        let window = u.int_in_range(0..=2)?;
        let passes: u8 = u.arbitrary()?;
        let flat_albedo = passes & 1 == 0 || u.arbitrary()?;
        let mut frames = Vec::new();
        for _ in 0..2 * window + 1 {
            frames.push(frame(u, (rows, columns), passes, flat_albedo)?);
        }
        for _ in 0..u.int_in_range(0..=24)? {
            edit(u, &mut frames, flat_albedo)?;
        }
        Ok(Self { frames, there, lambda, engine, skip, flat_albedo })
    }

    fn run(self) -> hush::Result<()> {
        let engine = &ENGINES[self.engine % ENGINES.len()];
        let centre = self.frames.len() / 2;
        let encoded = self.frames.iter().map(|f| engine.encode_view(&f.view())).collect::<hush::Result<Vec<_>>>()?;
        let offsets = (0..encoded.len()).map(|i| (i as i32 - centre as i32, &encoded[i]));
        let neighbours: Vec<_> = offsets.filter(|(offset, _)| *offset != 0 && self.there >> (offset + 3) & 1 == 0).collect();
        let (denoised, left_out) = engine.denoise_with(&encoded[centre], &neighbours, self.lambda, self.skip, SILENT)?;
        assert!((0.0..=1.0).contains(&left_out.constant), "{left_out:?}");
        assert_sane(&denoised, &self.frames[centre]);
        if self.flat_albedo {
            assert_inside(&denoised, self.hull());
        }
        if !self.skip.constant && self.skip != NONE {
            let (mut whole, _) = engine.denoise_with(&encoded[centre], &neighbours, self.lambda, NONE, SILENT)?;
            if let Some(alpha) = whole.alpha.as_mut().filter(|_| left_out.alpha) {
                // What is filtered may be a rounding away from the 1 that it is.
                assert!(alpha.iter().all(|a| (a - 1.0).abs() < 1e-6), "alpha is 1 all over the window");
                alpha.fill(1.0);
            }
            assert!(bits(&denoised) == bits(&whole), "leaving out with {:?} is exact", self.skip);
        }
        Ok(())
    }

    /// The range of each channel over the usable pixels of the window; down to black where a pixel is unusable.
    fn hull(&self) -> [(f32, f32); 3] {
        let mut hull = [(f32::INFINITY, 0.0f32); 3];
        for pixel in self.frames.iter().flat_map(|f| f.colour.lanes(Axis(2))) {
            let usable = pixel.iter().all(|v| v.is_finite());
            for (range, v) in hull.iter_mut().zip(pixel) {
                let v = if usable { v.clamp(0.0, BRIGHTEST) } else { 0.0 };
                *range = (range.0.min(v), range.1.max(v));
            }
        }
        hull
    }
}

/// A number at the edge of something, or any.
fn value(u: &mut Unstructured) -> Read<f32> {
    match u.arbitrary::<u8>()? {
        any @ 0..=23 => Ok(ODD[usize::from(any)]),
        24..=127 => Ok(f32::from(u.arbitrary::<i16>()?) / 256.0),
        _ => Ok(f32::from_bits(u.arbitrary()?)),
    }
}

/// Random numbers from −`centre` to 1 − `centre`, times a number.
fn noise(u: &mut Unstructured, size: (usize, usize, usize), centre: f32) -> Read<Array3<f32>> {
    let (seed, scale) = (u.arbitrary::<u32>()?, value(u)?);
    let random = |i: u32| {
        let z = (i ^ seed).wrapping_mul(0x9e37_79b9);
        let z = (z ^ (z >> 15)).wrapping_mul(0x2c1b_3c6d);
        ((z ^ (z >> 13)) >> 8) as f32 / 16_777_216.0
    };
    Ok(Array3::from_shape_fn(size, |(y, x, c)| scale * (random(((y * size.1 + x) * size.2 + c) as u32) - centre)))
}

/// A frame with the passes of which a bit is set.
fn frame(u: &mut Unstructured, (rows, columns): (usize, usize), passes: u8, flat_albedo: bool) -> Read<Frame> {
    let mut frame = Frame::new(noise(u, (rows, columns, 3), 0.0)?);
    if passes & 1 != 0 {
        frame.albedo = Some(match flat_albedo {
            true => Array3::from_elem((rows, columns, 3), 0.6),
            false => noise(u, (rows, columns, 3), 0.0)?,
        });
    }
    if passes & 2 != 0 {
        frame.normal = Some(noise(u, (rows, columns, 3), 0.5)?);
    }
    let plane = |image: Array3<f32>| -> Array2<f32> { image.index_axis_move(Axis(2), 0) };
    if passes & 4 != 0 {
        frame.depth = Some(plane(noise(u, (rows, columns, 1), 0.0)?));
    }
    // Without vectors no neighbour is used.
    if passes & 8 == 0 {
        frame.vector = Some(noise(u, (rows, columns, 4), 0.5)?);
    }
    if passes & 16 != 0 {
        frame.alpha = Some(plane(noise(u, (rows, columns, 1), 0.0)?));
    }
    for name in ["Diffuse Direct", "Emission"].into_iter().take(usize::from(passes >> 5 & 3)) {
        frame.aovs.push(Aov { name: name.into(), image: noise(u, (rows, columns, 3), 0.0)? });
    }
    Ok(frame)
}

/// Sets a pixel, a row, a column or all of a pass to one number.
fn edit<'a>(u: &mut Unstructured, frames: &'a mut [Frame], flat_albedo: bool) -> Read<()> {
    let index = u.choose_index(frames.len())?;
    let frame = &mut frames[index];
    let (pass, area, value) = (u.int_in_range(0..=6u8)?, u.int_in_range(0..=3u8)?, value(u)?);
    let plane = |p: &'a mut Option<Array2<f32>>| p.as_mut().map(|p| p.view_mut().insert_axis(Axis(2)));
    let image = match pass {
        1 => frame.albedo.as_mut().filter(|_| !flat_albedo).map(|p| p.view_mut()),
        2 => frame.normal.as_mut().map(|p| p.view_mut()),
        3 => frame.vector.as_mut().map(|p| p.view_mut()),
        4 => plane(&mut frame.depth),
        5 => plane(&mut frame.alpha),
        6 => frame.aovs.first_mut().map(|p| p.image.view_mut()),
        _ => Some(frame.colour.view_mut()),
    };
    let Some(mut image) = image else { return Ok(()) };
    let (rows, columns, channels) = image.dim();
    let (y, x, c) = (u.choose_index(rows)?, u.choose_index(columns)?, u.choose_index(channels)?);
    match area {
        0 => image[[y, x, c]] = value,
        1 => image.slice_mut(s![y, .., c]).fill(value),
        2 => image.slice_mut(s![.., x, ..]).fill(value),
        _ => image.fill(value),
    }
    Ok(())
}

/// The result has the frame's size and is an image: finite, no negative light, alpha in 0…1.
fn assert_sane(denoised: &Denoised, frame: &Frame) {
    assert_eq!(denoised.colour.dim(), frame.colour.dim());
    for (at, v) in denoised.colour.indexed_iter() {
        assert!(v.is_finite() && *v >= 0.0, "colour {v} at {at:?}");
    }
    assert!(denoised.alpha.is_some() || frame.alpha.is_none(), "an alpha stays; one may come of a neighbour");
    for (at, v) in denoised.alpha.iter().flat_map(|a| a.indexed_iter()) {
        assert!((0.0..=1.0).contains(v), "alpha {v} at {at:?}");
    }
    assert_eq!(denoised.aovs.len(), frame.aovs.len());
    for aov in &denoised.aovs {
        assert!(aov.image.dim() == frame.colour.dim() && aov.image.iter().all(|v| v.is_finite()), "{}", aov.name);
    }
}

/// Weights sum to one within rounding, which is 1e-5 of the values.
fn assert_inside(denoised: &Denoised, hull: [(f32, f32); 3]) {
    for ((y, x, c), v) in denoised.colour.indexed_iter() {
        let (low, high) = hull[c];
        assert!(*v >= low * (1.0 - 1e-5) && *v <= high * (1.0 + 1e-5), "{v} at {y}, {x}, {c} is not in {low}…{high}");
    }
}

fn bits(denoised: &Denoised) -> Vec<u32> {
    let images = denoised.aovs.iter().flat_map(|a| a.image.iter());
    denoised.colour.iter().chain(denoised.alpha.iter().flatten()).chain(images).map(|v| v.to_bits()).collect()
}
