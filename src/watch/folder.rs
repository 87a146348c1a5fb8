//! The watched folder: its shots, which files in it changed, and which of them are whole.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::WatchOptions;
use super::events::WatchEvent;
use super::folder_events::{Changes, FolderEvents, is_remote};
use super::shots::Shot;
use super::tree::{FrameFile, ShotKey, Tree};
use crate::engine::Identity;
use crate::error::{Error, Result};
use crate::io::sequence::Sequence;
use crate::io::{FileId, file_id, other_pattern};
use crate::rules::checks::WarningKind;
use crate::shot::{CancelToken, Job, Stamp, real_folder};

/// Even with events the folder is scanned now and then, as some get lost.
const RESCAN: Duration = Duration::from_secs(10);
/// Between two scans of a system that refuses events.
const POLL: Duration = Duration::from_secs(2);
/// So many shots of one frame with names alike are told.
const ALIKE: usize = 3;
/// A scan takes at most this share of the time.
const SHARE: u32 = 20;

/// The watched folder.
pub(super) struct Folder<'a> {
    pub tree: Tree,
    pub shots: BTreeMap<ShotKey, Shot>,
    options: &'a WatchOptions,
    report: &'a dyn Fn(WatchEvent<'_>),
    job: &'a dyn Fn(Sequence) -> Result<Job>,
    engine: &'a Identity,
    events: FolderEvents,
    /// The input folder, as the system knows it; none while it is not there.
    root: Option<FileId>,
    real_input: PathBuf,
    /// Shots that cannot be denoised as they are.
    refused: BTreeMap<ShotKey, Refusal>,
    /// Frames were asked for by number.
    asked: bool,
    poll: Option<Duration>,
    next_scan: Duration,
    /// What was reported to be left out.
    left_out: BTreeSet<PathBuf>,
    began: Instant,
}

impl<'a> Folder<'a> {
    /// As [`super::watch`]; times count from `began`.
    pub fn new(
        options: &'a WatchOptions,
        job: &'a dyn Fn(Sequence) -> Result<Job>,
        engine: &'a Identity,
        report: &'a dyn Fn(WatchEvent<'_>),
        began: Instant,
    ) -> Result<Self> {
        let tree = Tree::new(&options.input, &options.output)?;
        // Settings that no shot could be denoised with are refused now.
        let any = job(Sequence { name: String::new(), frames: Vec::new(), ignored: Vec::new(), named: None })?;
        any.reach()?;
        Ok(Self {
            tree,
            shots: BTreeMap::new(),
            options,
            report,
            job,
            engine,
            events: FolderEvents::off(),
            root: None,
            real_input: PathBuf::new(),
            refused: BTreeMap::new(),
            asked: any.settings.frames.is_some(),
            poll: options.poll,
            next_scan: Duration::ZERO,
            left_out: BTreeSet::new(),
            began,
        })
    }

    fn now(&self) -> Duration {
        self.began.elapsed()
    }

    /// Whether the folder is there.
    pub fn is_there(&self) -> bool {
        self.root.is_some()
    }

    /// What changed since the last call; waits for something up to `timeout`.
    pub fn changes(&self, timeout: Duration) -> Changes {
        self.events.changes(timeout)
    }

    /// Stops watching.
    pub fn close(&mut self) {
        self.events.stop();
    }

    /// Says how the folder is watched: by events where there are any to be had.
    pub fn begin(&mut self) {
        if self.poll.is_none() && is_remote(&self.tree.input) {
            self.warn("the folder is on a network: it is scanned every few seconds".into());
            self.poll = Some(POLL);
        }
        let (input, output) = (&self.tree.input, &self.tree.output);
        (self.report)(WatchEvent::Watching { input, output, polling: self.poll.is_some() || self.options.once });
    }

    fn warn(&self, message: String) {
        (self.report)(WatchEvent::Warning { kind: WarningKind::Note, message });
    }

    /// Takes in what changed in the folder.
    pub fn take_in(&mut self, changes: Changes) -> Result<()> {
        let root = identity(&self.tree.input);
        if root.is_none() || root != self.root {
            self.events.stop();
            self.next_scan = Duration::ZERO;
        }
        self.root = root;
        if root.is_none() {
            self.shots.values_mut().for_each(|s| s.frames.there().collect::<Vec<_>>().into_iter().for_each(|n| s.gone(n)));
            return Ok(());
        }
        if self.poll.is_none() && !self.options.once && !self.events.are_on() {
            // The system tells of real paths.
            self.real_input = real_folder(&self.tree.input);
            if let Err(refusal) = self.events.start(&self.real_input) {
                self.warn(refusal);
                self.poll = Some(POLL);
            }
            self.next_scan = Duration::ZERO;
        }
        let (real, input) = (self.real_input.clone(), self.tree.input.clone());
        let named = |path: &Path| path.strip_prefix(&real).map_or_else(|_| path.into(), |below| input.join(below));
        for (path, closed) in changes.files {
            self.look_at(&named(&path), closed)?;
        }
        if changes.all || self.now() >= self.next_scan {
            let before = self.now();
            self.scan(&self.tree.input.clone())?;
            self.tell_of_other_settings();
            let took = self.now().saturating_sub(before);
            self.next_scan = self.now() + (took * SHARE).max(self.poll.unwrap_or(RESCAN));
        } else {
            for folder in changes.folders {
                self.scan(&named(&folder))?;
            }
        }
        Ok(())
    }

    /// Looks at one path that may have changed.
    fn look_at(&mut self, path: &Path, closed: bool) -> Result<()> {
        let Some(file) = self.tree.frame_of(path) else { return Ok(()) };
        match Stamp::of(path).filter(|_| path.is_file()) {
            Some(stamp) => self.seen(file, stamp, closed),
            None => {
                if let Some(shot) = self.shots.get_mut(&file.key).filter(|s| s.file(file.number) == file.name()) {
                    shot.gone(file.number);
                }
                Ok(())
            }
        }
    }

    /// Looks at a folder and everything below it.
    fn scan(&mut self, folder: &Path) -> Result<()> {
        let found = self.tree.scan(folder);
        let mut there: BTreeMap<Arc<ShotKey>, BTreeSet<i64>> = BTreeMap::new();
        let mut single: BTreeMap<Arc<ShotKey>, String> = BTreeMap::new();
        for (file, stamp) in found.frames {
            let numbers = there.entry(file.key.clone()).or_default();
            numbers.insert(file.number);
            match numbers.len() {
                1 => _ = single.insert(file.key.clone(), file.name()),
                _ => _ = single.remove(&file.key),
            }
            self.seen(file, stamp, false)?;
        }
        self.tell_of_other_numbers(&single);
        let tree = &self.tree;
        for (key, shot) in self.shots.iter_mut().filter(|(key, _)| tree.input.join(&key.folder).starts_with(folder)) {
            let there = there.get(key);
            let gone = |n: &i64| !there.is_some_and(|t| t.contains(n));
            let gone: Vec<i64> = shot.frames.there().filter(gone).collect();
            gone.into_iter()
                .filter(|n| !shot.source(tree, *n).exists())
                .collect::<Vec<_>>()
                .into_iter()
                .for_each(|n| shot.gone(n));
        }
        for (path, why) in found.ignored {
            if self.left_out.insert(path.clone()) {
                let message = format!("left out {}: it {why}", path.display());
                (self.report)(WatchEvent::Warning { kind: WarningKind::Ignored, message });
            }
        }
        Ok(())
    }

    /// Tells once where shots of one frame look like one shot with something behind the frame number.
    fn tell_of_other_numbers(&mut self, single: &BTreeMap<Arc<ShotKey>, String>) {
        let mut folders: BTreeMap<&Path, Vec<&str>> = BTreeMap::new();
        single.iter().for_each(|(key, name)| folders.entry(&key.folder).or_default().push(name));
        for (folder, names) in folders {
            let found = other_pattern(names.into_iter()).filter(|(_, count)| *count >= ALIKE);
            let Some((pattern, count)) = found else { continue };
            let pattern = self.tree.input.join(folder).join(pattern);
            if self.left_out.insert(pattern.clone()) {
                let pattern = pattern.display();
                self.warn(format!(
                    "{count} files like {pattern} are taken for as many shots of one frame, for the last number in a name is the \
                     frame's: where it is the other one, watch '{pattern}' instead"
                ));
            }
        }
    }

    /// Tells where a shot's settings were changed after they were read.
    fn tell_of_other_settings(&mut self) {
        for shot in self.shots.values_mut() {
            let Some(file) = shot.changed_settings(self.job) else { continue };
            let (shot, file) = (&shot.name, file.display());
            let message =
                format!("{shot} goes on with the settings that it began with, though {file} has changed: start the watch again");
            (self.report)(WatchEvent::Warning { kind: WarningKind::Note, message });
        }
    }

    fn seen(&mut self, file: FrameFile, stamp: Stamp, closed: bool) -> Result<()> {
        let now = self.now();
        if !self.shots.contains_key(&file.key) {
            if self.refused.get(&*file.key).is_some_and(|refusal| now < refusal.until) {
                return Ok(());
            }
            match Shot::new(&self.tree, &file, self.options, self.job, self.engine) {
                Ok(shot) => _ = self.shots.insert(ShotKey::clone(&file.key), shot),
                Err(error) if self.options.once && !matches!(error, Error::SwitchedOff { .. }) => return Err(error),
                // The other shots are not to suffer from it; the settings may be mended.
                Err(error) => {
                    let message = format!("left out {}: {error}", file.key.name(file.digits));
                    if self.left_out.insert(message.clone().into()) {
                        self.warn(message);
                    }
                    let since = self.refused.get(&*file.key).map_or(now, |refusal| refusal.since);
                    let off = if let Error::SwitchedOff { by } = error { Some(by) } else { None };
                    self.refused.insert(ShotKey::clone(&file.key), Refusal { since, until: now + POLL, off });
                    return Ok(());
                }
            }
        }
        let Some(shot) = self.shots.get_mut(&file.key) else { return Ok(()) };
        if self.poll.is_some() {
            shot.rules.quiet = self.poll.unwrap_or_default();
        }
        let path = self.tree.source(&file.key, file.number, file.digits);
        if !shot.seen(&file, stamp, closed, now) && self.left_out.insert(path.clone()) {
            let message = format!("left out {}: another file has the same frame number", path.display());
            (self.report)(WatchEvent::Warning { kind: WarningKind::Ignored, message });
        }
        Ok(())
    }

    /// Looks into the files that may be whole; whether any frame has landed.
    pub fn look_into_files(&mut self, cancel: &CancelToken) -> bool {
        let mut landed = false;
        let now = self.now();
        for shot in self.shots.values_mut() {
            for number in shot.frames.due(&shot.rules, now) {
                if cancel.is_cancelled() {
                    return landed;
                }
                let again = shot.frames.is_again(number);
                if shot.look(&self.tree, number, self.began.elapsed()) {
                    let source = shot.source(&self.tree, number);
                    (self.report)(WatchEvent::Landed { shot: &shot.name, frame: number, source, again });
                    landed = true;
                }
            }
        }
        landed
    }

    /// Whether a shot whose settings cannot be had may still come.
    pub fn may_bring_more(&self) -> bool {
        self.refused.iter().any(|(key, refusal)| refusal.off.is_none() && !self.shots.contains_key(key))
    }

    /// Where every shot that has begun to come is switched off: by what, and since when nothing else came.
    pub fn switched_off(&self) -> Option<(&str, Duration)> {
        let last = self.refused.values().max_by_key(|refusal| refusal.since)?;
        let by = last.off.as_deref().filter(|_| self.shots.is_empty() && !self.may_bring_more())?;
        Some((by, last.since))
    }

    /// Whether frames were asked for by number, so that the watch has an end.
    pub fn has_end(&self) -> bool {
        self.asked
    }
}

/// Why a shot is not denoised.
struct Refusal {
    since: Duration,
    /// The next attempt.
    until: Duration,
    /// What switches denoising off; else there is something to mend.
    off: Option<String>,
}

/// Tells one folder from another that was put in its place.
fn identity(folder: &Path) -> Option<FileId> {
    file_id(folder).filter(|_| folder.is_dir())
}
