//! A frame's two passes in a run: its own, done once, and the second one over the results around it.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Instant;

use super::dial::{DialEntry, FrameDial};
use super::events::Event;
use super::lambda_image::LambdaImage;
use super::planned_frame::{Action, PlannedFrame};
use super::prepare::Plan;
use super::progress::FrameProgress;
use super::run_state::Run;
use super::threads::Decoded;
use super::window_cache::{Made, Slot, WindowCache};
use crate::engine::{Denoised, Dial, EncodedFrame, Engine, FirstPass, LambdaMask, LeftOut, Listener};
use crate::error::Result;
use crate::frame::LambdaMap;
use crate::rules::window::{Availability, WindowFrame, neighbours};

/// The frames whose first pass is to be done, ascending: those to do, and where a second pass follows those that it takes.
pub(super) fn first_passes(plan: &Plan, cache: &WindowCache) -> Vec<i64> {
    let reach = plan.settings.second_reach();
    let targets = plan.frames.iter().filter(|f| matches!(f.action, Action::Denoise(_)));
    let with_neighbours = |f: &PlannedFrame| {
        let taken = f.neighbours.iter().filter(|n| n.unused.is_none() && n.offset.unsigned_abs() as usize <= reach);
        taken.map(|n| n.number).chain([f.frame]).collect::<Vec<i64>>()
    };
    let all: BTreeSet<i64> = targets.flat_map(with_neighbours).collect();
    all.into_iter().filter(|n| !cache.made.contains_key(n)).collect()
}

/// The frames to decode for some first passes: they and the neighbours that they use, ascending, without those that are there.
pub(super) fn decode_order(plan: &Plan, passes: &[i64], there: &BTreeMap<i64, Slot>) -> Vec<i64> {
    let window = |n: i64| {
        let near = neighbours(n, plan.settings.window, |n| plan.sources.known(n));
        near.into_iter().filter(|n| n.unused.is_none()).map(|n| n.number).chain([n])
    };
    let all: BTreeSet<i64> = passes.iter().flat_map(|n| window(*n)).collect();
    all.into_iter().filter(|n| !there.contains_key(n)).collect()
}

/// What is kept of the frames of a window that are used, by offset.
fn used<'a, T>(window: &[WindowFrame], kept: &'a BTreeMap<i64, T>) -> Vec<(i32, &'a T)> {
    window.iter().filter(|n| n.unused.is_none()).filter_map(|n| Some((n.offset, kept.get(&n.number)?))).collect()
}

impl Run<'_> {
    /// The frames around one, by what is known now.
    pub(super) fn window(&self, frame: i64, radius: usize) -> Vec<WindowFrame> {
        neighbours(frame, radius, |n| match self.bad.contains_key(&n) {
            true => Availability::Bad,
            false => self.plan.sources.known(n),
        })
    }

    /// Checks and encodes a frame that was decoded.
    pub(super) fn take_in(&mut self, decoded: Decoded, engine: &Engine) {
        let Decoded { number, frame, state } = decoded;
        let began = Instant::now();
        self.cache.saw(number, state);
        let encoded = frame.and_then(|(views, glance)| {
            let seen = self.cache.pixels.look(number, glance);
            self.notes.entry(number).or_default().extend(seen.note);
            if let Some(warning) = seen.warning {
                (self.report)(Event::Warning(&warning));
            }
            views.into_iter().map(|frame| engine.encode(frame)).collect()
        });
        match encoded {
            Ok(encoded) => {
                self.cache.ring.insert(number, Slot::new(self.plan, number, encoded, began.elapsed().as_secs_f64()));
            }
            Err(error) => {
                (self.report)(Event::Error { frame: Some(number), message: error.to_string() });
                match self.job.strict {
                    true => self.stop(error),
                    false => _ = self.bad.insert(number, error),
                }
            }
        }
    }

    /// Does the first pass of a frame that was read, with its own dial, whether it is to be written or not.
    pub(super) fn first_pass(&mut self, number: i64, engine: &Engine, progress: &mut FrameProgress<'_>) {
        let Some(centre) = self.cache.ring.get(&number) else { return };
        let began = Instant::now();
        let window = self.window(number, self.plan.settings.window);
        let around = used(&window, &self.cache.ring);
        let dial = FrameDial::of(self.job, number);
        let is_target = self.plan.frames.iter().any(|f| f.frame == number && matches!(f.action, Action::Denoise(_)));
        // One that only helps needs no image; without, it has its λ all over.
        let image = dial.lambda_image.as_deref().filter(|path| is_target || !matches!(path.try_exists(), Ok(false)));
        let image = engine.in_pool(|| LambdaImage::read(self.plan, number, image)).transpose();
        let result = image.and_then(|image| {
            let mask = image.as_ref().map(|image| &image.mask);
            let views = progress.follow(|listener| denoise_views(engine, centre, &around, (&dial, mask), listener))?;
            Ok((views, image))
        });
        let seconds = centre.seconds + began.elapsed().as_secs_f64();
        match result {
            Ok((views, image)) => {
                let own = || centre.encoded.iter().find_map(|frame| frame.lambda_mask()?.note());
                let note = image.as_ref().map_or_else(own, |image| image.mask.note());
                let dial = DialEntry::new(&dial, image.and_then(|image| image.state));
                let made = Made::new(self.plan, (number, &window), views.into_iter().unzip(), (dial, note), seconds);
                self.cache.made.insert(number, made);
            }
            Err(error) => {
                // A target says so itself, when it is its turn.
                if !is_target {
                    (self.report)(Event::Error { frame: Some(number), message: error.to_string() });
                    if self.job.strict {
                        return self.stop(error);
                    }
                }
                self.failed.insert(number, (error, seconds));
            }
        }
    }

    /// The result of a frame, one image a view, and the time it took; None where its first pass failed.
    pub(super) fn result(&mut self, target: i64, window: &[WindowFrame], engine: &Engine) -> Option<(Vec<Denoised>, f64)> {
        let began = Instant::now();
        if self.plan.settings.second_reach() == 0 {
            let made = self.cache.made.remove(&target)?;
            return Some((made.views.into_iter().map(FirstPass::denoised).collect(), made.seconds));
        }
        let made = self.cache.made.get(&target)?;
        let around = used(window, &self.cache.made);
        let view = |(index, centre): (usize, &FirstPass)| {
            let near: Vec<(i32, &FirstPass)> =
                around.iter().filter_map(|(offset, made)| Some((*offset, made.views.get(index)?))).collect();
            engine.second_pass(centre, &near)
        };
        let views = made.views.iter().enumerate().map(view).collect();
        let seconds = made.seconds + began.elapsed().as_secs_f64();
        if let Some(made) = self.cache.made.get_mut(&target) {
            made.views.iter_mut().for_each(FirstPass::averaged);
        }
        Some((views, seconds))
    }
}

/// Does the first pass of each view with the same views of the frames around it; `image` is the mask where it is not in the frame itself.
fn denoise_views(
    engine: &Engine,
    centre: &Slot,
    around: &[(i32, &Slot)],
    (dial, image): (&FrameDial, Option<&LambdaMask>),
    listener: Listener<'_>,
) -> Result<Vec<(FirstPass, LeftOut)>> {
    let views = centre.encoded.len() as f64;
    let view = |(index, centre): (usize, &EncodedFrame)| {
        let neighbours: Vec<(i32, &EncodedFrame)> =
            around.iter().filter_map(|(offset, slot)| Some((*offset, slot.encoded.get(index)?))).collect();
        let map = LambdaMap::of_mask(image.or(centre.lambda_mask()), dial.lambda, dial.lambda_masked)?;
        let lambda = Dial::new(dial.lambda, map.as_ref());
        engine.first_pass(centre, &neighbours, lambda, &|fraction| listener((index as f64 + fraction) / views))
    };
    centre.encoded.iter().enumerate().map(view).collect()
}
