//! `hush denoise`: arguments to a job, the run, its exit code.

use std::path::PathBuf;

use clap::Args;

use super::advice::with_options;
use super::progress::{Mode, Progress};
use super::setting_args::{OfRuns, QueryArgs};
use super::signals::stop_handler;
use super::{CatchSignals, Exit, print, print_json, say};
use crate::error::Result;
use crate::io::sequence::Sequence;
use crate::shot::{Action, CancelToken, Event, Job, Plan, Summary, run};
use crate::words::{self, counted};

/// Denoises the frames of a shot
///
/// Every frame of the range is written into the output folder under its input's name, with the same layout and all other
/// passes untouched. Frames that are there already, made from the same input with the same settings, are skipped; a run that
/// was stopped is continued by running the same command again. What was done to each frame is recorded in hush-manifest.json there.
#[derive(Args)]
#[command(after_help = super::EXIT_CODES)]
pub(super) struct DenoiseArgs {
    /// A folder, a glob, a pattern such as shot/frame_####.exr or shot/frame_%04d.exr, or files
    ///
    /// Folders are not searched deeper, so the output folder may be a new one inside the input folder. Of files that are named, the
    /// others of their sequence beside them are not written, but help.
    /// May be left out where the shot's settings name the frames.
    #[arg(value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    #[command(flatten)]
    shot: QueryArgs<OfRuns>,
    /// Write every frame again, also over files that Hush did not write
    #[arg(long)]
    overwrite: bool,
    /// Stop at the first bad or missing frame
    #[arg(long)]
    strict: bool,
    /// Say nothing but errors
    #[arg(short, long, conflicts_with = "json")]
    quiet: bool,
    /// One JSON event a line on standard output: start, working, progress, frame, warning, error, done
    #[arg(long)]
    json: bool,
    /// Progress, status and failure lines for a farm that runs OpenJD jobs
    #[arg(long, conflicts_with_all = ["json", "quiet"])]
    openjd: bool,
    /// Only tell what would be done
    #[arg(long)]
    dry_run: bool,
}

/// Runs the subcommand.
pub(super) fn denoise(args: &DenoiseArgs, catch_signals: CatchSignals) -> Result<Exit> {
    let mode = if args.openjd { Mode::OpenJd } else { Mode::choose(args.quiet, args.json) };
    let progress = Progress::new(mode);
    let done = denoise_with(args, mode, &progress, catch_signals);
    match done {
        // A machine that reads events finds this one there too.
        Err(error) if matches!(mode, Mode::Json | Mode::OpenJd) => {
            progress.report(&Event::Error { frame: None, message: error.to_string() });
            Err(error)
        }
        done => done,
    }
}

fn denoise_with(args: &DenoiseArgs, mode: Mode, progress: &Progress, catch_signals: CatchSignals) -> Result<Exit> {
    let (sequence, settings) = args.shot.query(&args.inputs).find()?;
    if matches!(mode, Mode::Bar | Mode::Lines) {
        settings.from_files().iter().for_each(|line| say(format_args!("{line}")));
        tell_named(&sequence);
    }
    let job = Job { overwrite: args.overwrite, strict: args.strict, ..Job::of(&settings, sequence, None)? };
    if args.dry_run {
        let plan = Plan::new(&job)?;
        if mode == Mode::Json {
            print_json(&plan)
        } else {
            show(&job, &plan)
        }
        return Ok(Exit::Good);
    }
    let engine = job.settings.engine()?;
    let cancel = CancelToken::new();
    catch_signals(stop_handler(&cancel, Some(&job.output)))?;
    let summary = run(&job, &engine, &|event| progress.report(&event), &cancel)?;
    Ok(exit_of(&summary))
}

/// Says what was found beside the files that were named.
fn tell_named(sequence: &Sequence) {
    if let Some(named) = &sequence.named {
        let numbers: Vec<i64> = named.iter().copied().collect();
        let verb = if numbers.len() == 1 { "is" } else { "are" };
        let (frames, all) = (words::frames(&numbers), counted(sequence.frames.len(), "frame"));
        say(format_args!("{}: {frames} of {all} there {verb} denoised, those beside may help", sequence.name));
    }
}

fn exit_of(summary: &Summary) -> Exit {
    if summary.interrupted {
        Exit::Stopped
    } else if summary.is_complete() {
        Exit::Good
    } else if summary.written + summary.skipped == 0 {
        Exit::Nothing
    } else {
        Exit::Partly
    }
}

/// The plan in words.
fn show(job: &Job, plan: &Plan) {
    print(format_args!(
        "{} → {}, {}, window {}, lambda {}",
        job.sequence.name,
        job.output.display(),
        counted(plan.frames.len(), "frame"),
        plan.settings.window,
        job.lambda()
    ));
    for warning in &plan.warnings {
        print(format_args!("warning: {}", with_options(&warning.message)));
    }
    for frame in &plan.frames {
        let used: Vec<String> =
            frame.neighbours.iter().filter(|n| n.unused.is_none()).map(|n| format!("{:+}", n.offset)).collect();
        let what = match &frame.action {
            Action::Denoise(None) => "denoise".to_string(),
            Action::Denoise(Some(why)) => format!("denoise again ({why})"),
            Action::Skip => "skip, already done".to_string(),
            Action::Fail(reason) => format!("cannot: {}", with_options(reason)),
        };
        let alone = used.is_empty() || matches!(frame.action, Action::Fail(_));
        let with = if alone { String::new() } else { format!(" with {}", used.join(" ")) };
        print(format_args!("frame {}: {what}{with}", frame.frame));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn summary(frames: usize, written: usize, skipped: usize) -> Summary {
        Summary { frames, written, skipped, ..Summary::default() }
    }

    #[test]
    fn exit_codes_tell_what_happened() {
        assert_eq!(exit_of(&summary(3, 2, 1)), Exit::Good);
        assert_eq!(exit_of(&Summary { failed: vec![2], ..summary(3, 2, 0) }), Exit::Partly);
        assert_eq!(exit_of(&Summary { degraded: vec![2], ..summary(3, 3, 0) }), Exit::Partly);
        assert_eq!(exit_of(&Summary { missing: "9".into(), ..summary(3, 3, 0) }), Exit::Partly);
        assert_eq!(exit_of(&Summary { failed: vec![1, 2, 3], ..summary(3, 0, 0) }), Exit::Nothing);
        assert_eq!(exit_of(&Summary { stopped: Some(crate::Error::Cancelled), ..summary(3, 1, 0) }), Exit::Partly);
        assert_eq!(exit_of(&Summary { interrupted: true, ..summary(3, 1, 0) }), Exit::Stopped);
    }
}
