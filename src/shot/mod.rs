//! A shot from files to files: every frame of the range is written, and a bad frame does not stop the others.
//!
//! ```no_run
//! use hush::shot::{CancelToken, Job, run};
//!
//! let sequence = hush::io::sequence::Sequence::find(&["shot"])?;
//! let engine = hush::Engine::new(hush::Settings::default())?;
//! let summary = run(&Job::new(sequence, "denoised"), &engine, &|event| println!("{event:?}"), &CancelToken::new())?;
//! assert!(summary.is_complete());
//! # Ok::<(), hush::Error>(())
//! ```

mod actions;
mod bookkeeping;
mod cancel;
mod check;
mod currency;
mod dial;
mod events;
mod file_state;
mod frame_settings;
mod input_file;
mod job;
mod lambda_image;
mod ledger;
mod manifest;
mod output;
mod passes;
mod planned_frame;
mod prepare;
mod progress;
mod run;
mod run_state;
mod scope;
mod sources;
mod survey;
mod threads;
mod window_cache;

pub use cancel::CancelToken;
pub use check::{Checked, CheckedFrame, Counts, FrameState, SequenceCheck};
pub use currency::{Stale, StaleKind};
pub use dial::DialEntry;
pub use events::{Event, Status, Summary};
pub use file_state::{Content, FileState, Stamp};
pub use frame_settings::FrameSettings;
pub use job::{Job, WholeShot};
pub use ledger::Ledger;
pub use manifest::{Entry, MANIFEST, MANIFEST_VERSION, Manifest, NeighbourEntry};
pub use output::remove_unfinished;
pub(crate) use output::{lies_in, real_folder};
pub use planned_frame::{Action, PlannedFrame};
pub use prepare::Plan;
pub use run::{Runner, run};
pub use scope::Scope;

pub use crate::rules::checks::{Warning, WarningKind};
pub use crate::rules::window::{Unused, WindowFrame};
pub(crate) use input_file::has_vector;
pub use survey::{RuleSummary, Survey, SurveyedFrame, Timing, Unread, survey};
