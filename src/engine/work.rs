//! What is computed of one frame, tile by tile.

use ndarray::{Array3, s};

use super::paths::{Path, paths};
use super::steps::{Listener, Steps};
use super::unpack::own_pixels;
use super::{EncodedFrame, Engine, FirstPass, LeftOut, Skip};
use crate::frame::Dial;
use crate::kernels::Channels;
use crate::network::levels::SEEN;
use crate::network::warp::EXTRAS;
use crate::tiles::active::{RangePath, active_blocks};
use crate::tiles::cover::cover;
use crate::tiles::{Rect, Tile, tiles};

/// What the frames in the window and one tile may take together where nothing is said.
const MEMORY: u64 = 3200 << 20;
/// What one tile takes at most and at least, whatever is allowed: a whole 1080p frame with a ±2 window takes about the most.
const TILE_MEMORY: (u64, u64) = (320 << 20, 1200 << 20);

/// What is computed of one frame, and from what.
pub(super) struct FrameWork<'a> {
    pub centre: &'a EncodedFrame,
    pub paths: Vec<Path<'a>>,
    pub channels: Channels,
    /// In half-resolution pixels; the rest keeps its own pixels.
    parts: Vec<Rect>,
    pub skip: Skip,
    /// Whether the second pass is to follow.
    pub second: bool,
    left_out: LeftOut,
}

impl FrameWork<'_> {
    /// Bytes that the frames of the window hold.
    pub fn window_bytes(&self) -> usize {
        self.paths.iter().map(|p| p.neighbour().bytes()).sum::<usize>() + self.centre.bytes()
    }

    /// About what the frames hold that a second pass keeps: their results, what it takes of their neighbours, and vectors beyond the window.
    fn kept_bytes(&self) -> usize {
        let (pixels, count) = (self.centre.packed.padded_rows * self.centre.packed.padded_columns, self.paths.len());
        let ahead = count.div_ceil(2);
        pixels * ((count + 1) * 4 * self.channels.values + (ahead + 1) * count * SEEN + ahead * 16)
    }

    /// What was left out, once it is known which neighbours had anything to give.
    pub fn left_out(&self, used: &[bool]) -> LeftOut {
        LeftOut { untrusted: used.iter().filter(|used| !**used).count(), ..self.left_out }
    }
}

impl Engine {
    pub(super) fn work<'a>(&self, centre: &'a EncodedFrame, neighbours: &[(i32, &'a EncodedFrame)], skip: Skip) -> FrameWork<'a> {
        let packed = &centre.packed;
        let mut left_out = LeftOut::default();
        let coarse_modulation = self.predictor.albedo_levels > 1;
        let mut channels = Channels {
            coarse_modulation,
            alpha_as_modulation: packed.has_alpha && packed.has_albedo,
            ..Channels::new(packed.extra, packed.has_alpha)
        };
        let paths = paths(centre, neighbours);
        let window = || paths.iter().map(Path::neighbour).chain([centre]);
        if skip.opaque && channels.alpha && window().all(|f| f.ranges.opaque) {
            channels = channels.opaque();
            left_out.alpha = true;
        }
        let (rows, columns) = (packed.padded_rows / 2, packed.padded_columns / 2);
        let whole = Rect { row: 0, column: 0, rows, columns };
        let mut parts = vec![whole];
        if skip.constant {
            let ranges =
                |path: &Path<'a>| RangePath { frames: path.frames.iter().map(|f| &f.ranges).collect(), later: path.offset > 0 };
            let paths: Vec<RangePath> = paths.iter().map(ranges).collect();
            let active = active_blocks(&centre.ranges, &paths, 2 * self.kernel_reach());
            parts = cover(&active, rows, columns, self.halo());
            let kept: usize = parts.iter().map(|p| p.grown(self.halo(), rows, columns).area()).sum();
            left_out.constant = 1.0 - (kept as f64 / whole.area() as f64).min(1.0);
        }
        left_out.still = if skip.still { paths.iter().filter(|p| p.is_still()).count() } else { 0 };
        FrameWork { centre, paths, channels, parts, skip, second: false, left_out }
    }

    /// With the second pass to follow, where there is one.
    pub(super) fn then_second<'a>(&self, work: FrameWork<'a>) -> FrameWork<'a> {
        FrameWork { second: self.has_second_pass(), ..work }
    }

    pub(super) fn run(&self, work: &FrameWork, dial: Dial, listener: Listener<'_>) -> (FirstPass, LeftOut) {
        let FrameWork { centre, paths, channels, .. } = work;
        let packed = &centre.packed;
        let (half_rows, half_columns) = (packed.padded_rows / 2, packed.padded_columns / 2);
        let (tiles, tile) = self.tiles(work);
        // Tiles of several sizes leave buffers behind that fit nothing; a single one is the same size frame after frame.
        self.buffers.keep_at_most(if tiles.len() == 1 { TILE_MEMORY.1 as usize } else { tile / 4 });
        let offsets: Vec<i32> = paths.iter().map(|path| path.offset).collect();
        let made = |image| {
            let made = FirstPass::new(image, centre, *channels);
            if work.second { made.kept(centre, offsets.clone()) } else { made }
        };
        let covered = tiles.iter().map(|t| t.core.area()).sum::<usize>() == half_rows * half_columns;
        if let ([whole], true) = (&tiles[..], covered) {
            let stages = self.tile(work, *whole, dial, Steps::whole(listener));
            let mut first = made(stages.image);
            first.see(whole.core, &stages.used, &stages.seen);
            return (first, work.left_out(&stages.used));
        }
        let size = (packed.padded_rows, packed.padded_columns, channels.values);
        let mut first = made(if covered { Array3::zeros(size) } else { own_pixels(packed, channels) });
        let mut used = vec![tiles.is_empty(); paths.len()];
        let (all, mut done) = (tiles.iter().map(|t| t.region.area()).sum::<usize>() as f64, 0.0);
        for tile in tiles {
            let steps = Steps { listener, before: done, share: tile.region.area() as f64 / all };
            let stages = self.tile(work, tile, dial, steps);
            done += steps.share;
            let c = tile.core;
            let part = s![2 * c.row..2 * (c.row + c.rows), 2 * c.column..2 * (c.column + c.columns), ..];
            first.image.slice_mut(part).assign(&stages.image);
            first.see(c, &stages.used, &stages.seen);
            used.iter_mut().zip(stages.used).for_each(|(all, one)| *all |= one);
        }
        (first, work.left_out(&used))
    }

    /// The tiles of what is to be computed, and what one may take in bytes.
    pub(super) fn tiles(&self, work: &FrameWork) -> (Vec<Tile>, usize) {
        let packed = &work.centre.packed;
        let (half_rows, half_columns) = (packed.padded_rows / 2, packed.padded_columns / 2);
        let held = work.window_bytes() + if work.second { work.kept_bytes() } else { 0 };
        let left = |allowed: u64| allowed.saturating_sub(held as u64).min(TILE_MEMORY.1);
        let tile = self.settings.memory.map_or(left(MEMORY).max(TILE_MEMORY.0), left) as usize;
        let area = tile / self.bytes_per_pixel(&work.channels, work.paths.len());
        (work.parts.iter().flat_map(|p| tiles(*p, half_rows, half_columns, self.halo(), area)).collect(), tile)
    }

    /// Bytes that one half-resolution pixel of a tile takes.
    pub(super) fn bytes_per_pixel(&self, channels: &Channels, neighbours: usize) -> usize {
        let images = (1 + neighbours) * (4 * channels.full() + 2 * channels.coarse());
        let gathered = neighbours * (self.features + EXTRAS) * 5 / 16;
        4 * (self.channels_per_pixel + images + neighbours * (EXTRAS + 4) + gathered + 4 * channels.values)
    }
}
