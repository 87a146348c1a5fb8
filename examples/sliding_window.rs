//! A shot as a stream: each frame goes in once and comes out as soon as the ones after it are there to help.
//!
//!     cargo run --release --example sliding_window

use std::path::Path;

use hush::io::sequence::Sequence;
use hush::io::{Selection, read_frame, read_layout, resolve};
use hush::{Denoiser, Engine, Settings};
use ndarray::Array3;

/// Frames on each side that help. More than two help little; each costs memory and time.
const WINDOW: usize = 2;

fn main() -> hush::Result<()> {
    let mut denoiser = Denoiser::new(Engine::new(Settings::default())?, WINDOW)?;
    let shot = Sequence::find(&[Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/shot")])?;
    let (mut noisy, mut ready) = (Vec::new(), Vec::new());
    for file in &shot.frames {
        let layout = read_layout(&file.path)?;
        let frame = read_frame(&layout, &resolve(&layout, &Selection::default())?)?;
        // A corner is enough to see how it goes; leave out `part` for the whole.
        let corner = frame.view().part(80..208, 160..320);
        noisy.push(corner.colour.to_owned());
        // λ 1, the cleanest. What comes back lags two frames behind.
        ready.extend(denoiser.push(&corner, 1.0, file.number)?);
    }
    // The last frames have no more to wait for.
    ready.extend(denoiser.flush()?);
    let (numbers, denoised): (Vec<i64>, Vec<Array3<f32>>) = ready.into_iter().map(|(n, frame)| (n, frame.colour)).unzip();
    assert!(shot.frames.iter().map(|file| file.number).eq(numbers));

    // From frame to frame the noise is new each time. What changes in the denoised ones is what moves.
    let change = |frames: &[Array3<f32>]| {
        let each = frames.windows(2).map(|pair| (&pair[1] - &pair[0]).mapv(f32::abs).mean().unwrap_or(f32::NAN));
        each.sum::<f32>() / (frames.len() - 1) as f32
    };
    let (before, after) = (change(&noisy), change(&denoised));
    println!("{} frames; mean change from frame to frame: {before:.4} noisy, {after:.4} denoised", denoised.len());
    assert!(after < 0.75 * before, "the noise no longer flickers");
    Ok(())
}
