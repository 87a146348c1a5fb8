//! The inner loops: a register tile of PX pixels × NV vectors of output channels, swept over a tile of the image.
//!
//! Each output value is one chain: bias, then ky, kx and ci in that order, one FMA each, whatever tile it falls into.

use super::isa::Isa;
use super::pack::{Source, Window, pack};
use super::vector::{Portable, Vector};

/// Output channels in one vector group; weights are packed in blocks of a few groups.
pub(super) const GROUP: usize = 16;
/// The widest register tile in pixels: how far past a tile the kernel may read.
const PIXELS_MAX: usize = 24;
/// Output columns in a tile at most, a multiple of every register tile.
const TILE_COLUMNS: usize = 120;
/// What a packed input tile may take, so that it stays in L2 beside the weights.
const TILE_BYTES: usize = 400 << 10;
/// Output rows in a tile at most.
const TILE_ROWS: usize = 8;

/// One block of output channels: `groups` × 16 of them from `channel` on.
pub(super) struct Block {
    pub channel: usize,
    pub groups: usize,
    /// Offset of its weights, [ky][kx][ci][16 · groups], in `Layer::weights`.
    pub weights: usize,
}

/// What one run of a convolution needs to know.
pub(super) struct Layer<'a> {
    pub weights: &'a [f32],
    /// Padded to whole groups.
    pub bias: &'a [f32],
    pub blocks: &'a [Block],
    pub kernel: usize,
    pub stride: usize,
    pub inputs: usize,
    pub outputs: usize,
    pub sources: &'a [Source<'a>],
    pub relu_input: bool,
    pub relu_output: bool,
    /// All rows of the output's width.
    pub add: Option<&'a [f32]>,
    /// Add what the output already holds.
    pub add_output: bool,
    /// Columns of the output.
    pub columns: usize,
}

impl Layer<'_> {
    /// Output rows that a thread takes at a time.
    pub fn tile_rows(&self, rows: usize, threads: usize) -> usize {
        let line = (TILE_COLUMNS.min(self.columns) * self.stride + self.kernel) * self.inputs * size_of::<f32>();
        let fitting = (TILE_BYTES / line.max(1)).saturating_sub(self.kernel - 1) / self.stride;
        fitting.clamp(1, TILE_ROWS).min(rows.div_ceil(threads)).max(1)
    }

    /// Columns of a tile: even shares of the width, in whole register tiles.
    fn tile_columns(&self) -> usize {
        let tiles = self.columns.div_ceil(TILE_COLUMNS).max(1);
        self.columns.div_ceil(tiles).next_multiple_of(PIXELS_MAX)
    }
}

/// Computes output rows from `row` on into `output`, whole rows of columns × outputs values. `scratch` is for reuse.
pub(super) fn rows(isa: Isa, layer: &Layer, row: usize, output: &mut [f32], scratch: &mut super::buffer::Buffer) {
    match isa.supported() {
        Isa::Portable => tiles::<Portable>(layer, row, output, scratch),
        // SAFETY: `supported` has found the instructions on this CPU.
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => unsafe { x86::rows_avx2(layer, row, output, scratch) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => unsafe { x86::rows_avx512(layer, row, output, scratch) },
        #[cfg(not(target_arch = "x86_64"))]
        _ => tiles::<Portable>(layer, row, output, scratch),
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::super::buffer::Buffer;
    use super::super::vector::{Avx2, Avx512};
    use super::{Layer, tiles};

    #[target_feature(enable = "avx2,fma")]
    pub fn rows_avx2(layer: &Layer, row: usize, output: &mut [f32], scratch: &mut Buffer) {
        tiles::<Avx2>(layer, row, output, scratch);
    }

    #[target_feature(enable = "avx512f")]
    pub fn rows_avx512(layer: &Layer, row: usize, output: &mut [f32], scratch: &mut Buffer) {
        tiles::<Avx512>(layer, row, output, scratch);
    }
}

/// One strip of output pixels: where the kernel reads and writes.
#[derive(Clone, Copy)]
struct Strip {
    /// Packed input of the strip's first pixel at ky = kx = 0.
    input: *const f32,
    /// Floats between packed rows.
    input_row: usize,
    /// Floats between the inputs of neighbouring output pixels.
    input_pixel: usize,
    output: *mut f32,
    add: *const f32,
    pixels: usize,
}

#[inline(always)]
fn tiles<V: Tiled>(layer: &Layer, row: usize, output: &mut [f32], scratch: &mut super::buffer::Buffer) {
    let width = layer.columns * layer.outputs;
    let rows = output.len().checked_div(width).unwrap_or(0);
    let (kernel, stride, tile_columns) = (layer.kernel, layer.stride, layer.tile_columns());
    for column in (0..layer.columns).step_by(tile_columns) {
        let pixels = tile_columns.min(layer.columns - column);
        let window = Window {
            row: (row * stride) as isize - (kernel / 2) as isize,
            column: (column * stride) as isize - (kernel / 2) as isize,
            rows: (rows - 1) * stride + kernel,
            columns: (pixels - 1) * stride + kernel,
        };
        let input_row = window.columns * layer.inputs;
        scratch.reset(window.rows * input_row + PIXELS_MAX * stride * layer.inputs);
        pack::<V>(layer.sources, layer.relu_input, window, scratch.as_mut_slice());
        for block in layer.blocks {
            for r in 0..rows {
                let offset = r * width + column * layer.outputs;
                let to = output[offset..][..pixels * layer.outputs].as_mut_ptr();
                let add = match layer.add {
                    Some(add) => add[(row + r) * width + column * layer.outputs..][..pixels * layer.outputs].as_ptr(),
                    None if layer.add_output => to.cast_const(),
                    None => std::ptr::null(),
                };
                let input = scratch.as_slice()[r * stride * input_row..].as_ptr();
                let strip = Strip { input, input_row, input_pixel: stride * layer.inputs, output: to, add, pixels };
                // SAFETY: the strip lies in the packed tile, which is PIXELS_MAX pixels longer than it needs to be, and in
                // `pixels` pixels of output (and add); V's instructions are there because the caller chose V.
                unsafe { V::sweep(layer, block, strip) }
            }
        }
    }
}

/// The register tiles that an instruction set has room for.
trait Tiled: Vector {
    /// # Safety
    /// The CPU has V's instructions; `strip` points to `pixels` pixels, and to PIXELS_MAX more of readable input.
    unsafe fn sweep(layer: &Layer, block: &Block, strip: Strip);
}

impl Tiled for Portable {
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
impl Tiled for super::vector::Avx2 {
    #[inline(always)]
    unsafe fn sweep(layer: &Layer, block: &Block, strip: Strip) {
        for group in 0..block.groups {
            // SAFETY: the caller's promise. 6 × 2 accumulators, 2 weights and a broadcast fill the 16 registers.
            unsafe { sweep::<Self, 6, 2>(layer, block, group * GROUP, strip) }
        }
    }
}

#[cfg(target_arch = "x86_64")]
impl Tiled for super::vector::Avx512 {
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
    let channel = block.channel + first;
    let valid = (layer.outputs - channel).min(NV * V::LANES);
    let weights = layer.weights[block.weights + first..].as_ptr();
    let bias = layer.bias[channel..][..NV * V::LANES].as_ptr();
    for x in (0..strip.pixels).step_by(PX) {
        let pixels = (strip.pixels - x).min(PX);
        // SAFETY: x lies in the strip; weights hold kernel² · inputs taps from the block on.
        unsafe {
            let sums = sums::<V, PX, NV>(layer, strip, x, bias, weights, block.groups * GROUP);
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
unsafe fn sums<V: Vector, const PX: usize, const NV: usize>(
    layer: &Layer,
    strip: Strip,
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
        for ky in 0..layer.kernel {
            let mut input = strip.input.add(ky * strip.input_row + x * strip.input_pixel);
            // kx and ci are one run of neighbours in memory.
            for _ in 0..layer.kernel * layer.inputs {
                let mut w = [V::load(weight); NV];
                for v in 1..NV {
                    w[v] = V::load(weight.add(v * V::LANES));
                }
                for p in 0..PX {
                    let value = V::broadcast(input.add(p * strip.input_pixel));
                    for v in 0..NV {
                        sums[p][v] = sums[p][v].fma(value, w[v]);
                    }
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
