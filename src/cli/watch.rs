//! `hush watch`: arguments to a watch, its exit code.

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;

use super::progress::Mode;
use super::setting_args::{OfRuns, QueryArgs};
use super::signals::stop_handler;
use super::status::StatusLine;
use super::{CatchSignals, Exit};
use crate::engine::Engine;
use crate::error::{Error, Result};
use crate::io::sequence::Sequence;
use crate::settings::ShotQuery;
use crate::shot::{CancelToken, Event, Job};
use crate::watch::{WatchEvent, WatchOptions, WatchSummary, watch};

/// Denoises the frames of a folder while they are still being rendered
///
/// Each frame is denoised as soon as it is whole and those beside it are there. Every sequence in the folder and in the folders
/// below it is a shot; the output folder mirrors them. The result is that of hush denoise over the finished shots. With --frames
/// the last frames need not wait for --settle, and the watch ends once these frames are done in every shot that has one of them, or
/// have failed and nothing new has come for --settle seconds.
/// Several processes, on several machines too, may watch the same folder into the same output folder and share the work. Stop it
/// with Ctrl-C; run it again to go on.
#[derive(Args)]
#[command(after_help = super::EXIT_CODES)]
pub(super) struct WatchArgs {
    /// A folder, or a pattern such as shot/frame_####.exr; it need not be there yet
    #[arg(value_name = "INPUT")]
    input: PathBuf,
    #[command(flatten)]
    shot: QueryArgs<OfRuns>,
    /// Seconds without a new frame until missing neighbours are given up [default: 30, more where frames take longer]
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    settle: Option<Duration>,
    /// Keep frames as they are when a neighbour comes later that they lacked
    #[arg(long)]
    no_redo: bool,
    /// Scan the folder every few seconds, for network drives [default: 2 where given; by itself on NFS and SMB]
    #[arg(long, value_name = "SECONDS", value_parser = interval, num_args = 0..=1, default_missing_value = "2", require_equals = true)]
    poll: Option<Duration>,
    /// Denoise what is there, wait for nothing, and stop
    #[arg(long)]
    once: bool,
    /// Say nothing but errors
    #[arg(short, long, conflicts_with = "json")]
    quiet: bool,
    /// One JSON event a line on standard output: watching, landed, waiting and those of hush denoise
    #[arg(long)]
    json: bool,
}

/// Runs the subcommand.
pub(super) fn watch_folder(args: &WatchArgs, catch_signals: CatchSignals) -> Result<Exit> {
    let mode = Mode::choose(args.quiet, args.json);
    let status = StatusLine::new(mode);
    let done = watch_with(args, &status, catch_signals);
    if let (Err(error), Mode::Json) = (&done, mode) {
        // A machine that reads events finds this one there too.
        let event = Event::Error { frame: None, message: error.to_string() };
        status.report(&WatchEvent::Shot { shot: "", event });
    }
    done
}

fn watch_with(args: &WatchArgs, status: &StatusLine, catch_signals: CatchSignals) -> Result<Exit> {
    let query = args.shot.query(&[]);
    let settings = query.settings(None)?;
    let output = settings.output()?;
    let options = WatchOptions {
        input: args.input.clone(),
        output: output.clone(),
        settle: args.settle,
        redo: !args.no_redo,
        poll: args.poll,
        once: args.once,
    };
    let engine = settings.values.engine()?;
    let cancel = CancelToken::new();
    catch_signals(stop_handler(&cancel, Some(&output)))?;
    let report = watch(
        &options,
        &|sequence| job_of(&query, sequence, &output, &engine),
        &engine,
        &|event| status.report(&event),
        &cancel,
    )?;
    Ok(exit_of(&report))
}

/// The job for a sequence, with the settings beside its frames.
///
/// # Errors
/// They name other weights, another renderer, other rules or another number of passes than the engine has.
fn job_of(query: &ShotQuery, sequence: Sequence, output: &Path, engine: &Engine) -> Result<Job> {
    let settings = query.settings(Sequence::folder(&[] as &[&Path], &sequence).as_deref())?;
    let (shot, one) = (settings.values.identity()?, engine.identity());
    let differ = [
        ("model", shot.model != one.model),
        ("renderer", shot.renderer != one.renderer),
        ("skip", shot.skip != one.skip),
        ("second_pass", shot.second_pass != one.second_pass),
    ];
    for (name, differs) in differ {
        if differs {
            let by = settings.origin(name);
            let reason =
                format!("{by} says another than the watch began with, and one watch has one engine: set {name} to one for all");
            return Err(Error::BadSetting { name, reason });
        }
    }
    Job::of(&settings, sequence, Some(output.to_owned()))
}

fn exit_of(report: &WatchSummary) -> Exit {
    if report.interrupted {
        Exit::Stopped
    } else if report.is_complete() {
        Exit::Good
    } else if report.written + report.skipped == 0 {
        Exit::Nothing
    } else {
        Exit::Partly
    }
}

fn seconds(text: &str) -> Result<Duration, String> {
    let number = text.trim().parse::<f64>().ok().filter(|s| (0.0..=1e7).contains(s));
    number.map(Duration::from_secs_f64).ok_or_else(|| format!("'{text}' is no time: write seconds, such as 30"))
}

fn interval(text: &str) -> Result<Duration, String> {
    seconds(text).and_then(|s| if s >= Duration::from_millis(100) { Ok(s) } else { Err("at least 0.1 seconds".into()) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_read() {
        assert_eq!(seconds("2.5"), Ok(Duration::from_millis(2500)));
        assert_eq!(seconds("0"), Ok(Duration::ZERO));
        for bad in ["", "-1", "nan", "inf", "5s", "1e9"] {
            assert!(seconds(bad).is_err(), "{bad}");
        }
        assert!(interval("0").is_err() && interval("0.5").is_ok());
    }

    #[test]
    fn exit_codes_tell_what_happened() {
        let report = || WatchSummary { frames: 3, written: 2, skipped: 1, ..WatchSummary::default() };
        assert_eq!(exit_of(&report()), Exit::Good);
        assert_eq!(exit_of(&WatchSummary { failed: vec![2], ..report() }), Exit::Partly);
        assert_eq!(exit_of(&WatchSummary { missing: "9".into(), ..report() }), Exit::Partly);
        assert_eq!(exit_of(&WatchSummary { failed: vec![1], written: 0, skipped: 0, ..report() }), Exit::Nothing);
        assert_eq!(exit_of(&WatchSummary { interrupted: true, ..report() }), Exit::Stopped);
    }
}
