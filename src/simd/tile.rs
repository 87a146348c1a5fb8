//! Cuts a convolution into tiles that stay in L2, and lays each one's input out for the kernel.

use super::buffer::Buffer;
use super::isa::Isa;
use super::kernel::{Kernel, PIXELS_MAX, Segment, Strip};
use super::pack::{Source, Window, pack};
use super::vector::Portable;

/// Output columns in a tile at most, a multiple of every register tile.
const TILE_COLUMNS: usize = 120;
/// What a tile's input may take, so that it stays in L2 beside the weights.
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
        let line = (self.tile_columns() * self.stride + self.kernel) * self.inputs * size_of::<f32>();
        let fitting = (TILE_BYTES / line.max(1)).saturating_sub(self.kernel - 1) / self.stride;
        fitting.clamp(1, TILE_ROWS).min(rows.div_ceil(threads)).max(1)
    }

    /// Columns of a tile: even shares of the width, in whole register tiles (so each tile starts at an even column).
    fn tile_columns(&self) -> usize {
        let tiles = if self.in_place() { 1 } else { self.columns.div_ceil(TILE_COLUMNS) };
        self.columns.div_ceil(tiles).next_multiple_of(PIXELS_MAX)
    }

    /// Whether the kernel can read the sources where they lie.
    fn in_place(&self) -> bool {
        self.kernel == 1 && self.stride == 1 && !self.relu_input && self.sources.len() <= Strip::SEGMENTS
    }
}

/// Computes output rows from `row` on into `output`, whole rows of columns × outputs values. `scratch` is for reuse.
pub(super) fn rows(isa: Isa, layer: &Layer, row: usize, output: &mut [f32], scratch: &mut Buffer) {
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
    use super::super::vector::{Avx2, Avx512};
    use super::{Buffer, Layer, tiles};

    #[target_feature(enable = "avx2,fma")]
    pub fn rows_avx2(layer: &Layer, row: usize, output: &mut [f32], scratch: &mut Buffer) {
        tiles::<Avx2>(layer, row, output, scratch);
    }

    #[target_feature(enable = "avx512f")]
    pub fn rows_avx512(layer: &Layer, row: usize, output: &mut [f32], scratch: &mut Buffer) {
        tiles::<Avx512>(layer, row, output, scratch);
    }
}

#[inline(always)]
fn tiles<V: Kernel>(layer: &Layer, row: usize, output: &mut [f32], scratch: &mut Buffer) {
    let width = layer.columns * layer.outputs;
    let rows = output.len().checked_div(width).unwrap_or(0);
    let tile_columns = layer.tile_columns();
    for column in (0..layer.columns).step_by(tile_columns) {
        let pixels = tile_columns.min(layer.columns - column);
        let tile = Tile { row, column, rows, pixels };
        if !layer.in_place() {
            pack::<V>(layer.sources, layer.relu_input, tile.window(layer), scratch, PIXELS_MAX * layer.stride);
        }
        for block in layer.blocks {
            for r in 0..rows {
                let offset = column * layer.outputs;
                let to = output[r * width + offset..][..pixels * layer.outputs].as_mut_ptr();
                let add = match layer.add {
                    Some(add) => add[(row + r) * width + offset..][..pixels * layer.outputs].as_ptr(),
                    None if layer.add_output => to.cast_const(),
                    None => std::ptr::null(),
                };
                let in_place = layer.in_place();
                let mut strip = Strip { segments: [Segment::EMPTY; Strip::SEGMENTS], in_place, output: to, add, pixels };
                if in_place {
                    tile.source_segments(layer, r, &mut strip.segments);
                } else {
                    tile.packed_segments(layer, r, scratch.as_slice(), &mut strip.segments);
                }
                // SAFETY: the segments hold `pixels` pixels of input and room to read PIXELS_MAX more (packed tile and
                // activations alike), output and add `pixels` pixels; V's instructions are there as the caller chose V.
                unsafe { V::sweep(layer, block, strip) }
            }
        }
    }
}

/// A rectangle of output pixels.
struct Tile {
    row: usize,
    column: usize,
    rows: usize,
    pixels: usize,
}

impl Tile {
    /// The input that the tile needs.
    fn window(&self, layer: &Layer) -> Window {
        Window {
            row: (self.row * layer.stride) as isize - (layer.kernel / 2) as isize,
            column: (self.column * layer.stride) as isize - (layer.kernel / 2) as isize,
            rows: (self.rows - 1) * layer.stride + layer.kernel,
            columns: (self.pixels - 1) * layer.stride + layer.kernel,
        }
    }

    /// Row `r` of the tile in the packed input: a segment for each ky, as kx and ci are one run of neighbours in memory.
    #[inline(always)]
    fn packed_segments(&self, layer: &Layer, r: usize, packed: &[f32], segments: &mut [Segment; Strip::SEGMENTS]) {
        let width = self.window(layer).columns * layer.inputs;
        for (ky, segment) in segments.iter_mut().take(layer.kernel).enumerate() {
            let input = packed[(r * layer.stride + ky) * width..].as_ptr();
            *segment = Segment { input, pixel: layer.stride * layer.inputs, halved: false, run: layer.kernel * layer.inputs };
        }
    }

    /// Row `r` of the tile in the sources themselves, a segment for each.
    #[inline(always)]
    fn source_segments(&self, layer: &Layer, r: usize, segments: &mut [Segment; Strip::SEGMENTS]) {
        for (source, segment) in layer.sources.iter().zip(segments) {
            let shift = usize::from(source.upsample);
            let input = source.activation.pixels_from((self.row + r) >> shift, self.column >> shift).as_ptr();
            let channels = source.activation.channels();
            *segment = Segment { input, pixel: channels, halved: source.upsample, run: channels };
        }
    }
}
