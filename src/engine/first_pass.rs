//! A frame after the first pass, as it is kept for the second pass of the frames around it.

use std::borrow::Cow;
use std::fmt;
use std::sync::Arc;

use ndarray::{Array3, Axis, concatenate, s};

use super::unpack::unpack;
use super::{Denoised, EncodedFrame};
use crate::frame::pixels::Pixels;
use crate::kernels::Channels;
use crate::network::levels::SEEN;
use crate::tiles::Rect;

/// A denoised frame that may yet be averaged with those around it.
pub struct FirstPass {
    /// (rows, columns, values), padded.
    pub(super) image: Array3<f32>,
    /// Which value is which.
    pub(super) channels: Channels,
    rows: usize,
    columns: usize,
    pub(super) has_alpha: bool,
    aov_names: Vec<String>,
    pub(super) exposure: f32,
    /// Where a second pass is to follow.
    pub(super) vectors: Option<Arc<Pixels<4>>>,
    /// Whether nothing moves.
    pub(super) still: bool,
    /// Neighbours that have logits, by offset.
    pub(super) offsets: Vec<i32>,
    /// [half-resolution row][neighbour][[`SEEN`]][column].
    pub(super) seen: Vec<f32>,
}

impl fmt::Debug for FirstPass {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let size = (self.rows, self.columns);
        f.debug_struct("FirstPass").field("size", &size).field("neighbours", &self.offsets).finish_non_exhaustive()
    }
}

impl FirstPass {
    /// Of a frame whose kernels give this image.
    pub(super) fn new(image: Array3<f32>, centre: &EncodedFrame, channels: Channels) -> Self {
        let packed = &centre.packed;
        Self {
            image,
            channels,
            rows: packed.rows,
            columns: packed.columns,
            has_alpha: packed.has_alpha,
            aov_names: packed.aov_names.clone(),
            exposure: packed.exposure,
            vectors: None,
            still: centre.ranges.still,
            offsets: Vec::new(),
            seen: Vec::new(),
        }
    }

    /// As it is to be kept for a second pass: with its vectors, and room for what that takes of the neighbours at `offsets`.
    pub(super) fn kept(mut self, centre: &EncodedFrame, offsets: Vec<i32>) -> Self {
        let (rows, columns) = (centre.packed.padded_rows / 2, centre.packed.padded_columns / 2);
        self.seen = vec![0.0; rows * offsets.len() * SEEN * columns];
        (self.vectors, self.offsets) = (centre.packed.vectors.clone(), offsets);
        self
    }

    /// Takes in what a tile saw of the neighbours that it `used`; `core` in half-resolution pixels.
    pub(super) fn see(&mut self, core: Rect, used: &[bool], seen: &[f32]) {
        let (columns, count) = (self.image.dim().1 / 2, self.offsets.len());
        let places: Vec<usize> = (0..count).filter(|n| used[*n]).collect();
        for (y, row) in seen.chunks_exact((places.len() * SEEN * core.columns).max(1)).enumerate() {
            for (from, part) in row.chunks_exact(core.columns).enumerate() {
                let line = ((core.row + y) * count + places[from / SEEN]) * SEEN + from % SEEN;
                self.seen[line * columns + core.column..][..core.columns].copy_from_slice(part);
            }
        }
    }

    /// Lets go of what only its own second pass takes.
    pub fn averaged(&mut self) {
        (self.offsets, self.seen) = (Vec::new(), Vec::new());
    }

    /// Whether its own second pass is done and it only helps those of others.
    pub fn is_averaged(&self) -> bool {
        self.seen.is_empty()
    }

    /// Bytes that it holds.
    pub fn bytes(&self) -> usize {
        4 * (self.image.len() + self.seen.len()) + self.vectors.as_ref().map_or(0, |vectors| 16 * vectors.len())
    }

    /// Whether another one's pixels are of the same kind, but for alpha.
    pub(super) fn fits(&self, other: &Self) -> bool {
        (self.rows, self.columns, &self.aov_names) == (other.rows, other.columns, &other.aov_names)
    }

    /// The image, with an alpha of 1 where `alpha` is wanted of a frame whose own was not filtered.
    pub(super) fn image_with(&self, alpha: bool) -> Cow<'_, Array3<f32>> {
        if !alpha || self.channels.alpha {
            return Cow::Borrowed(&self.image);
        }
        let (rows, columns, _) = self.image.dim();
        let ones = Array3::ones((rows, columns, 1));
        let parts = [self.image.slice(s![.., .., ..3]), ones.view(), self.image.slice(s![.., .., 3..])];
        // Parts of one size are always joined.
        concatenate(Axis(2), &parts)
            .map_or(Cow::Borrowed(&self.image), |whole| Cow::Owned(whole.as_standard_layout().into_owned()))
    }

    /// This frame with another image; `alpha`: whether it has one, and whether it is among the values.
    pub(super) fn shown(&self, image: Array3<f32>, alpha: (bool, bool)) -> Denoised {
        unpack(image, (self.rows, self.columns), alpha, &self.aov_names)
    }

    /// The result, where there is no second pass.
    pub fn denoised(self) -> Denoised {
        unpack(self.image, (self.rows, self.columns), (self.has_alpha, self.channels.alpha), &self.aov_names)
    }
}
