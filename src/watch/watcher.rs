//! The loop: look around, look into files, work, wait.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::claims::{Claims, tidy};
use super::events::{Event, Report, Waiting};
use super::eyes::{Eyes, Hints, is_remote};
use super::ready::Counts;
use super::shots::Shot;
use super::tree::{Place, ShotKey, Tree};
use super::{Options, work};
use crate::engine::Engine;
use crate::error::{Error, Result};
use crate::io::sequence::Sequence;
use crate::rules::checks::WarningKind;
use crate::shot::{CancelToken, Job, Runner, Stamp, real_folder};
use crate::words;

/// Even with events the folder is scanned now and then, as some get lost.
const RESCAN: Duration = Duration::from_secs(10);
/// Between two scans of a system that refuses events.
const POLL: Duration = Duration::from_secs(2);
/// A scan takes at most this share of the time.
const SHARE: u32 = 20;
/// Free memory is given back this often.
const TRIM: Duration = Duration::from_secs(5);
/// The longest wait between two looks.
const TICK: Duration = Duration::from_millis(200);
/// A file must have been incomplete this long to be told.
const TELL_AFTER: Duration = Duration::from_secs(5);

/// A watch.
pub(super) struct Watcher<'a> {
    pub options: &'a Options,
    pub report: &'a dyn Fn(Event<'_>),
    pub cancel: &'a CancelToken,
    pub tree: Tree,
    pub shots: BTreeMap<ShotKey, Shot>,
    pub runner: Runner<'a>,
    pub claims: Claims,
    /// Output folders whose leftovers were cleared.
    pub swept: BTreeSet<PathBuf>,
    /// The shot that had its turn last.
    pub turn: Option<ShotKey>,
    /// Nothing can be written before then, and the wait after the next failure.
    pub pause: (Duration, Duration),
    pub stopped: Option<Error>,
    job: &'a dyn Fn(Sequence) -> Result<Job>,
    eyes: Eyes,
    /// The input folder, as the system knows it; none while it is not there.
    root: Option<(u64, u64)>,
    real_input: PathBuf,
    /// Shots whose settings cannot be had: until the next attempt, and whether there is something to mend.
    refused: BTreeMap<ShotKey, (Duration, bool)>,
    poll: Option<Duration>,
    next_scan: Duration,
    next_trim: Duration,
    told: Option<Waiting>,
    told_ignored: BTreeSet<PathBuf>,
    began: Instant,
}

impl<'a> Watcher<'a> {
    /// As [`super::watch`].
    pub fn new(
        options: &'a Options,
        job: &'a dyn Fn(Sequence) -> Result<Job>,
        engine: &'a Engine,
        report: &'a dyn Fn(Event<'_>),
        cancel: &'a CancelToken,
    ) -> Result<Self> {
        let tree = Tree::new(&options.input, &options.output)?;
        // Settings that no shot could be denoised with are told now.
        job(Sequence { name: String::new(), frames: Vec::new(), ignored: Vec::new(), named: None })?.reach()?;
        Ok(Self {
            options,
            report,
            cancel,
            tree,
            shots: BTreeMap::new(),
            runner: Runner::new(engine),
            claims: Claims::new(),
            swept: BTreeSet::new(),
            turn: None,
            pause: (Duration::ZERO, work::FIRST_PAUSE),
            stopped: None,
            job,
            eyes: Eyes::closed(),
            root: None,
            real_input: PathBuf::new(),
            refused: BTreeMap::new(),
            poll: options.poll,
            next_scan: Duration::ZERO,
            next_trim: TRIM,
            told: None,
            told_ignored: BTreeSet::new(),
            began: Instant::now(),
        })
    }

    /// Time since the start.
    pub fn now(&self) -> Duration {
        self.began.elapsed()
    }

    /// Runs until cancelled or done.
    pub fn run(mut self) -> Result<Report> {
        self.choose_eyes();
        if self.options.once && !self.tree.input.is_dir() {
            let reason = "there is no such folder".into();
            return Err(Error::BadInput { input: self.tree.input.display().to_string(), reason });
        }
        let mut hints = Hints::default();
        while !self.cancel.is_cancelled() && self.stopped.is_none() {
            self.look_around(hints)?;
            self.look_into_files();
            hints = match self.work() {
                true => {
                    // The end of the work is told, even where the numbers are as before.
                    self.told = None;
                    if self.now() >= self.next_trim {
                        give_memory_back();
                        self.next_trim = self.now() + TRIM;
                    }
                    self.eyes.hints(Duration::ZERO)
                }
                false if self.options.once && self.is_finished() => break,
                false if self.has_all() => {
                    self.tell();
                    break;
                }
                false => {
                    self.tell();
                    self.eyes.hints(TICK)
                }
            };
        }
        self.finish()
    }

    /// Events where there are any to be had.
    fn choose_eyes(&mut self) {
        if self.poll.is_none() && is_remote(&self.tree.input) {
            self.warn("the folder is on a network: it is scanned every few seconds".into());
            self.poll = Some(POLL);
        }
        let (input, output) = (&self.tree.input, &self.tree.output);
        (self.report)(Event::Watching { input, output, polling: self.poll.is_some() || self.options.once });
    }

    fn warn(&self, message: String) {
        (self.report)(Event::Warning { kind: WarningKind::Note, message });
    }

    /// Takes in what changed in the folder.
    fn look_around(&mut self, hints: Hints) -> Result<()> {
        let root = identity(&self.tree.input);
        if root.is_none() || root != self.root {
            self.eyes.close();
            self.next_scan = Duration::ZERO;
        }
        self.root = root;
        if root.is_none() {
            self.shots.values_mut().for_each(|s| s.frames.there().collect::<Vec<_>>().into_iter().for_each(|n| s.gone(n)));
            return Ok(());
        }
        if self.poll.is_none() && !self.options.once && !self.eyes.are_open() {
            // The system tells of real paths.
            self.real_input = real_folder(&self.tree.input);
            if let Err(refusal) = self.eyes.open(&self.real_input) {
                self.warn(refusal);
                self.poll = Some(POLL);
            }
            self.next_scan = Duration::ZERO;
        }
        let (real, input) = (self.real_input.clone(), self.tree.input.clone());
        let named = |path: &Path| path.strip_prefix(&real).map_or_else(|_| path.into(), |below| input.join(below));
        for (path, closed) in hints.files {
            self.look_at(&named(&path), closed)?;
        }
        if hints.all || self.now() >= self.next_scan {
            let before = self.now();
            self.scan(&self.tree.input.clone())?;
            let took = self.now().saturating_sub(before);
            self.next_scan = self.now() + (took * SHARE).max(self.poll.unwrap_or(RESCAN));
        } else {
            for folder in hints.folders {
                self.scan(&named(&folder))?;
            }
        }
        Ok(())
    }

    /// Looks at one path that may have changed.
    fn look_at(&mut self, path: &Path, closed: bool) -> Result<()> {
        let Some(place) = self.tree.place(path) else { return Ok(()) };
        match Stamp::of(path).filter(|_| path.is_file()) {
            Some(stamp) => self.seen(place, stamp, closed),
            None => {
                if let Some(shot) = self.shots.get_mut(&place.key).filter(|s| s.file(place.number) == place.file()) {
                    shot.gone(place.number);
                }
                Ok(())
            }
        }
    }

    /// Looks at a folder and everything below it.
    fn scan(&mut self, folder: &Path) -> Result<()> {
        let found = self.tree.scan(folder);
        let mut there: BTreeMap<Arc<ShotKey>, BTreeSet<i64>> = BTreeMap::new();
        for (place, stamp) in found.frames {
            there.entry(place.key.clone()).or_default().insert(place.number);
            self.seen(place, stamp, false)?;
        }
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
            if self.told_ignored.insert(path.clone()) {
                let message = format!("left out {}: it {why}", path.display());
                (self.report)(Event::Warning { kind: WarningKind::Ignored, message });
            }
        }
        Ok(())
    }

    fn seen(&mut self, place: Place, stamp: Stamp, closed: bool) -> Result<()> {
        let now = self.now();
        if !self.shots.contains_key(&place.key) {
            if self.refused.get(&*place.key).is_some_and(|(until, _)| now < *until) {
                return Ok(());
            }
            match Shot::new(&self.tree, &place, self.options, self.job) {
                Ok(shot) => _ = self.shots.insert(ShotKey::clone(&place.key), shot),
                Err(error) if self.options.once && !matches!(error, Error::SwitchedOff { .. }) => return Err(error),
                // The other shots are not to suffer from it; the settings may be mended.
                Err(error) => {
                    let mendable = !matches!(error, Error::SwitchedOff { .. });
                    self.refused.insert(ShotKey::clone(&place.key), (now + POLL, mendable));
                    let message = format!("left out {}: {error}", place.key.name(place.digits));
                    if self.told_ignored.insert(message.clone().into()) {
                        self.warn(message);
                    }
                    return Ok(());
                }
            }
        }
        let Some(shot) = self.shots.get_mut(&place.key) else { return Ok(()) };
        if self.poll.is_some() {
            shot.rules.quiet = self.poll.unwrap_or_default();
        }
        let path = self.tree.source(&place.key, place.number, place.digits);
        if !shot.seen(&place, stamp, closed, now) && self.told_ignored.insert(path.clone()) {
            let message = format!("left out {}: another file has the same frame number", path.display());
            (self.report)(Event::Warning { kind: WarningKind::Ignored, message });
        }
        Ok(())
    }

    /// Looks into the files that may be whole.
    fn look_into_files(&mut self) {
        let now = self.now();
        for shot in self.shots.values_mut() {
            for number in shot.frames.due(&shot.rules, now) {
                if self.cancel.is_cancelled() {
                    return;
                }
                let again = shot.frames.is_again(number);
                if shot.look(&self.tree, number, self.began.elapsed()) {
                    let source = shot.source(&self.tree, number);
                    (self.report)(Event::Landed { shot: &shot.name, frame: number, source, again });
                    self.told = None;
                }
            }
        }
    }

    /// With `once`: nothing is left to do.
    fn is_finished(&self) -> bool {
        let now = self.now();
        let idle = |s: &Shot| s.frames.held(now) == 0 && s.frames.due(&s.rules, now).is_empty();
        self.shots.values().all(idle)
    }

    /// Every frame that was asked for by number is done, in every shot that has one of them; no other shot is known to come.
    fn has_all(&self) -> bool {
        let waits = |(key, (_, mendable)): (&ShotKey, &(Duration, bool))| *mendable && !self.shots.contains_key(key);
        let mut asked = self.asked().peekable();
        asked.peek().is_some() && asked.all(|s| s.frames.has_all(&s.rules)) && !self.refused.iter().any(waits)
    }

    /// The shots that hold a frame that is to be written.
    fn asked(&self) -> impl Iterator<Item = &Shot> {
        self.shots.values().filter(|s| s.rules.frames.is_none() || s.frames.any_wanted(&s.rules))
    }

    /// The frames that were asked for and have not come: `3-5,9`; of several shots each with its name.
    fn missing(&self) -> String {
        let all = self.asked().count() == 0;
        let shots: Vec<&Shot> = if all { self.shots.values().collect() } else { self.asked().collect() };
        let missing = |shot: &Shot| {
            let there: Vec<i64> = shot.frames.there().collect();
            words::ranges(&shot.rules.frames.as_ref().map(|set| set.missing(&there)).unwrap_or_default())
        };
        match shots.as_slice() {
            [only] => missing(only),
            several => {
                let told = several.iter().map(|s| (s, missing(s))).filter(|(_, missing)| !missing.is_empty());
                told.map(|(shot, missing)| format!("{} {missing}", shot.name)).collect::<Vec<_>>().join("; ")
            }
        }
    }

    fn counts(&self) -> (Counts, usize) {
        let (mut all, mut held) = (Counts::default(), 0);
        for shot in self.shots.values() {
            let counts = shot.frames.counts(&shot.rules);
            all.landed += counts.landed;
            all.done += counts.done;
            all.failed += counts.failed;
            all.waiting += counts.waiting;
            all.partial += counts.partial;
            held += shot.frames.held(self.now());
        }
        (all, held)
    }

    /// Tells how far the watch is, where that changed, and which files have stayed incomplete.
    fn tell(&mut self) {
        let now = self.now();
        self.tell_partial(|since| now.saturating_sub(since) >= TELL_AFTER);
        let (counts, held) = self.counts();
        let waiting = Waiting {
            input: self.root.is_some(),
            landed: counts.landed,
            denoised: counts.done,
            waiting: counts.waiting.saturating_sub(held),
            incomplete: counts.partial,
            elsewhere: held,
            failed: counts.failed,
        };
        if self.told.as_ref() != Some(&waiting) {
            (self.report)(Event::Waiting(&waiting));
            self.told = Some(waiting);
        }
    }

    fn tell_partial(&mut self, long: impl Fn(Duration) -> bool) {
        for shot in self.shots.values_mut() {
            let partial: Vec<(i64, String)> =
                shot.frames.partial().filter(|(_, _, since)| long(*since)).map(|(n, why, _)| (n, why.into())).collect();
            for (frame, reason) in partial {
                let Some(stamp) = shot.frames.stamp(frame) else { continue };
                if shot.told_partial.insert(frame, stamp) != Some(stamp) {
                    let source = shot.source(&self.tree, frame);
                    (self.report)(Event::Incomplete { shot: &shot.name, frame, source, reason });
                }
            }
        }
    }

    fn finish(mut self) -> Result<Report> {
        self.eyes.close();
        if self.options.once {
            self.tell_partial(|_| true);
        }
        let mut done = Report { interrupted: self.cancel.is_cancelled(), ..Report::default() };
        for shot in self.shots.values() {
            let counts = shot.frames.counts(&shot.rules);
            done.frames += counts.landed;
            done.written += shot.written;
            done.skipped += counts.done.saturating_sub(shot.own.len());
            done.failed.extend(shot.frames.failed());
            if self.options.once {
                done.failed.extend(shot.frames.partial().map(|(n, ..)| n));
            }
            done.degraded.extend(&shot.degraded);
        }
        done.missing = self.missing();
        done.stopped = self.stopped.as_ref().map(ToString::to_string);
        done.seconds = self.now().as_secs_f64();
        self.swept.iter().for_each(|output| tidy(output));
        if self.options.once && self.shots.is_empty() && !done.interrupted {
            let reason = "holds no .exr files with a frame number in their names".into();
            return Err(Error::BadInput { input: self.tree.input.display().to_string(), reason });
        }
        (self.report)(Event::Done(&done));
        Ok(done)
    }
}

/// Gives free memory back to the system: over thousands of short runs, glibc would keep more and more of it in small pieces.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
fn give_memory_back() {
    // SAFETY: it touches only memory that is not in use.
    unsafe { libc::malloc_trim(0) };
}

/// Gives free memory back to the system, which other allocators do by themselves.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
fn give_memory_back() {}

/// Tells one folder from another that was put in its place.
#[cfg(unix)]
fn identity(folder: &Path) -> Option<(u64, u64)> {
    use std::os::unix::fs::MetadataExt;
    std::fs::metadata(folder).ok().filter(|m| m.is_dir()).map(|m| (m.dev(), m.ino()))
}

/// Tells whether a folder is there.
#[cfg(not(unix))]
fn identity(folder: &Path) -> Option<(u64, u64)> {
    folder.is_dir().then_some((0, 0))
}
