//! The network's layers on the CPU: the same bits for any number of threads and any split into rows.
//!
//! [`Conv`] holds packed weights and runs on an [`Activation`] with the instruction set that [`Isa`](crate::simd::Isa) picks.
//! `cache_tile` cuts the work up, `pack` lays a tile's input out, with padding, ReLU, concatenation and up-sampling done on the way,
//! and `register_tile` sums. [`Winograd`] does the 3×3 layers of the residual blocks with less than half the products by the same
//! inner loops. [`Dense`] has pixels in the lanes and feeds kernel application.

mod activation;
mod cache_tile;
mod conv;
mod dense;
mod epilogue;
mod pack;
mod register_tile;
mod winograd;
mod winograd_transform;

#[cfg(test)]
mod conformance;

pub use activation::Activation;
pub use conv::Conv;
pub use dense::{Dense, SEGMENT};
pub use epilogue::Epilogue;
pub use pack::Source;
pub use winograd::Winograd;
