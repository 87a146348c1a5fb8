//! What a shot does not need: what each rule leaves out of each frame, which passes are never decoded, and the time it saves.

use std::collections::BTreeMap;
use std::time::Instant;

use serde::Serialize;

use super::cancel::CancelToken;
use super::scope::Scope;
use crate::engine::{EncodedFrame, Engine, SILENT};
use crate::error::{Error, Result};
use crate::rules::skip::{LeftOut, RULES, Rule, Skip};

/// How often each variant is timed.
const TRIES: usize = 4;

/// What was found.
#[derive(Clone, Debug, Serialize)]
pub struct Survey {
    /// The sequence's name.
    pub sequence: String,
    /// Frames on each side.
    pub window: usize,
    /// By ascending number.
    pub frames: Vec<SurveyedFrame>,
    /// One a rule.
    pub rules: Vec<RuleSummary>,
    /// Passes of the first frame that are not used.
    pub unread: Vec<Unread>,
    /// The share of the file's pixel data, before compression, that is not used, 0…1.
    pub unread_share: f64,
    /// None if it was not asked for, or nothing is left out.
    pub time: Option<Timing>,
    /// Frames that could not be read.
    pub failed: BTreeMap<i64, String>,
}

/// One frame.
#[derive(Clone, Debug, Serialize)]
pub struct SurveyedFrame {
    /// Its number.
    pub frame: i64,
    /// How many neighbours can help.
    pub neighbours: usize,
    /// For each view layer and stereo view.
    pub left_out: Vec<LeftOut>,
}

/// What one rule does in the whole shot.
#[derive(Clone, Debug, Serialize)]
pub struct RuleSummary {
    /// Which.
    pub rule: Rule,
    /// Whether it is on. Where it is off, the numbers say what it would do.
    pub on: bool,
    /// How far a result may be off.
    pub bound: &'static str,
    /// What it leaves out.
    pub why: &'static str,
    /// How many frames it changes.
    pub frames: usize,
    /// Over the frames' images: the mean share of pixels, of images without alpha to filter, or the number of neighbours.
    pub mean: f64,
    /// The most in one image.
    pub most: f64,
}

/// A pass of the file that nothing needs.
#[derive(Clone, Debug, Serialize)]
pub struct Unread {
    /// Such as `ViewLayer.CryptoObject00`.
    pub pass: String,
    /// Bytes a frame before compression.
    pub bytes: u64,
    /// Whether it lies in parts of its own, which are not even decompressed.
    pub apart: bool,
}

/// Time to denoise one frame, with and without the rules in turn.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Timing {
    /// The frame that was timed: of those that something is left out of, the one with the median share of pixels.
    pub frame: i64,
    /// How often each was timed.
    pub tries: usize,
    /// The least seconds with the rules.
    pub with: f64,
    /// The least seconds with nothing left out.
    pub without: f64,
    /// Frames that something is left out of.
    pub frames: usize,
    /// The whole shot's seconds if each of those took `with`, the others `without`.
    pub shot_with: f64,
    /// The whole shot's seconds if each took `without`.
    pub shot_without: f64,
}

/// Looks at every frame. `progress` hears how many frames are done; `timed` also measures one frame.
///
/// # Errors
/// No frame can be read; [`Error::Cancelled`].
pub fn survey(scope: &Scope, engine: &Engine, timed: bool, progress: &dyn Fn(usize), cancel: &CancelToken) -> Result<Survey> {
    let mut look = Look { scope, ring: BTreeMap::new(), opaque: BTreeMap::new(), failed: scope.bad.clone(), first_error: None };
    let (mut frames, mut each) = (Vec::new(), Vec::new());
    let skip = engine.skip();
    let all = RULES.into_iter().fold(skip, |skip, rule| skip.with(rule, true));
    for (done, &number) in scope.frames.iter().enumerate() {
        let around = scope.around(number, scope.window);
        look.load(engine, number, &around, cancel)?;
        progress(done + 1);
        let Some(centre) = look.ring.get(&number) else { continue };
        let count = around.iter().filter(|(_, n)| look.ring.contains_key(n)).count();
        let of = |skip: Skip| -> Vec<LeftOut> {
            let opaque = |view: usize| look.opaque.get(&number).and_then(|views| views.get(view)).copied().unwrap_or(false);
            let view = |(view, centre)| {
                let neighbours = look.neighbours(&around, view);
                let found = engine.left_out(centre, &neighbours, skip);
                let takes_alpha = neighbours.iter().any(|(_, frame)| frame.has_alpha());
                LeftOut { alpha: found.alpha || opaque(view) && !takes_alpha, ..found }
            };
            centre.iter().enumerate().map(view).collect()
        };
        let left_out = of(skip);
        each.push(if all == skip { left_out.clone() } else { would_be(&left_out, skip, of) });
        frames.push(SurveyedFrame { frame: number, neighbours: count, left_out });
    }
    if frames.is_empty() {
        return Err(look
            .first_error
            .unwrap_or(Error::BadInput { input: scope.name.clone(), reason: "no frame can be read".into() }));
    }
    let failed = std::mem::take(&mut look.failed);
    drop(look);
    let time = if timed { time(scope, engine, skip, &frames, cancel)? } else { None };
    let (unread, unread_share) = unread(scope);
    let rules = RULES.into_iter().map(|rule| summary(rule, skip.has(rule), &each)).collect();
    Ok(Survey { sequence: scope.name.clone(), window: scope.window, frames, rules, unread, unread_share, time, failed })
}

/// What is left out, and for the rules that are off what each would leave out if it alone were turned on.
fn would_be(left_out: &[LeftOut], skip: Skip, of: impl Fn(Skip) -> Vec<LeftOut>) -> Vec<LeftOut> {
    let mut out = left_out.to_vec();
    for rule in RULES.into_iter().filter(|r| !skip.has(*r)) {
        for (out, one) in out.iter_mut().zip(of(skip.with(rule, true))) {
            match rule {
                Rule::Constant => out.constant = one.constant,
                Rule::Opaque => out.alpha = one.alpha,
                Rule::Untrusted => out.untrusted = one.untrusted,
                Rule::Still => out.still = one.still,
            }
        }
    }
    out
}

fn summary(rule: Rule, on: bool, each: &[Vec<LeftOut>]) -> RuleSummary {
    let values: Vec<f64> = each.iter().flatten().map(|l| l.by(rule)).collect();
    RuleSummary {
        rule,
        on,
        bound: rule.bound(),
        why: rule.why(),
        frames: each.iter().filter(|views| views.iter().any(|l| l.by(rule) > 0.0)).count(),
        mean: values.iter().sum::<f64>() / values.len().max(1) as f64,
        most: values.iter().copied().fold(0.0, f64::max),
    }
}

/// A window of frames that were looked at.
struct Look<'a> {
    scope: &'a Scope,
    ring: BTreeMap<i64, Vec<EncodedFrame>>,
    /// Whether the file has alpha that is 1 everywhere, which is not even taken in.
    opaque: BTreeMap<i64, Vec<bool>>,
    failed: BTreeMap<i64, String>,
    first_error: Option<Error>,
}

impl Look<'_> {
    fn load(&mut self, engine: &Engine, number: i64, around: &[(i32, i64)], cancel: &CancelToken) -> Result<()> {
        self.ring.retain(|n, _| *n == number || around.iter().any(|(_, a)| a == n));
        for n in around.iter().map(|(_, n)| *n).chain([number]) {
            cancel.check()?;
            if self.ring.contains_key(&n) || self.failed.contains_key(&n) {
                continue;
            }
            let read = self.scope.read(n).and_then(|views| {
                let resolved = self.scope.about(n).map(|(_, resolved)| resolved).unwrap_or_default();
                let opaque = views.iter().zip(resolved).map(|(f, r)| r.alpha.is_some() && f.alpha.is_none()).collect();
                self.opaque.insert(n, opaque);
                views.iter().map(|f| engine.look(f)).collect()
            });
            match read {
                Ok(views) => _ = self.ring.insert(n, views),
                Err(error) => {
                    self.failed.insert(n, error.to_string());
                    self.first_error.get_or_insert(error);
                }
            }
        }
        Ok(())
    }

    fn neighbours(&self, around: &[(i32, i64)], view: usize) -> Vec<(i32, &EncodedFrame)> {
        around.iter().filter_map(|(offset, n)| Some((*offset, self.ring.get(n)?.get(view)?))).collect()
    }
}

/// Times the frame in the middle of those that something is left out of.
fn time(scope: &Scope, engine: &Engine, skip: Skip, frames: &[SurveyedFrame], cancel: &CancelToken) -> Result<Option<Timing>> {
    let share = |f: &SurveyedFrame| f.left_out.iter().map(|l| l.constant).sum::<f64>();
    let something = |f: &&SurveyedFrame| f.left_out.iter().any(|l| *l != LeftOut::default());
    let mut order: Vec<&SurveyedFrame> = frames.iter().filter(something).collect();
    order.sort_by(|a, b| share(a).total_cmp(&share(b)));
    let Some(number) = order.get(order.len() / 2).map(|f| f.frame) else { return Ok(None) };
    let encode = |n: i64| -> Result<Vec<EncodedFrame>> { scope.read(n)?.into_iter().map(|f| engine.encode(f)).collect() };
    let centre = encode(number)?;
    let around: Vec<(i32, Vec<EncodedFrame>)> =
        scope.around(number, scope.window).into_iter().filter_map(|(offset, n)| Some((offset, encode(n).ok()?))).collect();
    let (mut with, mut without) = (Vec::new(), Vec::new());
    for _ in 0..TRIES {
        for (skip, to) in [(skip, &mut with), (Skip::NONE, &mut without)] {
            cancel.check()?;
            let began = Instant::now();
            for (view, centre) in centre.iter().enumerate() {
                let near: Vec<(i32, &EncodedFrame)> =
                    around.iter().filter_map(|(offset, views)| Some((*offset, views.get(view)?))).collect();
                engine.denoise_with(centre, &near, 1.0, skip, SILENT)?;
            }
            to.push(began.elapsed().as_secs_f64());
        }
    }
    // Whatever else the machine does only adds to a time.
    let least = |times: &[f64]| times.iter().copied().fold(f64::INFINITY, f64::min);
    let (with, without) = (least(&with), least(&without));
    let (changed, others) = (order.len() as f64, (frames.len() - order.len()) as f64);
    let (shot_with, shot_without) = (changed * with + others * without, (changed + others) * without);
    Ok(Some(Timing { frame: number, tries: TRIES, with, without, frames: order.len(), shot_with, shot_without }))
}

/// The passes of the first frame that nothing needs, and their share of the data.
fn unread(scope: &Scope) -> (Vec<Unread>, f64) {
    let Some((layout, views)) = scope.frames.first().and_then(|n| scope.about(*n)) else { return (Vec::new(), 0.0) };
    let used: Vec<(usize, usize)> = views.iter().flat_map(|v| v.channels()).map(|c| (c.part, c.index)).collect();
    let pixels = (layout.columns * layout.rows) as u64;
    let (mut out, mut all, mut spared) = (Vec::new(), 0, 0);
    for layer in &layout.layers {
        for pass in &layer.passes {
            let bytes = |c: &crate::io::Channel| pixels * c.sample.bytes() as u64;
            all += pass.channels.iter().map(bytes).sum::<u64>();
            let idle: Vec<_> = pass.channels.iter().filter(|c| !used.contains(&(c.part, c.index))).collect();
            let size: u64 = idle.iter().map(|c| bytes(c)).sum();
            spared += size;
            if idle.len() == pass.channels.len() && !idle.is_empty() {
                let names = [layer.name.as_str(), pass.name.as_str(), pass.view.as_deref().unwrap_or_default()];
                let name = names.into_iter().filter(|n| !n.is_empty()).collect::<Vec<_>>().join(".");
                let apart = idle.iter().all(|c| used.iter().all(|(part, _)| *part != c.part));
                out.push(Unread { pass: name, bytes: size, apart });
            }
        }
    }
    (out, if all == 0 { 0.0 } else { spared as f64 / all as f64 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rules_that_are_off_tell_what_they_would_do() {
        let skip = Skip::default().with(Rule::Untrusted, false);
        let now = [LeftOut { constant: 0.25, still: 2, ..LeftOut::default() }];
        let with_untrusted = |wanted: Skip| {
            assert!(wanted.untrusted && wanted.constant);
            vec![LeftOut { constant: 0.9, still: 0, untrusted: 3, ..LeftOut::default() }]
        };
        let both = would_be(&now, skip, with_untrusted);
        assert_eq!(both, [LeftOut { constant: 0.25, still: 2, untrusted: 3, ..LeftOut::default() }]);
        let each = [both, vec![LeftOut::default()]];
        let constant = summary(Rule::Constant, true, &each);
        assert_eq!((constant.frames, constant.mean, constant.most), (1, 0.125, 0.25));
        let untrusted = summary(Rule::Untrusted, false, &each);
        assert!(!untrusted.on && untrusted.most == 3.0 && untrusted.bound == "exact");
        assert_eq!(summary(Rule::Opaque, true, &each).frames, 0);
    }
}
