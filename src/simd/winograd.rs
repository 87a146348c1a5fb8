//! 3×3 convolution by Winograd's minimal filtering F(2×2, 3×3) (Lavin and Gray 2016): 16 products for four pixels instead of 36.
//!
//! Tiles of 4×4 inputs are transformed, multiplied point by point with transformed weights (16 matrix products over the channels, by
//! the same inner loops as [`super::Conv`]) and transformed back to 2×2 outputs. The transforms only add and halve.

#![allow(clippy::needless_range_loop, reason = "a tile is an index space; i and j are its coordinates")]

use std::cell::RefCell;

use ndarray::{ArrayView1, ArrayView4};
use rayon::prelude::*;

use super::activation::Activation;
use super::buffer::Buffer;
use super::conv::{Epilogue, blocks};
use super::isa::Isa;
use super::kernel::{GROUP, Kernel, PIXELS_MAX, Segment, Strip};
use super::pack::{Source, Window, pack};
use super::tile::{Block, Layer};
use super::vector::{Portable, Vector};

/// Rows and columns of a tile of outputs.
const SIDE: usize = 2;
/// Points of a transformed tile.
const POINTS: usize = 16;
/// Tiles that are multiplied at a time, so that they stay in L2 beside the weights.
const TILES: usize = 48;
/// Floats between the points' tiles beyond those that they need: sixteen streams a power of two apart would share few lines of L1.
const SPREAD: usize = 5 * GROUP;
/// Output rows that a thread takes at a time.
const STRIP_ROWS: usize = 8;

thread_local! {
    static SCRATCH: RefCell<Scratch> = const { RefCell::new(Scratch { packed: Buffer::empty(), tiles: Buffer::empty(), products: Buffer::empty() }) };
}

/// Floats from point to point.
const fn point_of(channels: usize) -> usize {
    TILES * channels + SPREAD
}

/// Buffers of one thread.
struct Scratch {
    /// The input with its border.
    packed: Buffer,
    /// [point][tile][input channel].
    tiles: Buffer,
    /// [point][tile][output channel].
    products: Buffer,
}

/// A 3×3 convolution of stride 1 with padding 1, as PyTorch's `Conv2d(ci, co, 3, padding=1)`.
///
/// Results are bit-equal for any thread count, between AVX2 and AVX-512, and for images cut out at even rows and columns, out of
/// the border's reach. They are within 4e-6 of the sum of the products' magnitudes.
pub struct Winograd {
    /// [point][block][input channel][16 · groups].
    weights: Buffer,
    bias: Buffer,
    zero: Buffer,
    blocks: Vec<Block>,
    inputs: usize,
    outputs: usize,
}

impl Winograd {
    /// Transforms `weight` (co, ci, 3, 3); `bias` (co).
    ///
    /// # Panics
    /// Where a shape is none of these, or a number of channels no multiple of 16.
    pub fn new(weight: ArrayView4<f32>, bias: ArrayView1<f32>) -> Self {
        let (outputs, inputs, rows, columns) = weight.dim();
        assert!((rows, columns) == (3, 3) && bias.len() == outputs, "weight {:?}, bias {}", weight.dim(), bias.len());
        assert!(
            inputs > 0 && outputs > 0 && inputs.is_multiple_of(GROUP) && outputs.is_multiple_of(GROUP),
            "whole vectors of channels"
        );
        let blocks = blocks(outputs / GROUP, inputs);
        let mut weights = Buffer::zeroed(POINTS * inputs * outputs);
        for (point, weights) in weights.as_mut_slice().chunks_exact_mut(inputs * outputs).enumerate() {
            for block in &blocks {
                let width = block.groups * GROUP;
                for (ci, line) in weights[block.weights..][..inputs * width].chunks_exact_mut(width).enumerate() {
                    for (c, to) in line.iter_mut().enumerate() {
                        *to = transformed(|y, x| weight[[block.channel + c, ci, y, x]], point);
                    }
                }
            }
        }
        let mut packed_bias = Buffer::zeroed(outputs);
        packed_bias.as_mut_slice().iter_mut().zip(bias).for_each(|(to, from)| *to = *from);
        Self { weights, bias: packed_bias, zero: Buffer::zeroed(outputs), blocks, inputs, outputs }
    }

    pub fn output_channels(&self) -> usize {
        self.outputs
    }

    /// Convolves `input` into `output`, which takes the output's shape. Uses the threads of the current rayon pool.
    ///
    /// # Panics
    /// Where `input` has other channels than the weights, or `add` another shape than the output.
    pub fn run(&self, isa: Isa, input: &Activation, output: &mut Activation, epilogue: Epilogue) {
        output.reset(input.rows(), input.columns(), self.outputs);
        self.compute(isa, input, output, epilogue, false);
    }

    /// As [`Winograd::run`], added to what `output` holds.
    ///
    /// # Panics
    /// As [`Winograd::run`], and where `output` has another shape than the convolution's.
    pub fn run_onto(&self, isa: Isa, input: &Activation, output: &mut Activation, epilogue: Epilogue) {
        assert_eq!(output.shape(), (input.rows(), input.columns(), self.outputs), "the output to add to");
        assert!(epilogue.add.is_none(), "run_onto adds the output itself");
        self.compute(isa, input, output, epilogue, true);
    }

    fn compute(&self, isa: Isa, input: &Activation, output: &mut Activation, epilogue: Epilogue, onto: bool) {
        assert_eq!(input.channels(), self.inputs, "input channels");
        let (rows, columns, _) = output.shape();
        if let Some(add) = epilogue.add {
            assert_eq!(add.shape(), output.shape(), "the image to add");
        }
        if output.as_slice().is_empty() {
            return;
        }
        let strip = rows.div_ceil(rayon::current_num_threads()).next_multiple_of(SIDE).min(STRIP_ROWS);
        let job = Job { layer: self, input, columns, epilogue, onto };
        output.as_mut_slice().par_chunks_mut(strip * columns * self.outputs).enumerate().for_each(|(i, output)| {
            SCRATCH.with_borrow_mut(|scratch| rows_of(isa, &job, i * strip, output, scratch));
        });
    }
}

/// A point of G g Gᵀ for one pair of channels, G the transform of F(2, 3).
fn transformed(weight: impl Fn(usize, usize) -> f32, point: usize) -> f32 {
    const G: [[f64; 3]; 4] = [[1.0, 0.0, 0.0], [0.5, 0.5, 0.5], [0.5, -0.5, 0.5], [0.0, 0.0, 1.0]];
    let (i, j) = (point / 4, point % 4);
    let mut sum = 0.0;
    for y in 0..3 {
        for x in 0..3 {
            sum += G[i][y] * f64::from(weight(y, x)) * G[j][x];
        }
    }
    sum as f32
}

/// One run of a convolution.
struct Job<'a> {
    layer: &'a Winograd,
    input: &'a Activation,
    columns: usize,
    epilogue: Epilogue<'a>,
    onto: bool,
}

/// Computes output rows from `row`, an even one, on into `output`, whole rows.
fn rows_of(isa: Isa, job: &Job, row: usize, output: &mut [f32], scratch: &mut Scratch) {
    match isa.supported() {
        Isa::Portable => strip::<Portable>(job, row, output, scratch),
        // SAFETY: `supported` has found the instructions on this CPU.
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => unsafe { x86::strip_avx2(job, row, output, scratch) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => unsafe { x86::strip_avx512(job, row, output, scratch) },
        #[cfg(not(target_arch = "x86_64"))]
        _ => strip::<Portable>(job, row, output, scratch),
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::super::vector::{Avx2, Avx512};
    use super::{Job, Scratch, strip};

    #[target_feature(enable = "avx2,fma")]
    pub fn strip_avx2(job: &Job, row: usize, output: &mut [f32], scratch: &mut Scratch) {
        strip::<Avx2>(job, row, output, scratch);
    }

    #[target_feature(enable = "avx512f")]
    pub fn strip_avx512(job: &Job, row: usize, output: &mut [f32], scratch: &mut Scratch) {
        strip::<Avx512>(job, row, output, scratch);
    }
}

#[inline(always)]
fn strip<V: Kernel>(job: &Job, row: usize, output: &mut [f32], scratch: &mut Scratch) {
    let (inputs, outputs) = (job.layer.inputs, job.layer.outputs);
    let rows = output.len() / (job.columns * outputs);
    scratch.tiles.reset(POINTS * point_of(inputs) + PIXELS_MAX * inputs);
    scratch.products.reset(POINTS * point_of(outputs));
    for column in (0..job.columns).step_by(SIDE * TILES) {
        let tiles = (job.columns - column).div_ceil(SIDE).min(TILES);
        let window = Window {
            row: row as isize - 1,
            column: column as isize - 1,
            rows: rows.next_multiple_of(SIDE) + 2,
            columns: SIDE * tiles + 2,
        };
        pack::<V>(&[Source::new(job.input)], job.epilogue.relu_input, window, &mut scratch.packed, 0);
        for r in (0..rows).step_by(SIDE) {
            let line = window.columns * inputs;
            scatter::<V>(&scratch.packed.as_slice()[r * line..][..4 * line], line, inputs, tiles, scratch.tiles.as_mut_slice());
            multiply::<V>(job.layer, tiles, scratch.tiles.as_slice(), scratch.products.as_mut_slice());
            gather::<V>(job, scratch.products.as_slice(), (row, r, column), tiles, output);
        }
    }
}

/// Bᵀ d B of each tile of four rows of `line` values: [point][tile][channel], TILES tiles from point to point.
#[inline(always)]
fn scatter<V: Vector>(rows: &[f32], line: usize, channels: usize, tiles: usize, out: &mut [f32]) {
    assert!(rows.len() >= 4 * line && line >= (SIDE * tiles + 2) * channels && out.len() >= POINTS * point_of(channels));
    for tile in 0..tiles {
        for c in (0..channels).step_by(V::LANES) {
            // SAFETY: the lengths are asserted, channels are whole vectors; V's instructions are there as the caller chose V.
            unsafe {
                let from = rows.as_ptr().add(SIDE * tile * channels + c);
                let to = out.as_mut_ptr().add(tile * channels + c);
                let mut half = [[V::load(from); 4]; 4];
                for x in 0..4 {
                    let [a, b, c, d] = [
                        V::load(from.add(x * channels)),
                        V::load(from.add(line + x * channels)),
                        V::load(from.add(2 * line + x * channels)),
                        V::load(from.add(3 * line + x * channels)),
                    ];
                    [half[0][x], half[1][x], half[2][x], half[3][x]] = [a.sub(c), b.add(c), c.sub(b), b.sub(d)];
                }
                for i in 0..4 {
                    let [a, b, c, d] = half[i];
                    let point = [a.sub(c), b.add(c), c.sub(b), b.sub(d)];
                    for j in 0..4 {
                        point[j].store(to.add((4 * i + j) * point_of(channels)));
                    }
                }
            }
        }
    }
}

/// At each point, the tiles' channels times the weights.
#[inline(always)]
fn multiply<V: Kernel>(layer: &Winograd, tiles: usize, from: &[f32], to: &mut [f32]) {
    let (inputs, outputs) = (layer.inputs, layer.outputs);
    for point in 0..POINTS {
        let product = Layer {
            weights: &layer.weights.as_slice()[point * inputs * outputs..][..inputs * outputs],
            bias: layer.zero.as_slice(),
            blocks: &layer.blocks,
            kernel: 1,
            stride: 1,
            inputs,
            outputs,
            sources: &[],
            relu_input: false,
            relu_output: false,
            add: None,
            add_output: false,
            columns: tiles,
        };
        let input = from[point * point_of(inputs)..][..(TILES + PIXELS_MAX) * inputs].as_ptr();
        let mut segments = [Segment::EMPTY; Strip::SEGMENTS];
        segments[0] = Segment { input, pixel: inputs, halved: false, run: inputs };
        let output = to[point * point_of(outputs)..][..TILES * outputs].as_mut_ptr();
        let strip = Strip { segments, in_place: false, output, add: std::ptr::null(), pixels: tiles };
        for block in &layer.blocks {
            // SAFETY: the segment holds TILES tiles and PIXELS_MAX more, the output TILES; V's instructions are there as the caller
            // chose V.
            unsafe { V::sweep(&product, block, strip) }
        }
    }
}

/// Aᵀ m A of each tile, with bias, residual and ReLU, to two rows of the output: rows `r` and r + 1 of `output`, which starts at `row`.
#[inline(always)]
fn gather<V: Vector>(job: &Job, products: &[f32], (row, r, column): (usize, usize, usize), tiles: usize, output: &mut [f32]) {
    let channels = job.layer.outputs;
    let width = job.columns * channels;
    let rows = output.len() / width - r;
    assert!(products.len() >= POINTS * point_of(channels) && job.layer.bias.as_slice().len() >= channels && tiles <= TILES);
    for tile in 0..tiles {
        let left = column + SIDE * tile;
        let at = Corner { output: r * width + left * channels, add: (row + r) * width + left * channels, width };
        // SAFETY: the lengths are asserted; the tile's pixels lie in the image, those outside are named as such.
        unsafe {
            if rows >= SIDE && job.columns - left >= SIDE {
                gather_tile::<V, SIDE, SIDE>(job, products, tile, at, output);
            } else if rows >= SIDE {
                gather_tile::<V, SIDE, 1>(job, products, tile, at, output);
            } else if job.columns - left >= SIDE {
                gather_tile::<V, 1, SIDE>(job, products, tile, at, output);
            } else {
                gather_tile::<V, 1, 1>(job, products, tile, at, output);
            }
        }
    }
}

/// Where a tile's first pixel lies in the strip's output and in the image to add, both `width` floats a row.
#[derive(Clone, Copy)]
struct Corner {
    output: usize,
    add: usize,
    width: usize,
}

/// The first ROWS × COLUMNS pixels of a tile.
///
/// # Safety
/// V's instructions are there, the products and the bias are whole.
#[inline(always)]
unsafe fn gather_tile<V: Vector, const ROWS: usize, const COLUMNS: usize>(
    job: &Job,
    products: &[f32],
    tile: usize,
    at: Corner,
    output: &mut [f32],
) {
    let channels = job.layer.outputs;
    for c in (0..channels).step_by(V::LANES) {
        // SAFETY: the caller's promise, and channels are whole vectors; output and residual are sliced.
        unsafe {
            let from = products.as_ptr().add(tile * channels + c);
            let bias = V::load(job.layer.bias.as_slice().as_ptr().add(c));
            let mut half = [[bias; 4]; SIDE];
            for j in 0..4 {
                let [a, b, m, d] = [
                    V::load(from.add(j * point_of(channels))),
                    V::load(from.add((4 + j) * point_of(channels))),
                    V::load(from.add((8 + j) * point_of(channels))),
                    V::load(from.add((12 + j) * point_of(channels))),
                ];
                [half[0][j], half[1][j]] = [a.add(b).add(m), b.sub(m).sub(d)];
            }
            for y in 0..ROWS {
                let [a, b, m, d] = half[y];
                let pair = [a.add(b).add(m).add(bias), b.sub(m).sub(d).add(bias)];
                for x in 0..COLUMNS {
                    let pixel = y * at.width + x * channels + c;
                    let to = output[at.output + pixel..][..V::LANES].as_mut_ptr();
                    let mut sum = pair[x];
                    if let Some(add) = job.epilogue.add {
                        sum = sum.add(V::load(add.as_slice()[at.add + pixel..][..V::LANES].as_ptr()));
                    } else if job.onto {
                        sum = sum.add(V::load(to));
                    }
                    if job.epilogue.relu_output {
                        sum = sum.relu();
                    }
                    sum.store(to);
                }
            }
        }
    }
}
