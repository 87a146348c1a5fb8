//! The inner loops: a register tile of PX pixels × NV vectors of output channels, swept along a strip of pixels.
//!
//! Each output value is one chain: bias, then ky, kx and ci in that order, one FMA each, whatever tile it falls into.

#![allow(clippy::needless_range_loop, reason = "a register tile is an index space; p and v are its coordinates")]

use super::activation::SPARE_PIXELS;
use crate::simd::{LANES, Simd};

/// Vectors of output channels in the widest block: 3 × 8 pixels fill the registers best.
const BLOCK_VECTORS: usize = 3;
/// Segments of a strip: rows of a packed tile, or sources.
pub(super) const SEGMENTS: usize = 3;

/// One block of output channels: `vectors` × 16 of them from `channel` on.
pub(super) struct Block {
    pub channel: usize,
    pub vectors: usize,
    /// Offset of its weights, [tap][16 · vectors], in `Weights::taps`.
    pub offset: usize,
}

impl Block {
    /// Splits `vectors` into blocks of 3 and 2 (one block of 1 where there is no other way) of so many taps.
    pub fn all(vectors: usize, taps: usize) -> Vec<Self> {
        let mut blocks = Vec::new();
        let mut vector = 0;
        while vector < vectors {
            let left = vectors - vector;
            // 4 is 2 + 2, not 3 + 1.
            let take = if left == 4 { 2 } else { left.min(BLOCK_VECTORS) };
            blocks.push(Self { channel: vector * LANES, vectors: take, offset: vector * LANES * taps });
            vector += take;
        }
        blocks
    }
}

/// What the inputs are multiplied by.
#[derive(Clone, Copy)]
pub(super) struct Weights<'a> {
    /// For each block [tap][16 · vectors].
    pub taps: &'a [f32],
    /// Padded to whole vectors.
    pub bias: &'a [f32],
    /// Output channels.
    pub outputs: usize,
}

/// One strip of output pixels: what the sums are of, and what becomes of them.
pub(super) struct Strip<'a> {
    /// In the order in which they are summed.
    pub segments: [Segment<'a>; SEGMENTS],
    /// The segments lie in the sources, not in a packed tile.
    pub in_place: bool,
    /// Whole pixels of all output channels.
    pub output: &'a mut [f32],
    pub add: Add<'a>,
    pub relu: bool,
}

/// What is added to the sums.
#[derive(Clone, Copy)]
pub(super) enum Add<'a> {
    Nothing,
    /// What the output holds.
    Output,
    /// An image's strip, as long as the output's.
    Image(&'a [f32]),
}

/// A run of inputs that lie side by side, for each pixel of a strip.
#[derive(Clone, Copy)]
pub(super) struct Segment<'a> {
    /// From the run of the strip's first pixel on, to [`SPARE_PIXELS`] past the last one's.
    pub input: &'a [f32],
    /// Floats between the runs of neighbouring pixels.
    pub pixel: usize,
    /// Two neighbouring pixels share a run; the first pixel is an even one. Only in place.
    pub halved: bool,
    pub run: usize,
}

impl Segment<'_> {
    pub const EMPTY: Self = Self { input: &[], pixel: 0, halved: false, run: 0 };
}

/// The block's output channels of every pixel of the strip, in register tiles that the instruction set has room for.
#[inline(always)]
pub(super) fn sweep<S: Simd>(s: S, weights: Weights, block: &Block, strip: &mut Strip) {
    match S::REGISTERS {
        // 24 accumulators of the 32 registers.
        32.. => match block.vectors {
            1 => sweep_by::<S, 24, 1>(s, weights, block, 0, strip),
            2 => sweep_by::<S, 12, 2>(s, weights, block, 0, strip),
            _ => sweep_by::<S, 8, 3>(s, weights, block, 0, strip),
        },
        // 6 accumulators, weights and a broadcast.
        8.. => {
            for v in 0..block.vectors {
                sweep_by::<S, 6, 1>(s, weights, block, v, strip);
            }
        }
        _ => {
            for v in 0..block.vectors {
                sweep_by::<S, 2, 1>(s, weights, block, v, strip);
            }
        }
    }
}

/// Output channels from vector `first` of the block on, NV vectors of them, for every pixel of the strip.
#[inline(always)]
fn sweep_by<S: Simd, const PX: usize, const NV: usize>(s: S, weights: Weights, block: &Block, first: usize, strip: &mut Strip) {
    match strip.in_place {
        true => sweep_from::<S, PX, NV, true>(s, weights, block, first, strip),
        false => sweep_from::<S, PX, NV, false>(s, weights, block, first, strip),
    }
}

#[inline(always)]
fn sweep_from<S: Simd, const PX: usize, const NV: usize, const IN_PLACE: bool>(
    s: S,
    weights: Weights,
    block: &Block,
    first: usize,
    strip: &mut Strip,
) {
    const { assert!(PX <= SPARE_PIXELS && SPARE_PIXELS.is_multiple_of(PX) && PX.is_multiple_of(2)) };
    let channel = block.channel + first * LANES;
    let valid = (weights.outputs - channel).min(NV * LANES);
    let taps = &weights.taps[block.offset + first * LANES..];
    let bias = &weights.bias[channel..][..NV * LANES];
    let pixels = strip.output.len() / weights.outputs;
    for x in (0..pixels).step_by(PX) {
        let count = (pixels - x).min(PX);
        let sums = sums::<S, PX, NV, IN_PLACE>(s, &strip.segments, x, bias, taps, block.vectors * LANES);
        let at = x * weights.outputs + channel;
        if count == PX && valid == NV * LANES {
            finish(s, sums, strip, at, weights.outputs);
        } else {
            finish_part(s, sums, strip, at, weights.outputs, (count, valid));
        }
    }
}

/// The convolution itself, for the strip's pixels from `x` on. `step` is the number of weights from a tap to the next.
#[inline(always)]
fn sums<S: Simd, const PX: usize, const NV: usize, const IN_PLACE: bool>(
    s: S,
    segments: &[Segment; SEGMENTS],
    x: usize,
    bias: &[f32],
    taps: &[f32],
    step: usize,
) -> [[S::V; NV]; PX] {
    let mut sums = [[s.load(bias, 0); NV]; PX];
    for sum in &mut sums {
        for v in 1..NV {
            sum[v] = s.load(bias, v * LANES);
        }
    }
    let mut taps = taps;
    for segment in segments {
        let shift = u32::from(IN_PLACE && segment.halved);
        let input = &segment.input[(x >> shift) * segment.pixel..];
        // What the loop below reads, checked once for all of it.
        assert!(segment.run == 0 || ((PX - 1) >> shift) * segment.pixel + segment.run <= input.len());
        assert!(segment.run == 0 || (segment.run - 1) * step + NV * LANES <= taps.len());
        let (mut input, mut weight) = (input.as_ptr(), taps.as_ptr());
        let mut ahead = input.wrapping_add((PX >> shift) * segment.pixel);
        for _ in 0..segment.run {
            // SAFETY: the first assertion covers each pixel's run of inputs, the second each tap's weights; the pointers step through
            // them and are not read after the last.
            unsafe {
                let mut w = [s.load(&*weight.cast::<[f32; LANES]>(), 0); NV];
                for v in 1..NV {
                    w[v] = s.load(&*weight.add(v * LANES).cast::<[f32; LANES]>(), 0);
                }
                for p in 0..PX {
                    let value = s.splat(*input.add((p >> shift) * segment.pixel));
                    for v in 0..NV {
                        sums[p][v] = s.fma(value, w[v], sums[p][v]);
                    }
                }
            }
            if IN_PLACE {
                // The next PX pixels come from afar; their strided reads fool the hardware's prefetcher.
                s.prefetch(ahead);
                ahead = ahead.wrapping_add(PX >> shift);
            }
            input = input.wrapping_add(1);
            weight = weight.wrapping_add(step);
        }
        taps = &taps[(segment.run * step).min(taps.len())..];
    }
    sums
}

/// Adds the residual, applies ReLU and stores a whole register tile. Short loops, which unroll, keep the sums in registers.
#[inline(always)]
fn finish<S: Simd, const PX: usize, const NV: usize>(
    s: S,
    mut sums: [[S::V; NV]; PX],
    strip: &mut Strip,
    at: usize,
    outputs: usize,
) {
    let add = match strip.add {
        Add::Nothing => None,
        Add::Output => Some(&*strip.output),
        Add::Image(image) => Some(image),
    };
    if let Some(add) = add {
        for p in 0..PX {
            let pixel = &add[at + p * outputs..][..NV * LANES];
            for v in 0..NV {
                sums[p][v] = s.add(sums[p][v], s.load(pixel, v * LANES));
            }
        }
    }
    if strip.relu {
        for p in 0..PX {
            for v in 0..NV {
                sums[p][v] = s.relu(sums[p][v]);
            }
        }
    }
    for p in 0..PX {
        let pixel = &mut strip.output[at + p * outputs..][..NV * LANES];
        for v in 0..NV {
            s.store(sums[p][v], pixel, v * LANES);
        }
    }
}

/// As `finish`, for the first `pixels` pixels and their first `channels` channels.
#[inline(always)]
fn finish_part<S: Simd, const PX: usize, const NV: usize>(
    s: S,
    sums: [[S::V; NV]; PX],
    strip: &mut Strip,
    at: usize,
    outputs: usize,
    (pixels, channels): (usize, usize),
) {
    const { assert!(PX * NV <= SPARE_PIXELS) };
    // Through memory, as indexing registers is not possible.
    let mut spilled = [0.0; SPARE_PIXELS * LANES];
    for p in 0..PX {
        for v in 0..NV {
            s.store(sums[p][v], &mut spilled, (p * NV + v) * LANES);
        }
    }
    for p in 0..pixels {
        let sums = &mut spilled[p * NV * LANES..][..channels];
        let place = at + p * outputs..at + p * outputs + channels;
        let add = match strip.add {
            Add::Nothing => None,
            Add::Output => Some(&strip.output[place.clone()]),
            Add::Image(image) => Some(&image[place.clone()]),
        };
        if let Some(add) = add {
            for (sum, add) in sums.iter_mut().zip(add) {
                *sum += *add;
            }
        }
        if strip.relu {
            for sum in sums.iter_mut() {
                *sum = if *sum > 0.0 { *sum } else { 0.0 };
            }
        }
        strip.output[place].copy_from_slice(sums);
    }
}
