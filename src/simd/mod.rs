//! Arithmetic on the CPU's vector instructions: convolutions, dense layers over pixel segments, sixteen-lane maths.

pub mod dense;
mod isa;
pub mod lanes;

pub use isa::Isa;
