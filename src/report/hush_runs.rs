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
    /// Frames that could not be read, and why.
    pub bad: BTreeMap<i64, String>,
}

impl<'a> HushRuns<'a> {
    /// For the frames of a shot.
    pub fn new(scope: &'a Scope, engine: &'a Engine) -> Self {
        Self { scope, engine, encoded: BTreeMap::new(), made: BTreeMap::new(), bad: BTreeMap::new() }
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
            if self.encoded.contains_key(&n) || self.bad.contains_key(&n) {
                continue;
            }
            match read(n) {
                Ok(frame) => _ = self.encoded.insert(n, self.engine.encode(frame)?),
                Err(error) => _ = self.bad.insert(n, error.to_string()),
            }
        }
        Ok(())
    }

    /// Denoises a frame that was taken in. In a run over a shot each frame's first pass is done once, so that the time of one and of the
    /// second pass is a frame's.
    ///
    /// # Errors
    /// It could not be read.
    pub fn run(&mut self, number: i64, setting: HushSetting) -> Result<HushRun> {
        if setting.second_pass {
            self.make_around(number, setting)?;
        }
        let (centre, near) = self.window(number, setting.window)?;
        let footprint = self.engine.footprint(centre, &near);
        let (before, began) = (self.engine.stage_seconds(), Instant::now());
        let (denoised, left_out, first) = if setting.second_pass {
            let (first, left_out) = self.first_pass(number, setting)?;
            (self.engine.second_pass(&first, &self.made_around(number, setting.window)), left_out, Some(first))
        } else {
            let (denoised, left_out) = self.engine.denoise_with(centre, &near, setting.lambda, setting.skip, SILENT)?;
            (denoised, left_out, None)
        };
        let (seconds, now) = (began.elapsed().as_secs_f64(), self.engine.stage_seconds());
        let mut window_bytes = footprint.window;
        if let Some(mut first) = first {
            window_bytes += first.bytes();
            window_bytes += self.made_around(number, setting.window).iter().map(|(_, made)| made.bytes()).sum::<usize>();
            first.averaged();
            self.made.insert(number, first);
        }
        Ok(HushRun {
            colour: denoised.colour,
            seconds,
            stages: std::array::from_fn(|stage| now[stage] - before[stage]),
            left_out: left_out.constant,
            window_bytes,
            tile_bytes: footprint.tile,
        })
    }

    /// Does the first passes around a frame that are not done.
    fn make_around(&mut self, number: i64, setting: HushSetting) -> Result<()> {
        for (_, n) in self.scope.around(number, setting.window) {
            if !self.made.contains_key(&n) && self.encoded.contains_key(&n) {
                let (first, _) = self.first_pass(n, setting)?;
                self.made.insert(n, first);
            }
        }
        Ok(())
    }

    /// The results of the first pass around a frame, by offset.
    fn made_around(&self, number: i64, window: usize) -> Vec<(i32, &FirstPass)> {
        let around = self.scope.around(number, window).into_iter();
        around.filter_map(|(offset, n)| Some((offset, self.made.get(&n)?))).collect()
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
}
