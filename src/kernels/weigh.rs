//! Masked joint softmax over the taps of several images, and the weighted sums: sixteen pixels at a time.

use super::planes::Planes;
use crate::simd::dense::SEGMENT;
use crate::simd::lanes::Lanes;

/// Logits are clamped to ± this, so that no weight underflows (`LOGIT_LIMIT` in `training/model.py`).
const LOGIT_LIMIT: f32 = 40.0;

/// An image whose taps take part in a softmax.
#[derive(Clone, Copy)]
pub struct Taps<'a> {
    /// The image; its channels have `phases` planes each.
    pub image: &'a Planes,
    /// Planes a channel.
    pub phases: usize,
    /// From a pixel to its taps, as made by [`offsets`].
    pub offsets: &'a [isize],
    /// [tap][32] logits of the segment.
    pub logits: &'a [f32],
}

/// Index distances from plane 0 of a pixel to the taps of a `size` × `size` kernel, rows first, `step` pixels apart.
///
/// With four phases the pixel is sub-pixel `phase` of a half-resolution pixel, and taps count full-resolution pixels.
pub fn offsets(image: &Planes, phases: usize, phase: usize, size: usize, step: isize) -> Vec<isize> {
    let radius = (size / 2) as isize;
    let origin = image.at(0, 0, 0) as isize;
    let mut out = Vec::with_capacity(size * size);
    for ky in -radius..=radius {
        for kx in -radius..=radius {
            let (y, x) = (ky * step, kx * step);
            let (plane, y, x) = if phases == 4 {
                let (y, x) = ((phase / 2) as isize + y, (phase % 2) as isize + x);
                ((y.rem_euclid(2) * 2 + x.rem_euclid(2)) as usize, y.div_euclid(2), x.div_euclid(2))
            } else {
                (0, y, x)
            };
            out.push(image.at(plane, y, x) as isize - origin);
        }
    }
    out
}

/// Taps of all images together.
pub fn count(images: &[Taps]) -> usize {
    images.iter().map(|i| i.offsets.len()).sum()
}

/// Writes the weights [tap][16] of pixels `x + part`… of row `y`: softmax over all images' taps, those outside `mask` left out.
#[inline(always)]
pub fn weigh<L: Lanes>(l: L, images: &[Taps], mask: usize, y: usize, x: usize, part: usize, weights: &mut [f32]) {
    let (low, high) = (l.splat(-LOGIT_LIMIT), l.splat(LOGIT_LIMIT));
    let mut greatest = low;
    for image in images {
        for k in 0..image.offsets.len() {
            greatest = l.max(greatest, l.load(image.logits, k * SEGMENT + part));
        }
    }
    let greatest = l.min(greatest, high);
    let mut norm = l.splat(0.0);
    let mut slots = weights.chunks_exact_mut(16);
    for image in images {
        let start = image.image.at(mask * image.phases, y as isize, (x + part) as isize) as isize;
        for (k, offset) in image.offsets.iter().enumerate() {
            let logit = l.min(l.max(l.load(image.logits, k * SEGMENT + part), low), high);
            let usable = l.load(image.image.data(), (start + offset) as usize);
            let weight = l.mul(l.exp(l.sub(logit, greatest)), usable);
            norm = l.add(norm, weight);
            if let Some(slot) = slots.next() {
                l.store(weight, slot, 0);
            }
        }
    }
    let scale = l.where_positive(norm, l.div(l.splat(1.0), l.max(norm, l.splat(1e-37))));
    for slot in weights.chunks_exact_mut(16).take(count(images)) {
        let weight = l.mul(l.load(slot, 0), scale);
        l.store(weight, slot, 0);
    }
}

/// Σ weight · tap of one channel for the pixels that [`weigh`] was called for.
#[inline(always)]
pub fn weighted<L: Lanes>(l: L, images: &[Taps], channel: usize, y: usize, x: usize, part: usize, weights: &[f32]) -> L::V {
    let mut sum = l.splat(0.0);
    let mut slots = weights.chunks_exact(16);
    for image in images {
        let start = image.image.at(channel * image.phases, y as isize, (x + part) as isize) as isize;
        for (offset, slot) in image.offsets.iter().zip(&mut slots) {
            sum = l.fma(l.load(slot, 0), l.load(image.image.data(), (start + offset) as usize), sum);
        }
    }
    sum
}
