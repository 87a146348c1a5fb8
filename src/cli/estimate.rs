//! How much of a run is done, and how long the rest will take: from the first frame's first parts on.

use std::time::{Duration, Instant};

use crate::shot::Event;

/// What the events say so far.
#[derive(Default)]
pub(super) struct Estimate {
    /// Frames of the run.
    pub frames: usize,
    /// Frames finished, those that were there before included.
    pub finished: usize,
    /// Frames that are to be made.
    todo: usize,
    /// Frames that were begun.
    begun: usize,
    /// Of the one begun last, 0…1.
    fraction: f64,
    /// When the first was begun.
    began: Option<Instant>,
}

impl Estimate {
    /// Takes the next event.
    pub fn take(&mut self, event: &Event<'_>, now: Instant) {
        match event {
            Event::Start { frames, todo, .. } => *self = Self { frames: *frames, todo: *todo, ..Self::default() },
            Event::Working { .. } => {
                self.began.get_or_insert(now);
                (self.begun, self.fraction) = (self.begun + 1, 0.0);
            }
            Event::Progress { fraction, .. } => self.fraction = *fraction,
            Event::Frame { finished, .. } => self.finished = *finished,
            _ => {}
        }
    }

    /// How much of the whole run is done, 0…1.
    pub fn share(&self) -> f64 {
        let done = (self.frames.saturating_sub(self.todo)) as f64 + self.done();
        (done.max(self.finished as f64) / self.frames.max(1) as f64).min(1.0)
    }

    /// How long the rest will take; None before anything is known.
    pub fn left(&self, now: Instant) -> Option<Duration> {
        let (done, all) = (self.done(), self.todo as f64);
        if done <= 0.0 {
            return None;
        }
        let spent = now.saturating_duration_since(self.began?).as_secs_f64();
        Some(Duration::from_secs_f64(spent * (all - done).max(0.0) / done))
    }

    /// Of the frames to be made: the last one begun counts as far as it is.
    fn done(&self) -> f64 {
        let last = if self.finished >= self.frames { 1.0 } else { self.fraction };
        (self.begun.saturating_sub(1)) as f64 + if self.begun > 0 { last } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::shot::Status;

    fn start(frames: usize, todo: usize) -> Event<'static> {
        Event::Start { sequence: "a", output: Path::new("b"), frames, todo, window: 2, lambda: 1.0 }
    }

    fn frame(finished: usize, frames: usize) -> Event<'static> {
        Event::Frame {
            frame: 1,
            status: Status::Denoised,
            lambda: 1.0,
            source: "a".into(),
            output: "b".into(),
            neighbours: vec![],
            reason: None,
            seconds: 1.0,
            finished,
            frames,
        }
    }

    #[test]
    fn the_first_part_of_the_first_frame_tells_of_the_whole() {
        let (mut e, began) = (Estimate::default(), Instant::now());
        let at = |seconds: u64| began + Duration::from_secs(seconds);
        e.take(&start(10, 4), at(0));
        assert_eq!((e.share(), e.left(at(0))), (0.6, None));
        e.take(&Event::Working { frame: 1 }, at(5));
        assert_eq!(e.left(at(6)), None);
        e.take(&Event::Progress { frame: 1, fraction: 0.25 }, at(7));
        assert_eq!((e.share(), e.left(at(7))), (0.625, Some(Duration::from_secs(30))));
        // The next is begun while the first is being written.
        e.take(&Event::Working { frame: 2 }, at(13));
        e.take(&frame(7, 10), at(14));
        assert_eq!((e.share(), e.left(at(13))), (0.7, Some(Duration::from_secs(24))));
    }

    #[test]
    fn nothing_is_left_at_the_end() {
        let (mut e, now) = (Estimate::default(), Instant::now());
        e.take(&start(1, 1), now);
        e.take(&Event::Working { frame: 1 }, now);
        e.take(&frame(1, 1), now + Duration::from_secs(9));
        assert_eq!((e.share(), e.left(now + Duration::from_secs(9))), (1.0, Some(Duration::ZERO)));
    }
}
