//! What is computed where: the frames of a run, each frame's window, tiles, and what is wrong with a shot.

pub mod checks;
pub mod frames;
pub mod lambda;
pub mod tiles;
pub mod window;
