//! Kernel predictors: features to logits, a segment of 32 pixels at a time (Vogels et al. 2018, sections 4.2 and 5.2).
//!
//! Logits live only as long as the segment's kernels are applied; a whole frame of them never exists.

use super::pairs::{Neighbour, Row, gather_at, segment_of};
use super::temporal::dense;
use super::warp::EXTRAS;
use super::weights::Weights;
use crate::error::Result;
use crate::plan::tiles::Rect;
use crate::simd::Activation;
use crate::simd::dense::{Dense, SEGMENT};
use crate::simd::lanes::Lanes;

/// How many taps each kernel has.
#[derive(Clone, Copy, Debug)]
pub struct TapCounts {
    pub centre: usize,
    pub neighbour: usize,
    pub coarse: usize,
    pub albedo: usize,
}

/// One resolution's predictor: a head on the body's features and one on each neighbour's pair.
pub struct Head {
    width: usize,
    features: usize,
    centre: Dense,
    pair_centre: Dense,
    pair_neighbour: Dense,
    pair: Dense,
    /// How often the neighbours' features are halved: 0 at half resolution.
    halvings: usize,
}

/// Buffers of one thread, reused from segment to segment.
pub struct Logits {
    /// [output][32] of the centre's head.
    pub centre: Vec<f32>,
    /// [output][32] of each neighbour's head.
    pub pairs: Vec<Vec<f32>>,
    x: Vec<f32>,
    base: Vec<f32>,
    hidden: Vec<f32>,
    joined: Vec<f32>,
    scratch: Vec<f32>,
}

/// The predictors of the pyramid's levels.
pub struct Predictor {
    /// Full resolution: for each of four sub-pixels centre, coarse and albedo taps; per neighbour its taps and its albedo tap.
    pub full: Head,
    /// Half resolution and coarser: centre and coarse taps, the coarsest without these; per neighbour its taps.
    pub coarse: Vec<Head>,
    pub taps: TapCounts,
}

impl Predictor {
    /// Takes the heads of the weights.
    pub fn new(weights: &Weights) -> Result<Self> {
        let a = &weights.architecture;
        let square = |n: usize| n * n;
        let taps = TapCounts {
            centre: square(a.centre_taps),
            neighbour: square(a.neighbour_taps),
            coarse: square(a.coarse_taps),
            albedo: square(a.albedo_taps),
        };
        let (full, half) = (4 * (taps.centre + taps.coarse + taps.albedo), taps.centre + taps.coarse);
        let (pair_full, pair_half) = (4 * (taps.neighbour + 1), taps.neighbour);
        let part = |key: &str, outputs: usize, inputs: usize, range: std::ops::Range<usize>| -> Result<Dense> {
            let (w, b) = weights.conv(key, outputs, inputs, 1, true)?;
            let bias = b.as_ref().map(|b| b.slice(ndarray::s![range.clone()]));
            Ok(Dense::new(w.slice(ndarray::s![range.clone(), .., 0, 0]), bias))
        };
        let head = |at: &str, width: usize, centre: Dense, pair: Dense, halvings: usize| -> Result<Head> {
            Ok(Head {
                width,
                features: a.features,
                centre,
                pair_centre: dense(weights, &format!("pair_{at}_centre"), a.pair, width, true)?,
                pair_neighbour: dense(weights, &format!("pair_{at}_neighbour"), a.pair, a.features + EXTRAS, false)?,
                pair,
                halvings,
            })
        };
        let centre = |range| part("head_half", full + half, a.half, range);
        let pair = |range| part("pair_half_head", pair_full + pair_half, a.pair, range);
        let below = |at: &str, width: usize, outputs: usize, halvings: usize| {
            let centre = dense(weights, &format!("head_{at}"), outputs, width, true)?;
            head(at, width, centre, dense(weights, &format!("pair_{at}_head"), taps.neighbour, a.pair, true)?, halvings)
        };
        let mut coarse = vec![head("half", a.half, centre(full..full + half)?, pair(pair_full..pair_full + pair_half)?, 0)?];
        let coarsest = |level: usize| if level == a.levels { taps.centre } else { half };
        coarse.push(below("quarter", a.quarter, coarsest(3), 1)?);
        if a.levels > 3 {
            coarse.push(below("eighth", a.eighth, coarsest(4), 2)?);
        }
        Ok(Self { full: head("half", a.half, centre(0..full)?, pair(0..pair_full)?, 0)?, coarse, taps })
    }
}

impl Head {
    /// Buffers for this head and a number of neighbours.
    pub fn buffers(&self, neighbours: usize) -> Logits {
        let pair = (self.features + EXTRAS) * SEGMENT;
        Logits {
            centre: vec![0.0; self.centre.output_len()],
            pairs: vec![vec![0.0; self.pair.output_len()]; neighbours],
            x: vec![0.0; self.width * SEGMENT],
            base: vec![0.0; self.pair_centre.output_len()],
            hidden: vec![0.0; self.pair_neighbour.output_len()],
            joined: vec![0.0; pair],
            scratch: vec![0.0; 4 * pair * self.halvings],
        }
    }

    /// Logits of the segment at row `y`, columns `x`… of the head's resolution; `features` covers the region.
    #[inline(always)]
    #[allow(clippy::too_many_arguments)]
    pub fn predict<L: Lanes>(
        &self,
        l: L,
        features: &Activation,
        neighbours: &[Neighbour],
        region: Rect,
        y: usize,
        x: usize,
        out: &mut Logits,
    ) {
        let row = Row { values: features.row(y), start: 0, columns: features.columns() };
        segment_of(l, row, self.width, x, true, &mut out.x);
        self.centre.run(l, &out.x, None, false, &mut out.centre);
        if neighbours.is_empty() {
            return;
        }
        self.pair_centre.run(l, &out.x, None, false, &mut out.base);
        for (neighbour, logits) in neighbours.iter().zip(&mut out.pairs) {
            gather_at(l, self.halvings, *neighbour, region, (y, x), &mut out.scratch, &mut out.joined);
            self.pair_neighbour.run(l, &out.joined, Some(&out.base), true, &mut out.hidden);
            self.pair.run(l, &out.hidden, None, false, logits);
        }
    }
}
