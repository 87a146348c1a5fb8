//! A shot as a stream: each frame is encoded once, waits in the window, helps its neighbours, and is denoised with their help.
//!
//!     cargo run --release --example sliding_window

use std::collections::VecDeque;
use std::path::Path;

use hush::io::sequence::Sequence;
use hush::io::{Selection, read_frame, read_layout, resolve};
use hush::{EncodedFrame, Engine, Settings};
use ndarray::Array3;

/// Frames on each side that help. More than two help little; each costs memory and time.
const WINDOW: usize = 2;

fn main() -> hush::Result<()> {
    let engine = Engine::new(Settings::default())?;
    let shot = Sequence::find(&[Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/shot")])?;
    let (mut noisy, mut denoised) = (Vec::new(), Vec::new());

    // The frames around the next one to be denoised, oldest first, and where that one stands among them.
    let mut window: VecDeque<EncodedFrame> = VecDeque::new();
    let mut centre = 0;
    let mut files = shot.frames.iter();
    loop {
        // Take in frames until the window reaches far enough ahead, or the shot ends.
        while window.len() <= centre + WINDOW
            && let Some(file) = files.next()
        {
            let layout = read_layout(&file.path)?;
            let frame = read_frame(&layout, &resolve(&layout, &Selection::default())?)?;
            // A corner is enough to see how it goes; leave out `part` for the whole.
            let corner = frame.view().part(80..208, 160..320);
            noisy.push(corner.colour.to_owned());
            window.push_back(engine.encode_view(&corner)?);
        }
        let Some(frame) = window.get(centre) else { break };

        // Neighbours are told by how far they are away; before the first frame and after the last there are fewer.
        let offsets = (0..window.len()).map(|i| (i as i32 - centre as i32, &window[i]));
        let neighbours: Vec<_> = offsets.filter(|(offset, _)| *offset != 0).collect();
        denoised.push(engine.denoise(frame, &neighbours, 1.0)?.colour);

        // Slide on. A frame that no later one needs goes, and its memory with it.
        match centre == WINDOW {
            true => _ = window.pop_front(),
            false => centre += 1,
        }
    }

    // From frame to frame the noise is new each time. What changes in the denoised ones is what moves.
    let change = |frames: &[Array3<f32>]| {
        let each = frames.windows(2).map(|pair| (&pair[1] - &pair[0]).mapv(f32::abs).mean().unwrap_or(f32::NAN));
        each.sum::<f32>() / (frames.len() - 1) as f32
    };
    let (before, after) = (change(&noisy), change(&denoised));
    println!("{} frames; mean change from frame to frame: {before:.4} noisy, {after:.4} denoised", denoised.len());
    assert_eq!(denoised.len(), shot.frames.len());
    assert!(after < 0.75 * before, "the noise no longer flickers");
    Ok(())
}
