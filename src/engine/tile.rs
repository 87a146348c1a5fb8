//! One tile through the network and the kernels.

use ndarray::Array3;

use super::Engine;
use super::clock::Stage;
use super::paths::Path;
use super::steps::{Mark, Steps};
use super::work::FrameWork;
use crate::frame::Dial;
use crate::frame::packed::PackedFrame;
use crate::kernels::planes::Planes;
use crate::layers::Activation;
use crate::network::gathered::Gathered;
use crate::network::levels::{Level, Levels, Margins, Pyramid, pyramid_of};
use crate::network::pairs::Neighbour;
use crate::network::specialisation::Codes;
use crate::network::variance::variances;
use crate::network::warp::{Warped, centre_planes, warp};
use crate::tiles::Tile;

/// What one tile's pass leaves behind; all but the image is for the comparison with PyTorch.
#[cfg_attr(not(test), allow(dead_code))]
pub(super) struct Stages {
    /// The body's, at half, quarter and eighth resolution.
    pub features: [Activation; 3],
    pub gathered: [Gathered; 2],
    pub pyramid: Pyramid,
    /// The denoised coarser levels, half resolution last.
    pub coarse: Vec<Planes>,
    /// The core, (rows, columns, values).
    pub image: Array3<f32>,
    /// What the second pass takes of the neighbours that had any pixel to give, as [`Levels::full`] says.
    pub seen: Vec<f32>,
    /// For each neighbour whether it had any pixel to give.
    pub used: Vec<bool>,
}

impl Engine {
    pub(super) fn tile(&self, work: &FrameWork, tile: Tile, dial: Dial, steps: Steps<'_>) -> Stages {
        let (centre, channels, skip, region) = (work.centre, work.channels, work.skip, tile.region);
        let margins = Margins::new(self.widths[0].max(self.widths[1]).max(self.widths[3]), self.widths[2]);
        let seen = work.paths.iter().enumerate().map(|(index, path)| {
            let frames: Vec<&PackedFrame> = path.frames.iter().map(|f| &f.packed).collect();
            let still = skip.still && path.is_still();
            let offset = (path.offset, still);
            let warped =
                self.clock.time(Stage::Warp, || warp(self.isa, &frames, offset, region, &channels, margins.full, &self.buffers));
            steps.reached(Mark::WARPED.part(index + 1, work.paths.len()));
            (path, warped)
        });
        let mut used = Vec::with_capacity(work.paths.len());
        let seen = seen.filter(|(_, (_, warped))| {
            used.push(warped.trusted || !skip.untrusted);
            warped.trusted || !skip.untrusted
        });
        let (paths, (images, warped)): (Vec<&Path>, (Vec<Planes>, Vec<Warped>)) = seen.unzip();
        let pyramid = self.clock.time(Stage::Coarse, || {
            let own = centre_planes(self.isa, &centre.packed, region, &channels, margins.full, &self.buffers);
            let full = Level { centre: own, neighbours: images };
            pyramid_of(self.isa, full, &channels, margins, (self.levels, centre.packed.exposure))
        });
        steps.reached(Mark::PYRAMID);
        let neighbours: Vec<Neighbour> =
            paths.iter().zip(&warped).map(|(path, warped)| Neighbour { features: &path.neighbour().features, warped }).collect();
        let (mixed, gathered) = self.clock.time(Stage::Temporal, || {
            let noise = self.temporal.wants_variances().then(|| variances(self.isa, &pyramid.full, &channels));
            let (mixed, quarter) =
                self.temporal.run(self.isa, &centre.features, &neighbours, noise.as_ref(), region, &self.buffers);
            let eighth = quarter.halved();
            (mixed, [quarter, eighth])
        });
        steps.reached(Mark::TEMPORAL);
        let features = self.clock.time(Stage::Body, || self.body.run(self.isa, mixed, (dial, region)));
        steps.reached(Mark::BODY);
        let levels = Levels {
            isa: self.isa,
            predictor: &self.predictor,
            channels,
            margins,
            pyramid: &pyramid,
            features: &features,
            neighbours: &neighbours,
            gathered: &gathered,
            tile,
            widths: self.widths,
            second: work.second.then(|| Codes::half(dial, region)),
        };
        let coarse = self.clock.time(Stage::Coarse, || levels.coarse());
        steps.reached(Mark::COARSE);
        let (image, seen) = self.clock.time(Stage::Full, || levels.full(coarse.last()));
        steps.reached(Mark::FULL);
        Stages { features, gathered, pyramid, coarse, image, seen, used }
    }

    #[cfg(test)]
    pub(super) fn stages(&self, centre: &super::EncodedFrame, neighbours: &[(i32, &super::EncodedFrame)], dial: Dial) -> Stages {
        let work = self.then_second(self.work(centre, neighbours, self.settings.skip));
        let whole = crate::tiles::Rect {
            row: 0,
            column: 0,
            rows: centre.packed.padded_rows / 2,
            columns: centre.packed.padded_columns / 2,
        };
        self.tile(&work, Tile { core: whole, region: whole }, dial, Steps::whole(super::SILENT))
    }
}
