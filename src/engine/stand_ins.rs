//! The frames of a window as the engine takes them together: all with an alpha, or none.

use super::{EncodedFrame, Engine};
use crate::frame::ranges::Ranges;

impl EncodedFrame {
    /// Whether another frame's pixels are of the same kind, but for alpha. Colours divided by an albedo and colours that are not cannot be
    /// averaged.
    pub(super) fn fits(&self, other: &Self) -> bool {
        let form = |f: &Self| (f.packed.rows, f.packed.columns, f.packed.has_albedo);
        form(self) == form(other) && self.packed.aov_names == other.packed.aov_names
    }
}

impl Engine {
    /// Does some work in the engine's threads with a frame and those around it. Where some that can be averaged came with an alpha, others
    /// stand in for those without: an alpha of 1 all over is not even read.
    pub(super) fn with_window<T: Send>(
        &self,
        centre: &EncodedFrame,
        neighbours: &[(i32, &EncodedFrame)],
        work: impl FnOnce(&EncodedFrame, &[(i32, &EncodedFrame)]) -> T + Send,
    ) -> T {
        let fitting = || neighbours.iter().map(|n| n.1).filter(|f| f.fits(centre)).chain([centre]);
        let is_mixed = fitting().any(EncodedFrame::has_alpha) && !fitting().all(EncodedFrame::has_alpha);
        let stand_in = |frame: &EncodedFrame| {
            (is_mixed && frame.fits(centre) && !frame.has_alpha()).then(|| {
                let packed = frame.packed.with_opaque_alpha(&self.buffers);
                EncodedFrame { ranges: Ranges::new(&packed), packed, features: frame.features.clone() }
            })
        };
        self.in_pool(|| {
            let (own, near) = (stand_in(centre), neighbours.iter().map(|n| stand_in(n.1)).collect::<Vec<_>>());
            let neighbours: Vec<(i32, &EncodedFrame)> =
                neighbours.iter().zip(&near).map(|((offset, given), near)| (*offset, near.as_ref().unwrap_or(given))).collect();
            work(own.as_ref().unwrap_or(centre), &neighbours)
        })
    }
}
