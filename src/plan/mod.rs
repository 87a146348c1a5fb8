//! What to do before it is done: which frames, which neighbours, and whether the shot is in order.

pub mod checks;
pub mod frames;
pub mod window;
