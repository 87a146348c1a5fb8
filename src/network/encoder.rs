//! Source encoder: one frame's passes to features at half resolution (Vogels et al. 2018, section 4.1).

use rayon::prelude::*;

use super::features::Features;
use super::residual::Residual;
use super::weights::Weights;
use crate::error::Result;
use crate::frame::packed::{COLOUR, DEPTH, GuideViews, PackedFrame};
use crate::frame::sanitise::bounded;
use crate::kernels::keys::MAX_EXPOSED;
use crate::layers::{Activation, Conv, Epilogue, Winograd};
use crate::memory::BufferPool;
use crate::simd::Isa;
use crate::simd::math::ln_1p_all;

/// Channels at full resolution: log colour 3, albedo 3, normal 3, log depth 1.
const INPUTS: usize = 10;

/// Half-resolution pixels that are encoded at once: a 1080p frame.
const WHOLE_AREA: usize = 600_000;
/// Half-resolution pixels of a strip of a larger frame.
const STRIP_AREA: usize = 200_000;

/// The renderer-specific part of the network.
pub struct Encoder {
    first: Conv,
    second: Winograd,
    blocks: Vec<Residual>,
}

impl Encoder {
    /// Takes the layers `encoder.*` of the weights: those of the renderer that was chosen.
    pub fn new(weights: &Weights) -> Result<Self> {
        let width = weights.architecture.features;
        let first = weights.layer("encoder.first", width, 4 * INPUTS, 1)?;
        let second = weights.winograd("encoder.second", width, width)?;
        let block = |i: usize| Residual::winograd(weights, &format!("encoder.blocks.{i}"), width);
        Ok(Self { first, second, blocks: (0..weights.architecture.blocks_encoder).map(block).collect::<Result<_>>()? })
    }

    /// Half-resolution pixels around a pixel that its features depend on: one for each 3×3 convolution.
    pub fn halo(&self) -> usize {
        2 + 2 * self.blocks.len()
    }

    /// Features (padded rows / 2, padded columns / 2, features) of a frame, computed in strips that bound the memory, which comes from `pool`.
    pub fn run(&self, isa: Isa, frame: &PackedFrame, guides: &GuideViews, pool: &BufferPool) -> Features {
        let (rows, columns) = (frame.padded_rows / 2, frame.padded_columns / 2);
        // Strips and the halo are even: Winograd's tiles lie alike in all of them.
        let (step, halo) = (if rows * columns <= WHOLE_AREA { rows } else { (STRIP_AREA / columns).max(2) & !1 }, self.halo());
        let mut features = Features::new(rows, columns, self.second.output_channels(), pool);
        let (mut hidden, mut out) = (Activation::in_pool(pool), Activation::in_pool(pool));
        for first in (0..rows).step_by(step) {
            let (start, end) = (first.saturating_sub(halo), (first + step + halo).min(rows));
            let inputs = inputs(isa, frame, guides, start..end, pool);
            self.first.run(isa, &inputs, &mut hidden, Epilogue { relu_output: true, ..Default::default() });
            self.second.run(isa, &hidden, &mut out, Epilogue::default());
            self.blocks.iter().for_each(|block| block.run(isa, &mut out, &mut hidden));
            features.put(&out, first - start, step.min(rows - first), first);
        }
        features
    }
}

/// The encoder's input in some half-resolution rows, the 2×2 pixels of a half-resolution pixel side by side: channel c·4 + 2·(row & 1) + (column & 1).
fn inputs(isa: Isa, frame: &PackedFrame, guides: &GuideViews, rows: std::ops::Range<usize>, pool: &BufferPool) -> Activation {
    let half_columns = frame.padded_columns / 2;
    let columns = frame.padded_columns;
    let mut out = Activation::in_pool(pool);
    out.reset(rows.len(), half_columns, 4 * INPUTS);
    out.as_mut_slice().par_chunks_mut(half_columns * 4 * INPUTS).enumerate().for_each(|(hy, row)| {
        let mut logs = vec![0.0; 4 * columns];
        for dy in 0..2 {
            let y = 2 * (rows.start + hy) + dy;
            let pixels = &frame.groups[0][y * columns..][..columns];
            for (x, lanes) in pixels.iter().enumerate() {
                for c in 0..3 {
                    logs[c * columns + x] = (lanes[COLOUR + c] * frame.exposure).min(MAX_EXPOSED);
                }
                logs[3 * columns + x] = lanes[DEPTH];
            }
            ln_1p_all(isa, &mut logs);
            let y = y.min(frame.rows - 1);
            for x in 0..columns {
                let to = &mut row[x / 2 * 4 * INPUTS..][..4 * INPUTS];
                let phase = 2 * dy + x % 2;
                let mut put = |c: usize, v: f32| to[c * 4 + phase] = v;
                put(9, logs[3 * columns + x]);
                let guide_x = x.min(frame.columns - 1);
                for c in 0..3 {
                    put(c, logs[c * columns + x]);
                    put(3 + c, guides.albedo.as_ref().map_or(0.0, |a| bounded(a[[y, guide_x, c]], 0.0)));
                    put(6 + c, guides.normal.as_ref().map_or(0.0, |n| bounded(n[[y, guide_x, c]], -1.0)));
                }
            }
        }
    });
    out
}
