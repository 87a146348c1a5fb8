//! A 1×1 layer over 32 pixels at a time, pixels in the vector lanes: the shape in which logits feed kernel application.

use ndarray::{ArrayView1, ArrayView2};

use crate::simd::{LANES, Simd};

/// Pixels that one call computes.
pub const SEGMENT: usize = 32;

const BLOCK: usize = 12;

/// Weights of a 1×1 layer, packed in blocks of twelve output rows.
#[derive(Clone, Debug)]
pub struct Dense {
    inputs: usize,
    outputs: usize,
    weight: Vec<f32>,
    bias: Vec<f32>,
}

impl Dense {
    /// Packs `weight` (outputs, inputs) and `bias` (outputs).
    pub fn new(weight: ArrayView2<f32>, bias: Option<ArrayView1<f32>>) -> Self {
        let (outputs, inputs) = weight.dim();
        let blocks = outputs.div_ceil(BLOCK);
        let mut packed = vec![0.0; blocks * inputs * BLOCK];
        for ((o, i), w) in weight.indexed_iter() {
            packed[(o / BLOCK * inputs + i) * BLOCK + o % BLOCK] = *w;
        }
        let mut padded = vec![0.0; blocks * BLOCK];
        if let Some(bias) = bias {
            padded.iter_mut().zip(bias).for_each(|(to, from)| *to = *from);
        }
        Self { inputs, outputs, weight: packed, bias: padded }
    }

    /// Floats that the output of one segment takes: outputs, rounded up to whole blocks, times [`SEGMENT`].
    pub fn output_len(&self) -> usize {
        self.outputs.div_ceil(BLOCK) * BLOCK * SEGMENT
    }

    /// `out` [output][32] = `start` [output][32] (or the bias) + W·`x` [input][32], then ReLU where asked.
    #[inline(always)]
    pub fn run<S: Simd>(&self, s: S, x: &[f32], start: Option<&[f32]>, relu: bool, out: &mut [f32]) {
        match S::REGISTERS {
            32.. => self.tiles::<S, 12, 2>(s, x, start, relu, out),
            8.. => self.tiles::<S, 6, 1>(s, x, start, relu, out),
            _ => self.tiles::<S, 2, 2>(s, x, start, relu, out),
        }
    }

    /// In register tiles of T outputs × NV vectors of pixels.
    #[inline(always)]
    fn tiles<S: Simd, const T: usize, const NV: usize>(
        &self,
        s: S,
        x: &[f32],
        start: Option<&[f32]>,
        relu: bool,
        out: &mut [f32],
    ) {
        const { assert!(BLOCK.is_multiple_of(T) && SEGMENT.is_multiple_of(NV * LANES)) };
        let x = &x[..self.inputs * SEGMENT];
        let zero = s.splat(0.0);
        for (block, weight) in self.weight.chunks_exact(self.inputs * BLOCK).enumerate() {
            for (part, pixel) in (0..BLOCK).step_by(T).flat_map(|part| (0..SEGMENT).step_by(NV * LANES).map(move |p| (part, p))) {
                let first = block * BLOCK + part;
                let mut sums = [[zero; NV]; T];
                for (t, sum) in sums.iter_mut().enumerate() {
                    for (v, sum) in sum.iter_mut().enumerate() {
                        *sum = match start {
                            Some(start) => s.load(start, (first + t) * SEGMENT + pixel + LANES * v),
                            None => s.splat(self.bias[first + t]),
                        };
                    }
                }
                for (x, w) in x.chunks_exact(SEGMENT).zip(weight.chunks_exact(BLOCK)) {
                    let mut inputs = [zero; NV];
                    for (v, input) in inputs.iter_mut().enumerate() {
                        *input = s.load(x, pixel + LANES * v);
                    }
                    for (sum, w) in sums.iter_mut().zip(&w[part..part + T]) {
                        let w = s.splat(*w);
                        for (sum, x) in sum.iter_mut().zip(inputs) {
                            *sum = s.fma(w, x, *sum);
                        }
                    }
                }
                for (t, sum) in sums.iter().enumerate() {
                    for (v, sum) in sum.iter().enumerate() {
                        let sum = if relu { s.relu(*sum) } else { *sum };
                        s.store(sum, out, (first + t) * SEGMENT + pixel + LANES * v);
                    }
                }
            }
        }
    }
}
