//! The second pass over time of a frame, with the first pass's results around it.

use std::borrow::Cow;

use ndarray::Array3;

use super::{Denoised, Engine, FirstPass, Stage};
use crate::frame::pixels::Pixels;
use crate::network::motion::Motion;
use crate::network::second_pass::{Near, Own, second_pass};

/// A neighbour, the frames that lead to it, and its place among those that have logits.
struct Around<'a> {
    frames: Vec<&'a FirstPass>,
    later: bool,
    index: usize,
}

impl<'a> Around<'a> {
    fn neighbour(&self) -> &'a FirstPass {
        self.frames[self.frames.len() - 1]
    }
}

impl Engine {
    /// Whether a second pass over time follows: the weights have one, and the settings want it.
    pub fn has_second_pass(&self) -> bool {
        self.identity.second_pass
    }

    /// Averages a frame's result with those of `neighbours`, (offset, frame) in any order, each after its own first pass. Frames that did
    /// not help in the first pass are left out, as are those behind a frame that is not given. Where there is none, or no second pass
    /// is to follow, the result is the first pass's, bit by bit.
    pub fn second_pass(&self, centre: &FirstPass, neighbours: &[(i32, &FirstPass)]) -> Denoised {
        self.in_pool(|| self.clock.time(Stage::SecondPass, || self.average(centre, neighbours)))
    }

    fn average(&self, centre: &FirstPass, neighbours: &[(i32, &FirstPass)]) -> Denoised {
        let at = |offset: i32| neighbours.iter().find(|(o, f)| *o == offset && f.fits(centre)).map(|(_, f)| *f);
        let around = |(index, offset): (usize, &i32)| {
            let path: Option<Vec<&FirstPass>> = (1..=offset.abs()).map(|step| at(step * offset.signum())).collect();
            let frames: Vec<&FirstPass> = std::iter::once(centre).chain(path?).collect();
            Some(Around { frames, later: *offset > 0, index })
        };
        let around: Vec<Around> = centre.offsets.iter().enumerate().filter_map(around).collect();
        if around.is_empty() {
            return centre.shown(centre.image.clone(), (centre.has_alpha, centre.channels.alpha));
        }
        let alpha = centre.channels.alpha || around.iter().any(|a| a.neighbour().channels.alpha);
        let image = centre.image_with(alpha);
        let images: Vec<Cow<'_, Array3<f32>>> = around.iter().map(|a| a.neighbour().image_with(alpha)).collect();
        let (rows, columns, _) = image.dim();
        let near = around.iter().zip(&images).map(|(a, image)| {
            let vectors: Vec<Option<&Pixels<4>>> = a.frames.iter().map(|f| f.vectors.as_deref()).collect();
            let motion = Motion { vectors, later: a.later, rows, columns };
            Near { image, motion, still: a.frames.iter().all(|f| f.still), index: a.index }
        });
        let near: Vec<Near> = near.collect();
        let own = Own { image: &image, exposure: centre.exposure, seen: &centre.seen, count: centre.offsets.len() };
        let has_alpha = centre.has_alpha || around.iter().any(|a| a.neighbour().has_alpha);
        centre.shown(second_pass(self.isa, own, &near), (has_alpha, alpha))
    }
}
