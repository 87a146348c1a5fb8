//! One convolution layer: weights packed once, run often.

use std::cell::RefCell;
use std::ops::Range;

use ndarray::{ArrayView1, ArrayView4};
use rayon::prelude::*;

use super::activation::Activation;
use super::cache_tile::{Layer, rows};
use super::epilogue::Epilogue;
use super::pack::Source;
use super::register_tile::{Add, Block, Weights};
use crate::memory::Buffer;
use crate::simd::{Isa, LANES};

thread_local! {
    static SCRATCH: RefCell<Buffer> = RefCell::new(Buffer::empty());
}

/// A convolution with padding k / 2 (zeros outside), as PyTorch's `Conv2d(ci, co, k, stride, padding=k // 2)`.
///
/// Each output value is bias, then ky, kx, ci in that order, one FMA each, so results are bit-equal for any thread count,
/// split into rows, and position of the pixel, and between AVX2, AVX-512 and NEON. `Isa::Portable` is bit-equal to them where the
/// compile target has FMA (aarch64); elsewhere it rounds products too and stays within 1e-5 of the sum of the products' magnitudes.
pub struct Conv {
    weights: Buffer,
    bias: Buffer,
    blocks: Vec<Block>,
    kernel: usize,
    stride: usize,
    inputs: usize,
    outputs: usize,
}

impl std::fmt::Debug for Conv {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Conv {}→{} {}×{}/{}", self.inputs, self.outputs, self.kernel, self.kernel, self.stride)
    }
}

impl Conv {
    /// Packs `weight` (co, ci, k, k), k = 1 or 3, and `bias` (co; none is zero). `stride` is 1 or 2.
    ///
    /// # Panics
    /// Where a shape or the stride is none of these.
    pub fn new(weight: ArrayView4<f32>, bias: Option<ArrayView1<f32>>, stride: usize) -> Self {
        let (outputs, inputs, kernel, kernel_columns) = weight.dim();
        assert!(outputs > 0 && inputs > 0 && matches!(kernel, 1 | 3) && kernel == kernel_columns, "weight {:?}", weight.dim());
        assert!(matches!(stride, 1 | 2), "stride {stride}");
        let vectors = outputs.div_ceil(LANES);
        let mut packed_bias = Buffer::zeroed(vectors * LANES);
        if let Some(bias) = bias {
            assert_eq!(bias.len(), outputs, "one bias for each output channel");
            packed_bias.as_mut_slice().iter_mut().zip(bias).for_each(|(to, from)| *to = *from);
        }
        let blocks = Block::all(vectors, kernel * kernel * inputs);
        let mut weights = Buffer::zeroed(vectors * LANES * kernel * kernel * inputs);
        for block in &blocks {
            let width = block.vectors * LANES;
            let packed = &mut weights.as_mut_slice()[block.offset..];
            for (tap, line) in packed.chunks_exact_mut(width).take(kernel * kernel * inputs).enumerate() {
                let (ky, kx, ci) = (tap / inputs / kernel, tap / inputs % kernel, tap % inputs);
                for (co, to) in (block.channel..outputs).zip(line) {
                    *to = weight[[co, ci, ky, kx]];
                }
            }
        }
        Self { weights, bias: packed_bias, blocks, kernel, stride, inputs, outputs }
    }

    /// Channels of the input.
    pub fn input_channels(&self) -> usize {
        self.inputs
    }

    /// Channels of the output.
    pub fn output_channels(&self) -> usize {
        self.outputs
    }

    /// (rows, columns) of the output for an input of that size.
    pub fn output_size(&self, rows: usize, columns: usize) -> (usize, usize) {
        (rows.div_ceil(self.stride), columns.div_ceil(self.stride))
    }

    /// Convolves `input` into `output`, which takes the output's shape. Uses the threads of the current rayon pool.
    ///
    /// # Panics
    /// Where `input` has other channels than the weights, or `add` another shape than the output.
    pub fn run(&self, isa: Isa, input: &Activation, output: &mut Activation, epilogue: Epilogue) {
        self.run_concat(isa, &[Source::new(input)], output, epilogue);
    }

    /// As [`Conv::run`], on the inputs' channels joined in their order, without making the joined image.
    ///
    /// # Panics
    /// As [`Conv::run`], and where the sources differ in size (an up-sampled one counts twice its size).
    pub fn run_concat(&self, isa: Isa, inputs: &[Source], output: &mut Activation, epilogue: Epilogue) {
        let (rows, columns) = self.check(inputs);
        output.reset(rows, columns, self.outputs);
        self.compute(isa, inputs, 0, output, epilogue, false);
    }

    /// As [`Conv::run`], only the output rows `range`: `output` takes the shape (range.len(), columns, channels). `input` (and
    /// `add`) hold all rows.
    ///
    /// # Panics
    /// As [`Conv::run`], and where `range` goes past the output's rows.
    pub fn run_rows(&self, isa: Isa, input: &Activation, output: &mut Activation, epilogue: Epilogue, range: Range<usize>) {
        let inputs = [Source::new(input)];
        let (rows, columns) = self.check(&inputs);
        assert!(range.start <= range.end && range.end <= rows, "rows {range:?} of {rows}");
        output.reset(range.len(), columns, self.outputs);
        self.compute(isa, &inputs, range.start, output, epilogue, false);
    }

    /// As [`Conv::run`], added to what `output` holds: a residual block's second convolution without a second image.
    ///
    /// # Panics
    /// As [`Conv::run`], and where `output` has another shape than the convolution's.
    pub fn run_onto(&self, isa: Isa, input: &Activation, output: &mut Activation, epilogue: Epilogue) {
        let inputs = [Source::new(input)];
        let (rows, columns) = self.check(&inputs);
        assert_eq!(output.shape(), (rows, columns, self.outputs), "the output to add to");
        assert!(epilogue.add.is_none(), "run_onto adds the output itself");
        self.compute(isa, &inputs, 0, output, epilogue, true);
    }

    /// The output's size, after making sure that the inputs fit.
    fn check(&self, inputs: &[Source]) -> (usize, usize) {
        let size = inputs.first().map_or((0, 0), Source::size);
        assert!(inputs.iter().all(|input| input.size() == size), "inputs of different sizes");
        assert_eq!(inputs.iter().map(|input| input.activation.channels()).sum::<usize>(), self.inputs, "input channels");
        self.output_size(size.0, size.1)
    }

    /// Fills `output`, which has its shape, with the convolution's rows from `first` on.
    fn compute(&self, isa: Isa, inputs: &[Source], first: usize, output: &mut Activation, epilogue: Epilogue, onto: bool) {
        let (rows_wanted, columns, _) = output.shape();
        let mut add = if onto { Add::Output } else { Add::Nothing };
        if let Some(image) = epilogue.add {
            let size = inputs.first().map_or((0, 0), Source::size);
            let (rows, columns) = self.output_size(size.0, size.1);
            assert_eq!(image.shape(), (rows, columns, self.outputs), "the image to add");
            add = Add::Image(image.as_slice());
        }
        if output.as_slice().is_empty() {
            return;
        }
        let layer = Layer {
            weights: Weights { taps: self.weights.as_slice(), bias: self.bias.as_slice(), outputs: self.outputs },
            blocks: &self.blocks,
            kernel: self.kernel,
            stride: self.stride,
            inputs: self.inputs,
            sources: inputs,
            relu_input: epilogue.relu_input,
            relu_output: epilogue.relu_output,
            add,
            columns,
        };
        let tile = layer.tile_rows(rows_wanted, rayon::current_num_threads());
        output.as_mut_slice().par_chunks_mut(tile * columns * self.outputs).enumerate().for_each(|(i, output)| {
            SCRATCH.with_borrow_mut(|scratch| rows(isa, &layer, first + i * tile, output, scratch));
        });
    }
}
