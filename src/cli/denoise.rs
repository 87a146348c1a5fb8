//! `hush denoise`: arguments to a job, the run, its exit code.

use std::path::{Path, PathBuf};

use clap::Args;

use super::progress::{Mode, Progress};
use super::size::parse_size;
use super::{CatchSignals, Exit, Handler, print, print_json, say};
use crate::engine::{Engine, Settings};
use crate::error::Result;
use crate::io::sequence::Sequence;
use crate::io::{Guides, Selection};
use crate::plan::frames::FrameSet;
use crate::shot::{Action, CancelToken, Event, Job, ModelId, Plan, Summary, remove_unfinished, run};

/// Denoises the frames of a shot
///
/// Every frame of the range is written into the output folder under its input's name, with the same layout and all other
/// passes untouched. Frames that are there already, made from the same input with the same settings, are skipped; a run that
/// was stopped is continued by running the same command again. What was done to each frame stands in hush-manifest.json there.
#[derive(Args)]
#[command(after_help = super::EXIT_CODES)]
pub(super) struct DenoiseArgs {
    /// A folder, a glob, a pattern such as shot/frame_####.exr or shot/frame_%04d.exr, or files
    ///
    /// Folders are not searched deeper, so the output folder may be a new one inside the input folder.
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// Folder to write to; never the one with the inputs
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// From 1 (cleanest) to 64 (keeps grain and the detail hidden in it)
    #[arg(short, long, default_value_t = 1.0, allow_negative_numbers = true)]
    lambda: f32,
    /// Frames on each side that help, 0 to 3 [default: 2 where there is a Vector pass, else 0]
    #[arg(short, long)]
    window: Option<usize>,
    /// Frames to write, such as 1-48,60; frames beside them still help [default: all]
    #[arg(short, long, allow_hyphen_values = true)]
    frames: Option<FrameSet>,
    /// View layer to denoise [default: the one with the most samples]
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// Stereo view to denoise [default: all]
    #[arg(long, value_name = "NAME")]
    view: Option<String>,
    /// View layer to take the Vector pass from, such as one without motion blur
    #[arg(long, value_name = "NAME")]
    vector_layer: Option<String>,
    /// Light pass to denoise along, such as "Diffuse Direct", or all; may be given several times
    #[arg(long = "aov", value_name = "NAME|all")]
    aovs: Vec<String>,
    /// Do without the Denoising Albedo
    #[arg(long)]
    no_albedo: bool,
    /// Do without the Denoising Normal
    #[arg(long)]
    no_normal: bool,
    /// Do without depth
    #[arg(long)]
    no_depth: bool,
    /// Do without motion vectors, and so without neighbours
    #[arg(long)]
    no_vector: bool,
    /// Keep the input beside the result as "Noisy Image"
    #[arg(long)]
    keep_noisy: bool,
    /// Write every frame again, also over files that Hush did not write
    #[arg(long)]
    overwrite: bool,
    /// Stop at the first bad or missing frame
    #[arg(long)]
    strict: bool,
    /// Memory for the frames in the window and the computing, such as 4G; reading and writing come on top [default: 3.1G]
    #[arg(long, value_name = "SIZE", value_parser = parse_size)]
    memory: Option<u64>,
    /// Threads for computing [default: all cores]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=4096))]
    threads: Option<u16>,
    /// Other weights, a safetensors file
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Say nothing but errors
    #[arg(short, long, conflicts_with = "json")]
    quiet: bool,
    /// One JSON event a line on standard output: start, working, frame, warning, error, done
    #[arg(long)]
    json: bool,
    /// Only tell what would be done
    #[arg(long)]
    dry_run: bool,
}

/// Runs the subcommand.
pub(super) fn denoise(args: DenoiseArgs, catch_signals: CatchSignals) -> Result<Exit> {
    let mode = Mode::choose(args.quiet, args.json);
    let progress = Progress::new(mode);
    let done = denoise_with(args, mode, &progress, catch_signals);
    match done {
        // A machine that reads events finds this one there too.
        Err(error) if mode == Mode::Json => {
            progress.report(&Event::Error { frame: None, message: error.to_string() });
            Err(error)
        }
        done => done,
    }
}

fn denoise_with(args: DenoiseArgs, mode: Mode, progress: &Progress, catch_signals: CatchSignals) -> Result<Exit> {
    let (dry_run, threads, memory, model) = (args.dry_run, args.threads, args.memory, args.model.clone());
    let job = args.into_job()?;
    if dry_run {
        let plan = Plan::new(&job)?;
        if mode == Mode::Json {
            print_json(&plan)
        } else {
            show(&job, &plan)
        }
        return Ok(Exit::Good);
    }
    let settings = Settings { memory, threads: threads.map(usize::from), ..Settings::default() };
    let engine = match &model {
        Some(path) => Engine::from_file(path, settings)?,
        None => Engine::new(settings)?,
    };
    let cancel = CancelToken::new();
    catch_signals(stop_handler(&cancel, &job.output))?;
    let summary = run(&job, &engine, &|event| progress.report(&event), &cancel)?;
    Ok(exit_of(&summary))
}

impl DenoiseArgs {
    fn into_job(self) -> Result<Job> {
        let sequence = Sequence::find(&self.inputs)?;
        let guides = Guides { albedo: !self.no_albedo, normal: !self.no_normal, depth: !self.no_depth, vector: !self.no_vector };
        let selection = Selection {
            layer: self.layer,
            view: self.view,
            vector_layer: self.vector_layer,
            guides,
            aovs: self.aovs,
            ..Selection::default()
        };
        let model = self.model.as_deref().map_or(Ok(ModelId::embedded()), ModelId::of_file)?;
        Ok(Job {
            frames: self.frames,
            lambda: self.lambda,
            window: self.window,
            selection,
            keep_noisy: self.keep_noisy,
            overwrite: self.overwrite,
            strict: self.strict,
            model,
            ..Job::new(sequence, self.output)
        })
    }
}

/// The first signal lets the frame in hand be finished, the second ends the process at once.
fn stop_handler(cancel: &CancelToken, output: &Path) -> Handler {
    let (cancel, output) = (cancel.clone(), output.to_path_buf());
    Box::new(move || {
        if cancel.is_cancelled() {
            remove_unfinished(&output);
            std::process::exit(Exit::Stopped as i32);
        }
        cancel.cancel();
        say("stopping after the frame in hand; once more stops at once");
    })
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
        "{} → {}, {} frames, window {}, lambda {}",
        job.sequence.name,
        job.output.display(),
        plan.frames.len(),
        plan.settings.window,
        plan.settings.lambda
    ));
    for warning in &plan.warnings {
        print(format_args!("warning: {}", warning.message));
    }
    for frame in &plan.frames {
        let used: Vec<String> =
            frame.neighbours.iter().filter(|n| n.unused.is_none()).map(|n| format!("{:+}", n.offset)).collect();
        let what = match &frame.action {
            Action::Denoise(None) => "denoise".to_string(),
            Action::Denoise(Some(why)) => format!("denoise again ({why})"),
            Action::Skip => "skip, already done".to_string(),
            Action::Fail(reason) => format!("cannot: {reason}"),
        };
        let with = if used.is_empty() { String::new() } else { format!(" with {}", used.join(" ")) };
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
        assert_eq!(exit_of(&Summary { stopped: Some(Error::Cancelled), ..summary(3, 1, 0) }), Exit::Partly);
        assert_eq!(exit_of(&Summary { interrupted: true, ..summary(3, 1, 0) }), Exit::Stopped);
    }
}
