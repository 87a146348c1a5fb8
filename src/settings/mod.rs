//! The settings of a shot, wherever they stand: in a USD stage, in `hush.toml` or `hush.json` beside the frames, on the command
//! line. Later ones win, and each value knows where it came from.
//!
//! ```no_run
//! use hush::settings::{Sources, ShotSettings, gather};
//!
//! let mut settings = gather(Some("shot".as_ref()), &Sources::default(), ShotSettings::default())?;
//! settings.values.lambda = Some("1:1,24:8".parse()?);
//! let job = settings.job(hush::io::sequence::Sequence::find(&["shot"])?, None)?;
//! # Ok::<(), hush::Error>(())
//! ```

mod apart;
mod gather;
mod keys;
mod layered;
mod names;
mod nearest;
mod side_file;
pub mod size;
#[cfg(feature = "usd")]
pub mod usd;
#[cfg(not(feature = "usd"))]
#[path = "no_usd.rs"]
pub mod usd;

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

pub use apart::{READ_STAGE, StageReader, answer as stage_answer, read_apart, set_stage_reader};
pub use gather::{Sources, gather};
pub use keys::{KEYS, Key};
pub use layered::{Layered, Origin};
pub use names::Guide;
pub use side_file::{SIDE_FILES, SideFile, beside, read_side_file};
pub use usd::StageRef;

use crate::io::PassNames;
use crate::rules::frames::FrameSet;
use crate::rules::lambda::Lambda;

/// What may be said about a shot. None: not said.
///
/// Serde reads it from and writes it to `hush.toml` and `hush.json`; keys that it does not know are errors.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ShotSettings {
    /// Whether the shot is to be denoised at all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub enable: Option<bool>,
    /// The frames: a folder, a pattern such as `render/frame_####.exr`, a glob or a file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub input: Option<PathBuf>,
    /// The folder to write to.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub output: Option<PathBuf>,
    /// The frames to write.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frames: Option<FrameSet>,
    /// The dial.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lambda: Option<Lambda>,
    /// Frames on each side that help, 0 to 3.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub window: Option<usize>,
    /// View layers to denoise, or `all`.
    #[serde(skip_serializing_if = "Option::is_none", deserialize_with = "names::several")]
    pub layers: Option<Vec<String>>,
    /// Stereo view to denoise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub view: Option<String>,
    /// View layer to take the Vector pass from.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vector_layer: Option<String>,
    /// Light passes to denoise along, or `all`.
    #[serde(skip_serializing_if = "Option::is_none", deserialize_with = "names::several")]
    pub aovs: Option<Vec<String>>,
    /// Guides that may be used; all of them where nothing is said.
    #[serde(skip_serializing_if = "Option::is_none", deserialize_with = "names::guides")]
    pub guides: Option<Vec<Guide>>,
    /// What the passes are called, where not as Blender calls them.
    #[serde(skip_serializing_if = "PassNames::is_default")]
    pub passes: PassNames,
    /// Keep the input beside the result as `Noisy Image`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub keep_noisy: Option<bool>,
    /// Other weights, a safetensors file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<PathBuf>,
    /// The renderer that made the frames, one that the weights have an encoder for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub renderer: Option<String>,
    /// Bytes for the frames in the window and the computing; in files also `4G`.
    #[serde(skip_serializing_if = "Option::is_none", deserialize_with = "size::bytes")]
    pub memory: Option<u64>,
}
