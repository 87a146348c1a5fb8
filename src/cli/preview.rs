//! `hush preview`: arguments to a request, its sheet, and a line for each combination.

use std::path::PathBuf;

use clap::Args;
use indicatif::{ProgressBar, ProgressDrawTarget};

use super::setting_args::{OfPreviews, QueryArgs};
use super::signals::stop_handler;
use super::{CatchSignals, Exit, say, tell};
use crate::error::{Error, Result};
use crate::preview::{Preview, Region, Request, SheetOptions, Variant, check_sheet, preview, write_sheet};
use crate::rules::lambda::Lambda;
use crate::shot::{CancelToken, Job};

/// Shows one frame denoised in several ways, as a sheet of tiles
///
/// Each lambda with each window, beside the frame as rendered. Only the frames that help this one are read, and no frame is
/// written. Tone: linear light to sRGB, no view transform.
#[derive(Args)]
pub(super) struct PreviewArgs {
    /// A folder, a glob, a pattern such as shot/frame_####.exr or shot/frame_%04d.exr, or files
    ///
    /// May be left out where the shot's settings name the frames.
    #[arg(value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// Number of the frame to show
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true)]
    frame: i64,
    /// PNG to write
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Values to try, 1 to 64, such as 1,4,16 [default: what the shot's settings say for the frame, else 1]
    #[arg(short, long, value_name = "LIST", value_delimiter = ',', allow_negative_numbers = true)]
    lambda: Vec<f32>,
    /// Windows to try, 0 to 3, such as 0,2 [default: what the shot's settings say, else 2 where there is a Vector pass, else 0]
    #[arg(short, long, value_name = "LIST", value_delimiter = ',')]
    window: Vec<usize>,
    /// Part of the frame, in pixels from the upper left corner; the rest is not computed [default: all of it]
    #[arg(long, value_name = "X,Y,WIDTH,HEIGHT")]
    region: Option<Region>,
    /// Show the rendered frame left of this place of each denoised tile, 0 to 1
    #[arg(long, value_name = "PLACE", num_args = 0..=1, default_missing_value = "0.5", value_parser = place)]
    before_after: Option<f64>,
    /// Also show what changes from the frame before along the motion, in false colours
    #[arg(long)]
    flicker: bool,
    /// Show it this many stops brighter
    #[arg(long, value_name = "EV", default_value_t = 0.0, allow_negative_numbers = true, value_parser = stops)]
    exposure: f64,
    #[command(flatten)]
    shot: QueryArgs<OfPreviews>,
    /// Say nothing but errors
    #[arg(short, long)]
    quiet: bool,
}

/// Runs the subcommand.
pub(super) fn show_preview(args: &PreviewArgs, catch_signals: CatchSignals) -> Result<Exit> {
    let (sequence, settings) = args.shot.query(&args.inputs).find()?;
    // The job is never run: it says what a run would read.
    let job = Job::of(&settings, sequence, Some(PathBuf::new()))?;
    check_sheet(&args.output, &job.sequence)?;
    let one = |value: &f32| Lambda::constant(*value).map(|lambda| lambda.at(args.frame));
    let clamped = args.lambda.iter().filter_map(|value| Lambda::constant(*value).ok()?.note());
    let notes: Vec<String> = settings.notes.iter().cloned().chain(clamped).collect();
    let lambdas: Vec<f32> = args.lambda.iter().map(one).collect::<Result<_>>()?;
    let request = Request {
        frame: args.frame,
        lambdas: if lambdas.is_empty() { vec![job.lambda().at(args.frame)] } else { lambdas },
        lambda_masked: job.lambda_masked(args.frame),
        windows: if args.window.is_empty() { job.settings.window.into_iter().collect() } else { args.window.clone() },
        region: args.region,
        flicker: args.flicker,
    };
    let engine = job.settings.engine()?;
    let cancel = CancelToken::new();
    catch_signals(stop_handler(&cancel, None))?;
    let target = if args.quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(Some(100), target);
    let made = preview((&job.sequence, &job.selection()), &request, &engine, &|f| bar.set_position((100.0 * f) as u64), &cancel);
    bar.finish_and_clear();
    let made = match made {
        Err(Error::Cancelled) => return Ok(Exit::Stopped),
        made => made?,
    };
    if !args.quiet {
        notes.iter().chain(&made.notes).for_each(|note| say(format_args!("warning: {note}")));
    }
    write_sheet(&made, &SheetOptions { exposure: args.exposure, before_after: args.before_after }, &args.output)?;
    if !args.quiet {
        lines(&made).iter().for_each(tell);
    }
    Ok(Exit::Good)
}

fn place(text: &str) -> Result<f64, String> {
    let place = text.parse().ok().filter(|p| (0.0..=1.0).contains(p));
    place.ok_or_else(|| format!("{text} is not in 0 (all denoised) to 1 (all noisy)"))
}

fn stops(text: &str) -> Result<f64, String> {
    let stops = text.parse().ok().filter(|s: &f64| s.abs() <= 100.0);
    stops.ok_or_else(|| format!("{text} is no number of stops"))
}

/// What each combination took and how much of it changes.
fn lines(made: &Preview) -> Vec<String> {
    let change = |mean: Option<f64>| mean.map_or(String::new(), |mean| format!(", change {:.1} %", 100.0 * mean));
    let mut out = Vec::new();
    for layer in &made.layers {
        let name = if made.layers.len() > 1 { format!("{}: ", layer.name) } else { String::new() };
        let noisy = layer.flicker.as_ref().map(|f| format!("{name}noisy{}", change(f.mean)));
        out.extend(noisy);
        for Variant { lambda, window, neighbours, flicker, seconds, .. } in &layer.variants {
            let helped: Vec<String> = neighbours.iter().map(i64::to_string).collect();
            let with = if helped.is_empty() { String::new() } else { format!(" with frames {}", helped.join(" ")) };
            let change = change(flicker.as_ref().and_then(|f| f.mean));
            out.push(format!("{name}lambda {lambda}, window {window}{with}: {seconds:.1} s{change}"));
        }
    }
    out
}
