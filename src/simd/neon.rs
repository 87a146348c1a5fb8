//! NEON: a vector is four registers of four lanes.

use std::arch::aarch64::*;
use std::arch::asm;

use half::f16;

use super::vector::{SQRT_HALF, Simd, SimdOp, each_register, sixteen, sixteen_mut};

/// Proof that the CPU has NEON.
#[derive(Clone, Copy, Debug)]
pub struct Neon(());

macro_rules! each {
    ($i:ident => $e:expr) => {
        each_register!([0, 1, 2, 3] $i => $e)
    };
}

impl Simd for Neon {
    type V = [float32x4_t; 4];
    const REGISTERS: usize = 8;
    #[inline(always)]
    fn detect() -> Option<Self> {
        std::arch::is_aarch64_feature_detected!("neon").then_some(Self(()))
    }
    #[inline(always)]
    fn run<Op: SimdOp>(self, op: Op) -> Op::Output {
        #[target_feature(enable = "neon")]
        fn compiled<Op: SimdOp>(token: Neon, op: Op) -> Op::Output {
            op.run(token)
        }
        // SAFETY: the token `self` proves that the CPU has NEON.
        unsafe { compiled(self, op) }
    }
    #[inline(always)]
    fn splat(self, x: f32) -> Self::V {
        each!(_i => vdupq_n_f32(x))
    }
    #[inline(always)]
    fn load(self, from: &[f32], at: usize) -> Self::V {
        let p = sixteen(from, at).as_ptr();
        each!(i => vld1q_f32(p.add(4 * i)))
    }
    #[inline(always)]
    fn load_f16(self, from: &[f16], at: usize) -> Self::V {
        let p = from[at..at + 16].as_ptr();
        each!(i => widened(vld1_u16(p.add(4 * i).cast())))
    }
    #[inline(always)]
    fn store(self, v: Self::V, to: &mut [f32], at: usize) {
        let p = sixteen_mut(to, at).as_mut_ptr();
        each!(i => vst1q_f32(p.add(4 * i), v[i]));
    }
    #[inline(always)]
    fn prefetch(self, at: *const f32) {
        // SAFETY: a prefetch faults nowhere and changes nothing but the cache.
        unsafe { asm!("prfm pldl1keep, [{at}]", at = in(reg) at, options(nomem, nostack, preserves_flags)) }
    }
    #[inline(always)]
    fn add(self, a: Self::V, b: Self::V) -> Self::V {
        each!(i => vaddq_f32(a[i], b[i]))
    }
    #[inline(always)]
    fn sub(self, a: Self::V, b: Self::V) -> Self::V {
        each!(i => vsubq_f32(a[i], b[i]))
    }
    #[inline(always)]
    fn mul(self, a: Self::V, b: Self::V) -> Self::V {
        each!(i => vmulq_f32(a[i], b[i]))
    }
    #[inline(always)]
    fn div(self, a: Self::V, b: Self::V) -> Self::V {
        each!(i => vdivq_f32(a[i], b[i]))
    }
    #[inline(always)]
    fn fma(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V {
        each!(i => vfmaq_f32(c[i], a[i], b[i]))
    }
    // NEON's own maximum and minimum hand on NaN and order zeros, so compare and select.
    #[inline(always)]
    fn max(self, a: Self::V, b: Self::V) -> Self::V {
        each!(i => vbslq_f32(vcgtq_f32(a[i], b[i]), a[i], b[i]))
    }
    #[inline(always)]
    fn min(self, a: Self::V, b: Self::V) -> Self::V {
        each!(i => vbslq_f32(vcltq_f32(a[i], b[i]), a[i], b[i]))
    }
    #[inline(always)]
    fn where_positive(self, x: Self::V, a: Self::V) -> Self::V {
        each!(i => vreinterpretq_f32_u32(vandq_u32(vcgtzq_f32(x[i]), vreinterpretq_u32_f32(a[i]))))
    }
    #[inline(always)]
    fn scale2(self, v: Self::V, n: Self::V) -> Self::V {
        each!(i => {
            let bits = vshlq_n_s32::<23>(vaddq_s32(vcvtnq_s32_f32(n[i]), vdupq_n_s32(127)));
            vmulq_f32(v[i], vreinterpretq_f32_s32(bits))
        })
    }
    #[inline(always)]
    fn round(self, v: Self::V) -> Self::V {
        each!(i => vrndnq_f32(v[i]))
    }
    #[inline(always)]
    fn split(self, v: Self::V) -> (Self::V, Self::V) {
        let e = each!(i => vshrq_n_s32::<23>(vsubq_s32(vreinterpretq_s32_f32(v[i]), vdupq_n_s32(SQRT_HALF))));
        let m = each!(i => vreinterpretq_f32_s32(vsubq_s32(vreinterpretq_s32_f32(v[i]), vshlq_n_s32::<23>(e[i]))));
        (m, each!(i => vcvtq_f32_s32(e[i])))
    }
    #[inline(always)]
    fn transpose(self, rows: [Self::V; 16]) -> [Self::V; 16] {
        let mut out = rows;
        for down in 0..4 {
            for across in 0..4 {
                let [a, b, c, d] = [0, 1, 2, 3].map(|i| rows[4 * down + i][across]);
                // SAFETY: the token `self` proves that the CPU has these instructions.
                unsafe {
                    let (low, low2) = (vzip1q_f32(a, c), vzip1q_f32(b, d));
                    let (high, high2) = (vzip2q_f32(a, c), vzip2q_f32(b, d));
                    out[4 * across][down] = vzip1q_f32(low, low2);
                    out[4 * across + 1][down] = vzip2q_f32(low, low2);
                    out[4 * across + 2][down] = vzip1q_f32(high, high2);
                    out[4 * across + 3][down] = vzip2q_f32(high, high2);
                }
            }
        }
        out
    }
}

/// Four half floats, widened. By the instruction itself, as Rust's type for what its intrinsic takes is not stable.
#[inline(always)]
fn widened(halves: uint16x4_t) -> float32x4_t {
    let wide: float32x4_t;
    // SAFETY: every CPU with NEON, of which the argument is proof, has this instruction; it touches these two registers only.
    unsafe {
        asm!(
            "fcvtl {wide:v}.4s, {halves:v}.4h",
            wide = lateout(vreg) wide,
            halves = in(vreg) halves,
            options(pure, nomem, nostack, preserves_flags),
        );
    }
    wide
}
