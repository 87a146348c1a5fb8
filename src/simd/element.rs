//! Types in which values wait in memory; all are computed with as f32.

use half::f16;

use super::vector::Simd;

/// A type that sixteen lanes can be loaded from.
pub trait Element: Copy + Send + Sync {
    /// Sixteen values from `from[at..]`, widened to f32; panics if they are not there.
    fn load<S: Simd>(simd: S, from: &[Self], at: usize) -> S::V;
}

impl Element for f32 {
    #[inline(always)]
    fn load<S: Simd>(simd: S, from: &[Self], at: usize) -> S::V {
        simd.load(from, at)
    }
}

impl Element for f16 {
    #[inline(always)]
    fn load<S: Simd>(simd: S, from: &[Self], at: usize) -> S::V {
        simd.load_f16(from, at)
    }
}
