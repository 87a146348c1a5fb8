//! AVX-512: a vector is one register.

use std::arch::x86_64::*;

use half::f16;

use super::avx2::Avx2;
use super::vector::{SQRT_HALF, Simd, SimdOp, sixteen, sixteen_mut};

/// Proof that the CPU has AVX-512F, AVX2, FMA and F16C.
#[derive(Clone, Copy, Debug)]
pub struct Avx512(());

macro_rules! proven {
    ($e:expr) => {
        // SAFETY: the token `self` proves that the CPU has these instructions; loads and stores go through checked arrays, and a
        // prefetch faults nowhere.
        unsafe { $e }
    };
}

impl Simd for Avx512 {
    type V = __m512;
    const REGISTERS: usize = 32;
    #[inline(always)]
    fn detect() -> Option<Self> {
        (is_x86_feature_detected!("avx512f") && Avx2::detect().is_some()).then_some(Self(()))
    }
    #[inline(always)]
    fn run<Op: SimdOp>(self, op: Op) -> Op::Output {
        #[target_feature(enable = "avx512f,avx2,fma,f16c")]
        fn compiled<Op: SimdOp>(token: Avx512, op: Op) -> Op::Output {
            op.run(token)
        }
        proven!(compiled(self, op))
    }
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
    fn load_f16(self, from: &[f16], at: usize) -> __m512 {
        let p = from[at..at + 16].as_ptr();
        proven!(_mm512_cvtph_ps(_mm256_loadu_si256(p.cast())))
    }
    #[inline(always)]
    fn store(self, v: __m512, to: &mut [f32], at: usize) {
        let p = sixteen_mut(to, at).as_mut_ptr();
        proven!(_mm512_storeu_ps(p, v))
    }
    #[inline(always)]
    fn prefetch(self, at: *const f32) {
        proven!(_mm_prefetch::<_MM_HINT_T0>(at.cast()))
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
