//! `hush survey`: what is left out of a shot, why, and the time that it saves.

use std::path::PathBuf;

use clap::Args;
use indicatif::{ProgressBar, ProgressDrawTarget};

use super::setting_args::{OfSurveys, QueryArgs};
use super::signals::stop_handler;
use super::{CatchSignals, Exit, print, print_json, say};
use crate::error::{Error, Result};
use crate::rules::skip::{LeftOut, Rule};
use crate::shot::{CancelToken, RuleSummary, Scope, Survey, survey};
use crate::words::counted;

/// Tells what is left out of a shot, why, and the time that it saves
///
/// Looks at the pixels of every frame and denoises one, in turn with and without. Nothing is written.
#[derive(Args)]
pub(super) struct SurveyArgs {
    /// A folder, a glob, a pattern such as shot/frame_####.exr or shot/frame_%04d.exr, or files; may be left out where the shot's
    /// settings name them
    #[arg(value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    #[command(flatten)]
    shot: QueryArgs<OfSurveys>,
    /// Measure no time
    #[arg(long)]
    no_timing: bool,
    /// One JSON object instead of text
    #[arg(long)]
    json: bool,
}

/// Runs the subcommand; frames that cannot be read show in the exit code.
pub(super) fn show_survey(args: &SurveyArgs, catch_signals: CatchSignals) -> Result<Exit> {
    let (sequence, settings) = args.shot.query(&args.inputs).find()?;
    let values = &settings.values;
    let scope = Scope::open(&sequence, &values.selection(), values.frames.as_ref(), values.window, 0)?;
    let engine = values.engine()?;
    let cancel = CancelToken::new();
    catch_signals(stop_handler(&cancel, None))?;
    let target = if args.json { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(Some(scope.frames.len() as u64), target);
    let found = survey(&scope, &engine, !args.no_timing, &|done| bar.set_position(done as u64), &cancel);
    bar.finish_and_clear();
    let found = match found {
        Err(Error::Cancelled) => return Ok(Exit::Stopped),
        found => found?,
    };
    if args.json {
        print_json(&found);
    } else {
        lines(&found).iter().for_each(print);
    }
    found.failed.iter().for_each(|(frame, reason)| say(format_args!("error: frame {frame}: {reason}")));
    Ok(if found.failed.is_empty() { Exit::Good } else { Exit::Partly })
}

/// The survey in words.
fn lines(found: &Survey) -> Vec<String> {
    let count = found.frames.len();
    let mut out = vec![format!("{}: {}, window {}", found.sequence, counted(count, "frame"), found.window), String::new()];
    let names = found.rules.iter().map(|r| r.rule.name().chars().count()).max().unwrap_or(0);
    for rule in &found.rules {
        let state = if rule.on { "on " } else { "off" };
        out.push(format!("{:names$}  {state}  {} ({})", rule.rule.name(), effect(rule, count), rule.bound));
        out.push(format!("{:names$}       {}", "", rule.why));
    }
    out.push(String::new());
    if found.unread.is_empty() {
        out.push("Every pass of the file is used.".into());
    } else {
        let list = |apart: bool| found.unread.iter().filter(|u| u.apart == apart).map(|u| u.pass.clone()).collect::<Vec<_>>();
        let share = 100.0 * found.unread_share;
        out.push(format!("Not used: {share:.0} % of the file's pixel data before compression."));
        for (passes, what) in [
            (list(true), "never decompressed"),
            (list(false), "decompressed, as they share a part with what is used, and passed over"),
        ] {
            if !passes.is_empty() {
                out.push(format!("  {what}: {}", passes.join(", ")));
            }
        }
    }
    let nothing = found.frames.iter().flat_map(|f| &f.left_out).all(|l| *l == LeftOut::default());
    if nothing {
        out.extend([String::new(), "Nothing is left out, so no time is saved.".into()]);
    }
    if let Some(time) = &found.time {
        out.push(String::new());
        out.push(format!(
            "Frame {}, the one in the middle by what is left out: {:.2} s instead of {:.2} s (the least of {} tries in turn).",
            time.frame, time.with, time.without, time.tries
        ));
        let change = 100.0 * (1.0 - time.shot_with / time.shot_without.max(1e-9));
        let (share, way) = (change.abs(), if change >= 0.0 { "less" } else { "more" });
        out.push(format!(
            "The shot, with something left out of {} of {}: about {:.1} s instead of {:.1} s, {share:.0} % {way}.",
            time.frames,
            counted(count, "frame"),
            time.shot_with,
            time.shot_without,
        ));
    }
    out
}

/// What a rule does or would do.
fn effect(rule: &RuleSummary, count: usize) -> String {
    if rule.frames == 0 {
        return format!("{} nothing", if rule.on { "leaves out" } else { "would leave out" });
    }
    let verb = if rule.on { "leaves out" } else { "would leave out" };
    let of = format!("in {} of {}", rule.frames, counted(count, "frame"));
    match rule.rule {
        Rule::Constant => {
            format!("{verb} {:.1} % of the pixels, at most {:.1} % of a frame, {of}", 100.0 * rule.mean, 100.0 * rule.most)
        }
        Rule::Opaque => format!("{verb} alpha {of}"),
        Rule::Still => format!("{} {:.1} neighbours a frame, {of}", if rule.on { "copies" } else { "would copy" }, rule.mean),
        Rule::Untrusted => format!("{verb} {:.1} neighbours a frame, {of}", rule.mean),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn effects_are_told_in_words() {
        let rule = |rule: Rule, on, frames, mean, most| RuleSummary { rule, on, bound: "", why: "", frames, mean, most };
        assert_eq!(
            effect(&rule(Rule::Constant, true, 3, 0.25, 0.5), 8),
            "leaves out 25.0 % of the pixels, at most 50.0 % of a frame, in 3 of 8 frames"
        );
        assert_eq!(
            effect(&rule(Rule::Untrusted, false, 1, 2.0, 4.0), 1),
            "would leave out 2.0 neighbours a frame, in 1 of 1 frame"
        );
        assert_eq!(effect(&rule(Rule::Opaque, true, 0, 0.0, 0.0), 8), "leaves out nothing");
    }
}
