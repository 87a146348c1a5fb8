//! What the values of a pass may be: everything else is brought into these ranges before it is computed with.

/// The brightest radiance that is kept as it is; more is clamped so that sums stay finite.
pub const MAX_RADIANCE: f32 = 1e35;
/// Depths from here on are background: Cycles' Depth pass has 1e10, Denoising Depth in Blender 5.2 the greatest float over the
/// pixel's samples, also where only one of them saw the background. That of 5.3 is made 0 as it is read.
const BACKGROUND_DEPTH: f32 = 1e9;
/// Nearer is no depth either: one over the mean depth, and any depth times it, must be finite.
const NEAREST_DEPTH: f32 = 1e-20;

/// A finite colour in 0…[`MAX_RADIANCE`].
pub fn radiance(v: f32) -> f32 {
    v.clamp(0.0, MAX_RADIANCE)
}

/// A guide's value in low…1; NaN is 0.
pub fn bounded(v: f32, low: f32) -> f32 {
    if v.is_nan() { 0.0 } else { v.clamp(low, 1.0) }
}

/// A depth in front of the background, else 0.
pub fn front(z: f32) -> f32 {
    if z > NEAREST_DEPTH && z < BACKGROUND_DEPTH { z } else { 0.0 }
}
