//! Functions of sixteen lanes, from the operations that every instruction set has.

use std::f32::consts::LOG2_E;

use super::isa::dispatch;
use super::vector::{LANES, Simd};

/// Cephes' polynomial for ln, from the highest power.
const LN: [f32; 8] =
    [-0.115_146_1, 0.116_769_99, -0.124_201_41, 0.142_493_23, -0.166_680_58, 0.200_007_15, -0.249_999_94, 0.333_333_3];

/// eˣ for x in −87…88, to about 2 units in the last place (Cephes' polynomial).
#[inline(always)]
pub fn exp<S: Simd>(s: S, x: S::V) -> S::V {
    let n = s.round(s.mul(x, s.splat(LOG2_E)));
    let r = s.fma(n, s.splat(-0.693_359_4), x);
    let r = s.fma(n, s.splat(2.121_944_4e-4), r);
    let mut p = s.splat(1.987_569_1e-4);
    for c in [1.398_2e-3, 8.333_452e-3, 4.166_579_6e-2, 1.666_666_5e-1, 0.5] {
        p = s.fma(p, r, s.splat(c));
    }
    let p = s.fma(s.mul(r, r), p, s.add(r, s.splat(1.0)));
    s.scale2(p, n)
}

/// ln(1 + x) for x ≥ 0 up to 1e38, to about 2 units in the last place (Cephes' polynomial).
#[inline(always)]
pub fn ln_1p<S: Simd>(s: S, x: S::V) -> S::V {
    let one = s.splat(1.0);
    let u = s.add(one, x);
    let lost = s.div(s.sub(x, s.sub(u, one)), u);
    let (m, e) = s.split(u);
    let t = s.sub(m, one);
    let z = s.mul(t, t);
    let mut p = s.splat(7.037_683_6e-2);
    for c in LN {
        p = s.fma(p, t, s.splat(c));
    }
    let y = s.fma(e, s.splat(-2.121_944_4e-4), s.mul(s.mul(t, z), p));
    let y = s.fma(z, s.splat(-0.5), y);
    let r = s.fma(e, s.splat(0.693_359_4), s.add(t, y));
    s.add(r, lost)
}

/// [`ln_1p_all`] inside a loop.
#[inline(always)]
pub fn ln_1p_each<S: Simd>(s: S, values: &mut [f32]) {
    let (whole, rest) = values.as_chunks_mut::<LANES>();
    for v in whole {
        s.store(ln_1p(s, s.load(v, 0)), v, 0);
    }
    let mut last = [0.0; LANES];
    last[..rest.len()].copy_from_slice(rest);
    s.store(ln_1p(s, s.load(&last, 0)), &mut last, 0);
    rest.copy_from_slice(&last[..rest.len()]);
}

dispatch! {
    /// Replaces each value x ≥ 0 by ln(1 + x).
    pub fn ln_1p_all(values: &mut [f32]) = ln_1p_each
}
