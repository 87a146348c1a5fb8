//! What is computed where: tiles, windows, and what a shot does not need.

pub mod tiles;
