//! The frames around the one that is previewed, decoded once and encoded, whole or as far as a region needs them.

use std::collections::BTreeMap;

use ndarray::{Array3, ArrayView3, s};

use super::region::{Region, needed};
use crate::engine::{EncodedFrame, Engine, FirstPass, SILENT};
use crate::error::{Error, Result};
use crate::frame::{Dial, Frame, LambdaMap};
use crate::rules::pixel_checks::{Glance, PixelChecks};
use crate::shot::{CancelToken, Scope};

/// Pixels around a pixel whose results its second pass compares.
const SECOND_REACH: usize = 4;

/// A frame to denoise and those that it depends on, as (offset, number).
pub(super) struct TargetFrame {
    pub number: i64,
    pub around: Vec<(i32, i64)>,
}

impl TargetFrame {
    pub fn new(scope: &Scope, number: i64, context: usize) -> Self {
        Self { number, around: scope.around(number, context) }
    }

    /// The frames that help one of those that it depends on, itself among them, as (offset, number).
    fn around(&self, number: i64, window: usize) -> Vec<(i32, i64)> {
        let all = self.around.iter().map(|(_, n)| *n).chain([self.number]);
        let near = all.filter(|n| *n != number && n.abs_diff(number) <= window as u64);
        near.map(|n| ((n - number) as i32, n)).collect()
    }
}

/// The encoded frames of one image, all cut alike.
pub(super) struct PreviewWindow {
    encoded: BTreeMap<i64, EncodedFrame>,
    /// Cut as the frames are: colours of the targets and the Vector pass of the first.
    pub colours: BTreeMap<i64, Frame>,
    /// Rows and columns of the whole frame.
    pub size: (usize, usize),
    /// What the frames were cut to.
    pub cut: Region,
    /// What of the whole frame was asked for.
    pub region: Region,
    /// Brings the frame's log-average luminance to 0.18.
    pub exposure: f32,
    /// What the pixels show to be wrong.
    pub notes: Vec<String>,
}

impl PreviewWindow {
    /// Reads the frames of all targets, for windows of at most `most`; the first one is the frame that is previewed. `read` hears of each
    /// that is encoded.
    ///
    /// # Errors
    /// The first target cannot be read; the region reaches beyond the frame; [`Error::Cancelled`].
    pub fn open(
        (scope, image): (&Scope, usize),
        engine: &Engine,
        (targets, most): (&[&TargetFrame], usize),
        region: Option<Region>,
        (cancel, read): (&CancelToken, &dyn Fn()),
    ) -> Result<Self> {
        let first = targets.first().map(|t| t.number).unwrap_or_default();
        let mut numbers: Vec<i64> = targets.iter().flat_map(|t| t.around.iter().map(|(_, n)| *n).chain([t.number])).collect();
        numbers.sort_unstable();
        numbers.dedup();
        let (mut frames, mut checks, mut notes) = (BTreeMap::new(), PixelChecks::default(), Vec::new());
        let mut window = None;
        for number in numbers {
            cancel.check()?;
            let reach = (engine.identity().context(most) - most) as u64;
            let is_denoised = targets.iter().any(|t| t.number.abs_diff(number) <= reach);
            let frame = match engine.in_pool(|| scope.read_image(number, image, is_denoised)) {
                Ok(frame) => frame,
                Err(error) if number == first => return Err(error),
                Err(error) => {
                    notes.push(format!("frame {number} cannot help: {error}"));
                    continue;
                }
            };
            notes.extend(checks.look(number, Glance::of(&frame)).warning.map(|w| w.message));
            frames.insert(number, frame);
            // Without a region nothing has to wait for the others: one whole frame at a time.
            if region.is_none() {
                let window = window.get_or_insert_with(|| Self::empty(frames[&number].size(), None));
                window.encode(engine, std::mem::take(&mut frames), (first, targets))?;
                read();
            }
        }
        notes.extend(checks.finish().map(|w| w.message));
        let mut window = match (window, region) {
            (Some(window), _) => window,
            (None, region) => {
                let size = frames.get(&first).map(Frame::size).unwrap_or_default();
                let region = region.unwrap_or(Region::whole(size)).within(size)?;
                let mut window = Self::empty(size, Some(region));
                window.cut = cut(engine, &frames, (targets, most), region);
                while let Some((number, frame)) = frames.pop_first() {
                    window.encode(engine, BTreeMap::from([(number, frame)]), (first, targets))?;
                    read();
                }
                window
            }
        };
        window.notes = notes;
        Ok(window)
    }

    fn empty(size: (usize, usize), region: Option<Region>) -> Self {
        let whole = Region::whole(size);
        Self {
            encoded: BTreeMap::new(),
            colours: BTreeMap::new(),
            size,
            cut: whole,
            region: region.unwrap_or(whole),
            exposure: 1.0,
            notes: Vec::new(),
        }
    }

    fn encode(&mut self, engine: &Engine, frames: BTreeMap<i64, Frame>, (first, targets): (i64, &[&TargetFrame])) -> Result<()> {
        for (number, frame) in frames {
            let whole = frame.view();
            let scales = engine.scales(&whole)?;
            // A neighbour of another size helps nobody; the engine leaves it out.
            let part = if whole.size() == self.size { whole.part(self.cut.rows(), self.cut.columns()) } else { whole };
            self.encoded.insert(number, engine.encode_part(&part, scales)?);
            if number == first {
                self.exposure = scales.exposure;
            }
            if targets.iter().any(|t| t.number == number) {
                let vector = part.vector.filter(|_| number == first).map(|v| v.to_owned());
                let alpha = part.alpha.map(|a| a.to_owned());
                self.colours.insert(number, Frame { alpha, vector, ..Frame::new(part.colour.to_owned()) });
            }
        }
        Ok(())
    }

    /// Denoises a target with at most `window` frames on each side; also which helped. The image is cut as the frames are.
    pub fn denoise(
        &self,
        engine: &Engine,
        target: &TargetFrame,
        window: usize,
        (lambda, masked): (f32, Option<f32>),
    ) -> Result<(crate::Denoised, Vec<i64>)> {
        let missing = || Error::BadInput { input: format!("frame {}", target.number), reason: "cannot be read".into() };
        let context = engine.identity().context(window);
        let helped = target.around(target.number, context).into_iter().map(|(_, n)| n).filter(|n| self.encoded.contains_key(n));
        let mut helped: Vec<i64> = helped.collect();
        helped.sort_unstable();
        let first = |number: i64| -> Result<FirstPass> {
            let centre = self.encoded.get(&number).ok_or_else(missing)?;
            let around = target.around(number, window);
            let around: Vec<(i32, &EncodedFrame)> =
                around.iter().filter_map(|(offset, n)| Some((*offset, self.encoded.get(n)?))).collect();
            let map = LambdaMap::of_mask(centre.lambda_mask(), lambda, masked)?;
            Ok(engine.first_pass(centre, &around, Dial::new(lambda, map.as_ref()), SILENT)?.0)
        };
        let own = first(target.number)?;
        if context == window {
            return Ok((own.denoised(), helped));
        }
        let taken = target.around(target.number, window).into_iter().filter(|(_, n)| self.encoded.contains_key(n));
        let near: Vec<(i32, FirstPass)> = taken.map(|(offset, n)| Ok((offset, first(n)?))).collect::<Result<_>>()?;
        let near: Vec<(i32, &FirstPass)> = near.iter().map(|(offset, pass)| (*offset, pass)).collect();
        Ok((engine.second_pass(&own, &near), helped))
    }

    /// The region of an image that is cut as the frames are, (rows, columns, channels).
    pub fn shown(&self, image: ArrayView3<f32>) -> Array3<f32> {
        let place = self.region.inside(self.cut);
        image.slice(s![place.rows(), place.columns(), ..]).to_owned()
    }
}

/// What of the frames a region needs: what denoising the first target there reads, and where the region lies in the others, what
/// denoising those reads.
fn cut(engine: &Engine, frames: &BTreeMap<i64, Frame>, (targets, most): (&[&TargetFrame], usize), region: Region) -> Region {
    let vectors: BTreeMap<i64, ArrayView3<f32>> =
        frames.iter().filter_map(|(n, frame)| Some((*n, frame.vector.as_ref()?.view()))).collect();
    let Some(first) = targets.first() else { return region };
    let size = frames.get(&first.number).map(Frame::size).unwrap_or_default();
    let mut all = region;
    for target in targets {
        // Of the frame before, the pixels that the region's come from.
        let seen = match vectors.get(&first.number) {
            Some(vectors) if target.number < first.number => region.moved(*vectors, false).map_or(region, |r| r.joined(region)),
            _ => region,
        };
        let same_size = |n: &i64| frames.get(n).is_some_and(|f| f.size() == size);
        let around = |n: i64| -> Vec<(i32, i64)> { target.around(n, most).into_iter().filter(|(_, n)| same_size(n)).collect() };
        let reach = engine.kernel_and_body_reach();
        all = all.joined(needed(seen, reach, size, &vectors, (target.number, &around(target.number))));
        if !engine.has_second_pass() {
            continue;
        }
        for later in [false, true] {
            let (step, mut place) = (if later { 1 } else { -1 }, Some(seen.grown(SECOND_REACH, size)));
            for k in 1..=most as i64 {
                place = place.and_then(|p| p.moved(*vectors.get(&(target.number + step * (k - 1)))?, later));
                let Some(there) = place else { break };
                let number = target.number + step * k;
                all = all.joined(needed(there, reach, size, &vectors, (number, &around(number))));
            }
        }
    }
    all.grown(engine.encoder_reach(), size)
}
