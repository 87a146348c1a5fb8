//! All logits of a region at once, for comparisons: a run holds no more than a segment of them.

use super::pairs::Pairs;
use super::predictor::Head;
use crate::layers::{Activation, SEGMENT};
use crate::simd::Isa;
use crate::simd::{Simd, dispatch};

/// One pyramid level's logits, [output][row][column] of the head's resolution.
pub(crate) struct RegionLogits {
    pub rows: usize,
    pub columns: usize,
    /// Of the centre's head: what [`super::predictor::Predictor`] says, then nothing that means anything.
    pub centre: Vec<f32>,
    /// Of each neighbour's head.
    pub pairs: Vec<Vec<f32>>,
}

impl RegionLogits {
    /// What `head` predicts over a region, from the body's features over it.
    pub fn new(isa: Isa, head: &Head, features: &Activation, pairs: Pairs) -> Self {
        let (rows, columns) = (features.rows(), features.columns());
        let buffers = head.buffers(pairs.len());
        let room = |len: usize| vec![0.0; len / SEGMENT * rows * columns];
        let of_pairs = buffers.pairs.iter().map(|p| room(p.len())).collect();
        let mut out = Self { rows, columns, centre: room(buffers.centre.len()), pairs: of_pairs };
        for y in 0..rows {
            logits_row(isa, head, features, pairs, y, &mut out);
        }
        out
    }

    /// The logit of an output at a pixel.
    pub fn at(&self, values: &[f32], output: usize, y: usize, x: usize) -> f32 {
        values[(output * self.rows + y) * self.columns + x]
    }

    fn put(&mut self, x: usize, y: usize, segment: &[f32], pair: Option<usize>) {
        let (rows, columns) = (self.rows, self.columns);
        let to = pair.map_or(&mut self.centre, |n| &mut self.pairs[n]);
        for (output, from) in segment.chunks_exact(SEGMENT).enumerate() {
            let count = SEGMENT.min(columns - x);
            to[(output * rows + y) * columns + x..][..count].copy_from_slice(&from[..count]);
        }
    }
}

#[inline(always)]
fn logits_row_body<S: Simd>(s: S, head: &Head, features: &Activation, pairs: Pairs, y: usize, out: &mut RegionLogits) {
    let mut logits = head.buffers(pairs.len());
    for x in (0..features.columns()).step_by(SEGMENT) {
        head.predict(s, features, pairs, y, x, &mut logits);
        out.put(x, y, &logits.centre, None);
        logits.pairs.iter().enumerate().for_each(|(n, pair)| out.put(x, y, pair, Some(n)));
    }
}

dispatch! {
    fn logits_row(head: &Head, features: &Activation, pairs: Pairs<'_>, y: usize, out: &mut RegionLogits) = logits_row_body
}
