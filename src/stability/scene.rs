//! Frames made by rule: a moving, textured, noisy scene with every pass.

use ndarray::{Array2, Array3};

use crate::{Aov, Frame};

/// Pixels (right, down) that the scene moves a frame.
pub const MOTION: (f32, f32) = (3.25, -1.5);

/// A number in 0…1 that depends on its arguments only.
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

fn image(rows: usize, columns: usize, channels: usize, of: impl Fn(usize, usize, usize) -> f32) -> Array3<f32> {
    Array3::from_shape_fn((rows, columns, channels), |(y, x, c)| of(y, x, c))
}

/// Where a pixel of frame `t` lies on the moving texture.
fn place(t: usize, y: usize, x: usize) -> (f32, f32) {
    (x as f32 - MOTION.0 * t as f32, y as f32 - MOTION.1 * t as f32)
}

/// Frame `t` without noise: a checker of two materials under a soft light, (rows, columns, 3).
pub fn clean(t: usize, rows: usize, columns: usize) -> Array3<f32> {
    let albedo = albedo(t, rows, columns);
    image(rows, columns, 3, |y, x, c| {
        let (u, v) = place(t, y, x);
        albedo[[y, x, c]] * (0.6 + 0.4 * (0.11 * u + 0.7 * c as f32).sin() * (0.09 * v).cos())
    })
}

fn albedo(t: usize, rows: usize, columns: usize) -> Array3<f32> {
    image(rows, columns, 3, |y, x, c| {
        let (u, v) = place(t, y, x);
        let light = ((u / 11.0).floor() + (v / 9.0).floor()).rem_euclid(2.0) > 0.5;
        if light { [0.8, 0.7, 0.55][c] } else { [0.12, 0.2, 0.3][c] }
    })
}

/// What a few samples of a light make of 1: positive, of mean 1.
fn samples(seed: u64, t: usize, y: usize, x: usize) -> f32 {
    let one = |i: usize| -random(seed ^ (t as u64) << 32, y, x, i).max(1e-6).ln();
    0.5 * (one(0) + one(1))
}

/// Frame `t`, noisy, with every guide, alpha and one light pass; `seed` changes the noise alone.
pub fn frame(seed: u64, t: usize, rows: usize, columns: usize) -> Frame {
    let mut colour = clean(t, rows, columns);
    colour.indexed_iter_mut().for_each(|((y, x, _), v)| *v *= samples(seed, t, y, x));
    let light = image(rows, columns, 3, |y, x, c| colour[[y, x, c]] * random(seed ^ 0x55, y, x, t));
    let mut frame = Frame::new(colour);
    frame.albedo = Some(albedo(t, rows, columns));
    frame.normal = Some(image(rows, columns, 3, |y, x, c| {
        let (u, v) = place(t, y, x);
        [(0.11 * u).sin() * 0.5, (0.09 * v).sin() * 0.5, 0.7][c]
    }));
    frame.depth = Some(Array2::from_shape_fn((rows, columns), |(y, x)| 4.0 + 0.02 * y as f32 + 0.01 * x as f32));
    frame.vector = Some(image(rows, columns, 4, |_, _, c| [-MOTION.0, MOTION.1, -MOTION.0, MOTION.1][c]));
    frame.alpha = Some(Array2::from_shape_fn((rows, columns), |(y, x)| random(seed ^ 0x44, y, x, t).mul_add(0.5, 0.5)));
    frame.aovs = vec![Aov { name: "Light".into(), image: light }];
    frame
}
