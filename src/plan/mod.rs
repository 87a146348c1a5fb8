//! What is computed where: the frames of a run, each frame's window, tiles, and what is wrong with a shot.

pub mod active;
pub mod checks;
pub mod cover;
pub mod frames;
pub mod lambda;
pub mod skip;
pub mod tiles;
pub mod window;
