//! A 1×1 layer over 32 pixels at a time, pixels in the vector lanes: the shape in which logits feed kernel application.

use ndarray::{ArrayView1, ArrayView2};

use super::lanes::{Lanes, dispatch};

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

    /// Input channels.
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Floats that the output of one segment takes: outputs, rounded up to whole blocks, times [`SEGMENT`].
    pub fn output_len(&self) -> usize {
        self.outputs.div_ceil(BLOCK) * BLOCK * SEGMENT
    }

    /// `out` [output][32] = `start` [output][32] (or the bias) + W·`x` [input][32], then ReLU where asked.
    #[inline(always)]
    pub fn run<L: Lanes>(&self, l: L, x: &[f32], start: Option<&[f32]>, relu: bool, out: &mut [f32]) {
        match L::TILE {
            12 => self.tiles::<L, 12>(l, x, start, relu, out),
            3 => self.tiles::<L, 3>(l, x, start, relu, out),
            _ => self.tiles::<L, 2>(l, x, start, relu, out),
        }
    }

    #[inline(always)]
    fn tiles<L: Lanes, const T: usize>(&self, l: L, x: &[f32], start: Option<&[f32]>, relu: bool, out: &mut [f32]) {
        let x = &x[..self.inputs * SEGMENT];
        let zero = l.splat(0.0);
        for (block, weight) in self.weight.chunks_exact(self.inputs * BLOCK).enumerate() {
            for part in (0..BLOCK).step_by(T) {
                let first = block * BLOCK + part;
                let mut sums = [[zero; 2]; T];
                for (t, sum) in sums.iter_mut().enumerate() {
                    *sum = match start {
                        Some(start) => [l.load(start, (first + t) * SEGMENT), l.load(start, (first + t) * SEGMENT + 16)],
                        None => [l.splat(self.bias[first + t]); 2],
                    };
                }
                for (x, w) in x.chunks_exact(SEGMENT).zip(weight.chunks_exact(BLOCK)) {
                    let (x0, x1) = (l.load(x, 0), l.load(x, 16));
                    for (sum, w) in sums.iter_mut().zip(&w[part..part + T]) {
                        let w = l.splat(*w);
                        *sum = [l.fma(w, x0, sum[0]), l.fma(w, x1, sum[1])];
                    }
                }
                for (t, sum) in sums.iter().enumerate() {
                    for (half, v) in sum.iter().enumerate() {
                        let v = if relu { l.max(*v, zero) } else { *v };
                        l.store(v, out, (first + t) * SEGMENT + 16 * half);
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn run_body<L: Lanes>(l: L, layer: &Dense, x: &[f32], start: Option<&[f32]>, relu: bool, out: &mut [f32]) {
    layer.run(l, x, start, relu, out);
}

dispatch! {
    /// [`Dense::run`] on an instruction set.
    pub fn run_dense(layer: &Dense, x: &[f32], start: Option<&[f32]>, relu: bool, out: &mut [f32]) = run_body
}

#[cfg(test)]
mod tests {
    use ndarray::{Array1, Array2};

    use super::*;
    use crate::simd::Isa;

    #[test]
    fn matches_a_plain_product_on_every_isa() {
        for (outputs, inputs) in [(1, 1), (12, 48), (43, 39), (172, 48), (49, 32)] {
            let weight = Array2::from_shape_fn((outputs, inputs), |(o, i)| ((o * 7 + i * 3) % 11) as f32 / 11.0 - 0.4);
            let bias = Array1::from_shape_fn(outputs, |o| o as f32 / 50.0 - 0.5);
            let layer = Dense::new(weight.view(), Some(bias.view()));
            let x: Vec<f32> = (0..inputs * SEGMENT).map(|i| (i % 17) as f32 / 8.0 - 1.0).collect();
            for isa in Isa::available() {
                let mut out = vec![f32::NAN; layer.output_len()];
                run_dense(isa, &layer, &x, None, true, &mut out);
                for o in 0..outputs {
                    for p in 0..SEGMENT {
                        let exact: f64 = f64::from(bias[o])
                            + (0..inputs).map(|i| f64::from(weight[[o, i]]) * f64::from(x[i * SEGMENT + p])).sum::<f64>();
                        assert!((f64::from(out[o * SEGMENT + p]) - exact.max(0.0)).abs() < 1e-4, "{isa:?} {outputs}x{inputs}");
                    }
                }
            }
        }
    }
}
