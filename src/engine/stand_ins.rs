//! The frames of a window as the engine takes them together: all with an alpha, or none.

use super::{EncodedFrame, Engine};
use crate::frame::ranges::Ranges;

/// Stand-ins for the frames of a window that came without alpha where others came with one: an alpha of 1 all over is not even read.
pub(super) struct StandIns {
    centre: Option<EncodedFrame>,
    neighbours: Vec<Option<EncodedFrame>>,
}

impl StandIns {
    /// The window with these in it.
    pub fn window<'a>(
        &'a self,
        centre: &'a EncodedFrame,
        neighbours: &[(i32, &'a EncodedFrame)],
    ) -> (&'a EncodedFrame, Vec<(i32, &'a EncodedFrame)>) {
        let near = neighbours.iter().zip(&self.neighbours).map(|((offset, given), own)| (*offset, own.as_ref().unwrap_or(given)));
        (self.centre.as_ref().unwrap_or(centre), near.collect())
    }
}

impl EncodedFrame {
    /// Whether another frame's pixels are of the same kind, but for alpha. Colours divided by an albedo and colours that are not cannot be
    /// averaged.
    pub(super) fn fits(&self, other: &Self) -> bool {
        let form = |f: &Self| (f.packed.rows, f.packed.columns, f.packed.has_albedo);
        form(self) == form(other) && self.packed.aov_names == other.packed.aov_names
    }
}

impl Engine {
    /// What stands in for frames without alpha, where some that can be averaged with the centre have one.
    pub(super) fn stand_ins(&self, centre: &EncodedFrame, neighbours: &[(i32, &EncodedFrame)]) -> StandIns {
        let fitting = || neighbours.iter().map(|n| n.1).filter(|f| f.fits(centre)).chain([centre]);
        let is_mixed = fitting().any(EncodedFrame::has_alpha) && !fitting().all(EncodedFrame::has_alpha);
        let opaque = |frame: &EncodedFrame| {
            (is_mixed && frame.fits(centre) && !frame.has_alpha()).then(|| {
                let packed = frame.packed.with_opaque_alpha(&self.buffers);
                EncodedFrame { ranges: Ranges::new(&packed), packed, features: frame.features.clone() }
            })
        };
        self.in_pool(|| StandIns { centre: opaque(centre), neighbours: neighbours.iter().map(|n| opaque(n.1)).collect() })
    }
}
