//! A weights file, and a frame denoised with it where it is taken.

use std::path::Path;

use hush::{Engine, Frame, Settings};
use ndarray::Array3;
use serde_json::Value;

use super::{named, put};

/// Tensors are made for headers that want no more than this.
const MOST_BYTES: usize = 4 << 20;

/// The input is the file, or only its header, which then gets its length in front and tensors of small numbers behind it.
pub fn check(folder: &Path, bytes: &[u8]) -> hush::Result<()> {
    let path = folder.join("model.safetensors");
    match bytes.first() {
        Some(b'{') => put(&path, &completed(bytes)),
        _ => put(&path, bytes),
    }
    let engine = named(&path, Engine::from_file(&path, Settings::default()))?;
    let frames = (1..4).map(|t| {
        let mut frame = Frame::new(Array3::from_shape_fn((5, 9, 3), |(y, x, c)| ((y * 7 + x * 3 + c + t) % 5) as f32));
        frame.vector = Some(Array3::from_elem((5, 9, 4), 0.5));
        engine.encode(frame)
    });
    let frames = frames.collect::<hush::Result<Vec<_>>>()?;
    let denoised = engine.denoise(&frames[1], &[(-1, &frames[0]), (1, &frames[2])], 2.0)?;
    assert_eq!(denoised.colour.dim(), (5, 9, 3));
    Ok(())
}

fn completed(header: &[u8]) -> Vec<u8> {
    let parsed: Value = serde_json::from_slice(header).unwrap_or_default();
    let ends = parsed.as_object().into_iter().flatten().filter_map(|(_, tensor)| tensor["data_offsets"][1].as_u64());
    let length = ends.max().unwrap_or(0).min(MOST_BYTES as u64) as usize;
    let numbers = (0..length / 4).flat_map(|i| (((i * 31) % 17) as f32 * 0.01 - 0.08).to_le_bytes());
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend(header);
    bytes.extend(numbers.chain([0; 3]).take(length));
    bytes
}
