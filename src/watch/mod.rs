//! Denoises frames while the render is still running: each as soon as it is whole and those beside it are there.
//!
//! The folder is seen through the system's events, or scanned ([`WatchOptions::poll`]). Each sequence in it, and in the folders below
//! it, is a shot. Frames that are ready are run through [`crate::shot`], a few at a time; its manifest says what was done, so that
//! a watch that was killed goes on where it was, and the result is the same as that of one run over the finished shot.

mod allocator;
mod claims;
mod events;
mod folder;
mod folder_events;
mod host;
mod landing;
mod ready;
mod ready_rules;
#[cfg(test)]
mod ready_tests;
mod settings_files;
mod shots;
mod tree;
mod watcher;
mod work;

use std::path::PathBuf;
use std::time::Duration;

pub use events::{Waiting, WatchEvent, WatchSummary};

use crate::engine::Engine;
use crate::error::Result;
use crate::io::sequence::Sequence;
use crate::shot::{CancelToken, Job};

/// What to watch and how.
#[derive(Clone, Debug)]
pub struct WatchOptions {
    /// A folder, which need not be there yet, or a pattern such as `shot/frame_####.exr`.
    pub input: PathBuf,
    /// Where the frames go; the folders below the input folder are mirrored in it.
    pub output: PathBuf,
    /// How long no frame must have come until neighbours that are missing are given up. None: at least 30 seconds, and three
    /// times the usual time between two frames, up to an hour.
    pub settle: Option<Duration>,
    /// Frames are made again when a neighbour comes that they lacked.
    pub redo: bool,
    /// Scan the folder this often instead of asking the system for events.
    pub poll: Option<Duration>,
    /// Denoise what is there, wait for nothing, and stop.
    pub once: bool,
}

/// Watches a folder until it is cancelled, with `once` until everything there is done, and where the jobs say which frames there
/// will be until those are done, in every shot that has begun to come.
///
/// `job` gives the settings of a shot, whose first file it is told; its output, `overwrite` and `strict` are not used. Events are
/// reported on the calling thread.
///
/// # Errors
/// An output folder that is or holds the input folder, settings that cannot be had, with `once` nothing to denoise. Everything
/// else is reported and tried again.
pub fn watch(
    options: &WatchOptions,
    job: &dyn Fn(Sequence) -> Result<Job>,
    engine: &Engine,
    report: &dyn Fn(WatchEvent<'_>),
    cancel: &CancelToken,
) -> Result<WatchSummary> {
    watcher::Watcher::new(options, job, engine, report, cancel)?.run()
}
