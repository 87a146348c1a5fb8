//! Sixteen f32 lanes on every instruction set: a loop is written once, over [`Simd`], and runs on what the CPU has.
//!
//! A value of a back end's type is a token: it exists only where the CPU has the back end's instructions, so every operation is
//! safe to call. [`Isa`] detects them, and [`Isa::run`] is the one place where a token is made and a loop, a [`SimdOp`], is entered
//! compiled for its instructions; `dispatch!` writes the `SimdOp` of a plain function.
//!
//! All operations round alike on AVX-512, AVX2 and NEON. The portable path has no fused multiply-add unless the target has, and
//! agrees to a few units in the last place. `conformance` holds every back end to that.
//!
//! # Adding an instruction set
//! One file like `avx2.rs`: a token type and its `impl Simd`, whose `detect` makes the token only where the CPU has the instructions.
//! Then one line in the table of `isa.rs` and the module here. The conformance suites of this room and of `layers` run it from then
//! on.
//!
//! # Adding an element type
//! One file like `element.rs` holds: `impl Element` with a `load` that widens to f32 lanes. Where a back end has an instruction for
//! it, the load is an operation of [`Simd`] that widens lane by lane unless a back end does better (see [`Simd::load_f16`]); so would
//! be a dot product of bf16 or int8.

mod element;
mod isa;
pub mod math;
mod portable;
mod vector;

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
#[cfg(target_arch = "aarch64")]
mod neon;

#[cfg(test)]
pub(crate) mod conformance;

pub use element::Element;
pub use isa::Isa;
pub(crate) use isa::dispatch;
pub use vector::{LANES, Simd, SimdOp};
