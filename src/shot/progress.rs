//! How far the frame in hand is: reported now and then, and not at all of frames that are done in a second.

use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::{Duration, Instant};

use super::events::Event;

/// A frame that is done by then tells nothing.
const QUIET: Duration = Duration::from_secs(1);
/// From one event to the next.
const EVERY: Duration = Duration::from_millis(200);
/// Reading and encoding a frame, in what denoising one takes (1080p, window ±2).
const READING: f64 = 0.15;

/// The progress of one frame.
pub(super) struct FrameProgress<'a> {
    report: &'a dyn Fn(Event<'_>),
    frame: i64,
    due: Instant,
    /// Frames of the window that are still to be read, of so many.
    to_read: usize,
    reads: usize,
    /// First passes, of this frame or one beside it, and how many are done.
    passes: usize,
    passed: usize,
    reported: f64,
    /// Reached and not reported yet.
    reached: f64,
}

impl<'a> FrameProgress<'a> {
    /// Of a frame that `reads` frames are to be read for and so many first passes done.
    pub fn new(report: &'a dyn Fn(Event<'_>), frame: i64, reads: usize, passes: usize) -> Self {
        let due = Instant::now() + QUIET;
        Self { report, frame, due, to_read: reads, reads, passes, passed: 0, reported: 0.0, reached: 0.0 }
    }

    /// One more frame of the window was read and encoded.
    pub fn read_one(&mut self) {
        self.to_read = self.to_read.saturating_sub(1);
        self.reach(0.0);
    }

    /// Does a first pass on a thread of its own, and reports on this one what it says about how far it is, 0…1.
    pub fn follow<T: Send>(&mut self, work: impl FnOnce(&(dyn Fn(f64) + Sync)) -> T + Send) -> T {
        let (fractions, reached) = channel();
        let done = thread::scope(|scope| {
            let worker = scope.spawn(move || work(&move |fraction| _ = fractions.send(fraction)));
            loop {
                let wait = if self.reached > self.reported { self.due.saturating_duration_since(Instant::now()) } else { QUIET };
                match reached.recv_timeout(wait) {
                    Ok(fraction) => self.reach(fraction),
                    Err(RecvTimeoutError::Timeout) => self.report_due(),
                    Err(RecvTimeoutError::Disconnected) => break,
                }
            }
            worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        });
        self.passed += 1;
        done
    }

    /// `fraction` is of the first pass in hand.
    fn reach(&mut self, fraction: f64) {
        let reads = READING * self.reads as f64;
        let read = READING * (self.reads - self.to_read) as f64;
        let passed = self.passed as f64 + fraction;
        self.reached = self.reached.max((read + passed) / (reads + self.passes.max(1) as f64));
        self.report_due();
    }

    /// Reports what is new, where it is time.
    fn report_due(&mut self) {
        let now = Instant::now();
        // Thousandths: more would be noise.
        let fraction = (1000.0 * self.reached).round() / 1000.0;
        if fraction > self.reported && now >= self.due {
            (self.due, self.reported) = (now + EVERY, fraction);
            (self.report)(Event::Progress { frame: self.frame, fraction });
        }
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

    use super::*;

    fn heard(reads: usize, work: impl FnOnce(&(dyn Fn(f64) + Sync)) + Send) -> Vec<(Instant, f64)> {
        let all = RefCell::new(Vec::new());
        let report = |event: Event<'_>| match event {
            Event::Progress { frame: 7, fraction } => all.borrow_mut().push((Instant::now(), fraction)),
            other => panic!("{other:?}"),
        };
        let mut progress = FrameProgress::new(&report, 7, reads, 1);
        (0..reads).for_each(|_| progress.read_one());
        progress.follow(work);
        all.into_inner()
    }

    #[test]
    fn a_fast_frame_tells_nothing() {
        let work = |reached: &(dyn Fn(f64) + Sync)| (0..=100).for_each(|i| reached(f64::from(i) / 100.0));
        assert_eq!(heard(3, work), []);
    }

    #[test]
    fn a_slow_frame_tells_after_a_second_at_most_five_times_a_second_and_rising() {
        let began = Instant::now();
        let events = heard(0, |reached| {
            for i in 0..=190 {
                reached(f64::from(i) / 190.0);
                thread::sleep(Duration::from_millis(10));
            }
        });
        let (took, last) = (began.elapsed(), events.last().unwrap().1);
        assert!(events.len() >= 2 && events.len() as f64 <= took.as_secs_f64() * 5.0, "{} in {took:?}", events.len());
        assert!(events[0].0 - began >= QUIET && events[0].1 > 0.0 && last <= 1.0);
        assert!(events.windows(2).all(|w| w[1].0 - w[0].0 >= EVERY && w[1].1 > w[0].1), "{events:?}");
    }

    #[test]
    fn what_was_reached_early_is_reported_when_it_is_time() {
        let events = heard(0, |reached| {
            reached(0.25);
            thread::sleep(2 * QUIET);
        });
        assert_eq!(events.iter().map(|e| e.1).collect::<Vec<_>>(), [0.25]);
    }

    #[test]
    fn reading_counts() {
        let events = heard(4, |reached| {
            thread::sleep(2 * QUIET);
            reached(0.5);
            thread::sleep(5 * EVERY);
        });
        let fractions: Vec<f64> = events.iter().map(|e| e.1).collect();
        assert_eq!(fractions, [0.375, 0.688]);
    }
}
