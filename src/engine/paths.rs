//! The neighbours that a frame can use, with the frames that lead to each.

use super::EncodedFrame;
use crate::rules::window::MAX_WINDOW;

/// The frames from the centre to a neighbour, one step of motion each.
pub(super) struct Path<'a> {
    pub offset: i32,
    pub frames: Vec<&'a EncodedFrame>,
}

impl<'a> Path<'a> {
    pub fn neighbour(&self) -> &'a EncodedFrame {
        self.frames[self.frames.len() - 1]
    }

    /// Whether nothing moves from the centre to the neighbour and back.
    pub fn is_still(&self) -> bool {
        self.frames.iter().all(|f| f.ranges.still)
    }
}

/// For each usable neighbour the frames from the centre to it, nearest neighbours first.
pub(super) fn paths<'a>(centre: &'a EncodedFrame, neighbours: &[(i32, &'a EncodedFrame)]) -> Vec<Path<'a>> {
    let fits = |f: &EncodedFrame| f.fits(centre) && f.has_alpha() == centre.has_alpha();
    let at = |offset: i32| neighbours.iter().find(|(o, f)| *o == offset && fits(f)).map(|(_, f)| *f);
    let mut out = Vec::new();
    for distance in 1..=MAX_WINDOW as i32 {
        for sign in [-1, 1] {
            let path: Option<Vec<&EncodedFrame>> = (1..=distance).map(|d| at(sign * d)).collect();
            let Some(path) = path else { continue };
            let frames: Vec<&EncodedFrame> = std::iter::once(centre).chain(path).collect();
            if frames[..frames.len() - 1].iter().all(|f| f.has_vectors()) {
                out.push(Path { offset: sign * distance, frames });
            }
        }
    }
    out
}
