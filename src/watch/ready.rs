//! When a frame of a shot is ready to be denoised: it is whole, and so are the frames beside it, or nothing more is to come.
//!
//! A state machine without clocks and files: what was seen and what time it is are passed in.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Duration;

use super::landing::{FileCheck, FrameState, LOOK_AGAIN, LOOK_AGAIN_FOR, Landing, Made};
use super::ready_rules::ReadyRules;
use crate::rules::window::DEFAULT_WINDOW;
use crate::shot::Stamp;

/// Without `--settle`: at least this long, and three times the usual time between two frames, but no longer than `MOST`.
pub(super) const LEAST: Duration = Duration::from_secs(30);
const MOST: Duration = Duration::from_secs(3600);
/// Gaps between frames that the usual one is taken from.
const GAPS: usize = 9;

/// The frames of one shot.
#[derive(Debug, Default)]
pub(super) struct Frames {
    all: BTreeMap<i64, FrameState>,
    /// Frames that are not yet known to be whole.
    open: BTreeSet<i64>,
    /// Whole frames that may have to be made.
    maybe: BTreeSet<i64>,
    vector: bool,
    last_news: Duration,
    last_landing: Option<Duration>,
    gaps: VecDeque<Duration>,
}

/// How many frames are in which state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct FrameCounts {
    pub landed: usize,
    pub done: usize,
    /// Those of `done` whose file is not there, or not whole, any more.
    pub of_gone: usize,
    pub failed: usize,
    pub waiting: usize,
    pub partial: usize,
}

impl Frames {
    /// A file is there. `closed` says that its writer has closed it or renamed it into place.
    pub fn seen(&mut self, number: i64, stamp: Stamp, closed: bool, now: Duration) {
        let Some(state) = self.all.get_mut(&number) else {
            let landing = Landing::Unchecked { closed };
            self.all.insert(
                number,
                FrameState { stamp, since: now, landing, landed: false, made: None, held: Duration::ZERO, unread: false },
            );
            return self.news(number, now);
        };
        let changed = state.stamp != stamp || state.landing == Landing::Gone;
        // The last bytes may have come within the same tick of the file's clock.
        let look_again = closed && matches!(state.landing, Landing::Unchecked { .. } | Landing::Partial { .. });
        if changed {
            (state.stamp, state.since) = (stamp, now);
            state.becomes_readable();
        }
        if changed || look_again {
            state.landing = Landing::Unchecked { closed };
            self.open.insert(number);
        }
        if changed {
            self.news(number, now);
        }
    }

    fn news(&mut self, number: i64, now: Duration) {
        self.open.insert(number);
        self.last_news = now;
    }

    /// A file is gone. What was made of it stays.
    pub fn gone(&mut self, number: i64) {
        if let Some(state) = self.all.get_mut(&number) {
            state.landing = Landing::Gone;
            self.open.remove(&number);
            self.maybe.remove(&number);
        }
    }

    /// The numbers whose file is there.
    pub fn there(&self) -> impl Iterator<Item = i64> {
        self.all.iter().filter(|(_, s)| s.landing != Landing::Gone).map(|(n, _)| *n)
    }

    /// Files to look into now.
    pub fn due(&self, rules: &ReadyRules, now: Duration) -> Vec<i64> {
        let due = |s: &FrameState| match &s.landing {
            Landing::Unchecked { closed } => *closed || rules.once || now.saturating_sub(s.since) >= rules.quiet,
            Landing::Partial { again, .. } => !rules.once && again.is_some_and(|at| now >= at),
            Landing::Whole { .. } | Landing::Gone => false,
        };
        self.open.iter().copied().filter(|n| self.all.get(n).is_some_and(due)).collect()
    }

    /// What a look into a file found, and its stamp from before the look. True where a frame has landed.
    pub fn looked(&mut self, number: i64, stamp: Stamp, look: FileCheck, now: Duration) -> bool {
        let Some(state) = self.all.get_mut(&number) else { return false };
        if state.stamp != stamp {
            return false;
        }
        match look {
            FileCheck::Whole { vector } => {
                state.landing = Landing::Whole { vector };
                state.landed = true;
                state.becomes_readable();
                self.open.remove(&number);
                self.vector |= vector;
                self.last_news = now;
                if let Some(before) = self.last_landing.replace(now) {
                    self.gaps.push_back(now.saturating_sub(before));
                    while self.gaps.len() > GAPS {
                        self.gaps.pop_front();
                    }
                }
                self.touch(number);
                return true;
            }
            FileCheck::Partial(reason) => {
                let fresh = now.saturating_sub(state.since) < LOOK_AGAIN_FOR;
                state.landing = Landing::Partial { reason, again: fresh.then_some(now + LOOK_AGAIN) };
            }
            FileCheck::Unreadable(reason) => state.landing = Landing::unreadable(&reason, now),
        }
        false
    }

    /// Frames around a number may have to be made.
    fn touch(&mut self, number: i64) {
        let reach = 2 * crate::rules::window::MAX_WINDOW as i64;
        let whole = |s: &FrameState| matches!(s.landing, Landing::Whole { .. });
        self.maybe.extend(self.all.range(number - reach..=number + reach).filter(|(_, s)| whole(s)).map(|(n, _)| *n));
    }

    /// A run could not read a whole file: it is looked into again, and the frame and those around it are made once it can be read.
    pub fn set_unread(&mut self, number: i64, reason: &str, now: Duration) {
        if let Some(state) = self.all.get_mut(&number).filter(|s| matches!(s.landing, Landing::Whole { .. })) {
            (state.landing, state.unread) = (Landing::unreadable(reason, now), true);
            self.maybe.remove(&number);
            self.news(number, now);
        }
    }

    /// Whether a run could not read it, and no look has been better since.
    pub fn is_unread(&self, number: i64) -> bool {
        self.all.get(&number).is_some_and(|s| s.unread)
    }

    /// Whether the file has been whole before, with other content.
    pub fn is_again(&self, number: i64) -> bool {
        self.all.get(&number).is_some_and(|s| s.landed || s.made.is_some())
    }

    /// The file as it was last seen.
    pub fn stamp(&self, number: i64) -> Option<Stamp> {
        self.all.get(&number).map(|s| s.stamp)
    }

    /// How a frame was made, as far as it is known.
    pub fn made(&self, number: i64) -> Option<&Made> {
        self.all.get(&number)?.made.as_ref()
    }

    /// Takes note of how a frame was made.
    pub fn set_made(&mut self, number: i64, made: Option<Made>) {
        if let Some(state) = self.all.get_mut(&number) {
            state.made = made;
            self.maybe.insert(number);
        }
    }

    /// Forgets how frames were made whose denoised file is gone, which `is_there` tells. True where there is one.
    pub fn forget_lost(&mut self, is_there: impl Fn(i64) -> bool) -> bool {
        let made = |s: &FrameState| s.landing != Landing::Gone && s.made.as_ref().is_some_and(|made| !made.failed);
        let lost: Vec<i64> = self.all.iter().filter(|(n, s)| made(s) && !is_there(**n)).map(|(n, _)| *n).collect();
        lost.iter().for_each(|number| self.set_made(*number, None));
        !lost.is_empty()
    }

    /// Leaves a frame alone until then.
    pub fn hold(&mut self, number: i64, until: Duration) {
        if let Some(state) = self.all.get_mut(&number) {
            state.held = until;
        }
    }

    /// Frames on each side that help.
    pub fn window(&self, rules: &ReadyRules) -> usize {
        match rules.window {
            _ if !rules.vectors => 0,
            Some(window) => window,
            None if self.vector => DEFAULT_WINDOW,
            None => 0,
        }
    }

    /// Frames on each side that a frame depends on.
    fn context(&self, rules: &ReadyRules) -> i64 {
        (self.window(rules) * (1 + usize::from(rules.second_pass))) as i64
    }

    /// Whether some frame has motion vectors.
    pub fn has_vector(&self) -> bool {
        self.vector
    }

    /// The whole frames from `first` to `last`.
    pub fn whole(&self, first: i64, last: i64) -> impl Iterator<Item = i64> {
        let whole = |s: &FrameState| matches!(s.landing, Landing::Whole { .. });
        self.all.range(first..=last).filter(move |(_, s)| whole(s)).map(|(n, _)| *n)
    }

    /// The first and the last number that is there.
    pub fn ends(&self) -> Option<(i64, i64)> {
        let mut there = self.there();
        let first = there.next()?;
        Some((first, there.last().unwrap_or(first)))
    }

    /// Frames to denoise now, ascending.
    pub fn ready(&mut self, rules: &ReadyRules, now: Duration) -> Vec<i64> {
        let mut maybe = std::mem::take(&mut self.maybe);
        maybe.retain(|n| self.needs_work(*n, rules));
        self.maybe = maybe;
        let patient = rules.once || self.has_settled(rules, now);
        let start = if patient { None } else { self.start() };
        let held = |n: &i64| self.all.get(n).is_some_and(|s| s.held > now);
        let satisfied = |n: &i64| patient || self.is_satisfied(*n, rules, start);
        self.maybe.iter().copied().filter(|n| !held(n) && satisfied(n)).collect()
    }

    /// Frames that are whole, to be made, and held.
    pub fn held(&self, now: Duration) -> usize {
        self.maybe.iter().filter(|n| self.all.get(n).is_some_and(|s| s.held > now)).count()
    }

    /// Whether a frame is whole and not made, or made of something else.
    pub fn needs_work(&self, number: i64, rules: &ReadyRules) -> bool {
        let Some(state) = self.all.get(&number).filter(|_| rules.wants(number)) else { return false };
        let Landing::Whole { vector } = state.landing else { return false };
        let Some(made) = &state.made else { return true };
        let window = self.window(rules);
        if made.stamp != Some(state.stamp) || (made.window != window && !made.failed) {
            return true;
        }
        if made.failed || !rules.redo || !vector {
            return false;
        }
        let reach = self.context(rules);
        let new = |k: i64| {
            let then = made.around.iter().find(|(offset, _)| i64::from(*offset) == k - number).map(|(_, stamp)| *stamp);
            self.all.get(&k).is_some_and(|s| matches!(s.landing, Landing::Whole { .. }) && Some(s.stamp) != then)
        };
        (number - reach..=number + reach).any(|k| k != number && new(k))
    }

    /// Whether the window of a frame is there, as far as it is to come. `start` is the shot's first frame, if that is known.
    fn is_satisfied(&self, number: i64, rules: &ReadyRules, start: Option<i64>) -> bool {
        let vector = self.all.get(&number).is_some_and(|s| s.landing == Landing::Whole { vector: true });
        let reach = if vector { self.context(rules) } else { 0 };
        let to_come = |k: i64| match (self.all.get(&k).map(|s| &s.landing), &rules.frames) {
            (Some(Landing::Whole { .. }), _) => false,
            (Some(Landing::Unchecked { .. } | Landing::Partial { .. }), _) => true,
            (_, Some(set)) => set.contains(k),
            _ => start.is_none_or(|first| k > first),
        };
        !(number - reach..=number + reach).any(to_come)
    }

    /// The shot's first frame: the lowest number, where that is the oldest file too, so that frames come in ascending order.
    fn start(&self) -> Option<i64> {
        let mut there = self.all.iter().filter(|(_, s)| s.landing != Landing::Gone);
        let (number, first) = there.next()?;
        there.all(|(_, s)| s.stamp.modified >= first.stamp.modified).then_some(*number)
    }

    /// Whether no frame has come for so long that none is awaited any more.
    fn has_settled(&self, rules: &ReadyRules, now: Duration) -> bool {
        now.saturating_sub(self.last_news) >= rules.settle.unwrap_or_else(|| self.usual_settle())
    }

    fn usual_settle(&self) -> Duration {
        let mut gaps: Vec<Duration> = self.gaps.iter().copied().collect();
        gaps.sort_unstable();
        let usual = gaps.get(gaps.len() / 2).copied().unwrap_or_default();
        (usual * 3).clamp(LEAST, MOST)
    }

    /// Files that are not whole, and why.
    pub fn partial(&self) -> impl Iterator<Item = (i64, &str, Duration)> {
        self.open.iter().filter_map(|n| match self.all.get(n) {
            Some(FrameState { landing: Landing::Partial { reason, .. }, since, .. }) => Some((*n, reason.as_str(), *since)),
            _ => None,
        })
    }

    /// How many frames are in which state.
    pub fn counts(&self, rules: &ReadyRules) -> FrameCounts {
        let mut counts = FrameCounts { partial: self.open.len(), ..FrameCounts::default() };
        for (number, state) in self.all.iter().filter(|(n, _)| rules.wants(**n)) {
            let whole = matches!(state.landing, Landing::Whole { .. });
            counts.landed += usize::from(whole);
            if whole && self.maybe.contains(number) && self.needs_work(*number, rules) {
                counts.waiting += 1;
            } else if let Some(made) = &state.made {
                counts.failed += usize::from(made.failed && whole);
                counts.done += usize::from(!made.failed);
                counts.of_gone += usize::from(!made.failed && !whole);
            }
        }
        counts
    }

    /// Whether one of the frames that are to be written has been seen.
    pub fn any_wanted(&self, rules: &ReadyRules) -> bool {
        self.all.keys().any(|n| rules.wants(*n))
    }

    /// Whether every frame that the shot will have is made, of what is there now, or has failed and no news came since for as long as
    /// is waited for any. False where it is not known which those are.
    pub fn has_all(&self, rules: &ReadyRules, now: Duration) -> bool {
        let Some(set) = &rules.frames else { return false };
        let settled = self.has_settled(rules, now);
        let unsettled = |n: &i64| match self.all.get(n).map(|s| (&s.landing, s.unread)) {
            Some((Landing::Unchecked { .. }, _)) => true,
            Some((Landing::Partial { .. }, true)) => !settled,
            Some((Landing::Partial { .. }, false)) => rules.wants(*n),
            _ => false,
        };
        let ended = |s: &FrameState, made: &Made| !made.failed || (settled && s.landing != Landing::Gone);
        let made = |(n, s): (&i64, &FrameState)| {
            (s.made.as_ref().is_some_and(|made| ended(s, made)) && !self.needs_work(*n, rules)).then_some(*n)
        };
        let done: Vec<i64> = self.all.iter().filter_map(made).collect();
        set.missing(&done).is_empty() && !self.open.iter().any(unsettled)
    }

    /// The frames that could not be denoised, of which nothing is missing.
    pub fn failed(&self) -> impl Iterator<Item = i64> {
        let there = |s: &FrameState| s.unread || matches!(s.landing, Landing::Whole { .. });
        let failed = move |s: &FrameState| there(s) && s.made.as_ref().is_some_and(|m| m.failed);
        self.all.iter().filter(move |(_, s)| failed(s)).map(|(n, _)| *n)
    }
}
