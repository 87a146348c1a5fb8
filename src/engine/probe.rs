//! What the kernels of a frame are made from, for the float64 reference of the kernel stage.

use super::{EncodedFrame, Engine, LEVELS};
use crate::frame::packed::PackedFrame;
use crate::network::features::Features;
use crate::network::levels::Margins;
use crate::network::logits::RegionLogits;
use crate::network::pairs::Neighbour;
use crate::network::warp::{Warped, warp};
use crate::plan::tiles::{Rect, Tile};

/// The logits of a frame that is denoised as one tile, with nothing left out.
pub(crate) struct Probe {
    /// Of the neighbours used, in the order of the logits.
    pub offsets: Vec<i32>,
    pub full: RegionLogits,
    /// Half resolution and coarser.
    pub coarse: Vec<RegionLogits>,
}

impl Engine {
    /// Runs the network on all of `centre`; arguments as for [`Engine::denoise`], λ in its range.
    pub(crate) fn probe(&self, centre: &EncodedFrame, neighbours: &[(i32, &EncodedFrame)], lambda: f32) -> Probe {
        let plan = self.plan(centre, neighbours, self.settings.skip, LEVELS);
        let region = Rect { row: 0, column: 0, rows: centre.packed.padded_rows / 2, columns: centre.packed.padded_columns / 2 };
        let stages = self.tile(&plan, Tile { core: region, region }, lambda);
        let margins = Margins::new(self.widths[0].max(self.widths[1]).max(self.widths[3]), self.widths[2]);
        let used = plan.paths.iter().zip(&stages.used).filter(|(_, used)| **used).map(|(path, _)| path);
        let (offsets, seen): (Vec<i32>, Vec<(&Features, Warped)>) = used
            .map(|path| {
                let frames: Vec<&PackedFrame> = path.frames.iter().map(|f| &f.packed).collect();
                let way = (path.offset, self.settings.skip.still && path.is_still());
                let (_, warped) = warp(self.isa, &frames, way, region, &plan.channels, margins.full);
                (path.offset, (&path.neighbour().features, warped))
            })
            .unzip();
        let pairs: Vec<Neighbour> = seen.iter().map(|(features, warped)| Neighbour { features, warped }).collect();
        let logits = |head, features| RegionLogits::new(self.isa, head, features, &pairs, region);
        Probe {
            full: logits(&self.predictor.full, &stages.features[0]),
            coarse: self.predictor.coarse.iter().zip(&stages.features).map(|(head, features)| logits(head, features)).collect(),
            offsets,
        }
    }

    /// Pixels around a pixel of a frame beyond which nothing of that frame matters, but for its exposure and mean depth.
    pub(crate) fn reach(&self) -> usize {
        2 * (self.halo() + crate::network::encoder::HALO)
    }
}
