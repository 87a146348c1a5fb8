//! The settings of a shot, wherever they stand: in a USD stage, in `hush.toml` beside the frames, on the command line, in Python. Later
//! ones win, and each value knows where it came from. [`SETTINGS`] declares them.
//!
//! ```no_run
//! use hush::settings::{ShotQuery, ShotSettings};
//! use hush::shot::Job;
//!
//! let given = ShotSettings { lambda: Some("1:1,24:8".parse()?), ..ShotSettings::default() };
//! let (sequence, settings) = ShotQuery::new(&["shot"], given).find()?;
//! let job = Job::of(&settings, sequence, None)?;
//! # Ok::<(), hush::Error>(())
//! ```

mod apart;
mod declare;
mod file;
mod kind;
mod layered;
mod nearest;
mod query;
mod setting;
pub(crate) mod size;
mod table;
#[cfg(feature = "usd")]
pub mod usd;
#[cfg(not(feature = "usd"))]
#[path = "no_usd.rs"]
pub mod usd;

pub use apart::{READ_STAGE, StageReader, answer as stage_answer, read_apart, set_stage_reader};
pub use file::{SETTINGS_FILE, SettingsFile, read_settings_file};
pub use kind::{Kind, Unfit, in_words};
pub use layered::{Layered, Origin};
pub use query::ShotQuery;
pub use setting::{Effect, Setting};
pub use table::{Guide, NOT_OF_A_PREVIEW, SETTINGS, ShotSettings};
pub use usd::StageRef;

pub use crate::rules::frames::FrameSet;
pub use crate::rules::lambda::Lambda;
pub use crate::rules::skip::Rule;
