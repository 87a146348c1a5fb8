//! Events of a run as a progress bar, as lines, or as JSON.

use std::io::IsTerminal;
use std::time::Duration;

use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};

use super::advice::with_options;
use super::{print, print_json, say};
use crate::shot::{Event, Status, Summary};
use crate::words::counted;

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
}

impl Progress {
    /// Nothing is shown before the first event.
    pub fn new(mode: Mode) -> Self {
        Self { mode, bar: ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden()) }
    }

    /// Tells about an event.
    pub fn report(&self, event: &Event<'_>) {
        match self.mode {
            Mode::Json => print_json(event),
            Mode::OpenJd => openjd(event).into_iter().for_each(print),
            Mode::Quiet => {
                if let Event::Error { frame, message } = event {
                    say(error_text(*frame, message));
                }
            }
            Mode::Bar => self.update_bar(event),
            Mode::Lines => {
                if let Some(line) = line(event) {
                    say(line);
                }
            }
        }
    }

    fn update_bar(&self, event: &Event<'_>) {
        match event {
            Event::Start { frames, .. } => {
                let template = "{bar:30} {pos}/{len} frames · {rate} · {eta} left{msg}";
                if let Ok(style) = ProgressStyle::with_template(template) {
                    let rate = |state: &ProgressState, to: &mut dyn std::fmt::Write| _ = write!(to, "{:.2}/s", state.per_sec());
                    self.bar.set_style(style.with_key("rate", rate));
                }
                self.bar.set_length(*frames as u64);
                self.bar.set_draw_target(ProgressDrawTarget::stderr());
                self.bar.enable_steady_tick(Duration::from_millis(500));
            }
            Event::Working { frame } => self.bar.set_message(format!(" · frame {frame}")),
            Event::Frame { status, finished, .. } => {
                self.bar.set_position(*finished as u64);
                if *status == Status::Skipped {
                    // What was skipped says nothing about the speed.
                    self.bar.reset_eta();
                }
            }
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

/// An event as OpenJD's progress, status and failure lines; the rest goes to the log.
fn openjd(event: &Event<'_>) -> Vec<String> {
    // A runner reads line by line.
    let flat = |text: String| text.replace(['\n', '\r'], " ");
    let words = line(event).map(flat);
    match event {
        Event::Frame { finished, frames, .. } => {
            let progress = format!("openjd_progress: {:.1}", 100.0 * *finished as f64 / (*frames).max(1) as f64);
            words.into_iter().chain([progress]).collect()
        }
        Event::Working { frame } => vec![format!("openjd_status: frame {frame}")],
        Event::Start { .. } | Event::Done(_) => words.map(|w| format!("openjd_status: {w}")).into_iter().collect(),
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
    use crate::plan::checks::{Warning, WarningKind};

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
        assert_eq!(openjd(&error), ["openjd_fail: frame 12: cut short"]);
        assert_eq!(openjd(&Event::Working { frame: 3 }), ["openjd_status: frame 3"]);
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
        assert_eq!(openjd(&frame), ["frame 3 denoised in 1.0 s (1/3)", "openjd_progress: 33.3"]);
        assert!(
            openjd(&Event::Done(&Summary { frames: 1, written: 1, ..Summary::default() }))[0]
                .starts_with("openjd_status: 1 denoised")
        );
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
