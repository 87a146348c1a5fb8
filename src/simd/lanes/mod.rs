//! Sixteen f32 lanes on every instruction set, so that a kernel is written once.
//!
//! A value of one of the token types proves that the CPU has its instructions; [`dispatch!`] makes the token and enters a
//! function compiled for it. Every operation rounds alike on AVX-512 and AVX2; the portable path has no fused multiply-add
//! unless the target has, and agrees to a few units in the last place.

use half::f16;

/// Sixteen lanes of f32 and the operations that the kernels need.
pub trait Lanes: Copy + Send + Sync {
    /// Sixteen f32.
    type V: Copy;
    /// How many 32-pixel accumulators fit into registers: rows of the dense kernel's register tile.
    const TILE: usize;
    fn splat(self, x: f32) -> Self::V;
    /// Sixteen floats from `from[at..]`; panics if they are not there.
    fn load(self, from: &[f32], at: usize) -> Self::V;
    /// Sixteen half floats from `from[at..]`; panics if they are not there.
    fn load_half(self, from: &[f16], at: usize) -> Self::V;
    /// Writes sixteen floats to `to[at..]`; panics if there is no room.
    fn store(self, v: Self::V, to: &mut [f32], at: usize);
    fn add(self, a: Self::V, b: Self::V) -> Self::V;
    fn sub(self, a: Self::V, b: Self::V) -> Self::V;
    fn mul(self, a: Self::V, b: Self::V) -> Self::V;
    fn div(self, a: Self::V, b: Self::V) -> Self::V;
    /// a·b + c, fused where the instruction set has it.
    fn fma(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V;
    fn max(self, a: Self::V, b: Self::V) -> Self::V;
    fn min(self, a: Self::V, b: Self::V) -> Self::V;
    /// a where x > 0, else 0.
    fn where_positive(self, x: Self::V, a: Self::V) -> Self::V;
    /// v·2ⁿ for integral n in −126…127.
    fn scale2(self, v: Self::V, n: Self::V) -> Self::V;
    /// The nearest integer, ties to even.
    fn round(self, v: Self::V) -> Self::V;
    /// m in √½…√2 and e with v = m·2ᵉ, for positive normal v.
    fn split(self, v: Self::V) -> (Self::V, Self::V);
    /// Rows to columns.
    fn transpose(self, rows: [Self::V; 16]) -> [Self::V; 16];

    /// eˣ for x in −87…88, to about 2 units in the last place (Cephes' polynomial).
    #[inline(always)]
    fn exp(self, x: Self::V) -> Self::V {
        let n = self.round(self.mul(x, self.splat(std::f32::consts::LOG2_E)));
        let r = self.fma(n, self.splat(-0.693_359_4), x);
        let r = self.fma(n, self.splat(2.121_944_4e-4), r);
        let mut p = self.splat(1.987_569_1e-4);
        for c in [1.398_2e-3, 8.333_452e-3, 4.166_579_6e-2, 1.666_666_5e-1, 0.5] {
            p = self.fma(p, r, self.splat(c));
        }
        let p = self.fma(self.mul(r, r), p, self.add(r, self.splat(1.0)));
        self.scale2(p, n)
    }

    /// ln(1 + x) for x ≥ 0 up to 1e38, to about 2 units in the last place (Cephes' polynomial).
    #[inline(always)]
    fn ln_1p(self, x: Self::V) -> Self::V {
        let one = self.splat(1.0);
        let u = self.add(one, x);
        let lost = self.div(self.sub(x, self.sub(u, one)), u);
        let (m, e) = self.split(u);
        let t = self.sub(m, one);
        let z = self.mul(t, t);
        let mut p = self.splat(7.037_683_6e-2);
        for c in LN {
            p = self.fma(p, t, self.splat(c));
        }
        let y = self.fma(e, self.splat(-2.121_944_4e-4), self.mul(self.mul(t, z), p));
        let y = self.fma(z, self.splat(-0.5), y);
        let r = self.fma(e, self.splat(0.693_359_4), self.add(t, y));
        self.add(r, lost)
    }
}

const LN: [f32; 8] =
    [-0.115_146_1, 0.116_769_99, -0.124_201_41, 0.142_493_23, -0.166_680_58, 0.200_007_15, -0.249_999_94, 0.333_333_3];
/// The bits of √½.
const SQRT_HALF: i32 = 0x3f35_04f3;

#[inline(always)]
fn sixteen(from: &[f32], at: usize) -> &[f32; 16] {
    from[at..at + 16].try_into().expect("a slice of sixteen")
}

mod portable;
pub use portable::Portable;

#[cfg(target_arch = "x86_64")]
pub use x86::{Avx2, Avx512};

#[cfg(target_arch = "x86_64")]
mod x86;

/// Defines `fn name(isa: Isa, args…)` that runs the generic `body::<L: Lanes>(lanes, args…)` compiled for the instruction set.
///
/// An instruction set that the CPU lacks falls back to the portable path. `body` must be `#[inline(always)]`.
macro_rules! dispatch {
    ($(#[$meta:meta])* $vis:vis fn $name:ident($($arg:ident: $ty:ty),* $(,)?) = $body:ident) => {
        $(#[$meta])*
        #[allow(clippy::too_many_arguments)]
        $vis fn $name(isa: $crate::simd::Isa, $($arg: $ty),*) {
            #[cfg(target_arch = "x86_64")]
            {
                #[allow(clippy::too_many_arguments)]
                #[target_feature(enable = "avx512f,avx2,fma,f16c")]
                fn avx512(lanes: $crate::simd::lanes::Avx512, $($arg: $ty),*) {
                    $body(lanes, $($arg),*)
                }
                #[allow(clippy::too_many_arguments)]
                #[target_feature(enable = "avx2,fma,f16c")]
                fn avx2(lanes: $crate::simd::lanes::Avx2, $($arg: $ty),*) {
                    $body(lanes, $($arg),*)
                }
                if isa == $crate::simd::Isa::Avx512 && let Some(lanes) = $crate::simd::lanes::Avx512::new() {
                    // SAFETY: the token proves that the CPU has the instructions.
                    return unsafe { avx512(lanes, $($arg),*) };
                }
                if isa == $crate::simd::Isa::Avx2 && let Some(lanes) = $crate::simd::lanes::Avx2::new() {
                    // SAFETY: the token proves that the CPU has the instructions.
                    return unsafe { avx2(lanes, $($arg),*) };
                }
            }
            let _ = isa;
            $body($crate::simd::lanes::Portable, $($arg),*)
        }
    };
}
pub(crate) use dispatch;

/// [`ln_1p_all`] inside a kernel.
#[inline(always)]
pub(crate) fn ln_1p_body<L: Lanes>(l: L, values: &mut [f32]) {
    let (whole, rest) = values.as_chunks_mut::<16>();
    for v in whole {
        l.store(l.ln_1p(l.load(v, 0)), v, 0);
    }
    let mut last = [0.0; 16];
    last[..rest.len()].copy_from_slice(rest);
    l.store(l.ln_1p(l.load(&last, 0)), &mut last, 0);
    rest.copy_from_slice(&last[..rest.len()]);
}

dispatch! {
    /// Replaces each value x ≥ 0 by ln(1 + x).
    pub fn ln_1p_all(values: &mut [f32]) = ln_1p_body
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::Isa;

    #[inline(always)]
    fn exp_body<L: Lanes>(l: L, x: &[f32], out: &mut [f32]) {
        for at in (0..x.len()).step_by(16) {
            l.store(l.exp(l.load(x, at)), out, at);
        }
    }
    dispatch!(fn exp_all(x: &[f32], out: &mut [f32]) = exp_body);

    #[test]
    fn ln_1p_is_accurate_and_alike_on_every_isa() {
        let x: Vec<f32> = (0..4099).map(|i| 10f32.powf(-12.0 + i as f32 * (48.0 / 4099.0))).chain([0.0]).collect();
        for isa in Isa::available() {
            let mut out = x.clone();
            ln_1p_all(isa, &mut out);
            for (x, y) in x.iter().zip(&out) {
                let exact = f64::from(*x).ln_1p();
                assert!((f64::from(*y) - exact).abs() <= 4e-7 * exact, "{isa:?}: ln_1p({x}) = {y}");
            }
        }
    }

    #[inline(always)]
    fn transpose_body<L: Lanes>(l: L, from: &[f32], to: &mut [f32]) {
        let mut rows = [l.splat(0.0); 16];
        for (i, row) in rows.iter_mut().enumerate() {
            *row = l.load(from, 16 * i);
        }
        for (i, row) in l.transpose(rows).into_iter().enumerate() {
            l.store(row, to, 16 * i);
        }
    }
    dispatch!(fn transposed(from: &[f32], to: &mut [f32]) = transpose_body);

    #[test]
    fn transpose_swaps_rows_and_columns() {
        let from: Vec<f32> = (0..256).map(|i| i as f32).collect();
        for isa in Isa::available() {
            let mut to = vec![0.0; 256];
            transposed(isa, &from, &mut to);
            assert!((0..256).all(|i| to[i] == from[i % 16 * 16 + i / 16]), "{isa:?}");
        }
    }

    #[test]
    fn exp_is_accurate_on_every_isa() {
        let x: Vec<f32> = (0..4096).map(|i| -87.0 + i as f32 * (174.0 / 4096.0)).collect();
        for isa in Isa::available() {
            let mut out = vec![0.0; x.len()];
            exp_all(isa, &x, &mut out);
            for (x, y) in x.iter().zip(&out) {
                let exact = f64::from(*x).exp();
                assert!((f64::from(*y) - exact).abs() <= 4e-7 * exact, "{isa:?}: exp({x}) = {y}");
            }
        }
    }
}
