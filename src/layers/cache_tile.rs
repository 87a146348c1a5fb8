//! Cuts a convolution into tiles that stay in L2, and lays each one's input out for the inner loops.

use super::activation::SPARE_PIXELS;
use super::pack::{Source, Window, pack};
use super::register_tile::{Add, Block, SEGMENTS, Segment, Strip, Weights, sweep};
use crate::memory::Buffer;
use crate::simd::{Simd, dispatch};

/// Output columns in a tile at most, a multiple of every register tile.
const TILE_COLUMNS: usize = 120;
/// What a tile's input may take, so that it stays in L2 beside the weights.
const TILE_BYTES: usize = 400 << 10;
/// Output rows in a tile at most.
const TILE_ROWS: usize = 8;

/// What one run of a convolution needs to know.
pub(super) struct Layer<'a> {
    pub weights: Weights<'a>,
    pub blocks: &'a [Block],
    pub kernel: usize,
    pub stride: usize,
    pub inputs: usize,
    pub sources: &'a [Source<'a>],
    pub relu_input: bool,
    pub relu_output: bool,
    /// An image of all rows of the output's width.
    pub add: Add<'a>,
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
        self.columns.div_ceil(tiles).next_multiple_of(SPARE_PIXELS)
    }

    /// Whether the inner loops can read the sources where they lie.
    fn in_place(&self) -> bool {
        self.kernel == 1 && self.stride == 1 && !self.relu_input && self.sources.len() <= SEGMENTS
    }
}

dispatch! {
    /// Computes output rows from `row` on into `output`, whole rows of columns × outputs values. `scratch` is for reuse.
    pub(super) fn rows(layer: &Layer<'_>, row: usize, output: &mut [f32], scratch: &mut Buffer) = tiles
}

#[inline(always)]
fn tiles<S: Simd>(s: S, layer: &Layer, row: usize, output: &mut [f32], scratch: &mut Buffer) {
    let outputs = layer.weights.outputs;
    let width = layer.columns * outputs;
    let rows = output.len().checked_div(width).unwrap_or(0);
    let tile_columns = layer.tile_columns();
    let in_place = layer.in_place();
    for column in (0..layer.columns).step_by(tile_columns) {
        let pixels = tile_columns.min(layer.columns - column);
        let tile = Tile { row, column, rows, pixels };
        if !in_place {
            pack(s, layer.sources, layer.relu_input, tile.window(layer), scratch, SPARE_PIXELS * layer.stride);
        }
        for block in layer.blocks {
            for r in 0..rows {
                let offset = column * outputs;
                let segments =
                    if in_place { tile.source_segments(layer, r) } else { tile.packed_segments(layer, r, scratch.as_slice()) };
                let add = match layer.add {
                    Add::Image(image) => Add::Image(&image[(row + r) * width + offset..][..pixels * outputs]),
                    other => other,
                };
                let output = &mut output[r * width + offset..][..pixels * outputs];
                let mut strip = Strip { segments, in_place, output, add, relu: layer.relu_output };
                sweep(s, layer.weights, block, &mut strip);
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
    fn packed_segments<'a>(&self, layer: &Layer, r: usize, packed: &'a [f32]) -> [Segment<'a>; SEGMENTS] {
        let width = self.window(layer).columns * layer.inputs;
        let mut segments = [Segment::EMPTY; SEGMENTS];
        for (ky, segment) in segments.iter_mut().take(layer.kernel).enumerate() {
            let input = &packed[(r * layer.stride + ky) * width..];
            *segment = Segment { input, pixel: layer.stride * layer.inputs, halved: false, run: layer.kernel * layer.inputs };
        }
        segments
    }

    /// Row `r` of the tile in the sources themselves, a segment for each.
    #[inline(always)]
    fn source_segments<'a>(&self, layer: &Layer<'a>, r: usize) -> [Segment<'a>; SEGMENTS] {
        let mut segments = [Segment::EMPTY; SEGMENTS];
        for (source, segment) in layer.sources.iter().zip(&mut segments) {
            let shift = usize::from(source.upsample);
            let input = source.activation.pixels_from((self.row + r) >> shift, self.column >> shift);
            let channels = source.activation.channels();
            *segment = Segment { input, pixel: channels, halved: source.upsample, run: channels };
        }
        segments
    }
}
