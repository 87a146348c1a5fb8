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

/// Plain Rust; the path for every CPU that has no path of its own.
#[derive(Clone, Copy, Debug)]
pub struct Portable;

#[inline(always)]
fn map2(a: [f32; 16], b: [f32; 16], f: impl Fn(f32, f32) -> f32) -> [f32; 16] {
    let mut out = [0.0; 16];
    for i in 0..16 {
        out[i] = f(a[i], b[i]);
    }
    out
}

#[inline(always)]
fn sixteen(from: &[f32], at: usize) -> &[f32; 16] {
    from[at..at + 16].try_into().expect("a slice of sixteen")
}

impl Lanes for Portable {
    type V = [f32; 16];
    const TILE: usize = 2;
    #[inline(always)]
    fn splat(self, x: f32) -> Self::V {
        [x; 16]
    }
    #[inline(always)]
    fn load(self, from: &[f32], at: usize) -> Self::V {
        *sixteen(from, at)
    }
    #[inline(always)]
    fn load_half(self, from: &[f16], at: usize) -> Self::V {
        let mut out = [0.0; 16];
        for (to, from) in out.iter_mut().zip(&from[at..at + 16]) {
            *to = from.to_f32();
        }
        out
    }
    #[inline(always)]
    fn store(self, v: Self::V, to: &mut [f32], at: usize) {
        to[at..at + 16].copy_from_slice(&v);
    }
    #[inline(always)]
    fn add(self, a: Self::V, b: Self::V) -> Self::V {
        map2(a, b, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, a: Self::V, b: Self::V) -> Self::V {
        map2(a, b, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, a: Self::V, b: Self::V) -> Self::V {
        map2(a, b, |a, b| a * b)
    }
    #[inline(always)]
    fn div(self, a: Self::V, b: Self::V) -> Self::V {
        map2(a, b, |a, b| a / b)
    }
    #[inline(always)]
    fn fma(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V {
        let mut out = [0.0; 16];
        for i in 0..16 {
            out[i] = if cfg!(any(target_feature = "fma", target_arch = "aarch64")) {
                a[i].mul_add(b[i], c[i])
            } else {
                a[i] * b[i] + c[i]
            };
        }
        out
    }
    #[inline(always)]
    fn max(self, a: Self::V, b: Self::V) -> Self::V {
        map2(a, b, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn min(self, a: Self::V, b: Self::V) -> Self::V {
        map2(a, b, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn where_positive(self, x: Self::V, a: Self::V) -> Self::V {
        map2(x, a, |x, a| if x > 0.0 { a } else { 0.0 })
    }
    #[inline(always)]
    fn scale2(self, v: Self::V, n: Self::V) -> Self::V {
        map2(v, n, |v, n| v * f32::from_bits(((n as i32 + 127) as u32) << 23))
    }
    #[inline(always)]
    fn round(self, v: Self::V) -> Self::V {
        // Adding and taking away 1.5·2²³ rounds to the nearest integer without a library call.
        const MAGIC: f32 = 12_582_912.0;
        map2(v, v, |v, _| (v + MAGIC) - MAGIC)
    }
    #[inline(always)]
    fn split(self, v: Self::V) -> (Self::V, Self::V) {
        let exponent = |v: f32| (v.to_bits() as i32).wrapping_sub(SQRT_HALF) >> 23;
        let m = map2(v, v, |v, _| f32::from_bits((v.to_bits() as i32).wrapping_sub(exponent(v) << 23) as u32));
        (m, map2(v, v, |v, _| exponent(v) as f32))
    }
    #[inline(always)]
    fn transpose(self, rows: [Self::V; 16]) -> [Self::V; 16] {
        let mut out = [[0.0; 16]; 16];
        for r in 0..16 {
            for c in 0..16 {
                out[c][r] = rows[r][c];
            }
        }
        out
    }
}

#[cfg(target_arch = "x86_64")]
pub use x86::{Avx2, Avx512};

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::*;

    use half::f16;

    use super::{Lanes, SQRT_HALF, sixteen};

    /// Proof that the CPU has AVX-512F.
    #[derive(Clone, Copy, Debug)]
    pub struct Avx512(());

    /// Proof that the CPU has AVX2, FMA and F16C.
    #[derive(Clone, Copy, Debug)]
    pub struct Avx2(());

    impl Avx512 {
        /// The token, where the CPU has the instructions.
        pub fn new() -> Option<Self> {
            (is_x86_feature_detected!("avx512f") && Avx2::new().is_some()).then_some(Self(()))
        }
    }

    impl Avx2 {
        /// The token, where the CPU has the instructions.
        pub fn new() -> Option<Self> {
            let has = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") && is_x86_feature_detected!("f16c");
            has.then_some(Self(()))
        }
    }

    macro_rules! proven {
        ($e:expr) => {
            // SAFETY: the token `self` proves that the CPU has these instructions; loads and stores go through checked arrays.
            unsafe { $e }
        };
    }

    impl Lanes for Avx512 {
        type V = __m512;
        const TILE: usize = 12;
        #[inline(always)]
        fn splat(self, x: f32) -> __m512 {
            proven!(_mm512_set1_ps(x))
        }
        #[inline(always)]
        fn load(self, from: &[f32], at: usize) -> __m512 {
            let p = sixteen(from, at).as_ptr();
            proven!(_mm512_loadu_ps(p))
        }
        #[inline(always)]
        fn load_half(self, from: &[f16], at: usize) -> __m512 {
            let p = from[at..at + 16].as_ptr();
            proven!(_mm512_cvtph_ps(_mm256_loadu_si256(p.cast())))
        }
        #[inline(always)]
        fn store(self, v: __m512, to: &mut [f32], at: usize) {
            let p = to[at..at + 16].as_mut_ptr();
            proven!(_mm512_storeu_ps(p, v))
        }
        #[inline(always)]
        fn add(self, a: __m512, b: __m512) -> __m512 {
            proven!(_mm512_add_ps(a, b))
        }
        #[inline(always)]
        fn sub(self, a: __m512, b: __m512) -> __m512 {
            proven!(_mm512_sub_ps(a, b))
        }
        #[inline(always)]
        fn mul(self, a: __m512, b: __m512) -> __m512 {
            proven!(_mm512_mul_ps(a, b))
        }
        #[inline(always)]
        fn div(self, a: __m512, b: __m512) -> __m512 {
            proven!(_mm512_div_ps(a, b))
        }
        #[inline(always)]
        fn fma(self, a: __m512, b: __m512, c: __m512) -> __m512 {
            proven!(_mm512_fmadd_ps(a, b, c))
        }
        #[inline(always)]
        fn max(self, a: __m512, b: __m512) -> __m512 {
            proven!(_mm512_max_ps(a, b))
        }
        #[inline(always)]
        fn min(self, a: __m512, b: __m512) -> __m512 {
            proven!(_mm512_min_ps(a, b))
        }
        #[inline(always)]
        fn where_positive(self, x: __m512, a: __m512) -> __m512 {
            proven!(_mm512_maskz_mov_ps(_mm512_cmp_ps_mask::<_CMP_GT_OQ>(x, _mm512_setzero_ps()), a))
        }
        #[inline(always)]
        fn scale2(self, v: __m512, n: __m512) -> __m512 {
            proven!({
                let bits = _mm512_slli_epi32::<23>(_mm512_add_epi32(_mm512_cvtps_epi32(n), _mm512_set1_epi32(127)));
                _mm512_mul_ps(v, _mm512_castsi512_ps(bits))
            })
        }
        #[inline(always)]
        fn round(self, v: __m512) -> __m512 {
            proven!(_mm512_roundscale_ps::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(v))
        }
        #[inline(always)]
        fn split(self, v: __m512) -> (__m512, __m512) {
            proven!({
                let bits = _mm512_castps_si512(v);
                let e = _mm512_srai_epi32::<23>(_mm512_sub_epi32(bits, _mm512_set1_epi32(SQRT_HALF)));
                (_mm512_castsi512_ps(_mm512_sub_epi32(bits, _mm512_slli_epi32::<23>(e))), _mm512_cvtepi32_ps(e))
            })
        }
        #[inline(always)]
        fn transpose(self, r: [__m512; 16]) -> [__m512; 16] {
            let (mut t, mut u, mut out) = (r, r, r);
            for i in 0..8 {
                t[2 * i] = proven!(_mm512_unpacklo_ps(r[2 * i], r[2 * i + 1]));
                t[2 * i + 1] = proven!(_mm512_unpackhi_ps(r[2 * i], r[2 * i + 1]));
            }
            for i in (0..16).step_by(4) {
                proven!({
                    let (a, b) = (_mm512_castps_pd(t[i]), _mm512_castps_pd(t[i + 1]));
                    let (c, e) = (_mm512_castps_pd(t[i + 2]), _mm512_castps_pd(t[i + 3]));
                    u[i] = _mm512_castpd_ps(_mm512_unpacklo_pd(a, c));
                    u[i + 1] = _mm512_castpd_ps(_mm512_unpackhi_pd(a, c));
                    u[i + 2] = _mm512_castpd_ps(_mm512_unpacklo_pd(b, e));
                    u[i + 3] = _mm512_castpd_ps(_mm512_unpackhi_pd(b, e));
                });
            }
            for k in 0..4 {
                proven!({
                    let (v0, v1) = (_mm512_shuffle_f32x4::<0x88>(u[k], u[4 + k]), _mm512_shuffle_f32x4::<0xdd>(u[k], u[4 + k]));
                    let (w0, w1) =
                        (_mm512_shuffle_f32x4::<0x88>(u[8 + k], u[12 + k]), _mm512_shuffle_f32x4::<0xdd>(u[8 + k], u[12 + k]));
                    out[k] = _mm512_shuffle_f32x4::<0x88>(v0, w0);
                    out[4 + k] = _mm512_shuffle_f32x4::<0x88>(v1, w1);
                    out[8 + k] = _mm512_shuffle_f32x4::<0xdd>(v0, w0);
                    out[12 + k] = _mm512_shuffle_f32x4::<0xdd>(v1, w1);
                });
            }
            out
        }
    }

    // No closures: they would be functions of their own, compiled without the instruction set.
    macro_rules! both {
        ($i:ident => $e:expr) => {
            // SAFETY: the token `self` proves that the CPU has these instructions; loads and stores go through checked arrays.
            unsafe {
                [
                    {
                        let $i: usize = 0;
                        $e
                    },
                    {
                        let $i: usize = 1;
                        $e
                    },
                ]
            }
        };
    }

    impl Lanes for Avx2 {
        type V = [__m256; 2];
        const TILE: usize = 3;
        #[inline(always)]
        fn splat(self, x: f32) -> Self::V {
            both!(_i => _mm256_set1_ps(x))
        }
        #[inline(always)]
        fn load(self, from: &[f32], at: usize) -> Self::V {
            let p = sixteen(from, at).as_ptr();
            both!(i => _mm256_loadu_ps(p.add(8 * i)))
        }
        #[inline(always)]
        fn load_half(self, from: &[f16], at: usize) -> Self::V {
            let p = from[at..at + 16].as_ptr();
            both!(i => _mm256_cvtph_ps(_mm_loadu_si128(p.add(8 * i).cast())))
        }
        #[inline(always)]
        fn store(self, v: Self::V, to: &mut [f32], at: usize) {
            let p = to[at..at + 16].as_mut_ptr();
            both!(i => _mm256_storeu_ps(p.add(8 * i), v[i]));
        }
        #[inline(always)]
        fn add(self, a: Self::V, b: Self::V) -> Self::V {
            both!(i => _mm256_add_ps(a[i], b[i]))
        }
        #[inline(always)]
        fn sub(self, a: Self::V, b: Self::V) -> Self::V {
            both!(i => _mm256_sub_ps(a[i], b[i]))
        }
        #[inline(always)]
        fn mul(self, a: Self::V, b: Self::V) -> Self::V {
            both!(i => _mm256_mul_ps(a[i], b[i]))
        }
        #[inline(always)]
        fn div(self, a: Self::V, b: Self::V) -> Self::V {
            both!(i => _mm256_div_ps(a[i], b[i]))
        }
        #[inline(always)]
        fn fma(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V {
            both!(i => _mm256_fmadd_ps(a[i], b[i], c[i]))
        }
        #[inline(always)]
        fn max(self, a: Self::V, b: Self::V) -> Self::V {
            both!(i => _mm256_max_ps(a[i], b[i]))
        }
        #[inline(always)]
        fn min(self, a: Self::V, b: Self::V) -> Self::V {
            both!(i => _mm256_min_ps(a[i], b[i]))
        }
        #[inline(always)]
        fn where_positive(self, x: Self::V, a: Self::V) -> Self::V {
            both!(i => _mm256_and_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(x[i], _mm256_setzero_ps()), a[i]))
        }
        #[inline(always)]
        fn scale2(self, v: Self::V, n: Self::V) -> Self::V {
            both!(i => {
                let bits = _mm256_slli_epi32::<23>(_mm256_add_epi32(_mm256_cvtps_epi32(n[i]), _mm256_set1_epi32(127)));
                _mm256_mul_ps(v[i], _mm256_castsi256_ps(bits))
            })
        }
        #[inline(always)]
        fn round(self, v: Self::V) -> Self::V {
            both!(i => _mm256_round_ps::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(v[i]))
        }
        #[inline(always)]
        fn split(self, v: Self::V) -> (Self::V, Self::V) {
            let e = both!(i => {
                _mm256_srai_epi32::<23>(_mm256_sub_epi32(_mm256_castps_si256(v[i]), _mm256_set1_epi32(SQRT_HALF)))
            });
            let m = both!(i => _mm256_castsi256_ps(_mm256_sub_epi32(_mm256_castps_si256(v[i]), _mm256_slli_epi32::<23>(e[i]))));
            (m, both!(i => _mm256_cvtepi32_ps(e[i])))
        }
        #[inline(always)]
        fn transpose(self, rows: [Self::V; 16]) -> [Self::V; 16] {
            let mut out = rows;
            for (down, across) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let mut r = [rows[0][0]; 8];
                for i in 0..8 {
                    r[i] = rows[8 * down + i][across];
                }
                let mut t = r;
                for i in 0..4 {
                    proven!({
                        t[2 * i] = _mm256_unpacklo_ps(r[2 * i], r[2 * i + 1]);
                        t[2 * i + 1] = _mm256_unpackhi_ps(r[2 * i], r[2 * i + 1]);
                    });
                }
                for k in 0..2 {
                    proven!({
                        r[4 * k] = _mm256_shuffle_ps::<0x44>(t[4 * k], t[4 * k + 2]);
                        r[4 * k + 1] = _mm256_shuffle_ps::<0xee>(t[4 * k], t[4 * k + 2]);
                        r[4 * k + 2] = _mm256_shuffle_ps::<0x44>(t[4 * k + 1], t[4 * k + 3]);
                        r[4 * k + 3] = _mm256_shuffle_ps::<0xee>(t[4 * k + 1], t[4 * k + 3]);
                    });
                }
                for k in 0..4 {
                    proven!({
                        out[8 * across + k][down] = _mm256_permute2f128_ps::<0x20>(r[k], r[4 + k]);
                        out[8 * across + 4 + k][down] = _mm256_permute2f128_ps::<0x31>(r[k], r[4 + k]);
                    });
                }
            }
            out
        }
    }
}

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
