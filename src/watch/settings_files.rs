//! The files that a shot's settings were read from, and whether they say something else by now.

use std::path::PathBuf;

use crate::error::Result;
use crate::io::sequence::Sequence;
use crate::settings::SETTINGS_FILE;
use crate::shot::{Job, Stamp};

/// The files as they were when the settings were read.
pub(super) struct SettingsFiles {
    /// With the shot's first frame.
    sequence: Sequence,
    /// None for one that was not there.
    stamps: Vec<(PathBuf, Option<Stamp>)>,
}

impl SettingsFiles {
    /// Reads the settings of the shot that begins with a sequence.
    ///
    /// # Errors
    /// The settings cannot be had.
    pub fn read(sequence: Sequence, job: &dyn Fn(Sequence) -> Result<Job>) -> Result<(Job, Self)> {
        let beside = sequence.frames.first().map(|first| first.path.with_file_name(SETTINGS_FILE));
        let before = beside.as_deref().and_then(Stamp::of);
        let read = job(sequence.clone())?;
        let others = read.settings_files.iter().filter(|file| Some(*file) != beside.as_ref());
        let mut stamps: Vec<_> = others.map(|file| (file.clone(), Stamp::of(file))).collect();
        stamps.extend(beside.map(|file| (file, before)));
        Ok((read, Self { stamps, sequence }))
    }

    /// The file that changed since, where the settings are no longer those of `then`.
    pub fn changed(&mut self, then: &Job, job: &dyn Fn(Sequence) -> Result<Job>) -> Option<PathBuf> {
        let mut changed = None;
        for (file, stamp) in &mut self.stamps {
            let now = Stamp::of(file);
            if now != *stamp {
                *stamp = now;
                changed = Some(file.clone());
            }
        }
        changed.filter(|_| job(self.sequence.clone()).map_or(true, |now| now.settings != then.settings))
    }
}
