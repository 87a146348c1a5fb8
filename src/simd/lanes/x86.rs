//! AVX-512 and AVX2 lanes.

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
