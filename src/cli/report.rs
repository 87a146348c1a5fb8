//! `hush report`: arguments to a measurement, its page, and what it comes to in a few lines.

use std::path::{Path, PathBuf};

use clap::Args;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::setting_args::{OfReports, QueryArgs};
use super::signals::stop_handler;
use super::{CatchSignals, Exit, say, tell};
use crate::error::{Error, Result};
use crate::network::weights::Weights;
use crate::report::{MeasureOptions, Measured, Oidn, PAGE, REACH, measure, prepare, write};
use crate::settings::ShotSettings;
use crate::shot::{CancelToken, Scope};
use crate::stability;
use crate::words::counted;

/// Measures error against run time for the settings worth choosing between, and writes a page about it
///
/// Windows 0 to 3, the second pass over time, skipping, lambda, and Open Image Denoise where oidnDenoise or Python's pyoidn is
/// installed: as Cycles runs it, with guides as rendered, and fast. Each frame is denoised with each setting several times in turn.
/// Without --reference the error is estimated from noisy frames before and after. No frames are written.
#[derive(Args)]
pub(super) struct ReportArgs {
    /// A folder, a glob, a pattern such as shot/frame_####.exr or shot/frame_%04d.exr, or files; may be left out where the shot's
    /// settings name them
    #[arg(value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    #[command(flatten)]
    shot: QueryArgs<OfReports>,
    /// The frames as they should be, named alike: a folder, a pattern such as ref/frame_####.exr, or a file
    #[arg(short, long, value_name = "INPUT")]
    reference: Option<PathBuf>,
    /// Folder for the page, its plots and its numbers; a report that is there is replaced
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// How often each frame is timed with each setting
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u16).range(1..=1000))]
    repeats: u16,
    /// oidnDenoise, or the folder that it lies in [default: on the PATH, then Python's pyoidn]
    #[arg(long, value_name = "PATH", conflicts_with = "no_oidn")]
    oidn: Option<PathBuf>,
    /// Do without Open Image Denoise
    #[arg(long)]
    no_oidn: bool,
    /// Also try what must hold on hard cases, and show the worst of each
    #[arg(long)]
    stability: bool,
    /// Say nothing but errors
    #[arg(short, long)]
    quiet: bool,
}

/// Runs the subcommand; frames that could not be measured show in the exit code.
pub(super) fn report(args: &ReportArgs, catch_signals: CatchSignals) -> Result<Exit> {
    let (sequence, settings) = args.shot.query(&args.inputs).find()?;
    // Measured are every window, one pass and two, and the rules by default, on the beauty alone.
    let values = ShotSettings { skip: None, aovs: None, second_pass: Some(true), ..settings.values };
    let scope = Scope::open(&sequence, &values.selection(), values.frames.as_ref(), None, REACH)?;
    check_apart(&args.output, &scope)?;
    prepare(&args.output)?;
    let engine = values.engine()?;
    let oidn = if args.no_oidn { None } else { Oidn::find(args.oidn.as_deref())? };
    let options = MeasureOptions {
        reference: args.reference.clone(),
        repeats: usize::from(args.repeats),
        chosen: values.frames.is_some(),
        oidn: oidn.map(|oidn| (oidn, args.oidn.is_some())),
        layer: values.layers.as_ref().and_then(|layers| layers.first().cloned()),
        view: values.view.clone(),
    };
    let cancel = CancelToken::new();
    catch_signals(stop_handler(&cancel, Some(&args.output)))?;
    if !args.quiet {
        let peer = if options.oidn.is_some() { " and OIDN" } else { "" };
        say(format_args!("{}: measuring Hush's settings{peer}, {} each", scope.name, counted(usize::from(args.repeats), "time")));
    }
    let bar = ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::hidden());
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} runs · {eta} left") {
        bar.set_style(style);
    }
    if !args.quiet {
        bar.set_draw_target(ProgressDrawTarget::stderr());
    }
    let progress = |done: usize, all: usize| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    };
    let measured = measure(&scope, &engine, &options, &progress, &cancel).and_then(|mut measured| {
        cancel.check()?;
        if args.stability {
            let weights = Weights::open(values.model.as_deref(), values.renderer.as_deref())?;
            measured.report.stability = stability::run(&weights, 0, &|done, all, _| {
                progress(done, all);
                cancel.check()
            })?;
        }
        Ok(measured)
    });
    bar.finish_and_clear();
    let measured = match measured {
        Err(Error::Cancelled) => {
            say("stopped; nothing was written");
            return Ok(Exit::Stopped);
        }
        measured => measured?,
    };
    write(&measured, &args.output)?;
    if !args.quiet {
        summary(&measured).iter().for_each(tell);
        tell(format_args!("{}", args.output.join(PAGE).display()));
    }
    let failed = &measured.report.failed;
    failed.iter().for_each(|(frame, why)| say(format_args!("error: frame {frame}: {why}")));
    Ok(if failed.is_empty() { Exit::Good } else { Exit::Partly })
}

/// Frames and page must not share a folder: the page's files are no frames, and the next run would meet them.
fn check_apart(output: &Path, scope: &Scope) -> Result<()> {
    let folder = |path: &Path| std::fs::canonicalize(path).ok();
    let first =
        scope.frames.first().and_then(|n| scope.about(*n)).and_then(|(layout, _)| layout.path.parent().map(Path::to_path_buf));
    let first = first.map(|p| if p.as_os_str().is_empty() { PathBuf::from(".") } else { p });
    match (folder(output), first.as_deref().and_then(folder)) {
        (Some(a), Some(b)) if a == b => Err(Error::BadInput {
            input: format!("output {}", output.display()),
            reason: "is where the frames lie: choose another folder, such as a new one inside it".into(),
        }),
        _ => Ok(()),
    }
}

/// A line a setting, then what is to be said.
fn summary(measured: &Measured) -> Vec<String> {
    let report = &measured.report;
    let titles = report.basis.titles();
    let which: Vec<usize> = (0..titles.len()).filter(|e| titles[*e].is_some()).collect();
    let wide = |text: &str| text.chars().count();
    let width = report.rows_by_setting.iter().map(|r| wide(&r.candidate.name)).max().unwrap_or(0);
    let head: String = which.iter().filter_map(|e| titles[*e]).map(|t| format!("  {t:>10}")).collect();
    let mut out = vec![format!("{:width$}  s a frame{head}", "")];
    for row in &report.rows_by_setting {
        let name = format!("{}{}", row.candidate.name, " ".repeat(width - wide(&row.candidate.name)));
        let time = row.seconds.map_or_else(|| format!("{:>9}", "–"), |s| format!("{:>9.3}", s.median));
        let cells = which.iter().map(|e| {
            let cell = row.error(*e, report.basis).map_or("–".to_string(), |v| format!("{v:.4}"));
            format!("  {cell:>width$}", width = wide(titles[*e].unwrap_or_default()).max(10))
        });
        out.push(format!("{name}  {time}{}", cells.collect::<String>()));
    }
    if !report.stability.is_empty() {
        let failed = report.stability.iter().filter(|r| !r.passed).count();
        out.push(format!("Numerical soundness: {} checks, {failed} failed.", report.stability.len()));
    }
    out.extend(report.remarks.iter().cloned());
    out
}
