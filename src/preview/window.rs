//! The frames around the one that is previewed, decoded once and encoded, whole or as far as a region needs them.

use std::collections::BTreeMap;

use ndarray::{Array3, ArrayView3, s};

use super::region::{Region, needed};
use crate::engine::{EncodedFrame, Engine};
use crate::error::{Error, Result};
use crate::frame::{Dial, Frame, LambdaMap};
use crate::rules::pixel_checks::{Glance, PixelChecks};
use crate::shot::{CancelToken, Scope};

/// A frame to denoise and those that help it, as (offset, number).
pub(super) struct TargetFrame {
    pub number: i64,
    pub around: Vec<(i32, i64)>,
}

impl TargetFrame {
    pub fn new(scope: &Scope, number: i64, window: usize) -> Self {
        Self { number, around: scope.around(number, window) }
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
    /// Reads the frames of all targets; the first one is the frame that is previewed. `read` hears of each that is encoded.
    ///
    /// # Errors
    /// The first target cannot be read; the region reaches beyond the frame; [`Error::Cancelled`].
    pub fn open(
        (scope, image): (&Scope, usize),
        engine: &Engine,
        targets: &[&TargetFrame],
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
            if cancel.is_cancelled() {
                return Err(Error::Cancelled);
            }
            let is_target = targets.iter().any(|t| t.number == number);
            let frame = match engine.in_pool(|| scope.read_image(number, image, is_target)) {
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
                window.cut = cut(engine, &frames, targets, region);
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
        let centre = self.encoded.get(&target.number).ok_or_else(missing)?;
        let mut around: Vec<(i32, &EncodedFrame)> = Vec::new();
        let mut helped = Vec::new();
        for (offset, number) in target.around.iter().filter(|(offset, _)| offset.unsigned_abs() as usize <= window) {
            if let Some(frame) = self.encoded.get(number) {
                around.push((*offset, frame));
                helped.push(*number);
            }
        }
        helped.sort_unstable();
        let map = LambdaMap::of_mask(centre.lambda_mask(), lambda, masked)?;
        Ok((engine.denoise(centre, &around, Dial::new(lambda, map.as_ref()))?, helped))
    }

    /// The region of an image that is cut as the frames are, (rows, columns, channels).
    pub fn shown(&self, image: ArrayView3<f32>) -> Array3<f32> {
        let place = self.region.inside(self.cut);
        image.slice(s![place.rows(), place.columns(), ..]).to_owned()
    }
}

/// What of the frames a region needs: what denoising the first target there reads, and where the region lies in the others, what
/// denoising those reads.
fn cut(engine: &Engine, frames: &BTreeMap<i64, Frame>, targets: &[&TargetFrame], region: Region) -> Region {
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
        let around: Vec<(i32, i64)> = target.around.iter().copied().filter(|(_, n)| same_size(n)).collect();
        all = all.joined(needed(seen, engine.kernel_and_body_reach(), size, &vectors, (target.number, &around)));
    }
    all.grown(engine.encoder_reach(), size)
}
