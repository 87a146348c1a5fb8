//! Checks that need the frames' pixels: noise that repeats, motion vectors that are empty.

use super::checks::{Warning, WarningKind};
use crate::frame::Frame;

/// What the pixel checks need to know of a decoded frame; a few hundred kilobytes.
#[derive(Debug)]
pub struct Glance {
    size: (usize, usize),
    /// Colours at the sample points, as bits, and whether the colour differs from the pixel to the right.
    samples: Vec<([u32; 3], bool)>,
    /// None without a Vector pass.
    vector_zero: Option<bool>,
}

/// Sample points of a glance, at most about this many.
const SAMPLES: usize = 16_384;

impl Glance {
    /// Looks at a frame.
    pub fn of(frame: &Frame) -> Self {
        let (rows, columns) = frame.size();
        let stride = rows.saturating_mul(columns).div_ceil(SAMPLES).max(1);
        let bits = |i: usize| -> [u32; 3] {
            let at = |c: usize| frame.colour.get((i / columns, i % columns, c)).copied().unwrap_or(0.0).to_bits();
            [at(0), at(1), at(2)]
        };
        // An odd stride in pixels does not keep to one column.
        let samples = (0..rows * columns)
            .step_by(stride | 1)
            .filter(|i| i % columns + 1 < columns)
            .map(|i| (bits(i), bits(i) != bits(i + 1)))
            .collect();
        Self { size: (rows, columns), samples, vector_zero: frame.vector.as_ref().map(|v| v.iter().all(|x| *x == 0.0)) }
    }

    /// Share of the textured or noisy sample points that are bit-identical in both; None where there are too few to tell.
    fn identical(&self, other: &Self) -> Option<f32> {
        if self.size != other.size {
            return None;
        }
        // Flat areas (a plain background) are identical without anything being wrong.
        let pairs = self.samples.iter().zip(&other.samples).filter(|(a, b)| a.1 || b.1);
        let (mut all, mut same) = (0usize, 0usize);
        for (a, b) in pairs {
            all += 1;
            same += usize::from(a.0 == b.0);
        }
        (all >= 16).then(|| same as f32 / all as f32)
    }
}

/// What a frame gave reason to say.
#[derive(Debug, Default)]
pub struct FrameFindings {
    /// About this frame, for the manifest.
    pub note: Option<String>,
    /// About the shot, once.
    pub warning: Option<Warning>,
}

/// The checks that need pixels, fed with the frames in order as they are decoded.
#[derive(Debug, Default)]
pub struct PixelChecks {
    previous: Option<(i64, Glance)>,
    repeated: bool,
    with_vector: usize,
    moving: bool,
    differs: bool,
}

impl PixelChecks {
    /// Takes the next frame; warns at the first pair of frames with the same noise.
    pub fn look(&mut self, number: i64, glance: Glance) -> FrameFindings {
        self.with_vector += usize::from(glance.vector_zero.is_some());
        self.moving |= glance.vector_zero == Some(false);
        let mut found = FrameFindings::default();
        if let Some((before, last)) = self.previous.as_ref().filter(|(n, _)| n + 1 == number) {
            let identical = last.identical(&glance);
            self.differs |= identical.is_some_and(|share| share < 0.5);
            if identical.is_some_and(|share| share > 0.5) {
                found.note = Some(format!("the same noise as in frame {before}"));
                let message = format!(
                    "frames {before} and {number} have the same noise, so neighbours add nothing: turn on Render › Sampling › \
                     Advanced › Seed › the clock icon (animated seed) and render again"
                );
                found.warning = (!self.repeated).then(|| Warning::new(WarningKind::RepeatedNoise, message));
                self.repeated = true;
            }
        }
        self.previous = Some((number, glance));
        found
    }

    /// After a run's last frame: a Vector pass that was zero throughout although the colour changed.
    pub fn finish(&self) -> Option<Warning> {
        let message = "the Vector pass is zero in every frame: either nothing moves, or motion blur was on, which empties the pass; \
                       then render Vector in a second view layer without motion blur and set vector layer to NAME";
        (self.with_vector > 1 && !self.moving && self.differs).then(|| Warning::new(WarningKind::ZeroVector, message))
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;

    /// Noise from a seed, with or without vectors of a value.
    fn frame(seed: u32, vector: Option<f32>) -> Frame {
        let hash = |i: usize| (i as u32).wrapping_mul(2654435761).wrapping_add(seed.wrapping_mul(40503)) >> 9;
        let mut f = Frame::new(Array3::from_shape_fn((20, 30, 3), |(r, c, k)| hash(r * 97 + c * 3 + k) as f32));
        f.vector = vector.map(|v| Array3::from_elem((20, 30, 4), v));
        f
    }

    fn look(frames: &[Frame]) -> (Vec<WarningKind>, Option<WarningKind>) {
        let mut checks = PixelChecks::default();
        let seen =
            frames.iter().enumerate().filter_map(|(n, f)| checks.look(n as i64, Glance::of(f)).warning.map(|w| w.kind)).collect();
        (seen, checks.finish().map(|w| w.kind))
    }

    #[test]
    fn a_sound_shot_gets_no_warning() {
        assert_eq!(look(&[frame(1, Some(2.0)), frame(2, Some(2.0)), frame(3, Some(0.0))]), (vec![], None));
    }

    #[test]
    fn the_same_noise_twice_is_found_once() {
        let shot = [frame(1, None), frame(1, None), frame(1, None)];
        assert_eq!(look(&shot), (vec![WarningKind::RepeatedNoise], None));
    }

    #[test]
    fn a_flat_background_is_no_repeated_noise() {
        let mut shot = [frame(1, None), frame(2, None)];
        for f in &mut shot {
            f.colour.slice_mut(ndarray::s![..18, .., ..]).fill(0.5);
        }
        assert_eq!(look(&shot), (vec![], None));
        let flat = Frame::new(Array3::from_elem((20, 30, 3), 0.5));
        assert_eq!(look(&[flat.clone(), flat]), (vec![], None));
    }

    #[test]
    fn zero_vectors_matter_only_where_the_colour_changes() {
        assert_eq!(look(&[frame(1, Some(0.0)), frame(2, Some(0.0))]).1, Some(WarningKind::ZeroVector));
        assert_eq!(look(&[frame(1, Some(0.0)), frame(1, Some(0.0))]).1, None);
        assert_eq!(look(&[frame(1, Some(0.0))]).1, None);
        assert_eq!(look(&[frame(1, Some(f32::NAN)), frame(2, Some(0.0))]).1, None);
    }

    #[test]
    fn tiny_frames_are_looked_at_without_a_fault() {
        for size in [(1, 1), (1, 7), (7, 1), (0, 0)] {
            let f = Frame::new(Array3::zeros((size.0, size.1, 3)));
            assert!(Glance::of(&f).identical(&Glance::of(&f)).is_none());
        }
    }
}
