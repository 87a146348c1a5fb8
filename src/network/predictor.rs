//! Kernel predictors: features to logits, a segment of 32 pixels at a time (Vogels et al. 2018, sections 4.2 and 5.2).
//!
//! Logits live only as long as the segment's kernels are applied; a whole frame of them never exists.

use std::ops::Range;

use ndarray::{Array1, Array4, ArrayView1, Axis, concatenate, s};

use super::pairs::{Pairs, Row, gather, segment_of};
use super::temporal::dense;
use super::warp::EXTRAS;
use super::weights::Weights;
use crate::error::Result;
use crate::kernels::FULL_PHASES;
use crate::layers::Activation;
use crate::layers::{Dense, SEGMENT};
use crate::simd::Simd;

/// Queries of a kernel over one image: what to multiply a tap's key by, and its square (`QUERIES` in `training/network/model.py`).
const QUERIES: usize = 2;

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
    /// The output of `centre` at which the queries begin: two for each phase.
    pub queries: usize,
    /// The same of a neighbour's.
    pub pair_queries: usize,
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
    /// follow the taps of all sub-pixels.
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
        // Rows of a layer, then rows of the layer of its queries, as one.
        let joined =
            |key: &str, outputs: usize, rows: Range<usize>, query: (&str, usize, Range<usize>), inputs: usize| -> Result<Dense> {
                let (w, b) = weights.conv(key, outputs, inputs, 1, true)?;
                let (query_w, query_b) = weights.conv(query.0, query.1, inputs, 1, true)?;
                let take = |w: &Array4<f32>, rows: &Range<usize>| w.slice(s![rows.clone(), .., 0, 0]).to_owned();
                let weight = concatenate![Axis(0), take(&w, &rows), take(&query_w, &query.2)];
                let bias = |b: &Option<Array1<f32>>, rows: &Range<usize>| {
                    b.iter().flat_map(|b| b.slice(s![rows.clone()]).to_vec()).collect::<Vec<f32>>()
                };
                let bias = [bias(&b, &rows), bias(&query_b, &query.2)].concat();
                Ok(Dense::new(weight.view(), Some(ArrayView1::from(&bias[..]))))
            };
        let head = |at: &str, width: usize, (taps, pair_taps): (Part, Part)| -> Result<Head> {
            let of = |layer: &str, name: &str, part: &Part, inputs: usize| {
                joined(layer, part.of, part.taps.clone(), (name, part.queries_of, part.queries.clone()), inputs)
            };
            Ok(Head {
                width,
                features: a.features,
                centre: of(&format!("head_{at}"), &format!("query_{at}"), &taps, width)?,
                pair_centre: dense(weights, &format!("pair_{at}_centre"), a.pair, width, true)?,
                pair_neighbour: dense(weights, &format!("pair_{at}_neighbour"), a.pair, a.features + EXTRAS, false)?,
                pair: of(&format!("pair_{at}_head"), &format!("pair_{at}_query"), &pair_taps, a.pair)?,
                queries: taps.taps.len(),
                pair_queries: pair_taps.taps.len(),
            })
        };
        // One layer predicts the taps of full and half resolution, another their queries.
        let both = |full: usize, half: usize, taps: Range<usize>, queries: Range<usize>| Part {
            of: full + half,
            taps,
            queries_of: (FULL_PHASES + 1) * QUERIES,
            queries,
        };
        let (first, rest) = (0..FULL_PHASES * QUERIES, FULL_PHASES * QUERIES..(FULL_PHASES + 1) * QUERIES);
        let of_full = (both(full, half, 0..full, first.clone()), both(pair_full, pair_half, 0..pair_full, first));
        let of_half = (
            both(full, half, full..full + half, rest.clone()),
            both(pair_full, pair_half, pair_full..pair_full + pair_half, rest),
        );
        let whole = |taps: usize| Part { of: taps, taps: 0..taps, queries_of: QUERIES, queries: 0..QUERIES };
        let coarsest = |level: usize| whole(if level == a.levels { taps.centre } else { half });
        let mut coarse = vec![head("half", a.half, of_half)?];
        coarse.push(head("quarter", a.quarter, (coarsest(3), whole(taps.neighbour)))?);
        if a.levels > 3 {
            coarse.push(head("eighth", a.eighth, (coarsest(4), whole(taps.neighbour)))?);
        }
        Ok(Self { full: head("half", a.half, of_full)?, coarse, taps })
    }
}

/// Which of a layer's outputs are a head's taps, and which of another's its queries.
struct Part {
    of: usize,
    taps: Range<usize>,
    queries_of: usize,
    queries: Range<usize>,
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
