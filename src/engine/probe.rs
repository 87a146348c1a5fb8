//! What the kernels of a frame are made from, for the float64 reference of the kernel stage.

use super::steps::{SILENT, Steps};
use super::{EncodedFrame, Engine};
use crate::frame::Dial;
use crate::frame::packed::PackedFrame;
use crate::kernels::FULL_PHASES;
use crate::kernels::planes::Planes;
use crate::kernels::weigh::offsets;
use crate::network::features::Features;
use crate::network::levels::{Level, Margins};
use crate::network::logits::RegionLogits;
use crate::network::pairs::{Neighbour, Pairs};
use crate::network::predictor::Head;
use crate::network::warp::{Warped, warp};
use crate::tiles::{Rect, Tile};

/// The logits of a frame that is denoised as one tile, with nothing left out, moved by the taps' keys.
pub(crate) struct Probe {
    /// Of the neighbours used, in the order of the logits.
    pub offsets: Vec<i32>,
    pub full: RegionLogits,
    /// Half resolution and coarser.
    pub coarse: Vec<RegionLogits>,
}

/// How the kernels over one image lie in a level's logits.
struct Kernels {
    /// In taps.
    width: usize,
    /// Outputs from sub-pixel to sub-pixel.
    pitch: usize,
    phases: usize,
    /// The output at which the queries begin.
    queries: usize,
}

impl Kernels {
    /// Adds to the logits, [output][row][column], what the taps' keys do, as the kernel stage does it.
    fn move_by_keys(&self, logits: &mut [f32], (rows, columns): (usize, usize), image: &Planes, key: usize) {
        let area = rows * columns;
        for phase in 0..self.phases {
            for (k, distance) in offsets(image, self.phases, phase, self.width, 1).into_iter().enumerate() {
                for pixel in 0..area {
                    let pixel_key = image.at(key * self.phases, (pixel / columns) as isize, (pixel % columns) as isize);
                    let key = image.data()[(pixel_key as isize + distance) as usize];
                    let query = |i: usize| logits[(self.queries + 2 * phase + i) * area + pixel];
                    let query = key.mul_add(query(1), query(0));
                    let logit = &mut logits[(phase * self.pitch + k) * area + pixel];
                    *logit = key.mul_add(query, *logit);
                }
            }
        }
    }
}

impl Engine {
    /// Runs the network on all of `centre`; arguments as for [`Engine::denoise`], λ in its range.
    pub(crate) fn probe(&self, centre: &EncodedFrame, neighbours: &[(i32, &EncodedFrame)], lambda: f32) -> Probe {
        let plan = self.work(centre, neighbours, self.settings.skip);
        let region = Rect { row: 0, column: 0, rows: centre.packed.padded_rows / 2, columns: centre.packed.padded_columns / 2 };
        let stages = self.tile(&plan, Tile { core: region, region }, Dial::Constant(lambda), Steps::whole(SILENT));
        let margins = Margins::new(self.widths[0].max(self.widths[1]).max(self.widths[3]), self.widths[2]);
        let used = plan.paths.iter().zip(&stages.used).filter(|(_, used)| **used).map(|(path, _)| path);
        let (offsets, seen): (Vec<i32>, Vec<(&Features, Warped)>) = used
            .map(|path| {
                let frames: Vec<&PackedFrame> = path.frames.iter().map(|f| &f.packed).collect();
                let way = (path.offset, self.settings.skip.still && path.is_still());
                let (_, warped) = warp(self.isa, &frames, way, region, &plan.channels, margins.full, &self.buffers);
                (path.offset, (&*path.neighbour().features, warped))
            })
            .unzip();
        let neighbours: Vec<Neighbour> = seen.iter().map(|(features, warped)| Neighbour { features, warped }).collect();
        let (counts, key) = (self.predictor.taps, plan.channels.key());
        let half = Pairs::Half(&neighbours, region);
        let logits = |head: &Head, (features, pairs), level: &Level, phases| {
            let mut out = RegionLogits::new(self.isa, head, features, pairs);
            // At full resolution a sub-pixel's albedo taps, and its coarse ones, lie between its taps and the next one's.
            let (pitch, near_pitch) =
                if phases == 1 { (0, 0) } else { (counts.centre + counts.coarse + counts.albedo, counts.neighbour + 1) };
            let size = (out.rows, out.columns);
            let own = Kernels { width: self.widths[0], pitch, phases, queries: head.starts.queries };
            own.move_by_keys(&mut out.centre, size, &level.centre, key);
            let near = Kernels { width: self.widths[1], pitch: near_pitch, phases, queries: head.pair_starts.queries };
            out.pairs.iter_mut().zip(&level.neighbours).for_each(|(pair, image)| near.move_by_keys(pair, size, image, key));
            out
        };
        let pairs = std::iter::once(half).chain(stages.gathered.iter().map(Pairs::Coarser));
        let coarse = self.predictor.coarse.iter().zip(stages.features.iter().zip(pairs)).zip(&stages.pyramid.coarse);
        Probe {
            full: logits(&self.predictor.full, (&stages.features[0], half), &stages.pyramid.full, FULL_PHASES),
            coarse: coarse.map(|((head, known), level)| logits(head, known, level, 1)).collect(),
            offsets,
        }
    }

    /// Pixels around a pixel of a frame beyond which nothing of that frame matters, but for its exposure and mean depth.
    pub(crate) fn reach(&self) -> usize {
        self.kernel_and_body_reach() + self.encoder_reach()
    }
}
