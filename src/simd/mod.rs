//! f32 convolutions on the CPU, the engine room: the same bits for any number of threads and any split into rows.
//!
//! [`Conv`] holds packed weights and runs on an [`Activation`] with the instruction set that [`Isa`] picks at run time.
//! One generic kernel (`kernel`) serves every instruction set through the `Vector` trait (`vector`); `tile` cuts the work up
//! for it and `pack` lays a tile's input out, with padding, ReLU, concatenation and up-sampling done on the way. [`Winograd`] does the
//! 3×3 layers of the residual blocks with less than half the products.

mod activation;
pub(crate) mod buffer;
mod conv;
pub mod dense;
mod isa;
mod kernel;
pub mod lanes;
mod pack;
mod tile;
mod vector;
mod winograd;

#[cfg(test)]
mod tests;

pub use activation::Activation;
pub use buffer::{keep_at_most, release_memory};
pub use conv::{Conv, Epilogue};
pub use isa::Isa;
pub use pack::Source;
pub use winograd::Winograd;
