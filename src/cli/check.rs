//! `hush check`: which denoised frames are current, and why the others are not.

use std::collections::BTreeMap;
use std::path::PathBuf;

use clap::Args;

use super::setting_args::{OfRuns, QueryArgs};
use super::{Exit, print, print_json};
use crate::error::{Error, Result};
use crate::shot::{Checked, FrameState, Job, SequenceCheck};
use crate::words;

/// Tells which denoised frames are current
///
/// A frame is current if denoising it now, with the same options as for `hush denoise`, would give what is there. Exits with 0
/// only if every frame is, with 1 where there is none. Nothing is written.
#[derive(Args)]
pub(super) struct CheckArgs {
    /// A folder, a glob, a pattern such as shot/frame_####.exr, or files; may be left out where the shot's settings name them
    #[arg(value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    #[command(flatten)]
    shot: QueryArgs<OfRuns>,
    /// One JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// Runs the subcommand.
pub(super) fn check(args: &CheckArgs) -> Result<Exit> {
    let (sequence, settings) = args.shot.query(&args.inputs).find_even_unrendered()?;
    let job = Job::of(&settings, sequence, None)?;
    let checked = SequenceCheck::new().check(&job)?;
    if args.json {
        print_json(&checked);
    } else {
        lines(&checked).iter().for_each(print);
    }
    if checked.frames.is_empty() {
        let reason = "no frame is there, neither rendered nor denoised: check the path".into();
        return Err(Error::BadInput { input: named(args, &job), reason });
    }
    let good = checked.counts.current == checked.frames.len();
    Ok(if good { Exit::Good } else { Exit::Partly })
}

/// What was asked about, in the words of who asked.
fn named(args: &CheckArgs, job: &Job) -> String {
    match args.inputs.as_slice() {
        [] => job.sequence.name.clone(),
        some => some.iter().map(|input| input.display().to_string()).collect::<Vec<_>>().join(", "),
    }
}

/// A line for each state and reason, with the frames it is true of.
fn lines(checked: &Checked) -> Vec<String> {
    let mut groups: BTreeMap<(FrameState, &str), Vec<i64>> = BTreeMap::new();
    for frame in &checked.frames {
        groups.entry((frame.state, frame.reason.as_deref().unwrap_or_default())).or_default().push(frame.frame);
    }
    let line = |((state, reason), frames): (&(FrameState, &str), &Vec<i64>)| {
        let what = match state {
            FrameState::Current => "current",
            FrameState::Stale => "out of date",
            FrameState::Missing => "not denoised",
            FrameState::Unrendered => "not rendered",
        };
        let why = if reason.is_empty() { String::new() } else { format!(": {reason}") };
        format!("{}: {what}{why}", words::frames(frames))
    };
    groups.iter().map(line).collect()
}
