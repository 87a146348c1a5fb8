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
    mask: &'a [bool],
    size: usize,
    at: (isize, isize),
    logit: &'a dyn Fn(usize) -> f32,
}

impl LevelImage {
    fn taps<'a>(&'a self, size: usize, at: (isize, isize), logit: &'a dyn Fn(usize) -> f32) -> ImageTaps<'a> {
        ImageTaps { layer: self, mask: &self.mask, size, at, logit }
    }

    /// The same of a denoised level's albedo.
    fn albedo_taps<'a>(&'a self, size: usize, at: (isize, isize), logit: &'a dyn Fn(usize) -> f32) -> ImageTaps<'a> {
        ImageTaps { mask: &self.modulation_mask, ..self.taps(size, at, logit) }
    }
}

impl ImageTaps<'_> {
    /// The usable taps' pixel and logit.
    fn usable(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        let radius = (self.size / 2) as isize;
        (0..self.size * self.size).filter_map(move |k| {
            let (dy, dx) = ((k / self.size) as isize - radius, (k % self.size) as isize - radius);
            let pixel = self.layer.index(self.at.0 + dy, self.at.1 + dx)?;
            self.mask[pixel].then(|| (pixel, f64::from((self.logit)(k)).clamp(-LOGIT_LIMIT, LOGIT_LIMIT)))
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
        let with_alpha = frame.alpha.is_some() && frame.albedo.is_some();
        let modulated = 3 + usize::from(with_alpha);
        let mut out = None;
        for (k, (layers, logits)) in levels[1..].iter().zip(&probe.coarse).enumerate().rev() {
            let albedo = architecture.albedo_levels.saturating_sub(k + 1);
            out = Some(coarse(layers, out.as_ref(), logits, architecture, (albedo, modulated)));
        }
        Self { cells: fine(&levels[0], out.as_ref(), &probe.full, architecture, (frame, modulated)) }
    }
}

/// The frames from the centre to a neighbour, both included.
fn frames_between(frames: &[Frame], centre: usize, offset: i32) -> Vec<&Frame> {
    (0..=offset.unsigned_abs() as usize).map(|k| if offset > 0 { &frames[centre + k] } else { &frames[centre - k] }).collect()
}

/// A level below full resolution; `albedo` counts the levels from here on down that filter the albedo, `modulated` what is filtered with it:
/// its three channels, and alpha.
fn coarse(
    layers: &[LevelImage],
    coarser: Option<&LevelImage>,
    logits: &RegionLogits,
    a: &Architecture,
    (albedo, modulated): (usize, usize),
) -> LevelImage {
    let LevelImage { rows, columns, channels, .. } = layers[0];
    let [n_centre, n_coarse, n_albedo, n_near] = squares(a);
    let mut out = LevelImage::empty(rows, columns, channels);
    // The coarsest level has no coarse taps.
    let first_of_albedo = n_centre + if coarser.is_some() { n_coarse } else { 0 };
    let lines: Vec<Vec<[Option<Vec<BoundedValue>>; 2]>> = (0..rows)
        .into_par_iter()
        .map(|y| {
            let one = |x: usize| {
                let of_centre = |k: usize| logits.at(&logits.centre, k, y, x);
                let of_coarser = |k: usize| of_centre(n_centre + k);
                let of_albedo = |k: usize| of_centre(first_of_albedo + k);
                let of_coarser_albedo = |k: usize| of_albedo(n_albedo + k);
                let of_pairs: Vec<_> = logits.pairs.iter().map(|pair| move |k: usize| logits.at(pair, k, y, x)).collect();
                let of_albedos: Vec<_> = of_pairs.iter().map(|pair| move |_: usize| pair(n_near)).collect();
                let (at, below) = ((y as isize, x as isize), (y as isize / 2, x as isize / 2));
                let mut taps = vec![layers[0].taps(a.centre_taps, at, &of_centre)];
                taps.extend(layers[1..].iter().zip(&of_pairs).map(|(layer, logit)| layer.taps(a.neighbour_taps, at, logit)));
                taps.extend(coarser.map(|layer| layer.taps(a.coarse_taps, below, &of_coarser)));
                let values = average(&taps, channels, &channel);
                if albedo == 0 {
                    return [values, None];
                }
                let mut taps = vec![layers[0].taps(a.albedo_taps, at, &of_albedo)];
                taps.extend(layers[1..].iter().zip(&of_albedos).map(|(layer, logit)| layer.taps(1, at, logit)));
                let coarser = coarser.filter(|_| albedo > 1);
                taps.extend(coarser.map(|layer| layer.albedo_taps(a.coarse_taps, below, &of_coarser_albedo)));
                [values, average(&taps, modulated, &albedo_of)]
            };
            (0..columns).map(one).collect()
        })
        .collect();
    for [cells, modulation] in lines.into_iter().flatten() {
        out.mask.push(cells.is_some());
        let mut cells = cells.unwrap_or_else(|| vec![BoundedValue::default(); channels]);
        if let Some(alpha) = modulation.as_ref().and_then(|m| m.get(3)) {
            cells[3] = *alpha;
        }
        out.cells.extend(cells);
        out.modulation_mask.push(modulation.is_some());
        out.modulation.push(modulation.map_or([BoundedValue::default(); 3], |m| [m[0], m[1], m[2]]));
    }
    out
}

/// Taps of the centre's, the coarse, the albedo's and a neighbour's kernels.
fn squares(a: &Architecture) -> [usize; 4] {
    [a.centre_taps, a.coarse_taps, a.albedo_taps, a.neighbour_taps].map(|size| size * size)
}

/// The albedo's channels, and alpha behind them.
fn albedo_of(layer: &LevelImage, pixel: usize, c: usize) -> BoundedValue {
    if c < 3 { layer.modulation[pixel][c] } else { channel(layer, pixel, c) }
}

/// Full resolution, cut to the frame's own size and modulated.
fn fine(
    layers: &[LevelImage],
    half: Option<&LevelImage>,
    logits: &RegionLogits,
    a: &Architecture,
    (frame, modulated): (&Frame, usize),
) -> Array3<BoundedValue> {
    let channels = layers[0].channels;
    let (rows, columns) = frame.size();
    let alpha = usize::from(frame.alpha.is_some());
    let [n_centre, n_coarse, n_albedo, n_near] = squares(a);
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
            // The albedo's coarse taps follow the taps of all four phases.
            let of_coarse_albedo =
                |k: usize| logits.at(&logits.centre, 4 * (n_centre + n_coarse + n_albedo) + phase * n_coarse + k, hy, hx);
            let (at, below) = ((y as isize, x as isize), (hy as isize, hx as isize));
            let mut taps = vec![layers[0].taps(a.centre_taps, at, &of_centre)];
            let mut albedo = vec![layers[0].taps(a.albedo_taps, at, &of_albedo)];
            for (n, layer) in layers[1..].iter().enumerate() {
                taps.push(layer.taps(a.neighbour_taps, at, &of_pairs[n]));
                albedo.push(layer.taps(1, at, &of_albedos[n]));
            }
            taps.extend(half.map(|layer| layer.taps(a.coarse_taps, below, &of_coarse)));
            let half = half.filter(|_| a.albedo_levels > 1);
            albedo.extend(half.map(|layer| layer.albedo_taps(a.coarse_taps, below, &of_coarse_albedo)));
            let own = || (0..modulated).map(|c| albedo_of(&layers[0], y * layers[0].columns + x, c)).collect();
            let modulation = average(&albedo, modulated, &albedo_of).unwrap_or_else(own);
            let values = average(&taps, channels, &channel).unwrap_or_else(|| vec![BoundedValue::default(); channels]);
            for (c, v) in values.iter().enumerate() {
                if c == 3 && modulated == 4 {
                    line[[x, c]] = modulation[3];
                    continue;
                }
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
