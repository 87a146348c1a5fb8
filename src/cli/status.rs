//! Events of a watch as a status line, as lines, or as JSON.

use std::cell::RefCell;
use std::time::Duration;

use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::advice::with_options;
use super::progress::{Mode, error_text, line, missing};
use super::{say, tell_json};
use crate::shot;
use crate::watch::{Waiting, WatchEvent, WatchSummary};
use crate::words::counted;

/// Tells about a watch.
pub(super) struct StatusLine {
    mode: Mode,
    bar: ProgressBar,
    last: RefCell<String>,
}

impl StatusLine {
    /// Nothing is shown before the first event.
    pub fn new(mode: Mode) -> Self {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden());
        Self { mode, bar, last: RefCell::default() }
    }

    /// Tells about an event.
    pub fn report(&self, event: &WatchEvent<'_>) {
        match self.mode {
            Mode::Json => tell_json(event),
            Mode::Quiet => {
                if let Some(line) = error(event) {
                    say(line);
                }
            }
            // A watch has no end to come nearer to, so a farm gets lines.
            Mode::Lines | Mode::OpenJd => {
                // The same state may come and go many times; it is told once.
                if let Some(line) = text(event).filter(|line| self.last.replace(line.clone()) != *line) {
                    say(line);
                }
            }
            Mode::Bar => self.update_bar(event),
        }
    }

    fn update_bar(&self, event: &WatchEvent<'_>) {
        match event {
            WatchEvent::Watching { .. } => {
                if let Ok(style) = ProgressStyle::with_template("{spinner} {wide_msg}") {
                    self.bar.set_style(style);
                }
                self.bar.set_draw_target(ProgressDrawTarget::stderr());
                self.bar.enable_steady_tick(Duration::from_millis(250));
            }
            WatchEvent::Waiting(waiting) => return self.bar.set_message(waiting_text(waiting)),
            WatchEvent::Landed { .. } => return,
            WatchEvent::Shot { shot, event: shot::Event::Working { frame } } => {
                return self.bar.set_message(format!("{shot}: denoising frame {frame}"));
            }
            WatchEvent::Shot { shot, event: shot::Event::Progress { frame, fraction } } => {
                return self.bar.set_message(format!("{shot}: denoising frame {frame}, {:.0} %", 100.0 * fraction));
            }
            WatchEvent::Shot { event: shot::Event::Frame { .. }, .. } => return,
            WatchEvent::Done(_) => self.bar.finish_and_clear(),
            _ => {}
        }
        if let Some(line) = text(event) {
            self.bar.suspend(|| say(line));
        }
    }
}

/// An event as one line.
fn text(event: &WatchEvent<'_>) -> Option<String> {
    match event {
        WatchEvent::Watching { input, output, polling } => {
            let how = if *polling { ", scanning" } else { "" };
            Some(format!("watching {} → {}{how}", input.display(), output.display()))
        }
        WatchEvent::Incomplete { shot, frame, reason, .. } => {
            Some(format!("{shot}: frame {frame} is not whole yet: it {reason}"))
        }
        WatchEvent::Waiting(waiting) => Some(waiting_text(waiting)),
        WatchEvent::Paused { message, .. } => Some(format!("paused: {message}")),
        WatchEvent::Warning { message, .. } => Some(format!("warning: {}", with_options(message))),
        WatchEvent::Done(report) => Some(done_text(report)),
        WatchEvent::Shot { shot, event: shot::Event::Start { window, lambda, output, .. } } => {
            Some(format!("{shot} → {}: window {window}, lambda {lambda}", output.display()))
        }
        WatchEvent::Shot { shot, event } => {
            line(event).map(|line| if shot.is_empty() { line } else { format!("{shot}: {line}") })
        }
        _ => None,
    }
}

fn error(event: &WatchEvent<'_>) -> Option<String> {
    match event {
        WatchEvent::Shot { event: shot::Event::Error { frame, message }, .. } => Some(error_text(*frame, message)),
        WatchEvent::Paused { .. } => text(event),
        WatchEvent::Done(report) if !report.interrupted => missing(&report.missing).map(|text| error_text(None, &text)),
        _ => None,
    }
}

fn waiting_text(w: &Waiting) -> String {
    if !w.input {
        return "waiting for the folder".into();
    }
    let mut text = match w {
        Waiting { landed: 0, denoised: 0, incomplete: 0, .. } => "no frame to denoise is there yet".to_string(),
        Waiting { landed: 0, denoised: 0, .. } => "no frame is whole".to_string(),
        _ => format!("{} of {} denoised", w.denoised, counted(w.landed, "frame")),
    };
    for (count, what) in [
        (w.waiting, "waiting for frames beside them"),
        (w.incomplete, "not known to be whole yet"),
        (w.elsewhere, "at another process"),
        (w.failed, "failed"),
    ] {
        if count > 0 {
            text.push_str(&format!(", {count} {what}"));
        }
    }
    text
}

fn done_text(report: &WatchSummary) -> String {
    let mut text = format!("{} denoised", report.written);
    for (count, what) in
        [(report.skipped, "already done"), (report.failed.len(), "failed"), (report.degraded.len(), "without a bad neighbour")]
    {
        if count > 0 {
            text.push_str(&format!(", {count} {what}"));
        }
    }
    if !report.missing.is_empty() {
        text.push_str(&format!(", missing: {}", report.missing));
    }
    let end = if report.interrupted { "stopped, run again to continue: " } else { "" };
    format!("{end}{text}; {}", HumanDuration(Duration::from_secs_f64(report.seconds.max(0.0))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_state_is_told_in_words() {
        let waiting = Waiting { input: true, landed: 9, denoised: 5, waiting: 2, incomplete: 1, elsewhere: 1, failed: 0 };
        let text = waiting_text(&waiting);
        assert_eq!(
            text,
            "5 of 9 frames denoised, 2 waiting for frames beside them, 1 not known to be whole yet, 1 at another process"
        );
        assert_eq!(waiting_text(&Waiting::default()), "waiting for the folder");
        let empty = Waiting { input: true, ..Waiting::default() };
        assert_eq!(waiting_text(&empty), "no frame to denoise is there yet");
        let eight = Waiting { incomplete: 8, ..empty.clone() };
        assert_eq!(waiting_text(&eight), "no frame is whole, 8 not known to be whole yet");
        assert_eq!(waiting_text(&Waiting { landed: 1, ..empty }), "0 of 1 frame denoised");
    }

    #[test]
    fn the_end_counts_everything() {
        let report = WatchSummary {
            written: 4,
            skipped: 2,
            failed: vec![7],
            missing: "9".into(),
            interrupted: true,
            ..WatchSummary::default()
        };
        let text = done_text(&report);
        for part in ["4 denoised", "2 already done", "1 failed", "missing: 9", "stopped"] {
            assert!(text.contains(part), "{part} in {text}");
        }
    }
}
