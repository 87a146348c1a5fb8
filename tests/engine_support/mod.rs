//! Synthetic frames and small engines for the tests of the engine.
#![allow(dead_code, reason = "each test file uses its own part")]

use hush::engine::Isa;
use hush::engine::Skip;
use hush::engine::Weights;
use hush::{Denoised, EncodedFrame, Engine, Frame, Settings};
use ndarray::{Array2, Array3};

/// A network of random weights, small: for everything that must hold whatever the weights are.
pub const SMALL_MODEL: &[u8] = include_bytes!("../data/golden_model.safetensors");

/// The small network, which has a second pass, and does it.
pub fn small_of(settings: Settings) -> Engine {
    let weights = Weights::from_bytes("golden", SMALL_MODEL).unwrap();
    Engine::from_weights(&weights, Settings { second_pass: true, ..settings }).unwrap()
}

/// The small network.
pub fn small_with(isa: Option<Isa>, memory: Option<u64>) -> Engine {
    small_of(Settings { isa, memory, ..Settings::default() })
}

/// The small network that leaves out what `skip` says.
pub fn small_skipping(skip: Skip) -> Engine {
    small_of(Settings { skip, ..Settings::default() })
}

/// The small network with default settings.
pub fn small() -> Engine {
    small_with(None, None)
}

/// A number in 0…1 that depends on the seed and three indices only.
pub fn random(seed: u64, a: usize, b: usize, c: usize) -> f32 {
    let mut z = seed.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    for i in [a, b, c] {
        z = (z ^ (i as u64 + 0x51_7cc1)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z ^= z >> 29;
        z = z.wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 32;
    }
    (z >> 40) as f32 / (1u64 << 24) as f32
}

/// An image of (rows, columns, channels) random numbers in 0…1.
pub fn noise(seed: u64, rows: usize, columns: usize, channels: usize) -> Array3<f32> {
    Array3::from_shape_fn((rows, columns, channels), |(y, x, c)| random(seed, y, x, c))
}

/// A colour that spans six decades.
pub fn colour(seed: u64, rows: usize, columns: usize) -> Array3<f32> {
    noise(seed, rows, columns, 3).mapv(|v| 10.0f32.powf(6.0 * v - 3.0))
}

/// A frame of a beauty and vectors of a few pixels.
pub fn plain(seed: u64, rows: usize, columns: usize) -> Frame {
    let mut frame = Frame::new(colour(seed, rows, columns));
    frame.vector = Some(noise(seed ^ 0x77, rows, columns, 4).mapv(|v| 6.0 * v - 3.0));
    frame
}

/// A frame with every guide.
pub fn guided(seed: u64, rows: usize, columns: usize) -> Frame {
    let mut frame = plain(seed, rows, columns);
    frame.albedo = Some(noise(seed ^ 0x11, rows, columns, 3));
    frame.normal = Some(noise(seed ^ 0x22, rows, columns, 3).mapv(|v| 2.0 * v - 1.0));
    frame.depth = Some(Array2::from_shape_fn((rows, columns), |(y, x)| 20.0 * random(seed ^ 0x33, y, x, 0)));
    frame
}

/// A frame with every pass: guides, alpha, two light passes.
pub fn full(seed: u64, rows: usize, columns: usize) -> Frame {
    let mut frame = guided(seed, rows, columns);
    frame.alpha = Some(Array2::from_shape_fn((rows, columns), |(y, x)| random(seed ^ 0x44, y, x, 0)));
    split(&mut frame, seed, 2);
    frame
}

/// Gives a frame `parts` light passes that sum to its colour.
pub fn split(frame: &mut Frame, seed: u64, parts: usize) {
    let shares = |y, x, c| -> Vec<f32> { (0..parts).map(|p| random(seed ^ (0x55 + p as u64), y, x, c) + 1e-3).collect() };
    let images = (0..parts).map(|p| {
        Array3::from_shape_fn(frame.colour.dim(), |(y, x, c)| {
            let all = shares(y, x, c);
            frame.colour[[y, x, c]] * all[p] / all.iter().sum::<f32>()
        })
    });
    let named = images.enumerate().map(|(p, image)| hush::Aov { name: format!("Pass {p}"), image });
    frame.aovs = named.collect();
}

/// Encodes a run of frames.
pub fn encode(engine: &Engine, frames: impl IntoIterator<Item = Frame>) -> Vec<EncodedFrame> {
    frames.into_iter().map(|f| engine.encode(f).unwrap()).collect()
}

/// Denoises one of a run of frames with up to `window` frames on each side.
pub fn denoise(engine: &Engine, frames: &[EncodedFrame], centre: usize, window: usize, lambda: f32) -> Denoised {
    engine.denoise(&frames[centre], &around(frames, centre, window), lambda).unwrap()
}

/// The neighbours of one of a run of frames.
pub fn around(frames: &[EncodedFrame], centre: usize, window: usize) -> Vec<(i32, &EncodedFrame)> {
    let offset = |i: usize| i as i32 - centre as i32;
    let near = frames.iter().enumerate().map(|(i, f)| (offset(i), f));
    near.filter(|(o, _)| *o != 0 && o.unsigned_abs() as usize <= window).collect()
}

/// Every value of a result as bits, in order: equal only where the results are the same to the last bit.
pub fn bits(denoised: &Denoised) -> Vec<u32> {
    let alpha = denoised.alpha.iter().flatten();
    let aovs = denoised.aovs.iter().flat_map(|a| a.image.iter());
    denoised.colour.iter().chain(alpha).chain(aovs).map(|v| v.to_bits()).collect()
}

/// The greatest of some differences; what is no number is greater than any.
pub fn greatest(differences: impl IntoIterator<Item = f32>) -> f32 {
    differences.into_iter().fold(0.0, |most, d| if d.is_nan() { f32::INFINITY } else { most.max(d) })
}

/// Panics unless the result has the size and is an image: finite, no negative light, alpha in 0…1.
pub fn assert_sane(what: &str, denoised: &Denoised, rows: usize, columns: usize) {
    assert_eq!(denoised.colour.dim(), (rows, columns, 3), "{what}");
    for (at, v) in denoised.colour.indexed_iter() {
        assert!(v.is_finite() && *v >= 0.0, "{what}: colour {v} at {at:?}");
    }
    for (at, v) in denoised.alpha.iter().flat_map(|a| a.indexed_iter()) {
        assert!((0.0..=1.0).contains(v), "{what}: alpha {v} at {at:?}");
    }
    for aov in &denoised.aovs {
        assert_eq!(aov.image.dim(), (rows, columns, 3), "{what}: {}", aov.name);
        assert!(aov.image.iter().all(|v| v.is_finite()), "{what}: {}", aov.name);
    }
}
