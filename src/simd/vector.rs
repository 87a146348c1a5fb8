//! What every instruction set can do with sixteen f32 lanes.

use half::f16;

/// Lanes of every vector.
pub const LANES: usize = 16;
/// The bits of √½, where [`Simd::split`] parts mantissas.
pub(super) const SQRT_HALF: i32 = 0x3f35_04f3;

/// The token of an instruction set: proof that the CPU has it, and the operations on its vectors.
///
/// Every function is `#[inline(always)]`, so that it becomes part of the loop that [`Simd::run`] entered.
pub trait Simd: Copy + Send + Sync + 'static {
    /// Sixteen f32.
    type V: Copy;
    /// How many V the registers hold: what sizes the register tiles.
    const REGISTERS: usize;

    /// The token, where the CPU has the instructions.
    fn detect() -> Option<Self>;
    /// Runs `op` compiled for these instructions.
    fn run<Op: SimdOp>(self, op: Op) -> Op::Output;

    /// x in every lane.
    fn splat(self, x: f32) -> Self::V;
    /// Sixteen floats from `from[at..]`; panics if they are not there.
    fn load(self, from: &[f32], at: usize) -> Self::V;
    /// Writes sixteen floats to `to[at..]`; panics if there is no room.
    fn store(self, v: Self::V, to: &mut [f32], at: usize);
    /// a + b.
    fn add(self, a: Self::V, b: Self::V) -> Self::V;
    /// a − b.
    fn sub(self, a: Self::V, b: Self::V) -> Self::V;
    /// a · b.
    fn mul(self, a: Self::V, b: Self::V) -> Self::V;
    /// a / b.
    fn div(self, a: Self::V, b: Self::V) -> Self::V;
    /// a·b + c, rounded once where the instruction set can.
    fn fma(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V;
    /// a where a > b, else b: also where one is NaN, and for two zeros.
    fn max(self, a: Self::V, b: Self::V) -> Self::V;
    /// a where a < b, else b: also where one is NaN, and for two zeros.
    fn min(self, a: Self::V, b: Self::V) -> Self::V;
    /// a where x > 0, else +0.
    fn where_positive(self, x: Self::V, a: Self::V) -> Self::V;
    /// v·2ⁿ for integral n in −126…127.
    fn scale2(self, v: Self::V, n: Self::V) -> Self::V;
    /// The nearest integer, ties to even, for v in −2²²…2²².
    fn round(self, v: Self::V) -> Self::V;
    /// m in √½…√2 and e with v = m·2ᵉ, for positive normal v.
    fn split(self, v: Self::V) -> (Self::V, Self::V);
    /// Rows to columns.
    fn transpose(self, rows: [Self::V; LANES]) -> [Self::V; LANES];

    /// Sixteen half floats from `from[at..]`, widened; panics if they are not there.
    #[inline(always)]
    fn load_f16(self, from: &[f16], at: usize) -> Self::V {
        let mut wide = [0.0; LANES];
        for (to, from) in wide.iter_mut().zip(&from[at..at + LANES]) {
            *to = from.to_f32();
        }
        self.load(&wide, 0)
    }

    /// [`Simd::load`] without its check, for loops that made sure of all of it beforehand.
    ///
    /// # Safety
    /// `from[at..]` holds sixteen floats.
    #[inline(always)]
    unsafe fn load_unchecked(self, from: &[f32], at: usize) -> Self::V {
        // SAFETY: the caller's promise.
        self.load(unsafe { from.get_unchecked(at..at + LANES) }, 0)
    }

    /// [`Simd::store`] without its check, for loops that made sure of all of it beforehand.
    ///
    /// # Safety
    /// `to[at..]` has room for sixteen floats.
    #[inline(always)]
    unsafe fn store_unchecked(self, v: Self::V, to: &mut [f32], at: usize) {
        // SAFETY: the caller's promise.
        self.store(v, unsafe { to.get_unchecked_mut(at..at + LANES) }, 0);
    }

    /// Fetches the cache line at an address, which need not be valid.
    #[inline(always)]
    fn prefetch(self, _at: *const f32) {}

    /// v where it is above zero, else +0 (NaN too).
    #[inline(always)]
    fn relu(self, v: Self::V) -> Self::V {
        self.max(v, self.splat(0.0))
    }
}

/// A loop that is compiled once for each instruction set.
pub trait SimdOp {
    /// What it gives back.
    type Output;
    /// The loop; must be `#[inline(always)]`, lest it be compiled without the instructions.
    fn run<S: Simd>(self, simd: S) -> Self::Output;
}

/// Sixteen floats of a slice as an array.
#[inline(always)]
pub(super) fn sixteen(from: &[f32], at: usize) -> &[f32; LANES] {
    from[at..at + LANES].try_into().expect("a slice of sixteen")
}

/// Sixteen floats of a slice as an array for writing.
#[inline(always)]
pub(super) fn sixteen_mut(to: &mut [f32], at: usize) -> &mut [f32; LANES] {
    (&mut to[at..at + LANES]).try_into().expect("a slice of sixteen")
}

/// The values of an expression for each of a vector's registers, by their numbers. No closures: they would be functions of their own,
/// compiled without the instruction set.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
macro_rules! each_register {
    ([$($number:literal),+] $i:ident => $e:expr) => {
        // SAFETY: the caller's token `self` proves that the CPU has these instructions; loads and stores go through checked arrays.
        unsafe { [$({
            let $i: usize = $number;
            $e
        }),+] }
    };
}
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
pub(super) use each_register;
