//! Kernel predictors: features to logits, a segment of 32 pixels at a time (Vogels et al. 2018, sections 4.2 and 5.2).
//!
//! Logits live only as long as the segment's kernels are applied; a whole frame of them never exists.

use std::ops::Range;

use ndarray::{Array2, ArrayView1, Axis, concatenate, s};

use super::pairs::{Pairs, Row, gather, segment_of};
use super::warp::EXTRAS;
use super::weights::Weights;
use crate::error::Result;
use crate::kernels::FULL_PHASES;
use crate::layers::{Activation, Dense, SEGMENT};
use crate::simd::Simd;

/// Queries of a kernel over one image: what to multiply a tap's key by, and its square (`QUERIES` in `training/network/model.py`).
const QUERIES: usize = 2;

/// Logits of the second pass for each neighbour; the head gives those at λ 1, and how they move with λ's code.
pub const SECOND: usize = 2;

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
    /// Where in `centre`'s outputs what follows the taps begins.
    pub starts: Starts,
    /// The same of a neighbour's.
    pub pair_starts: Starts,
}

/// The outputs of a layer at which its groups begin, after the taps.
#[derive(Clone, Copy, Debug)]
pub struct Starts {
    /// The albedo's taps on the pyramid: of full resolution the coarse ones of each phase; below it the image's own, then the coarse ones.
    pub albedo: usize,
    /// Queries: two for each phase.
    pub queries: usize,
    /// What the logits of the second pass are made from, where there is one.
    pub second: usize,
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
}

/// The predictors of the pyramid's levels.
pub struct Predictor {
    /// Full resolution: for each of four sub-pixels centre, coarse and albedo taps; per neighbour its taps and its albedo tap. Queries
    /// follow the taps of all sub-pixels, and before them the albedo's coarse taps where it has any; the second pass's logits come last.
    pub full: Head,
    /// Half resolution and coarser: centre and coarse taps, the coarsest without these; per neighbour its taps. The albedo's taps follow
    /// on the levels that filter it.
    pub coarse: Vec<Head>,
    pub taps: TapCounts,
    /// Levels on which the albedo has kernels.
    pub albedo_levels: usize,
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
        let head = |at: &str, width: usize, [taps, albedo, queries]: [(Rows, Rows); 3], second: Rows| -> Result<Head> {
            let starts = |taps: &Rows, albedo: &Rows, queries: &Rows| {
                let (albedo, queries) = (taps.len(), [albedo.len(), queries.len()]);
                Starts { albedo, queries: albedo + queries[0], second: albedo + queries[0] + queries[1] }
            };
            Ok(Head {
                width,
                features: a.features,
                starts: starts(&taps.0, &albedo.0, &queries.0),
                pair_starts: starts(&taps.1, &albedo.1, &queries.1),
                centre: joined(weights, &[taps.0, albedo.0, queries.0], width)?,
                pair_centre: weights.dense(&format!("pair_{at}_centre"), a.pair, width, true)?,
                pair_neighbour: weights.dense(&format!("pair_{at}_neighbour"), a.pair, a.features + EXTRAS, false)?,
                pair: joined(weights, &[taps.1, albedo.1, queries.1, second], a.pair)?,
            })
        };
        // One layer predicts the taps of full and half resolution, another their queries, a third the albedo's on the pyramid.
        let deep = usize::from(a.albedo_levels > 1);
        let albedo_full = deep * FULL_PHASES * taps.coarse;
        let albedo_half = albedo_full + deep * (taps.albedo + taps.coarse);
        let queries = [FULL_PHASES * QUERIES, (FULL_PHASES + 1) * QUERIES];
        let rows = |layer: &'static str, of: usize, rows: Range<usize>| Rows { layer, of, rows };
        let half_taps = |of: Range<usize>, pair: Range<usize>| {
            (rows("head_half", full + half, of), rows("pair_half_head", pair_full + pair_half, pair))
        };
        let half_queries =
            |of: Range<usize>| (rows("query_half", queries[1], of.clone()), rows("pair_half_query", queries[1], of));
        let half_albedo = |of: Range<usize>, pair: Range<usize>| {
            (rows("head_albedo_half", albedo_half, of), rows("pair_albedo_half_head", 1, pair))
        };
        let of_full = [half_taps(0..full, 0..pair_full), half_albedo(0..albedo_full, 0..0), half_queries(0..queries[0])];
        let of_half = [
            half_taps(full..full + half, pair_full..pair_full + pair_half),
            half_albedo(albedo_full..albedo_half, 0..deep),
            half_queries(queries[0]..queries[1]),
        ];
        let whole = |layer: &'static str, count: usize| rows(layer, count, 0..count);
        let coarsest = |level: usize| if level == a.levels { taps.centre } else { half };
        let of_quarter = [
            (whole("head_quarter", coarsest(3)), whole("pair_quarter_head", taps.neighbour)),
            (whole("head_albedo_quarter", deep * taps.albedo), whole("pair_albedo_quarter_head", deep)),
            (whole("query_quarter", QUERIES), whole("pair_quarter_query", QUERIES)),
        ];
        let none = || whole("", 0);
        let mut coarse = vec![head("half", a.half, of_half, none())?, head("quarter", a.quarter, of_quarter, none())?];
        if a.levels > 3 {
            let of_eighth = [
                (whole("head_eighth", coarsest(4)), whole("pair_eighth_head", taps.neighbour)),
                (none(), none()),
                (whole("query_eighth", QUERIES), whole("pair_eighth_query", QUERIES)),
            ];
            coarse.push(head("eighth", a.eighth, of_eighth, none())?);
        }
        let full = head("half", a.half, of_full, whole("pair_second_head", a.second_pass * 2 * SECOND))?;
        Ok(Self { full, coarse, taps, albedo_levels: a.albedo_levels })
    }
}

/// Some outputs of a layer of the weights.
struct Rows {
    layer: &'static str,
    /// The layer's outputs in all.
    of: usize,
    rows: Range<usize>,
}

impl Rows {
    fn len(&self) -> usize {
        self.rows.len()
    }
}

/// Rows of several layers over the same inputs as one; a layer of which nothing is taken need not be there.
fn joined(weights: &Weights, parts: &[Rows], inputs: usize) -> Result<Dense> {
    let (mut weight, mut bias) = (Array2::zeros((0, inputs)), Vec::new());
    for Rows { layer, of, rows } in parts.iter().filter(|part| part.len() > 0) {
        let (w, b) = weights.conv(layer, *of, inputs, 1, true)?;
        weight = concatenate![Axis(0), weight, w.slice(s![rows.clone(), .., 0, 0])];
        bias.extend(b.iter().flat_map(|b| b.slice(s![rows.clone()]).to_vec()));
    }
    Ok(Dense::new(weight.view(), Some(ArrayView1::from(&bias[..]))))
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
        }
    }

    /// Logits of the segment at row `y`, columns `x`… of the head's resolution; `features` and `pairs` cover the region.
    #[inline(always)]
    #[allow(clippy::too_many_arguments)]
    pub fn predict<S: Simd>(&self, s: S, features: &Activation, pairs: Pairs, y: usize, x: usize, out: &mut Logits) {
        let row = Row { values: features.row(y), start: 0, columns: features.columns() };
        segment_of(s, row, self.width, x, true, &mut out.x);
        self.centre.run(s, &out.x, None, false, &mut out.centre);
        if pairs.is_empty() {
            return;
        }
        self.pair_centre.run(s, &out.x, None, false, &mut out.base);
        for (n, logits) in out.pairs.iter_mut().enumerate() {
            let joined = match pairs {
                Pairs::Half(neighbours, region) => {
                    gather(s, neighbours[n], region, y, x, &mut out.joined);
                    &out.joined
                }
                Pairs::Coarser(gathered) => gathered.segment(y, x, n),
            };
            self.pair_neighbour.run(s, joined, Some(&out.base), true, &mut out.hidden);
            self.pair.run(s, &out.hidden, None, false, logits);
        }
    }
}
