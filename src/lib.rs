//! Hush takes the noise out of Blender Cycles animations without flicker.
//!
//! A temporal, multi-scale, kernel-predicting denoiser after Vogels et al. 2018, "Denoising with Kernel Prediction and
//! Asymmetric Loss Functions". Data flows one way: [`io`] → [`frame`] → [`tiles`] → [`network`] → [`kernels`] → [`io`];
//! [`engine`] runs that chain over a window of frames in memory, [`shot`] over the files of a shot,
//! [`watch`] over a folder that is still being filled; [`report`] measures it.

pub mod cli;
pub mod engine;
pub mod error;
pub mod frame;
pub mod io;
pub mod kernels;
pub mod layers;
pub mod memory;
pub mod metrics;
pub mod network;
pub mod picture;
pub mod preview;
#[cfg(feature = "python")]
mod python;
pub mod report;
pub mod rules;
pub mod settings;
pub mod shot;
pub mod simd;
pub mod stability;
pub mod tiles;
pub mod watch;
mod words;

pub use engine::{Denoised, EncodedFrame, Engine, Settings};
pub use error::{Error, Result};
pub use frame::{Aov, Frame, FrameView};
