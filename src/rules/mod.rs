//! The rules of a shot: which frames to write, each frame's λ and window, what may be left out, and what is wrong with the render.

pub mod checks;
pub mod frames;
pub mod lambda;
pub mod pixel_checks;
pub mod skip;
pub mod window;
