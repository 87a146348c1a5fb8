//! The runs of Hush itself: a frame with each of its settings, from encoded frames that all of them share.

use std::collections::BTreeMap;
use std::time::Instant;

use ndarray::Array3;

use super::candidates::HushSetting;
use crate::engine::{EncodedFrame, Engine, FirstPass, LeftOut, SILENT, STAGES};
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::shot::Scope;

/// A frame that was denoised.
pub struct HushRun {
    pub colour: Array3<f32>,
    /// Without encoding.
    pub seconds: f64,
    pub stages: [f64; STAGES.len()],
    /// The share of the pixels that was not computed.
    pub left_out: f64,
    pub window_bytes: usize,
    pub tile_bytes: usize,
}

/// Denoises frame after frame.
pub struct HushRuns<'a> {
    scope: &'a Scope,
    engine: &'a Engine,
    encoded: BTreeMap<i64, EncodedFrame>,
    /// After their first pass, for the second one of those around.
    made: BTreeMap<i64, FirstPass>,
}

impl<'a> HushRuns<'a> {
    /// For the frames of a shot.
    pub fn new(scope: &'a Scope, engine: &'a Engine) -> Self {
        Self { scope, engine, encoded: BTreeMap::new(), made: BTreeMap::new() }
    }

    /// Encodes a frame and those around it that are not there yet, and lets go of all others. One that cannot be read does not help.
    ///
    /// # Errors
    /// A frame cannot be encoded.
    pub fn take_in(&mut self, number: i64, reach: usize, read: impl Fn(i64) -> Result<Frame>) -> Result<()> {
        let all: Vec<i64> = self.scope.around(number, reach).into_iter().map(|(_, n)| n).chain([number]).collect();
        self.encoded.retain(|n, _| all.contains(n));
        self.made.retain(|n, _| all.contains(n));
        for n in all {
            if !self.encoded.contains_key(&n)
                && let Ok(frame) = read(n)
            {
                self.encoded.insert(n, self.engine.encode(frame)?);
            }
        }
        Ok(())
    }

    /// Denoises a frame that was taken in.
    ///
    /// # Errors
    /// It could not be read.
    pub fn run(&mut self, number: i64, setting: HushSetting) -> Result<HushRun> {
        match setting.second_pass {
            true => self.in_two_passes(number, setting),
            false => self.in_one_pass(number, setting),
        }
    }

    fn in_one_pass(&self, number: i64, setting: HushSetting) -> Result<HushRun> {
        let (centre, near) = self.window(number, setting.window)?;
        let (before, began) = (self.engine.stage_seconds(), Instant::now());
        let (denoised, left_out) = self.engine.denoise_with(centre, &near, setting.lambda, setting.skip, SILENT)?;
        let seconds = began.elapsed().as_secs_f64();
        let footprint = self.engine.footprint(centre, &near);
        Ok(HushRun {
            colour: denoised.colour,
            seconds,
            stages: self.stages_since(before),
            left_out: left_out.constant,
            window_bytes: footprint.window,
            tile_bytes: footprint.tile,
        })
    }

    /// In a run over a shot each frame's first pass is done once, so that the time of one and of the second pass is a frame's.
    fn in_two_passes(&mut self, number: i64, setting: HushSetting) -> Result<HushRun> {
        let around = self.scope.around(number, setting.window);
        for (_, n) in &around {
            if !self.made.contains_key(n) && self.encoded.contains_key(n) {
                let (first, _) = self.first_pass(*n, setting)?;
                self.made.insert(*n, first);
            }
        }
        let (before, began) = (self.engine.stage_seconds(), Instant::now());
        let (mut first, left_out) = self.first_pass(number, setting)?;
        let near: Vec<(i32, &FirstPass)> = around.iter().filter_map(|(offset, n)| Some((*offset, self.made.get(n)?))).collect();
        let colour = self.engine.second_pass(&first, &near).colour;
        let seconds = began.elapsed().as_secs_f64();
        let stages = self.stages_since(before);
        let kept: usize = near.iter().map(|(_, made)| made.bytes()).sum::<usize>() + first.bytes();
        let (centre, near) = self.window(number, setting.window)?;
        let footprint = self.engine.footprint(centre, &near);
        first.averaged();
        self.made.insert(number, first);
        Ok(HushRun {
            colour,
            seconds,
            stages,
            left_out: left_out.constant,
            window_bytes: footprint.window + kept,
            tile_bytes: footprint.tile,
        })
    }

    fn first_pass(&self, number: i64, setting: HushSetting) -> Result<(FirstPass, LeftOut)> {
        let (centre, near) = self.window(number, setting.window)?;
        self.engine.first_pass(centre, &near, setting.lambda, SILENT)
    }

    /// A frame and those on each side that were taken in, by offset.
    #[allow(clippy::type_complexity)]
    fn window(&self, number: i64, window: usize) -> Result<(&EncodedFrame, Vec<(i32, &EncodedFrame)>)> {
        let missing = || Error::BadInput { input: format!("frame {number}"), reason: "could not be encoded".into() };
        let near = self.scope.around(number, window);
        let near = near.into_iter().filter_map(|(offset, n)| Some((offset, self.encoded.get(&n)?))).collect();
        Ok((self.encoded.get(&number).ok_or_else(missing)?, near))
    }

    fn stages_since(&self, before: [f64; STAGES.len()]) -> [f64; STAGES.len()] {
        let now = self.engine.stage_seconds();
        std::array::from_fn(|stage| now[stage] - before[stage])
    }
}
