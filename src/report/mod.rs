//! `hush report`: error against run time for the settings worth choosing between, as one page that needs nothing beside it.
//!
//! [`measure()`] runs a shot through every setting in turn; [`write()`] puts the page, its plots and its numbers into a folder.

mod axes;
mod candidates;
mod crops;
pub mod estimate;
mod files;
mod hush_runs;
mod judge;
mod machine;
mod measure;
mod oidn;
mod page;
mod pfm;
mod plots;
mod record;
mod soundness;
mod statistics;

pub use files::{PAGE, prepare, write};
pub use judge::REACH;
pub use measure::{FRAMES, MeasureOptions, Measured, measure};
pub use oidn::Oidn;
