//! The inner loops: a register tile of PX pixels × NV vectors of output channels, swept along a strip of pixels.
//!
//! Each output value is one chain: bias, then ky, kx and ci in that order, one FMA each, whatever tile it falls into.

#![allow(clippy::needless_range_loop, reason = "a register tile is an index space; p and v are its coordinates")]

use super::tile::{Block, Layer};
use super::vector::{Portable, Vector};

/// Output channels in one vector group; weights are packed in blocks of a few groups.
pub(super) const GROUP: usize = 16;
/// The widest register tile in pixels, a multiple of the others: how far past a strip the kernel may read.
pub(super) const PIXELS_MAX: usize = 24;

/// One strip of output pixels: where the kernel reads and writes.
#[derive(Clone, Copy)]
pub(super) struct Strip {
    /// In the order in which they are summed.
    pub segments: [Segment; Self::SEGMENTS],
    /// The segments lie in the sources, not in a packed tile.
    pub in_place: bool,
    pub output: *mut f32,
    /// Null for nothing to add.
    pub add: *const f32,
    pub pixels: usize,
}

impl Strip {
    pub const SEGMENTS: usize = 3;
}

/// A run of inputs that lie side by side, for each pixel of a strip.
#[derive(Clone, Copy)]
pub(super) struct Segment {
    /// The run of the strip's first pixel.
    pub input: *const f32,
    /// Floats between the runs of neighbouring pixels.
    pub pixel: usize,
    /// Two neighbouring pixels share a run; the first pixel is an even one. Only in place.
    pub halved: bool,
    pub run: usize,
}

impl Segment {
    pub const EMPTY: Self = Self { input: std::ptr::null(), pixel: 0, halved: false, run: 0 };
}

/// The register tiles that an instruction set has room for.
pub(super) trait Kernel: Vector {
    /// # Safety
    /// The CPU has V's instructions; `strip` points to `pixels` pixels, and to PIXELS_MAX more of readable input.
    unsafe fn sweep(layer: &Layer, block: &Block, strip: Strip);
}

impl Kernel for Portable {
    #[inline(always)]
    unsafe fn sweep(layer: &Layer, block: &Block, strip: Strip) {
        const PIXELS: usize = if cfg!(target_arch = "aarch64") { 4 } else { 2 };
        for group in 0..block.groups {
            // SAFETY: the caller's promise.
            unsafe { sweep::<Self, PIXELS, 2>(layer, block, group * GROUP, strip) }
        }
    }
}

#[cfg(target_arch = "x86_64")]
impl Kernel for super::vector::Avx2 {
    #[inline(always)]
    unsafe fn sweep(layer: &Layer, block: &Block, strip: Strip) {
        for group in 0..block.groups {
            // SAFETY: the caller's promise. 6 × 2 accumulators, 2 weights and a broadcast fill the 16 registers.
            unsafe { sweep::<Self, 6, 2>(layer, block, group * GROUP, strip) }
        }
    }
}

#[cfg(target_arch = "x86_64")]
impl Kernel for super::vector::Avx512 {
    #[inline(always)]
    unsafe fn sweep(layer: &Layer, block: &Block, strip: Strip) {
        // SAFETY: the caller's promise. 24 accumulators of the 32 registers.
        unsafe {
            match block.groups {
                1 => sweep::<Self, 24, 1>(layer, block, 0, strip),
                2 => sweep::<Self, 12, 2>(layer, block, 0, strip),
                _ => sweep::<Self, 8, 3>(layer, block, 0, strip),
            }
        }
    }
}

/// Output channels `first`.. of `block`, NV vectors of them, for every pixel of the strip.
#[inline(always)]
unsafe fn sweep<V: Vector, const PX: usize, const NV: usize>(layer: &Layer, block: &Block, first: usize, strip: Strip) {
    // SAFETY: the caller's promise.
    unsafe {
        match strip.in_place {
            true => sweep_from::<V, PX, NV, true>(layer, block, first, strip),
            false => sweep_from::<V, PX, NV, false>(layer, block, first, strip),
        }
    }
}

#[inline(always)]
unsafe fn sweep_from<V: Vector, const PX: usize, const NV: usize, const IN_PLACE: bool>(
    layer: &Layer,
    block: &Block,
    first: usize,
    strip: Strip,
) {
    const { assert!(PX <= PIXELS_MAX && PIXELS_MAX.is_multiple_of(PX) && PX.is_multiple_of(2)) };
    let channel = block.channel + first;
    let valid = (layer.outputs - channel).min(NV * V::LANES);
    let weights = layer.weights[block.weights + first..].as_ptr();
    let bias = layer.bias[channel..][..NV * V::LANES].as_ptr();
    for x in (0..strip.pixels).step_by(PX) {
        let pixels = (strip.pixels - x).min(PX);
        // SAFETY: x lies in the strip; weights hold a tap of block.groups · 16 floats for each input of the segments.
        unsafe {
            let sums = sums::<V, PX, NV, IN_PLACE>(&strip.segments, x, bias, weights, block.groups * GROUP);
            let at = x * layer.outputs + channel;
            if pixels == PX && valid == NV * V::LANES {
                finish(layer, sums, strip, at);
            } else {
                finish_part(layer, sums, strip, at, pixels, valid);
            }
        }
    }
}

/// The convolution itself, for the strip's pixels from `x` on. `step` is the number of weights of a tap.
#[inline(always)]
unsafe fn sums<V: Vector, const PX: usize, const NV: usize, const IN_PLACE: bool>(
    segments: &[Segment; Strip::SEGMENTS],
    x: usize,
    bias: *const f32,
    weights: *const f32,
    step: usize,
) -> [[V; NV]; PX] {
    // SAFETY: the promise of `sweep`.
    unsafe {
        let mut sums = [[V::load(bias); NV]; PX];
        for sum in &mut sums {
            for v in 1..NV {
                sum[v] = V::load(bias.add(v * V::LANES));
            }
        }
        let mut weight = weights;
        for segment in segments {
            let shift = u32::from(IN_PLACE && segment.halved);
            let mut input = segment.input.wrapping_add((x >> shift) * segment.pixel);
            let mut ahead = input.wrapping_add((PX >> shift) * segment.pixel);
            for _ in 0..segment.run {
                let mut w = [V::load(weight); NV];
                for v in 1..NV {
                    w[v] = V::load(weight.add(v * V::LANES));
                }
                for p in 0..PX {
                    let value = V::broadcast(input.add((p >> shift) * segment.pixel));
                    for v in 0..NV {
                        sums[p][v] = sums[p][v].fma(value, w[v]);
                    }
                }
                if IN_PLACE {
                    // The next PX pixels come from afar; their strided reads fool the hardware's prefetcher.
                    V::prefetch(ahead);
                    ahead = ahead.wrapping_add(PX >> shift);
                }
                input = input.add(1);
                weight = weight.wrapping_add(step);
            }
        }
        sums
    }
}

/// Adds the residual, applies ReLU and stores a whole register tile. Short loops, which unroll, keep the sums in registers.
#[inline(always)]
unsafe fn finish<V: Vector, const PX: usize, const NV: usize>(layer: &Layer, mut sums: [[V; NV]; PX], strip: Strip, at: usize) {
    // SAFETY: PX pixels of NV vectors from `at` on lie in the strip's output and residual.
    unsafe {
        if !strip.add.is_null() {
            for p in 0..PX {
                for v in 0..NV {
                    sums[p][v] = sums[p][v].add(V::load(strip.add.add(at + p * layer.outputs + v * V::LANES)));
                }
            }
        }
        if layer.relu_output {
            for p in 0..PX {
                for v in 0..NV {
                    sums[p][v] = sums[p][v].relu();
                }
            }
        }
        for p in 0..PX {
            for v in 0..NV {
                sums[p][v].store(strip.output.add(at + p * layer.outputs + v * V::LANES));
            }
        }
    }
}

/// As `finish`, for the first `pixels` pixels and their first `valid` channels.
#[inline(always)]
unsafe fn finish_part<V: Vector, const PX: usize, const NV: usize>(
    layer: &Layer,
    sums: [[V; NV]; PX],
    strip: Strip,
    at: usize,
    pixels: usize,
    valid: usize,
) {
    const { assert!(PX * NV * V::LANES <= PIXELS_MAX * GROUP) };
    // Through memory, as indexing registers is not possible.
    let mut spilled = [0.0; PIXELS_MAX * GROUP];
    // SAFETY: PX · NV vectors fit into `spilled`; `pixels` pixels of `valid` channels from `at` on into output and residual.
    unsafe {
        for p in 0..PX {
            for v in 0..NV {
                sums[p][v].store(spilled.as_mut_ptr().add((p * NV + v) * V::LANES));
            }
        }
        for p in 0..pixels {
            for c in (0..valid).step_by(V::LANES) {
                let count = (valid - c).min(V::LANES);
                let mut sum = V::load(spilled.as_ptr().add(p * NV * V::LANES + c));
                if !strip.add.is_null() {
                    sum = sum.add(V::load_first(strip.add.add(at + p * layer.outputs + c), count));
                }
                if layer.relu_output {
                    sum = sum.relu();
                }
                sum.store_first(strip.output.add(at + p * layer.outputs + c), count);
            }
        }
    }
}
