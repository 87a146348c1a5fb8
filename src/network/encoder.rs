//! Source encoder: one frame's passes to features at half resolution (Vogels et al. 2018, section 4.1).

use rayon::prelude::*;

use super::residual::Residual;
use super::weights::Weights;
use crate::error::Result;
use crate::frame::packed::{COLOUR, DEPTH, Guides, MODULATION, PackedFrame};
use crate::simd::{Activation, Conv, Epilogue, Isa};

/// Channels at full resolution: log colour 3, albedo 3, normal 3, log depth 1.
const INPUTS: usize = 10;

/// The renderer-specific part of the network.
pub struct Encoder {
    first: Conv,
    second: Conv,
    block: Residual,
}

impl Encoder {
    /// Takes the layers `encoder.*` of the weights.
    pub fn new(weights: &Weights) -> Result<Self> {
        let width = weights.architecture.features;
        let (w, b) = weights.conv("encoder.first", width, 4 * INPUTS, 3, true)?;
        let first = Conv::new(w.view(), b.as_ref().map(|b| b.view()), 1);
        let (w, b) = weights.conv("encoder.second", width, width, 3, true)?;
        let second = Conv::new(w.view(), b.as_ref().map(|b| b.view()), 1);
        Ok(Self { first, second, block: Residual::new(weights, "encoder.block", width)? })
    }

    /// Features (padded rows / 2, padded columns / 2, features) of a frame.
    pub fn run(&self, isa: Isa, frame: &PackedFrame, guides: &Guides) -> Activation {
        let inputs = inputs(frame, guides);
        let (mut hidden, mut out) = (Activation::empty(), Activation::empty());
        self.first.run(isa, &inputs, &mut hidden, Epilogue { relu_output: true, ..Default::default() });
        drop(inputs);
        self.second.run(isa, &hidden, &mut out, Epilogue::default());
        self.block.run(isa, &mut out, &mut hidden);
        out
    }
}

/// The encoder's input, the 2×2 pixels of a half-resolution pixel side by side: channel c·4 + 2·(row & 1) + (column & 1).
fn inputs(frame: &PackedFrame, guides: &Guides) -> Activation {
    let (half_rows, half_columns) = (frame.padded_rows / 2, frame.padded_columns / 2);
    let mut out = Activation::new(half_rows, half_columns, 4 * INPUTS);
    out.as_mut_slice().par_chunks_mut(half_columns * 4 * INPUTS).enumerate().for_each(|(hy, row)| {
        for (hx, to) in row.chunks_exact_mut(4 * INPUTS).enumerate() {
            for phase in 0..4 {
                let (y, x) = (2 * hy + phase / 2, 2 * hx + phase % 2);
                for (c, v) in pixel(frame, guides, y, x).into_iter().enumerate() {
                    to[c * 4 + phase] = v;
                }
            }
        }
    });
    out
}

/// The network's view of one pixel.
#[inline(always)]
fn pixel(frame: &PackedFrame, guides: &Guides, y: usize, x: usize) -> [f32; INPUTS] {
    let lanes = &frame.groups[0][y * frame.padded_columns + x];
    let (y, x) = (y.min(frame.rows - 1), x.min(frame.columns - 1));
    let finite = |v: f32, low: f32| if v.is_nan() { 0.0 } else { v.clamp(low, 1.0) };
    let mut out = [0.0; INPUTS];
    for c in 0..3 {
        out[c] = (lanes[COLOUR + c] * frame.exposure).ln_1p();
        out[3 + c] = guides.albedo.as_ref().map_or(0.0, |a| finite(a[[y, x, c]], 0.0));
        out[6 + c] = guides.normal.as_ref().map_or(0.0, |n| finite(n[[y, x, c]], -1.0));
    }
    out[9] = lanes[DEPTH].ln_1p();
    debug_assert!(lanes[MODULATION] > 0.0);
    out
}
