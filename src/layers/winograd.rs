//! 3×3 convolution by Winograd's minimal filtering F(2×2, 3×3) (Lavin and Gray 2016): 16 products for four pixels instead of 36.
//!
//! Tiles of 4×4 inputs are transformed, multiplied point by point with transformed weights (16 matrix products over the channels, by
//! the same inner loops as [`super::Conv`]) and transformed back to 2×2 outputs. The transforms only add and halve.

use std::cell::RefCell;

use ndarray::{ArrayView1, ArrayView4};
use rayon::prelude::*;

use super::activation::{Activation, SPARE_PIXELS};
use super::epilogue::Epilogue;
use super::pack::{Source, Window, pack};
use super::register_tile::{Add, Block, SEGMENTS, Segment, Strip, Weights, sweep};
use super::winograd_transform::{POINTS, SIDE, TILES, Target, from_points, point_of, to_points, weight_at};
use crate::memory::Buffer;
use crate::simd::{Isa, LANES, Simd, dispatch};

/// Output rows that a thread takes at a time.
const STRIP_ROWS: usize = 8;

thread_local! {
    static SCRATCH: RefCell<Scratch> =
        RefCell::new(Scratch { packed: Buffer::empty(), tiles: Buffer::empty(), products: Buffer::empty() });
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
/// Results are bit-equal for any thread count, between AVX2, AVX-512 and NEON, and for images cut out at even rows and columns, out
/// of the border's reach. They are within 4e-6 of the sum of the products' magnitudes.
pub struct Winograd {
    /// [point][block][input channel][16 · vectors].
    weights: Buffer,
    bias: Buffer,
    zero: Buffer,
    blocks: Vec<Block>,
    inputs: usize,
    outputs: usize,
}

impl std::fmt::Debug for Winograd {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Winograd {}→{}", self.inputs, self.outputs)
    }
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
            inputs > 0 && outputs > 0 && inputs.is_multiple_of(LANES) && outputs.is_multiple_of(LANES),
            "whole vectors of channels"
        );
        let blocks = Block::all(outputs / LANES, inputs);
        let mut weights = Buffer::zeroed(POINTS * inputs * outputs);
        for (point, weights) in weights.as_mut_slice().chunks_exact_mut(inputs * outputs).enumerate() {
            for block in &blocks {
                let width = block.vectors * LANES;
                for (ci, line) in weights[block.offset..][..inputs * width].chunks_exact_mut(width).enumerate() {
                    for (c, to) in line.iter_mut().enumerate() {
                        *to = weight_at(|y, x| weight[[block.channel + c, ci, y, x]], point);
                    }
                }
            }
        }
        let mut packed_bias = Buffer::zeroed(outputs);
        packed_bias.as_mut_slice().iter_mut().zip(bias).for_each(|(to, from)| *to = *from);
        Self { weights, bias: packed_bias, zero: Buffer::zeroed(outputs), blocks, inputs, outputs }
    }

    /// Channels of the output.
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
        let mut add = if onto { Add::Output } else { Add::Nothing };
        if let Some(image) = epilogue.add {
            assert_eq!(image.shape(), output.shape(), "the image to add");
            add = Add::Image(image.as_slice());
        }
        if output.as_slice().is_empty() {
            return;
        }
        let strip = rows.div_ceil(rayon::current_num_threads()).next_multiple_of(SIDE).min(STRIP_ROWS);
        let job = Job { layer: self, input, columns, relu_input: epilogue.relu_input, relu_output: epilogue.relu_output, add };
        output.as_mut_slice().par_chunks_mut(strip * columns * self.outputs).enumerate().for_each(|(i, output)| {
            SCRATCH.with_borrow_mut(|scratch| rows_of(isa, &job, i * strip, output, scratch));
        });
    }
}

/// One run of a convolution.
struct Job<'a> {
    layer: &'a Winograd,
    input: &'a Activation,
    columns: usize,
    relu_input: bool,
    relu_output: bool,
    /// An image of the output's size.
    add: Add<'a>,
}

dispatch! {
    /// Computes output rows from `row`, an even one, on into `output`, whole rows.
    fn rows_of(job: &Job<'_>, row: usize, output: &mut [f32], scratch: &mut Scratch) = strip
}

#[inline(always)]
fn strip<S: Simd>(s: S, job: &Job, row: usize, output: &mut [f32], scratch: &mut Scratch) {
    let (inputs, outputs) = (job.layer.inputs, job.layer.outputs);
    let width = job.columns * outputs;
    let rows = output.len() / width;
    scratch.tiles.reset(POINTS * point_of(inputs) + SPARE_PIXELS * inputs);
    scratch.products.reset(POINTS * point_of(outputs));
    for column in (0..job.columns).step_by(SIDE * TILES) {
        let tiles = (job.columns - column).div_ceil(SIDE).min(TILES);
        let window = Window {
            row: row as isize - 1,
            column: column as isize - 1,
            rows: rows.next_multiple_of(SIDE) + 2,
            columns: SIDE * tiles + 2,
        };
        pack(s, &[Source::new(job.input)], job.relu_input, window, &mut scratch.packed, 0);
        for (pair, output) in output.chunks_mut(SIDE * width).enumerate() {
            let (r, line) = (SIDE * pair, window.columns * inputs);
            let from = &scratch.packed.as_slice()[r * line..][..4 * line];
            to_points(s, from, line, inputs, tiles, scratch.tiles.as_mut_slice());
            multiply(s, job.layer, tiles, scratch.tiles.as_slice(), scratch.products.as_mut_slice());
            let add = match job.add {
                Add::Image(image) => Add::Image(&image[(row + r) * width..][..output.len()]),
                other => other,
            };
            let mut target = Target { rows: output, columns: job.columns, column, add, relu: job.relu_output };
            from_points(s, scratch.products.as_slice(), job.layer.bias.as_slice(), tiles, &mut target);
        }
    }
}

/// At each point, the tiles' channels times the weights.
#[inline(always)]
fn multiply<S: Simd>(s: S, layer: &Winograd, tiles: usize, from: &[f32], to: &mut [f32]) {
    let (inputs, outputs) = (layer.inputs, layer.outputs);
    for point in 0..POINTS {
        let taps = &layer.weights.as_slice()[point * inputs * outputs..][..inputs * outputs];
        let weights = Weights { taps, bias: layer.zero.as_slice(), outputs };
        let input = &from[point * point_of(inputs)..][..(TILES + SPARE_PIXELS) * inputs];
        let mut segments = [Segment::EMPTY; SEGMENTS];
        segments[0] = Segment { input, pixel: inputs, halved: false, run: inputs };
        let output = &mut to[point * point_of(outputs)..][..tiles * outputs];
        let mut strip = Strip { segments, in_place: false, output, add: Add::Nothing, relu: false };
        for block in &layer.blocks {
            sweep(s, weights, block, &mut strip);
        }
    }
}
