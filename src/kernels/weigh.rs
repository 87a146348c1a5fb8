//! Masked joint softmax over the taps of several images, and the weighted sums, a segment at a time.
//!
//! Image by image rather than pixel by pixel: the lines of one image stay in the first-level cache while all sub-pixels use them.

use super::planes::Planes;
use crate::layers::SEGMENT;
use crate::simd::Simd;
use crate::simd::math::exp;

/// Logits are clamped to ± this, so that no weight underflows (`LOGIT_LIMIT` in `training/network/model.py`).
const LOGIT_LIMIT: f32 = 40.0;

/// An image whose taps take part in a softmax.
#[derive(Clone, Copy)]
pub struct Taps<'a> {
    /// The image; its channels have `phases` planes each.
    pub image: &'a Planes,
    /// Planes a channel.
    pub phases: usize,
    /// For each output phase, from a pixel to its taps, as made by [`offsets`].
    pub offsets: &'a [Vec<isize>],
    /// [output phase][tap][32] logits of the segment, `pitch` taps from phase to phase.
    pub logits: &'a [f32],
    /// Taps between the logits of one output phase and the next.
    pub pitch: usize,
    /// The channel that is 1 where a pixel may be used.
    pub mask: usize,
    /// [output phase][2][32]: a tap's logit gets the first times its key and the second times its key squared. None without keys.
    pub queries: Option<&'a [f32]>,
}

impl Taps<'_> {
    /// Taps of one output pixel.
    fn len(&self) -> usize {
        self.offsets[0].len()
    }

    #[inline(always)]
    fn start(&self, channel: usize, y: usize, x: usize) -> isize {
        self.image.at(channel * self.phases, y as isize, x as isize) as isize
    }
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

/// What [`apply`] needs besides its arguments, reused from segment to segment.
#[derive(Default)]
pub struct TapWeights {
    taps: Vec<f32>,
    scales: Vec<f32>,
}

impl TapWeights {
    /// One over each pixel's sum of weights, [phase][32]; zero where no tap was usable.
    pub fn scales(&self) -> &[f32] {
        &self.scales
    }
}

/// Softmax over the images' taps, those outside the mask left out, and the weighted sums of `channels`, one part of them after the other:
/// `out` [channel][phase][32].
///
/// `y`, `x` count the images' pixels (half-resolution pixels where they have four phases); `key` is the channel of the taps' keys.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
pub fn apply<S: Simd>(
    s: S,
    images: &[Taps],
    key: usize,
    channels: [std::ops::Range<usize>; 2],
    y: usize,
    x: usize,
    buffers: &mut TapWeights,
    out: &mut [f32],
) {
    let phases = images[0].offsets.len();
    let total: usize = images.iter().map(Taps::len).sum();
    buffers.taps.resize(phases * total * SEGMENT, 0.0);
    buffers.scales.resize(phases * SEGMENT, 0.0);
    for phase in 0..phases {
        weigh(s, images, key, phase, y, x, &mut buffers.taps[phase * total * SEGMENT..], &mut buffers.scales[phase * SEGMENT..]);
    }
    let size = (channels[0].len() + channels[1].len()) * phases * SEGMENT;
    out[..size].fill(0.0);
    let mut before = 0;
    for image in images {
        for phase in 0..phases {
            let weights = &buffers.taps[(phase * total + before) * SEGMENT..][..image.len() * SEGMENT];
            let mut done = 0;
            for part in &channels {
                let mut channel = part.start;
                while channel < part.end {
                    let out = &mut out[(done * phases + phase) * SEGMENT..];
                    let at = Place { channel, phase, y, x };
                    let added = match part.end - channel {
                        1 => add::<S, 1>(s, image, at, weights, out),
                        2 => add::<S, 2>(s, image, at, weights, out),
                        _ => add::<S, 3>(s, image, at, weights, out),
                    };
                    (channel, done) = (channel + added, done + added);
                }
            }
        }
        before += image.len();
    }
    for out in out[..size].chunks_exact_mut(phases * SEGMENT) {
        for at in (0..phases * SEGMENT).step_by(16) {
            s.store(s.mul(s.load(out, at), s.load(&buffers.scales, at)), out, at);
        }
    }
}

/// Which channel's pixels [`add`] sums first, for which output phase, and where.
#[derive(Clone, Copy)]
struct Place {
    channel: usize,
    phase: usize,
    y: usize,
    x: usize,
}

/// Adds the weighted taps of N channels to `out`, [channel][phase][32] from the first one's phase on: each weight is read once for
/// all of them, and N sums grow side by side. Returns N.
#[inline(always)]
fn add<S: Simd, const N: usize>(s: S, image: &Taps, at: Place, weights: &[f32], out: &mut [f32]) -> usize {
    let data = image.image.data();
    let pitch = image.offsets.len() * SEGMENT;
    let mut starts = [0; N];
    let mut sums = [[s.splat(0.0); 2]; N];
    for n in 0..N {
        starts[n] = image.start(at.channel + n, at.y, at.x);
        sums[n] = [s.load(out, n * pitch), s.load(out, n * pitch + 16)];
    }
    for (offset, weight) in image.offsets[at.phase].iter().zip(weights.chunks_exact(SEGMENT)) {
        let weight = [s.load(weight, 0), s.load(weight, 16)];
        for n in 0..N {
            let pixels = &data[(starts[n] + offset) as usize..][..SEGMENT];
            sums[n] = [s.fma(weight[0], s.load(pixels, 0), sums[n][0]), s.fma(weight[1], s.load(pixels, 16), sums[n][1])];
        }
    }
    for (n, sum) in sums.iter().enumerate() {
        s.store(sum[0], out, n * pitch);
        s.store(sum[1], out, n * pitch + 16);
    }
    N
}

/// Weights [tap][32] of one output phase before normalisation, and what to multiply the sums by.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn weigh<S: Simd>(s: S, images: &[Taps], key: usize, phase: usize, y: usize, x: usize, weights: &mut [f32], scales: &mut [f32]) {
    let (low, high, above) = (s.splat(-LOGIT_LIMIT), s.splat(LOGIT_LIMIT), s.splat(2.0 * LOGIT_LIMIT));
    // A usable tap counts from above all that are not, so that those never matter, not even for the rounding.
    let mut greatest = [low; 2];
    let mut slots = weights.chunks_exact_mut(SEGMENT);
    for image in images {
        let mask = image.start(image.mask, y, x);
        let key = image.queries.map_or(mask, |_| image.start(key, y, x));
        let logits = &image.logits[phase * image.pitch * SEGMENT..][..image.len() * SEGMENT];
        let data = image.image.data();
        let mut query = [[s.splat(0.0); 2]; 2];
        if let Some(queries) = image.queries {
            let at = 2 * phase * SEGMENT;
            query = [
                [s.load(queries, at), s.load(queries, at + 16)],
                [s.load(queries, at + SEGMENT), s.load(queries, at + SEGMENT + 16)],
            ];
        }
        for ((offset, tap), slot) in image.offsets[phase].iter().zip(logits.chunks_exact(SEGMENT)).zip(&mut slots) {
            let usable = &data[(mask + offset) as usize..][..SEGMENT];
            for (part, greatest) in greatest.iter_mut().enumerate() {
                let mut logit = s.load(tap, 16 * part);
                if image.queries.is_some() {
                    let key = s.load(&data[(key + offset) as usize..][..SEGMENT], 16 * part);
                    logit = s.fma(key, s.fma(key, query[1][part], query[0][part]), logit);
                }
                let logit = s.min(s.max(logit, low), high);
                *greatest = s.max(*greatest, s.fma(s.load(usable, 16 * part), above, logit));
                s.store(logit, slot, 16 * part);
            }
        }
    }
    greatest = [s.sub(greatest[0], above), s.sub(greatest[1], above)];
    let mut norm = [s.splat(0.0); 2];
    let mut slots = weights.chunks_exact_mut(SEGMENT);
    for image in images {
        let mask = image.start(image.mask, y, x);
        for (offset, slot) in image.offsets[phase].iter().zip(&mut slots) {
            let usable = &image.image.data()[(mask + offset) as usize..][..SEGMENT];
            for part in 0..2 {
                let logit = s.load(slot, 16 * part);
                let weight = s.mul(exp(s, s.sub(logit, greatest[part])), s.load(usable, 16 * part));
                norm[part] = s.add(norm[part], weight);
                s.store(weight, slot, 16 * part);
            }
        }
    }
    for (part, norm) in norm.into_iter().enumerate() {
        let scale = s.where_positive(norm, s.div(s.splat(1.0), s.max(norm, s.splat(1e-37))));
        s.store(scale, scales, 16 * part);
    }
}
