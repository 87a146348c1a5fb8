//! Kernel predictors: features to logits, a segment of 32 pixels at a time (Vogels et al. 2018, sections 4.2 and 5.2).
//!
//! Logits live only as long as the segment's kernels are applied; a whole frame of them never exists.

use super::pairs::{Neighbour, Row, gather, gather_quarter, segment_of};
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
    quarter: bool,
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

/// The predictors of the three pyramid levels.
pub struct Predictor {
    /// Full resolution: for each of four sub-pixels centre, coarse and albedo taps; per neighbour its taps and its albedo tap.
    pub full: Head,
    /// Half resolution: centre and coarse taps; per neighbour its taps.
    pub half: Head,
    /// Quarter resolution: centre taps; per neighbour its taps.
    pub quarter: Head,
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
        let head = |at: &str, width: usize, centre: Dense, pair: Dense, quarter: bool| -> Result<Head> {
            Ok(Head {
                width,
                features: a.features,
                centre,
                pair_centre: dense(weights, &format!("pair_{at}_centre"), a.pair, width, true)?,
                pair_neighbour: dense(weights, &format!("pair_{at}_neighbour"), a.pair, a.features + EXTRAS, false)?,
                pair,
                quarter,
            })
        };
        let centre = |range| part("head_half", full + half, a.half, range);
        let pair = |range| part("pair_half_head", pair_full + pair_half, a.pair, range);
        Ok(Self {
            full: head("half", a.half, centre(0..full)?, pair(0..pair_full)?, false)?,
            half: head("half", a.half, centre(full..full + half)?, pair(pair_full..pair_full + pair_half)?, false)?,
            quarter: head(
                "quarter",
                a.quarter,
                dense(weights, "head_quarter", taps.centre, a.quarter, true)?,
                dense(weights, "pair_quarter_head", taps.neighbour, a.pair, true)?,
                true,
            )?,
            taps,
        })
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
            scratch: vec![0.0; if self.quarter { 4 * pair } else { 0 }],
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
            if self.quarter {
                gather_quarter(l, *neighbour, region, y, x, &mut out.scratch, &mut out.joined);
            } else {
                gather(l, *neighbour, region, y, x, &mut out.joined);
            }
            self.pair_neighbour.run(l, &out.joined, Some(&out.base), true, &mut out.hidden);
            self.pair.run(l, &out.hidden, None, false, logits);
        }
    }
}
