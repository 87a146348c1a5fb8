//! One frame in memory: pixels in, pixels out, no files.
//!
//!     cargo run --release --example one_frame

use hush::{Engine, Frame, Settings};
use ndarray::Array3;

fn main() -> hush::Result<()> {
    // A wall that is lit from the left. Images are (rows, columns, channels) of linear light.
    let clean = Array3::from_shape_fn((96, 128, 3), |(_, x, c)| (0.2 + 0.006 * x as f32) * [1.0, 0.9, 0.7][c]);

    // What a path tracer makes of it with few samples: right on average, and far off in each pixel.
    let mut state = 1u32;
    let mut random = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    };
    let noisy = clean.mapv(|light| light * 2.0 * random());

    // A frame is its beauty and what else the renderer knows. Each guide that is there helps; none has to be.
    let mut frame = Frame::new(noisy.clone());
    frame.albedo = Some(Array3::from_shape_fn(clean.dim(), |(_, _, c)| [1.0, 0.9, 0.7][c]));

    // The engine holds the network and is made once, for all frames.
    let engine = Engine::new(Settings::default())?;

    // Denoising has two steps: what can be said of a frame alone, and what comes of it and its neighbours. Here are none.
    // λ = 1 is the cleanest; up to 64 keeps ever more of the grain.
    let encoded = engine.encode(frame)?;
    let denoised = engine.denoise(&encoded, &[], 1.0)?;

    let error = |image: &Array3<f32>| (image - &clean).mapv(f32::abs).mean().unwrap_or(f32::NAN);
    let (before, after) = (error(&noisy), error(&denoised.colour));
    println!("mean error: {before:.4} noisy, {after:.4} denoised");
    assert!(after < before / 4.0, "the noise is gone");
    Ok(())
}
