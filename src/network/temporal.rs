//! Temporal extractor: the centre's features and its neighbours', mixed to the body's input (Vogels et al. 2018, section 4.2).
//!
//! Every neighbour goes through the same weights, so that any number of them, before and after, works with one network.

use rayon::prelude::*;

use super::features::Features;
use super::pairs::{Neighbour, features_of, gather};
use super::warp::EXTRAS;
use super::weights::Weights;
use crate::error::Result;
use crate::plan::tiles::Rect;
use crate::simd::dense::{Dense, SEGMENT};
use crate::simd::lanes::{Lanes, dispatch};
use crate::simd::{Activation, Isa};

/// Three 1×1 layers.
pub struct Temporal {
    centre: Dense,
    neighbour: Dense,
    mix: Dense,
    features: usize,
    width: usize,
}

/// A 1×1 layer of the weights as a [`Dense`].
pub(super) fn dense(weights: &Weights, key: &str, outputs: usize, inputs: usize, biased: bool) -> Result<Dense> {
    let (w, b) = weights.conv(key, outputs, inputs, 1, biased)?;
    Ok(Dense::new(w.slice(ndarray::s![.., .., 0, 0]), b.as_ref().map(|b| b.view())))
}

impl Temporal {
    /// Takes the layers `mix*` of the weights.
    pub fn new(weights: &Weights) -> Result<Self> {
        let (features, width) = (weights.architecture.features, weights.architecture.half);
        Ok(Self {
            centre: dense(weights, "mix_centre", width, features, true)?,
            neighbour: dense(weights, "mix_neighbour", width, features + EXTRAS, false)?,
            mix: dense(weights, "mix", width, features + width, true)?,
            features,
            width,
        })
    }

    /// The body's input over `region`, from the centre's features over the whole frame.
    pub fn run(&self, isa: Isa, centre: &Features, neighbours: &[Neighbour], region: Rect, out: &mut Activation) {
        out.reset(region.rows, region.columns, self.width);
        out.as_mut_slice().par_chunks_mut(region.columns * self.width).enumerate().for_each(|(y, row)| {
            temporal_row(isa, self, centre, neighbours, region, y, row);
        });
    }
}

#[inline(always)]
fn row_body<L: Lanes>(
    l: L,
    layers: &Temporal,
    centre: &Features,
    neighbours: &[Neighbour],
    region: Rect,
    y: usize,
    out: &mut [f32],
) {
    let (features, width) = (layers.features, layers.width);
    let mut joined = vec![0.0; (features + width) * SEGMENT];
    let mut pair = vec![0.0; (features + EXTRAS) * SEGMENT];
    let mut base = vec![0.0; layers.centre.output_len()];
    let mut each = vec![0.0; layers.neighbour.output_len()];
    let mut mixed = vec![0.0; layers.mix.output_len()];
    for x in (0..region.columns).step_by(SEGMENT) {
        features_of(l, centre, region, y, x, &mut joined);
        layers.centre.run(l, &joined, None, false, &mut base);
        joined[features * SEGMENT..].fill(0.0);
        let mut trust = [1.0f32; SEGMENT];
        for neighbour in neighbours {
            gather(l, *neighbour, region, y, x, &mut pair);
            layers.neighbour.run(l, &pair, Some(&base), true, &mut each);
            let share = &pair[features * SEGMENT..][..SEGMENT];
            for (sum, value) in joined[features * SEGMENT..].chunks_exact_mut(SEGMENT).zip(each.chunks_exact(SEGMENT)) {
                for p in 0..SEGMENT {
                    sum[p] += share[p] * value[p];
                }
            }
            trust.iter_mut().zip(share).for_each(|(sum, v)| *sum += v);
        }
        for sum in joined[features * SEGMENT..].chunks_exact_mut(SEGMENT) {
            for p in 0..SEGMENT {
                sum[p] /= trust[p];
            }
        }
        layers.mix.run(l, &joined, None, false, &mut mixed);
        for part in (0..SEGMENT).step_by(16) {
            for first in (0..width).step_by(16) {
                let mut block = [l.splat(0.0); 16];
                for (c, channel) in block.iter_mut().enumerate() {
                    *channel = l.load(&mixed, (first + c) * SEGMENT + part);
                }
                let inside = region.columns.saturating_sub(x + part);
                for (p, pixel) in l.transpose(block).into_iter().enumerate().take(inside) {
                    l.store(pixel, out, (x + part + p) * width + first);
                }
            }
        }
    }
}

dispatch! {
    fn temporal_row(layers: &Temporal, centre: &Features, neighbours: &[Neighbour], region: Rect, y: usize, out: &mut [f32]) = row_body
}
