//! One shot of the watched folder: its frames, its settings, and what was made of it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::time::Duration;

use super::WatchOptions;
use super::landing::{FileCheck, Made};
use super::ready::Frames;
use super::ready_rules::ReadyRules;
use super::settings_files::SettingsFiles;
use super::tree::{FrameFile, ShotKey, Tree};
use crate::engine::Identity;
use crate::error::{Error, Result};
use crate::io::is_complete;
use crate::io::sequence::{Sequence, SequenceFrame};
use crate::rules::frames::FrameSet;
use crate::shot::{Content, Entry, Job, Manifest, Stamp, Status, WholeShot, has_vector};

/// A file is stable when it has not changed this long, where nobody said that it was closed.
const QUIET: Duration = Duration::from_secs(1);

/// A shot.
pub(super) struct Shot {
    pub key: ShotKey,
    /// Such as `beauty/frame_####.exr`.
    pub name: String,
    pub frames: Frames,
    pub rules: ReadyRules,
    /// The settings; its sequence is empty.
    job: Job,
    settings_files: SettingsFiles,
    /// The engine's that makes its frames.
    engine: Identity,
    /// The width of the numbers in the files' names.
    digits: BTreeMap<i64, usize>,
    /// Kinds of warnings that were reported.
    pub warned: BTreeSet<String>,
    /// Files reported to be incomplete.
    pub reported_incomplete: BTreeMap<i64, Stamp>,
    pub started: bool,
    pub written: usize,
    /// Frames that this process wrote.
    pub own: BTreeSet<i64>,
    pub degraded: BTreeSet<i64>,
}

impl Shot {
    /// The shot of a file.
    ///
    /// # Errors
    /// Its settings cannot be had.
    pub fn new(
        tree: &Tree,
        file: &FrameFile,
        options: &WatchOptions,
        job: &dyn Fn(Sequence) -> Result<Job>,
        engine: &Identity,
    ) -> Result<Self> {
        let key = ShotKey::clone(&file.key);
        let path = tree.source(&key, file.number, file.digits);
        let frames = vec![SequenceFrame { number: file.number, path }];
        let sequence = Sequence { name: key.pattern(file.digits), frames, ignored: Vec::new(), named: None };
        let (mut job, settings_files) = SettingsFiles::read(sequence, job)?;
        job.output = tree.output(&key);
        job.sequence.frames.clear();
        (job.overwrite, job.strict) = (false, false);
        let rules = ReadyRules {
            window: job.settings.window,
            vectors: job.vectors(),
            frames: job.settings.frames.clone(),
            second_pass: engine.second_pass,
            settle: options.settle,
            redo: options.redo,
            quiet: options.poll.unwrap_or(QUIET),
            once: options.once,
        };
        Ok(Self {
            name: key.name(file.digits),
            key,
            frames: Frames::default(),
            rules,
            engine: engine.clone(),
            job,
            settings_files,
            digits: BTreeMap::new(),
            warned: BTreeSet::new(),
            reported_incomplete: BTreeMap::new(),
            started: false,
            written: 0,
            own: BTreeSet::new(),
            degraded: BTreeSet::new(),
        })
    }

    /// The file that other settings than the shot's stand in by now; told once of each change.
    pub fn changed_settings(&mut self, job: &dyn Fn(Sequence) -> Result<Job>) -> Option<PathBuf> {
        self.settings_files.changed(&self.job, job)
    }

    /// The output folder.
    pub fn output(&self) -> &std::path::Path {
        &self.job.output
    }

    /// A frame's file name.
    pub fn file(&self, number: i64) -> String {
        self.key.file(number, self.digits.get(&number).copied().unwrap_or(1))
    }

    /// A frame's input file.
    pub fn source(&self, tree: &Tree, number: i64) -> PathBuf {
        tree.source(&self.key, number, self.digits.get(&number).copied().unwrap_or(1))
    }

    /// A file is there. False where another file has the same number.
    pub fn seen(&mut self, file: &FrameFile, stamp: Stamp, closed: bool, now: Duration) -> bool {
        let near = self.engine.context(crate::rules::window::MAX_WINDOW) as i64;
        if !(file.number - near..=file.number + near).any(|n| self.rules.wants(n)) {
            return true;
        }
        if *self.digits.entry(file.number).or_insert(file.digits) != file.digits {
            return false;
        }
        self.frames.seen(file.number, stamp, closed, now);
        true
    }

    /// A file is gone.
    pub fn gone(&mut self, number: i64) {
        self.digits.remove(&number);
        self.frames.gone(number);
    }

    /// Looks into a file. True where a frame has landed.
    pub fn look(&mut self, tree: &Tree, number: i64, now: Duration) -> bool {
        let path = self.source(tree, number);
        let Some(stamp) = Stamp::of(&path) else {
            self.gone(number);
            return false;
        };
        // A run that could not read it got further than the look does.
        let sound = is_complete(&path).and_then(|()| match self.frames.is_unread(number) {
            true => Content::of(&path).map(drop),
            false => Ok(()),
        });
        let vector = sound.and_then(|()| match has_vector(&path, &self.job.selection()) {
            // The run will say what is missing.
            Err(Error::MissingPass { .. } | Error::MissingLayer { .. } | Error::BadSetting { .. }) => Ok(false),
            other => other,
        });
        let look = match vector {
            Ok(vector) => FileCheck::Whole { vector },
            Err(Error::Io { source, .. }) => FileCheck::Unreadable(source.to_string()),
            Err(Error::BadFile { reason, .. }) => FileCheck::Partial(reason),
            Err(_) => FileCheck::Whole { vector: false },
        };
        match Stamp::of(&path) {
            Some(after) if after == stamp => {
                self.frames.seen(number, stamp, false, now);
                self.frames.looked(number, stamp, look, now)
            }
            Some(after) => {
                self.frames.seen(number, after, false, now);
                false
            }
            None => {
                self.gone(number);
                false
            }
        }
    }

    /// Learns from the manifest how a frame was made, by whichever process. Files that Hush did not write are refused.
    pub fn learn(&mut self, number: i64, manifest: &Manifest) -> Result<()> {
        let output = self.job.output.join(self.file(number));
        let Some(entry) = manifest.entry(&output) else {
            if output.exists() {
                let reason = "is there already, and the manifest does not say that Hush wrote it: move it away or choose another \
                              output folder";
                return Err(Error::BadInput { input: output.display().to_string(), reason: reason.into() });
            }
            return Ok(());
        };
        let made = self.made(number, entry, manifest).filter(|m| !m.failed);
        let Some(made) = made else { return Ok(()) };
        if self.frames.made(number) != Some(&made) && is_complete(&output).is_ok() {
            self.frames.set_made(number, Some(made));
        }
        Ok(())
    }

    /// How the manifest says that a frame was made; none where it was not, or with other settings.
    pub fn made(&self, number: i64, entry: &Entry, manifest: &Manifest) -> Option<Made> {
        let then = manifest.settings.get(&entry.settings)?;
        let same = self.job.frame_settings(then.window, number, &self.engine).is_ok_and(|now| now == *then);
        let image = self.job.lambda_image(number).and_then(|path| Stamp::of(&path));
        let same_dials =
            entry.neighbours.iter().all(|n| n.dial.as_ref().is_none_or(|dial| dial.is_untouched(&self.job, n.frame)));
        if !same || image != entry.lambda_image.map(|state| state.stamp) || !same_dials || entry.status == Status::Planned {
            return None;
        }
        Self::as_made(entry, manifest)
    }

    /// As [`made`](Self::made), whatever the settings and masks are now.
    pub fn as_made(entry: &Entry, manifest: &Manifest) -> Option<Made> {
        let window = manifest.settings.get(&entry.settings)?.window;
        // One that could not be read then counts as not there.
        let known = entry.neighbours.iter().filter(|n| !n.is_unknown());
        let around = known.filter_map(|n| n.stamp.map(|state| (n.offset, state.stamp))).collect();
        Some(Made { stamp: entry.stamp.map(|state| state.stamp), around, window, failed: entry.status == Status::Failed })
    }

    /// Has the frames made again whose denoised files somebody deleted. True where there is one.
    pub fn forget_lost(&mut self) -> bool {
        let (key, digits, output) = (&self.key, &self.digits, &self.job.output);
        self.frames.forget_lost(|number| output.join(key.file(number, digits.get(&number).copied().unwrap_or(1))).exists())
    }

    /// Gives a frame up until its file changes.
    pub fn give_up(&mut self, number: i64) {
        let stamp = self.frames.stamp(number);
        let window = self.frames.window(&self.rules);
        self.frames.set_made(number, Some(Made { stamp, around: Box::default(), window, failed: true }));
    }

    /// The job for some frames, with those beside them.
    pub fn job_for(&self, tree: &Tree, targets: &[i64]) -> Job {
        let reach = self.engine.context(self.frames.window(&self.rules)) as i64;
        let mut numbers: BTreeSet<i64> = targets.iter().copied().collect();
        for target in targets {
            numbers.extend(self.frames.whole(target - reach, target + reach));
        }
        let file = |n: &i64| SequenceFrame { number: *n, path: self.source(tree, *n) };
        let frames: Vec<SequenceFrame> = numbers.iter().map(file).collect();
        let known = self.rules.frames.as_ref().and_then(FrameSet::ends);
        let ends = [known, self.frames.ends()].into_iter().flatten().reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
        let whole = ends.map(|(first, last)| WholeShot { first, last, vector: self.frames.has_vector() });
        let sequence = Sequence { name: self.job.sequence.name.clone(), frames, ignored: Vec::new(), named: None };
        Job { sequence, whole, ..self.job.clone() }.with(|settings| settings.frames = Some(FrameSet::of(targets)))
    }
}
