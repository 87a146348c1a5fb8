//! The kernel stage in float64, from the same logits: softmax over the usable taps, pyramid, blending, modulation.
//!
//! It also tells what any weights could have made: the range of the taps of each pixel, level by level.

use ndarray::Array3;
use rayon::prelude::*;

use super::level_image::{BoundedValue, LevelImage};
use crate::Frame;
use crate::engine::probe::Probe;
use crate::network::logits::RegionLogits;
use crate::network::weights::Architecture;

/// `LOGIT_LIMIT` in `training/network/model.py`.
const LOGIT_LIMIT: f64 = 40.0;

/// A frame's result, (rows, columns, values): colour, alpha, light passes.
pub(super) struct Reference {
    pub cells: Array3<BoundedValue>,
}

/// The taps of one image, `size` × `size` around `at`; `logit` gives the tap's logit.
struct ImageTaps<'a> {
    layer: &'a LevelImage,
    size: usize,
    at: (isize, isize),
    logit: &'a dyn Fn(usize) -> f32,
}

impl ImageTaps<'_> {
    /// The usable taps' pixel and logit.
    fn usable(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        let radius = (self.size / 2) as isize;
        (0..self.size * self.size).filter_map(move |k| {
            let (dy, dx) = ((k / self.size) as isize - radius, (k % self.size) as isize - radius);
            let pixel = self.layer.index(self.at.0 + dy, self.at.1 + dx)?;
            self.layer.mask[pixel].then(|| (pixel, f64::from((self.logit)(k)).clamp(-LOGIT_LIMIT, LOGIT_LIMIT)))
        })
    }
}

/// The weighted average over the usable taps of several images of what `of` finds in a pixel; None where no tap is usable.
fn average(
    images: &[ImageTaps],
    count: usize,
    of: &dyn Fn(&LevelImage, usize, usize) -> BoundedValue,
) -> Option<Vec<BoundedValue>> {
    let mut sums = vec![BoundedValue { value: 0.0, low: f64::INFINITY, high: f64::NEG_INFINITY, size: 0.0 }; count];
    let mut norm = 0.0;
    for taps in images {
        for (pixel, logit) in taps.usable() {
            let weight = logit.exp();
            norm += weight;
            for (c, sum) in sums.iter_mut().enumerate() {
                let cell = of(taps.layer, pixel, c);
                sum.value += weight * cell.value;
                sum.size += weight * cell.size;
                sum.low = sum.low.min(cell.low);
                sum.high = sum.high.max(cell.high);
            }
        }
    }
    for sum in &mut sums {
        (sum.value, sum.size) = (sum.value / norm, sum.size / norm);
    }
    (norm > 0.0).then_some(sums)
}

fn channel(layer: &LevelImage, pixel: usize, c: usize) -> BoundedValue {
    layer.pixel(pixel)[c]
}

impl Reference {
    /// Of `frames[centre]`, the window's frames in order, from what the engine's probe of it tells.
    pub fn new(frames: &[Frame], centre: usize, probe: &Probe, architecture: &Architecture) -> Self {
        let epsilon = f64::from(architecture.albedo_epsilon);
        let frame = &frames[centre];
        let full: Vec<LevelImage> = rayon::iter::once(None)
            .chain(probe.offsets.par_iter().map(Some))
            .map(|offset| match offset {
                None => LevelImage::new(frame, epsilon),
                Some(offset) => LevelImage::warped(&frames_between(frames, centre, *offset), *offset > 0, epsilon),
            })
            .collect();
        let mut levels = vec![full];
        for _ in &probe.coarse {
            levels.push(levels[levels.len() - 1].par_iter().map(LevelImage::down).collect());
        }
        let mut out = None;
        for (layers, logits) in levels[1..].iter().zip(&probe.coarse).rev() {
            out = Some(coarse(layers, out.as_ref(), logits, architecture));
        }
        Self { cells: fine(&levels[0], out.as_ref(), &probe.full, architecture, frame) }
    }
}

/// The frames from the centre to a neighbour, both included.
fn frames_between(frames: &[Frame], centre: usize, offset: i32) -> Vec<&Frame> {
    (0..=offset.unsigned_abs() as usize).map(|k| if offset > 0 { &frames[centre + k] } else { &frames[centre - k] }).collect()
}

/// A level below full resolution.
fn coarse(layers: &[LevelImage], coarser: Option<&LevelImage>, logits: &RegionLogits, a: &Architecture) -> LevelImage {
    let LevelImage { rows, columns, channels, .. } = layers[0];
    let mut out = LevelImage { rows, columns, channels, cells: Vec::new(), mask: Vec::new(), modulation: Vec::new() };
    let lines: Vec<Vec<Option<Vec<BoundedValue>>>> = (0..rows)
        .into_par_iter()
        .map(|y| {
            let one = |x: usize| {
                let of_centre = |k: usize| logits.at(&logits.centre, k, y, x);
                let of_coarser = |k: usize| logits.at(&logits.centre, a.centre_taps * a.centre_taps + k, y, x);
                let of_pairs: Vec<_> = logits.pairs.iter().map(|pair| move |k: usize| logits.at(pair, k, y, x)).collect();
                let at = (y as isize, x as isize);
                let mut taps = vec![ImageTaps { layer: &layers[0], size: a.centre_taps, at, logit: &of_centre }];
                for (layer, logit) in layers[1..].iter().zip(&of_pairs) {
                    taps.push(ImageTaps { layer, size: a.neighbour_taps, at, logit });
                }
                let at = (at.0 / 2, at.1 / 2);
                taps.extend(coarser.map(|layer| ImageTaps { layer, size: a.coarse_taps, at, logit: &of_coarser }));
                average(&taps, channels, &channel)
            };
            (0..columns).map(one).collect()
        })
        .collect();
    for cells in lines.into_iter().flatten() {
        out.mask.push(cells.is_some());
        out.cells.extend(cells.unwrap_or_else(|| vec![BoundedValue::default(); channels]));
    }
    out
}

/// Full resolution, cut to the frame's own size and modulated.
fn fine(
    layers: &[LevelImage],
    half: Option<&LevelImage>,
    logits: &RegionLogits,
    a: &Architecture,
    frame: &Frame,
) -> Array3<BoundedValue> {
    let channels = layers[0].channels;
    let (rows, columns) = frame.size();
    let alpha = usize::from(frame.alpha.is_some());
    let [n_centre, n_coarse, n_albedo, n_near] =
        [a.centre_taps, a.coarse_taps, a.albedo_taps, a.neighbour_taps].map(|size| size * size);
    let mut out = Array3::default((rows, columns, channels));
    out.axis_iter_mut(ndarray::Axis(0)).into_par_iter().enumerate().for_each(|(y, mut line)| {
        for x in 0..columns {
            let (hy, hx, phase) = (y / 2, x / 2, 2 * (y % 2) + x % 2);
            let of_centre = |k: usize| logits.at(&logits.centre, phase * (n_centre + n_coarse + n_albedo) + k, hy, hx);
            let of_coarse = |k: usize| of_centre(n_centre + k);
            let of_albedo = |k: usize| of_centre(n_centre + n_coarse + k);
            let of_pairs: Vec<_> =
                logits.pairs.iter().map(|pair| move |k: usize| logits.at(pair, phase * (n_near + 1) + k, hy, hx)).collect();
            let of_albedos: Vec<_> = of_pairs.iter().map(|pair| move |_: usize| pair(n_near)).collect();
            let at = (y as isize, x as isize);
            let mut taps = vec![ImageTaps { layer: &layers[0], size: a.centre_taps, at, logit: &of_centre }];
            let mut albedo = vec![ImageTaps { layer: &layers[0], size: a.albedo_taps, at, logit: &of_albedo }];
            for (n, layer) in layers[1..].iter().enumerate() {
                taps.push(ImageTaps { layer, size: a.neighbour_taps, at, logit: &of_pairs[n] });
                albedo.push(ImageTaps { layer, size: 1, at, logit: &of_albedos[n] });
            }
            let at = (hy as isize, hx as isize);
            taps.extend(half.map(|layer| ImageTaps { layer, size: a.coarse_taps, at, logit: &of_coarse }));
            let Some(values) = average(&taps, channels, &channel) else { continue };
            let modulation = |layer: &LevelImage, pixel: usize, c: usize| BoundedValue::of(layer.modulation[pixel][c]);
            let own = || (0..3).map(|c| modulation(&layers[0], y * layers[0].columns + x, c)).collect();
            let modulation = average(&albedo, 3, &modulation).unwrap_or_else(own);
            for (c, v) in values.iter().enumerate() {
                let m = if c < 3 { Some(c) } else { (c - 3).checked_sub(alpha).map(|c| c % 3) };
                line[[x, c]] = m.map_or(*v, |m| product(v, &modulation[m]));
            }
        }
    });
    out
}

/// A value times its modulation, which is never negative.
fn product(v: &BoundedValue, m: &BoundedValue) -> BoundedValue {
    BoundedValue {
        value: v.value * m.value,
        low: v.low * if v.low < 0.0 { m.high } else { m.low },
        high: v.high * if v.high < 0.0 { m.low } else { m.high },
        size: v.size * m.size,
    }
}
