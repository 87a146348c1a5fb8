//! Plain Rust in the shape that compilers vectorise: a vector is an array.

use super::vector::{SQRT_HALF, Simd, SimdOp, sixteen, sixteen_mut};

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

impl Simd for Portable {
    type V = [f32; 16];
    const REGISTERS: usize = 4;
    #[inline(always)]
    fn detect() -> Option<Self> {
        Some(Self)
    }
    #[inline(always)]
    fn run<Op: SimdOp>(self, op: Op) -> Op::Output {
        op.run(self)
    }
    #[inline(always)]
    fn splat(self, x: f32) -> Self::V {
        [x; 16]
    }
    #[inline(always)]
    fn load(self, from: &[f32], at: usize) -> Self::V {
        *sixteen(from, at)
    }
    #[inline(always)]
    fn store(self, v: Self::V, to: &mut [f32], at: usize) {
        *sixteen_mut(to, at) = v;
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
