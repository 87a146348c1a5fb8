//! Hush takes the noise out of Blender Cycles animations without flicker.
//!
//! A temporal, multi-scale, kernel-predicting denoiser after Vogels et al. 2018, "Denoising with Kernel Prediction and
//! Asymmetric Loss Functions". Data flows one way: [`io`] → [`frame`] → [`tiles`] → [`network`] → [`kernels`] → [`io`];
//! [`engine`] runs that chain over a window of frames in memory, [`shot`] over the files of a shot,
//! [`watch`] over a folder that is still being filled; [`report`] measures it.

#[doc(hidden)]
pub mod cli;
pub mod engine;
pub mod error;
pub mod frame;
pub mod io;
mod kernels;
mod metrics;
mod network;
mod picture;
pub mod preview;
#[cfg(feature = "python")]
mod python;
mod report;
mod rules;
pub mod settings;
pub mod shot;
mod simd;
mod stability;
mod tiles;
pub mod watch;
mod words;

pub use engine::{Denoised, EncodedFrame, Engine, Settings};
pub use error::{Error, Result};
pub use frame::{Aov, Frame, FrameView};

/// What only this project's own tests and benches use; it may change at any time.
#[cfg(feature = "internals")]
#[doc(hidden)]
pub mod internals {
    pub use crate::metrics::{EvaluateOptions, evaluate};
    pub use crate::network::body::Body;
    pub use crate::network::levels::kernel_reach;
    pub use crate::report::{Options, REACH, measure};
    pub use crate::simd::{Activation, Conv, Epilogue, Winograd};
    pub use crate::stability::{Case, CheckRow, HAZARDS, Suite, rendered, summary};
    pub use crate::tiles::{Rect, Tile, tiles};
}
