//! Pixels as a picture.

use rayon::prelude::*;
use resvg::tiny_skia::{IntSize, Pixmap};

/// A picture of (rows, columns) with these colours, red, green and blue 0…255 each. None where there are no pixels.
pub fn pixmap(rows: usize, columns: usize, colour: impl Fn(usize, usize) -> [f64; 3] + Sync) -> Option<Pixmap> {
    let mut data = vec![255; 4 * rows * columns];
    data.par_chunks_exact_mut((4 * columns).max(1)).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.chunks_exact_mut(4).enumerate() {
            pixel.iter_mut().zip(colour(y, x)).for_each(|(to, v)| *to = v.round().clamp(0.0, 255.0) as u8);
        }
    });
    let size = IntSize::from_wh(u32::try_from(columns).ok()?, u32::try_from(rows).ok()?)?;
    Pixmap::from_vec(data, size)
}

/// As PNG; empty where there is no picture.
pub fn png(picture: Option<Pixmap>) -> Vec<u8> {
    picture.and_then(|p| p.encode_png().ok()).unwrap_or_default()
}
