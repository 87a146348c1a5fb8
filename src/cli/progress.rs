//! Events of a run as a progress bar, as lines, or as JSON.

use std::cell::RefCell;
use std::io::IsTerminal;
use std::time::{Duration, Instant};

use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::advice::with_options;
use super::estimate::Estimate;
use super::{say, tell, tell_json};
use crate::shot::{Event, Status, Summary};
use crate::words::counted;

/// A line tells about a frame in hand at most this often.
const LINE_EVERY: Duration = Duration::from_secs(10);
/// Steps of the bar in a frame.
const STEPS: f64 = 1000.0;

/// How to tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mode {
    /// A bar on the terminal.
    Bar,
    /// A line a frame, for logs.
    Lines,
    /// Errors only.
    Quiet,
    /// One JSON object a line on standard output.
    Json,
    /// The lines that a runner of OpenJD jobs understands, on standard output.
    OpenJd,
}

impl Mode {
    /// The mode for these flags and this terminal.
    pub fn choose(quiet: bool, json: bool) -> Self {
        match (quiet, json) {
            (_, true) => Self::Json,
            (true, _) => Self::Quiet,
            _ if std::io::stderr().is_terminal() => Self::Bar,
            _ => Self::Lines,
        }
    }
}

/// Tells about a run.
pub(super) struct Progress {
    mode: Mode,
    bar: ProgressBar,
    estimate: RefCell<Estimate>,
    /// When a line told how far it is.
    told: RefCell<Instant>,
}

impl Progress {
    /// Nothing is shown before the first event.
    pub fn new(mode: Mode) -> Self {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden());
        Self { mode, bar, estimate: RefCell::default(), told: RefCell::new(Instant::now()) }
    }

    /// Tells about an event.
    pub fn report(&self, event: &Event<'_>) {
        self.estimate.borrow_mut().take(event, Instant::now());
        match self.mode {
            Mode::Json => tell_json(event),
            Mode::OpenJd => openjd(event, self.estimate.borrow().share()).into_iter().for_each(tell),
            Mode::Quiet => match event {
                Event::Error { frame, message } => say(error_text(*frame, message)),
                Event::Done(summary) => missing(&summary.missing).iter().for_each(|text| say(error_text(None, text))),
                _ => {}
            },
            Mode::Bar => self.update_bar(event),
            Mode::Lines => {
                let in_hand = match event {
                    Event::Progress { frame, fraction } => self.line_in_hand(*frame, *fraction, Instant::now()),
                    _ => None,
                };
                line(event).or(in_hand).iter().for_each(say);
            }
        }
    }

    /// How far a frame in hand is, and how long the rest will take; for a log only now and then.
    fn line_in_hand(&self, frame: i64, fraction: f64, now: Instant) -> Option<String> {
        let mut told = self.told.borrow_mut();
        if now.saturating_duration_since(*told) < LINE_EVERY {
            return None;
        }
        *told = now;
        let left = self.estimate.borrow().left(now).map(|left| format!(", {} left in all", HumanDuration(left)));
        Some(format!("frame {frame}: {:.0} %{}", 100.0 * fraction, left.unwrap_or_default()))
    }

    fn update_bar(&self, event: &Event<'_>) {
        let show = |message: String| {
            let estimate = self.estimate.borrow();
            let left = estimate.left(Instant::now()).map(|left| format!(" · {} left", HumanDuration(left)));
            let (done, frames) = (estimate.finished, estimate.frames);
            self.bar.set_position((STEPS * estimate.share() * frames as f64) as u64);
            self.bar.set_message(format!("{done}/{frames} frames{}{message}", left.unwrap_or_default()));
        };
        match event {
            Event::Start { frames, .. } => {
                if let Ok(style) = ProgressStyle::with_template("{bar:30} {msg}") {
                    self.bar.set_style(style);
                }
                self.bar.set_length((STEPS * *frames as f64) as u64);
                self.bar.set_draw_target(ProgressDrawTarget::stderr());
                self.bar.enable_steady_tick(Duration::from_millis(500));
                show(String::new());
            }
            Event::Working { frame } => show(format!(" · frame {frame}")),
            Event::Progress { frame, fraction } => show(format!(" · frame {frame}, {:.0} %", 100.0 * fraction)),
            Event::Frame { .. } => show(String::new()),
            Event::Done(_) => self.bar.finish_and_clear(),
            _ => {}
        }
        if let (Event::Start { .. } | Event::Warning(_) | Event::Error { .. } | Event::Done(_), Some(line)) = (event, line(event))
        {
            self.bar.suspend(|| say(line));
        }
    }
}

pub(super) fn error_text(frame: Option<i64>, message: &str) -> String {
    let message = with_options(message);
    frame.map_or_else(|| format!("error: {message}"), |f| format!("error: frame {f}: {message}"))
}

/// An event as OpenJD's progress, status and failure lines; the rest goes to the log. `share` of the whole is done.
fn openjd(event: &Event<'_>, share: f64) -> Vec<String> {
    // A runner reads line by line.
    let flat = |text: String| text.replace(['\n', '\r'], " ");
    let words = line(event).map(flat);
    match event {
        Event::Progress { .. } | Event::Frame { .. } => {
            words.into_iter().chain([format!("openjd_progress: {:.1}", 100.0 * share)]).collect()
        }
        Event::Working { frame } => vec![format!("openjd_status: frame {frame}")],
        Event::Done(summary) => {
            let missing = missing(&summary.missing).map(|text| format!("openjd_fail: {text}"));
            missing.into_iter().chain(words.map(|w| format!("openjd_status: {w}"))).collect()
        }
        Event::Start { .. } => words.map(|w| format!("openjd_status: {w}")).into_iter().collect(),
        Event::Error { .. } => words.map(|w| format!("openjd_fail: {}", w.trim_start_matches("error: "))).into_iter().collect(),
        _ => words.into_iter().collect(),
    }
}

/// An event as one line.
pub(super) fn line(event: &Event<'_>) -> Option<String> {
    match event {
        Event::Start { sequence, output, frames, todo, window, lambda } => Some(format!(
            "{sequence} → {}: {todo} of {} to denoise, window {window}, lambda {lambda}",
            output.display(),
            counted(*frames, "frame")
        )),
        Event::Frame { frame, status: Status::Denoised, seconds, finished, frames, .. } => {
            Some(format!("frame {frame} denoised in {seconds:.1} s ({finished}/{frames})"))
        }
        Event::Warning(warning) => Some(format!("warning: {}", with_options(&warning.message))),
        Event::Error { frame, message } => Some(error_text(*frame, message)),
        Event::Done(summary) => Some(summary_text(summary)),
        _ => None,
    }
}

/// What to say of frames that were asked for and have no file.
pub(super) fn missing(frames: &str) -> Option<String> {
    (!frames.is_empty()).then(|| format!("missing, though asked for: {frames}"))
}

fn summary_text(summary: &Summary) -> String {
    let mut text = format!("{} denoised", summary.written);
    let mut add = |count: usize, what: &str| {
        if count > 0 {
            text.push_str(&format!(", {count} {what}"));
        }
    };
    add(summary.skipped, "already done");
    add(summary.failed.len(), "failed");
    add(summary.degraded.len(), "without a bad neighbour");
    add(summary.frames.saturating_sub(summary.written + summary.skipped + summary.failed.len()), "not done");
    if !summary.missing.is_empty() {
        text.push_str(&format!(", missing: {}", summary.missing));
    }
    let end = if summary.interrupted { "interrupted, run again to continue: " } else { "" };
    format!("{end}{text}; {}", HumanDuration(Duration::from_secs_f64(summary.seconds.max(0.0))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rules::checks::{Warning, WarningKind};

    #[test]
    fn the_summary_counts_everything_once() {
        let summary = Summary {
            frames: 10,
            written: 4,
            skipped: 2,
            failed: vec![7],
            degraded: vec![6, 8],
            missing: "12".into(),
            interrupted: true,
            ..Summary::default()
        };
        let text = summary_text(&summary);
        for part in ["4 denoised", "2 already done", "1 failed", "2 without", "3 not done", "missing: 12", "interrupted"] {
            assert!(text.contains(part), "{part} in {text}");
        }
    }

    #[test]
    fn a_farm_reads_progress_status_and_failure() {
        let error = Event::Error { frame: Some(12), message: "cut\nshort".into() };
        assert_eq!(openjd(&error, 0.0), ["openjd_fail: frame 12: cut short"]);
        assert_eq!(openjd(&Event::Working { frame: 3 }, 0.0), ["openjd_status: frame 3"]);
        assert_eq!(openjd(&Event::Progress { frame: 3, fraction: 0.5 }, 0.1667), ["openjd_progress: 16.7"]);
        let frame = Event::Frame {
            frame: 3,
            status: Status::Denoised,
            lambda: 1.0,
            source: "a".into(),
            output: "b".into(),
            neighbours: vec![],
            reason: None,
            seconds: 1.0,
            finished: 1,
            frames: 3,
        };
        assert_eq!(openjd(&frame, 1.0 / 3.0), ["frame 3 denoised in 1.0 s (1/3)", "openjd_progress: 33.3"]);
        assert!(
            openjd(&Event::Done(&Summary { frames: 1, written: 1, ..Summary::default() }), 1.0)[0]
                .starts_with("openjd_status: 1 denoised")
        );
    }

    #[test]
    fn a_log_hears_of_a_long_frame_now_and_then() {
        let progress = Progress::new(Mode::Lines);
        let began = *progress.told.borrow();
        let at = |seconds: f64| began + Duration::from_secs_f64(seconds);
        assert_eq!(progress.line_in_hand(3, 0.2, at(4.0)), None);
        let start = Event::Start { sequence: "a", output: std::path::Path::new("b"), frames: 2, todo: 2, window: 2, lambda: 1.0 };
        let mut estimate = progress.estimate.borrow_mut();
        estimate.take(&start, began);
        estimate.take(&Event::Working { frame: 3 }, began);
        estimate.take(&Event::Progress { frame: 3, fraction: 0.5 }, at(12.0));
        drop(estimate);
        let line = progress.line_in_hand(3, 0.5, at(12.0));
        assert_eq!(line.as_deref(), Some("frame 3: 50 %, 36 seconds left in all"));
        assert_eq!(progress.line_in_hand(3, 0.6, at(15.0)), None);
    }

    #[test]
    fn errors_name_the_frame() {
        let error = Event::Error { frame: Some(12), message: "cut short".into() };
        assert_eq!(line(&error).as_deref(), Some("error: frame 12: cut short"));
    }

    #[test]
    fn one_frame_is_no_plural_and_advice_names_options() {
        let start = Event::Start {
            sequence: "f_####.exr",
            output: std::path::Path::new("out"),
            frames: 1,
            todo: 1,
            window: 0,
            lambda: 1.0,
        };
        assert_eq!(line(&start).as_deref(), Some("f_####.exr → out: 1 of 1 frame to denoise, window 0, lambda 1"));
        let warning = Warning::new(WarningKind::NoVector, "set window to 0");
        assert_eq!(line(&Event::Warning(&warning)).as_deref(), Some("warning: pass --window 0"));
    }
}
