//! Hush takes the noise out of Blender Cycles animations, with less flicker than frame by frame.
//!
//! A temporal, multi-scale, kernel-predicting denoiser after Vogels et al. 2018, "Denoising with Kernel Prediction and
//! Asymmetric Loss Functions". This is the crate behind the program `hush`, the Python module and the Blender extension.
//!
//! ```
//! use hush::ndarray::Array3;
//! use hush::{Engine, Frame, Settings};
//!
//! // (rows, columns, channels) of linear light.
//! let noisy = Array3::from_shape_fn((32, 48, 3), |(y, x, c)| ((y * 7 + x * 5 + c) % 9) as f32 * 0.1);
//! let engine = Engine::new(Settings::default())?;
//! let frame = engine.encode(Frame::new(noisy))?;
//! // Alone, with λ = 1: as clean as can be.
//! let denoised = engine.denoise(&frame, &[], 1.0)?;
//! assert_eq!(denoised.colour.dim(), (32, 48, 3));
//! # Ok::<(), hush::Error>(())
//! ```
//!
//! # A tour
//!
//! 1. [`Frame`] is what a renderer makes: a beauty, and what it knows of it. All else is about frames.
//! 2. [`Engine`] denoises frames in memory: [`encode`](Engine::encode) each once, then [`denoise`](Engine::denoise) it with those
//!    around it. Its [`Settings`] say how, such as with how much memory. A [`Denoiser`] does both for frames as they come.
//! 3. [`io`] reads frames from multilayer EXR files and writes them back with only the denoised passes changed;
//!    [`io::sequence`] finds the files of a shot.
//! 4. [`shot`] does both for all files of a shot: a [`Job`](shot::Job) says what is to be done, [`run`](shot::run()) does it and
//!    tells how far it is. What is there already is left as it is.
//! 5. [`settings`] are those of a shot, from `hush.toml`, a USD stage or the caller, and become a job.
//! 6. [`watch`] does with a folder that is still being rendered into what `shot` does with a finished one; [`preview`] shows a
//!    part of one frame with several settings.
//! 7. [`enum@Error`] is the one type of error: it names the file or the setting, and says what to do.
//!
//! Cargo's feature `program`, on by default, brings 6. and the command line with all that they depend on; `usd` the reader of stages.
//!
//! Data flows one way: `io` → `frame` → `tiles` → `network` → `kernels` → `io`; [`engine`] runs that chain over a window of frames.
//! Programs to begin with stand in the folder `examples`.

#![cfg_attr(not(feature = "program"), allow(dead_code, unused_imports, reason = "what the program alone asks for"))]
#![warn(missing_docs, clippy::undocumented_unsafe_blocks)]
#![cfg_attr(not(any(feature = "internals", feature = "python")), warn(missing_debug_implementations))]

#[cfg(feature = "program")]
#[doc(hidden)]
pub mod cli;
pub mod engine;
pub mod error;
pub mod frame;
pub mod io;
mod kernels;
mod layers;
mod memory;
#[cfg(feature = "program")]
mod metrics;
mod network;
#[cfg(feature = "program")]
mod picture;
#[cfg(feature = "program")]
pub mod preview;
#[cfg(feature = "python")]
mod python;
#[cfg(feature = "program")]
mod report;
mod rules;
pub mod settings;
pub mod shot;
mod simd;
#[cfg(feature = "program")]
mod stability;
mod tiles;
#[cfg(feature = "program")]
pub mod watch;
mod words;

pub use engine::{Denoised, Denoiser, EncodedFrame, Engine, FirstPass, Settings};
pub use error::{Error, Result};
pub use frame::{Aov, Dial, Frame, FrameView, LambdaMap, LambdaMask, OwnedDial};
/// The arrays that images are given and come back in, in the version that they must have.
pub use ndarray;

/// What only this project's own tests and benches use; it may change at any time.
#[cfg(feature = "internals")]
#[doc(hidden)]
pub mod internals {
    pub use crate::layers::{Activation, Conv, Epilogue, Winograd};
    pub use crate::metrics::{EvaluateOptions, evaluate};
    pub use crate::network::body::Body;
    pub use crate::network::levels::kernel_reach;
    pub use crate::report::{MeasureOptions, REACH, measure};
    pub use crate::stability::{Case, CheckRow, HAZARDS, Suite, rendered, summary};
    pub use crate::tiles::{Rect, Tile, tiles};
}
