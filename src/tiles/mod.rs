//! Tile geometry: which blocks of a frame need computing, few rectangles over them, and their cut into tiles with halos.

pub mod active;
pub mod cover;
mod cut;

pub use cut::*;
