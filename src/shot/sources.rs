//! The files that a run reads: their headers, why the bad ones are bad, and what they are as it starts.

use std::collections::BTreeMap;

use super::file_state::{FileMemory, FileState};
use super::input_file::InputFile;
use super::job::Job;
use crate::error::Error;
use crate::rules::window::Availability;

/// The files of the range and around it, by frame number.
#[derive(Debug)]
pub(super) struct Sources {
    /// The first and the last frame of the shot.
    ends: Option<(i64, i64)>,
    pub good: BTreeMap<i64, InputFile>,
    pub bad: BTreeMap<i64, Error>,
    /// The files as they are when the run starts, without their content.
    pub stamps: BTreeMap<i64, Option<FileState>>,
}

impl Sources {
    /// A file as it was when the run started.
    pub fn stamp(&self, number: i64) -> Option<FileState> {
        self.stamps.get(&number).copied().flatten()
    }

    /// What is known of a frame from its header.
    pub fn known(&self, number: i64) -> Availability {
        if self.ends.is_none_or(|(first, last)| number < first || number > last) {
            return Availability::Outside;
        }
        match self.good.get(&number) {
            Some(source) => source.known(),
            None if self.bad.contains_key(&number) => Availability::Bad,
            None => Availability::Missing,
        }
    }
}

/// Opens the files that `near` picks.
pub(super) fn open_sources(job: &Job, numbers: &[i64], near: impl Fn(i64) -> bool, files: &mut FileMemory) -> Sources {
    let ends = job.whole.map(|w| (w.first, w.last)).or(numbers.first().copied().zip(numbers.last().copied()));
    let mut sources = Sources { ends, good: BTreeMap::new(), bad: BTreeMap::new(), stamps: BTreeMap::new() };
    let selection = job.selection();
    for frame in job.sequence.frames.iter().filter(|f| near(f.number)) {
        sources.stamps.insert(frame.number, FileState::of(&frame.path));
        match files.layout(&frame.path).and_then(|layout| InputFile::new(frame.number, layout, &selection)) {
            Ok(source) => _ = sources.good.insert(frame.number, source),
            Err(error) => _ = sources.bad.insert(frame.number, error),
        }
    }
    sources
}
