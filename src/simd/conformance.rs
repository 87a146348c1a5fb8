//! What every back end must do, operation by operation, against plain scalars: it runs on each instruction set that the CPU has.

use std::f32::consts::{FRAC_1_SQRT_2, PI, SQRT_2};
use std::panic::{AssertUnwindSafe, catch_unwind};

use half::f16;

use super::{Element, Isa, LANES, Simd, SimdOp, math};

/// Numbers at the edges, and some between.
const EDGES: [f32; 22] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    -2.5,
    3.0e-5,
    PI,
    8_388_609.0,
    f32::MIN_POSITIVE,
    -f32::MIN_POSITIVE,
    1e-40,
    -1e-40,
    f32::from_bits(1),
    f32::EPSILON,
    f32::MAX,
    f32::MIN,
    3.0e38,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::NAN,
    -f32::NAN,
];

/// Whether two results are the same bits; any NaN is as good as another.
fn same(a: f32, b: f32) -> bool {
    a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan()
}

/// All back ends but the portable one have a fused multiply-add, and that one where the compiler may use it.
pub(crate) fn is_fused(isa: Isa) -> bool {
    isa != Isa::Portable || cfg!(any(target_arch = "aarch64", target_feature = "fma"))
}

/// a·b + c, rounded as `isa` rounds it.
pub(crate) fn scalar_fma(isa: Isa, a: f32, b: f32, c: f32) -> f32 {
    if is_fused(isa) { fused(a, b, c) } else { a * b + c }
}

/// a·b + c rounded once, which not every C library's `fmaf` does: the sum in f64, rounded to odd, so that rounding it again is harmless.
fn fused(a: f32, b: f32, c: f32) -> f32 {
    let (product, c) = (f64::from(a) * f64::from(b), f64::from(c));
    let sum = product + c;
    let of_c = sum - product;
    let lost = (product - (sum - of_c)) + (c - of_c);
    if !sum.is_finite() || lost == 0.0 || sum.to_bits() & 1 == 1 {
        return sum as f32;
    }
    let bits = if (lost > 0.0) == (sum > 0.0) { sum.to_bits() + 1 } else { sum.to_bits() - 1 };
    f64::from_bits(bits) as f32
}

/// An operation of up to three vectors.
#[derive(Clone, Copy, Debug)]
enum Operation {
    Add,
    Sub,
    Mul,
    Div,
    Max,
    Min,
    WherePositive,
    Relu,
    Fma,
}

impl Operation {
    const ALL: [Self; 9] =
        [Self::Add, Self::Sub, Self::Mul, Self::Div, Self::Max, Self::Min, Self::WherePositive, Self::Relu, Self::Fma];

    fn scalar(self, isa: Isa, [a, b, c]: [f32; 3]) -> f32 {
        match self {
            Self::Add => a + b,
            Self::Sub => a - b,
            Self::Mul => a * b,
            Self::Div => a / b,
            Self::Max => {
                if a > b {
                    a
                } else {
                    b
                }
            }
            Self::Min => {
                if a < b {
                    a
                } else {
                    b
                }
            }
            Self::WherePositive => {
                if a > 0.0 {
                    b
                } else {
                    0.0
                }
            }
            Self::Relu => {
                if a > 0.0 {
                    a
                } else {
                    0.0
                }
            }
            Self::Fma => scalar_fma(isa, a, b, c),
        }
    }

    #[inline(always)]
    fn vector<S: Simd>(self, s: S, [a, b, c]: [S::V; 3]) -> S::V {
        match self {
            Self::Add => s.add(a, b),
            Self::Sub => s.sub(a, b),
            Self::Mul => s.mul(a, b),
            Self::Div => s.div(a, b),
            Self::Max => s.max(a, b),
            Self::Min => s.min(a, b),
            Self::WherePositive => s.where_positive(a, b),
            Self::Relu => s.relu(a),
            Self::Fma => s.fma(a, b, c),
        }
    }
}

/// A loop of a test, over vectors that may begin anywhere.
struct Each<'a, F> {
    from: [&'a [f32]; 3],
    map: F,
}

/// From up to three vectors to one.
trait Map {
    fn map<S: Simd>(&self, s: S, from: [S::V; 3]) -> S::V;
}

impl<F: Map> SimdOp for Each<'_, F> {
    type Output = Vec<f32>;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Vec<f32> {
        let whole = self.from[0].len().next_multiple_of(LANES);
        let padded = self.from.map(|from| [from, &vec![1.0; whole - from.len()]].concat());
        let mut out = vec![0.0; whole];
        for at in (0..whole).step_by(LANES) {
            let from = [s.load(&padded[0], at), s.load(&padded[1], at), s.load(&padded[2], at)];
            s.store(self.map.map(s, from), &mut out, at);
        }
        out.truncate(self.from[0].len());
        out
    }
}

/// `map` of each triple on an instruction set.
fn mapped(isa: Isa, from: [&[f32]; 3], map: impl Map) -> Vec<f32> {
    isa.run(Each { from, map })
}

impl Map for Operation {
    #[inline(always)]
    fn map<S: Simd>(&self, s: S, from: [S::V; 3]) -> S::V {
        self.vector(s, from)
    }
}

#[test]
fn arithmetic_is_that_of_scalars_at_every_edge() {
    let triples: Vec<[f32; 3]> =
        EDGES.iter().flat_map(|a| EDGES.iter().flat_map(move |b| EDGES.iter().map(move |c| [*a, *b, *c]))).collect();
    let column = |i: usize| triples.iter().map(|triple| triple[i]).collect::<Vec<f32>>();
    let (a, b, c) = (column(0), column(1), column(2));
    for isa in Isa::available() {
        for operation in Operation::ALL {
            let found = mapped(isa, [&a, &b, &c], operation);
            for (triple, found) in triples.iter().zip(found) {
                let wanted = operation.scalar(isa, *triple);
                assert!(same(found, wanted), "{isa:?} {operation:?} of {triple:?}: {found:?}, not {wanted:?}");
            }
        }
    }
}

struct Scale2;
impl Map for Scale2 {
    #[inline(always)]
    fn map<S: Simd>(&self, s: S, [v, n, _]: [S::V; 3]) -> S::V {
        s.scale2(v, n)
    }
}

#[test]
fn scaling_by_powers_of_two_is_exact() {
    let exponents: Vec<f32> = (-126..=127).map(|n| n as f32).collect();
    for isa in Isa::available() {
        for v in EDGES {
            let found = mapped(isa, [&vec![v; exponents.len()], &exponents, &exponents], Scale2);
            for (n, found) in exponents.iter().zip(found) {
                assert!(same(found, v * 2f32.powi(*n as i32)), "{isa:?} {v:?}·2^{n}: {found:?}");
            }
        }
    }
}

struct Round;
impl Map for Round {
    #[inline(always)]
    fn map<S: Simd>(&self, s: S, [v, ..]: [S::V; 3]) -> S::V {
        s.round(v)
    }
}

#[test]
fn rounding_takes_ties_to_even() {
    let values: Vec<f32> =
        (-70..=70).map(|i| i as f32 / 4.0).chain([-0.0, 1e-40, 4_194_303.5, -4_194_303.5, 4_194_304.0]).collect();
    for isa in Isa::available() {
        for (v, found) in values.iter().zip(mapped(isa, [&values; 3], Round)) {
            assert_eq!(found, v.round_ties_even(), "{isa:?} {v}");
        }
    }
}

/// Mantissa or exponent.
struct Split(bool);
impl Map for Split {
    #[inline(always)]
    fn map<S: Simd>(&self, s: S, [v, ..]: [S::V; 3]) -> S::V {
        let (m, e) = s.split(v);
        if self.0 { m } else { e }
    }
}

#[test]
fn splitting_gives_a_mantissa_around_one_and_its_exponent() {
    let values: Vec<f32> = (-126..=127)
        .flat_map(|n| [1.0, 1.3, SQRT_2.next_down(), SQRT_2, 2f32.next_down()].map(|m| m * 2f32.powi(n)))
        .chain([f32::MIN_POSITIVE, f32::MAX])
        .collect();
    for isa in Isa::available() {
        let mantissas = mapped(isa, [&values; 3], Split(true));
        for ((v, m), e) in values.iter().zip(mantissas).zip(mapped(isa, [&values; 3], Split(false))) {
            assert_eq!(f64::from(m) * 2f64.powi(e as i32), f64::from(*v), "{isa:?}");
            assert!((FRAC_1_SQRT_2..SQRT_2).contains(&m), "{isa:?} {v}: {m}");
        }
    }
}

struct Memory;
impl SimdOp for Memory {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let from: Vec<f32> = (0..3 * LANES).map(|i| i as f32).collect();
        s.prefetch(from.as_ptr());
        s.prefetch(std::ptr::null());
        for at in 0..=2 * LANES {
            let mut to = vec![-1.0; 3 * LANES];
            s.store(s.load(&from, at), &mut to, at);
            let wanted = |i: usize| if (at..at + LANES).contains(&i) { i as f32 } else { -1.0 };
            assert!(to.iter().enumerate().all(|(i, v)| *v == wanted(i)), "at {at}: {to:?}");
        }
        let mut one = [0.0; LANES];
        s.store(s.splat(-0.0), &mut one, 0);
        assert!(one.iter().all(|v| v.to_bits() == (-0.0f32).to_bits()));
    }
}

/// A load or store that reaches one place beyond a slice.
struct Outside(usize);
impl SimdOp for Outside {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let (wide, narrow) = ([0.0; LANES], [f16::ZERO; LANES]);
        match self.0 {
            0 => s.store(s.load(&wide, 1), &mut [0.0; LANES], 0),
            1 => s.store(s.load(&wide[..LANES - 1], 0), &mut [0.0; LANES], 0),
            2 => s.store(s.load_f16(&narrow, 1), &mut [0.0; LANES], 0),
            3 => s.store(s.splat(1.0), &mut [0.0; LANES], 1),
            _ => s.store(s.splat(1.0), &mut [0.0; LANES - 1], 0),
        }
    }
}

#[test]
fn memory_is_touched_where_it_is_said_and_nowhere_else() {
    for isa in Isa::available() {
        isa.run(Memory);
        for way in 0..5 {
            assert!(catch_unwind(AssertUnwindSafe(|| isa.run(Outside(way)))).is_err(), "{isa:?} {way}");
        }
    }
}

/// Every value of an element type, widened.
struct Widened<'a, E>(&'a [E]);
impl<E: Element> SimdOp for Widened<'_, E> {
    type Output = Vec<f32>;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Vec<f32> {
        let mut out = vec![0.0; self.0.len()];
        for at in (0..out.len()).step_by(LANES) {
            s.store(E::load(s, self.0, at), &mut out, at);
        }
        out
    }
}

#[test]
fn every_element_is_widened_exactly() {
    let halves: Vec<f16> = (0..=u16::MAX).map(f16::from_bits).collect();
    let floats: Vec<f32> = EDGES[..LANES].to_vec();
    for isa in Isa::available() {
        assert!(isa.run(Widened(&halves)).iter().zip(&halves).all(|(found, half)| same(*found, half.to_f32())), "{isa:?}");
        assert!(isa.run(Widened(&floats)).iter().zip(&floats).all(|(found, v)| same(*found, *v)), "{isa:?}");
    }
}

struct Transposed;
impl SimdOp for Transposed {
    type Output = Vec<f32>;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Vec<f32> {
        let from: Vec<f32> = (0..LANES * LANES).map(|i| i as f32).collect();
        let mut rows = [s.splat(0.0); LANES];
        for (i, row) in rows.iter_mut().enumerate() {
            *row = s.load(&from, LANES * i);
        }
        let mut to = vec![0.0; from.len()];
        for (i, row) in s.transpose(rows).into_iter().enumerate() {
            s.store(row, &mut to, LANES * i);
        }
        to
    }
}

#[test]
fn transposing_swaps_rows_and_columns() {
    for isa in Isa::available() {
        let to = isa.run(Transposed);
        assert!((0..LANES * LANES).all(|i| to[i] == (i % LANES * LANES + i / LANES) as f32), "{isa:?}");
    }
}

struct Exp;
impl Map for Exp {
    #[inline(always)]
    fn map<S: Simd>(&self, s: S, [x, ..]: [S::V; 3]) -> S::V {
        math::exp(s, x)
    }
}

/// Within 4e-7 of each value, and the same bits on all that have a fused multiply-add.
fn assert_accurate(what: &str, x: &[f32], exact: impl Fn(f64) -> f64, on: impl Fn(Isa) -> Vec<f32>) {
    let mut fused: Option<Vec<f32>> = None;
    for isa in Isa::available() {
        let found = on(isa);
        for (x, y) in x.iter().zip(&found) {
            let exact = exact(f64::from(*x));
            assert!((f64::from(*y) - exact).abs() <= 4e-7 * exact, "{isa:?}: {what}({x}) = {y}");
        }
        if is_fused(isa) {
            assert_eq!(fused.get_or_insert_with(|| found.clone()), &found, "{isa:?} {what}");
        }
    }
}

#[test]
fn exp_and_ln_1p_are_accurate_and_alike() {
    let x: Vec<f32> = (0..4096).map(|i| -87.0 + i as f32 * (174.0 / 4096.0)).collect();
    assert_accurate("exp", &x, f64::exp, |isa| mapped(isa, [&x; 3], Exp));
    // Not whole vectors.
    let x: Vec<f32> = (0..4099).map(|i| 10f32.powf(-12.0 + i as f32 * (48.0 / 4099.0))).chain([0.0]).collect();
    assert_accurate("ln_1p", &x, f64::ln_1p, |isa| {
        let mut out = x.clone();
        math::ln_1p_all(isa, &mut out);
        out
    });
}
