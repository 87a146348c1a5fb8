//! AVX2: a vector is two registers of eight lanes.

use std::arch::x86_64::*;

use half::f16;

use super::vector::{SQRT_HALF, Simd, SimdOp, each_register, sixteen, sixteen_mut};

/// Proof that the CPU has AVX2, FMA and F16C.
#[derive(Clone, Copy, Debug)]
pub struct Avx2(());

macro_rules! proven {
    ($e:expr) => {
        // SAFETY: the token `self` proves that the CPU has these instructions; loads and stores go through checked arrays, and a
        // prefetch faults nowhere.
        unsafe { $e }
    };
}

macro_rules! each {
    ($i:ident => $e:expr) => {
        each_register!([0, 1] $i => $e)
    };
}

impl Simd for Avx2 {
    type V = [__m256; 2];
    const REGISTERS: usize = 8;
    #[inline(always)]
    fn detect() -> Option<Self> {
        let has = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") && is_x86_feature_detected!("f16c");
        has.then_some(Self(()))
    }
    #[inline(always)]
    fn run<Op: SimdOp>(self, op: Op) -> Op::Output {
        #[target_feature(enable = "avx2,fma,f16c")]
        fn compiled<Op: SimdOp>(token: Avx2, op: Op) -> Op::Output {
            op.run(token)
        }
        proven!(compiled(self, op))
    }
    #[inline(always)]
    fn splat(self, x: f32) -> Self::V {
        each!(_i => _mm256_set1_ps(x))
    }
    #[inline(always)]
    fn load(self, from: &[f32], at: usize) -> Self::V {
        let p = sixteen(from, at).as_ptr();
        each!(i => _mm256_loadu_ps(p.add(8 * i)))
    }
    #[inline(always)]
    fn load_f16(self, from: &[f16], at: usize) -> Self::V {
        let p = from[at..at + 16].as_ptr();
        each!(i => _mm256_cvtph_ps(_mm_loadu_si128(p.add(8 * i).cast())))
    }
    #[inline(always)]
    fn store(self, v: Self::V, to: &mut [f32], at: usize) {
        let p = sixteen_mut(to, at).as_mut_ptr();
        each!(i => _mm256_storeu_ps(p.add(8 * i), v[i]));
    }
    #[inline(always)]
    fn prefetch(self, at: *const f32) {
        proven!(_mm_prefetch::<_MM_HINT_T0>(at.cast()))
    }
    #[inline(always)]
    fn add(self, a: Self::V, b: Self::V) -> Self::V {
        each!(i => _mm256_add_ps(a[i], b[i]))
    }
    #[inline(always)]
    fn sub(self, a: Self::V, b: Self::V) -> Self::V {
        each!(i => _mm256_sub_ps(a[i], b[i]))
    }
    #[inline(always)]
    fn mul(self, a: Self::V, b: Self::V) -> Self::V {
        each!(i => _mm256_mul_ps(a[i], b[i]))
    }
    #[inline(always)]
    fn div(self, a: Self::V, b: Self::V) -> Self::V {
        each!(i => _mm256_div_ps(a[i], b[i]))
    }
    #[inline(always)]
    fn fma(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V {
        each!(i => _mm256_fmadd_ps(a[i], b[i], c[i]))
    }
    #[inline(always)]
    fn max(self, a: Self::V, b: Self::V) -> Self::V {
        each!(i => _mm256_max_ps(a[i], b[i]))
    }
    #[inline(always)]
    fn min(self, a: Self::V, b: Self::V) -> Self::V {
        each!(i => _mm256_min_ps(a[i], b[i]))
    }
    #[inline(always)]
    fn where_positive(self, x: Self::V, a: Self::V) -> Self::V {
        each!(i => _mm256_and_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(x[i], _mm256_setzero_ps()), a[i]))
    }
    #[inline(always)]
    fn scale2(self, v: Self::V, n: Self::V) -> Self::V {
        each!(i => {
            let bits = _mm256_slli_epi32::<23>(_mm256_add_epi32(_mm256_cvtps_epi32(n[i]), _mm256_set1_epi32(127)));
            _mm256_mul_ps(v[i], _mm256_castsi256_ps(bits))
        })
    }
    #[inline(always)]
    fn round(self, v: Self::V) -> Self::V {
        each!(i => _mm256_round_ps::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(v[i]))
    }
    #[inline(always)]
    fn split(self, v: Self::V) -> (Self::V, Self::V) {
        let e = each!(i => {
            _mm256_srai_epi32::<23>(_mm256_sub_epi32(_mm256_castps_si256(v[i]), _mm256_set1_epi32(SQRT_HALF)))
        });
        let m = each!(i => _mm256_castsi256_ps(_mm256_sub_epi32(_mm256_castps_si256(v[i]), _mm256_slli_epi32::<23>(e[i]))));
        (m, each!(i => _mm256_cvtepi32_ps(e[i])))
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
