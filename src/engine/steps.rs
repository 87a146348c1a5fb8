//! How far the work on one frame is.

/// What of a tile's time has passed where a stage ends, measured at 1080p with a window of ±2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mark(f64);

impl Mark {
    /// The neighbours' pixels are fetched.
    pub const WARPED: Self = Self(0.17);
    /// The pyramid's images are there.
    pub const PYRAMID: Self = Self(0.22);
    /// The temporal extractor is done.
    pub const TEMPORAL: Self = Self(0.36);
    /// The body is done.
    pub const BODY: Self = Self(0.78);
    /// The coarser levels are denoised.
    pub const COARSE: Self = Self(0.86);
    /// The tile is done.
    pub const FULL: Self = Self(1.0);

    /// So many of so many parts of the way to here, from the beginning of the tile.
    pub fn part(self, done: usize, of: usize) -> Self {
        Self(self.0 * done as f64 / of.max(1) as f64)
    }
}

/// Hears how far a frame is, 0…1.
pub type Listener<'a> = &'a (dyn Fn(f64) + Sync);

/// One tile among those of a frame: its share of the pixels computed, and what was done before it.
#[derive(Clone, Copy)]
pub(super) struct Steps<'a> {
    pub listener: Listener<'a>,
    pub before: f64,
    pub share: f64,
}

/// Nobody listens.
pub const SILENT: Listener<'static> = &|_| ();

impl<'a> Steps<'a> {
    /// Of a frame that is one tile.
    pub fn whole(listener: Listener<'a>) -> Self {
        Self { listener, before: 0.0, share: 1.0 }
    }

    /// Tells that a stage of this tile has ended.
    pub fn reached(&self, mark: Mark) {
        (self.listener)((self.before + self.share * mark.0).min(1.0));
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use ndarray::Array3;

    use crate::engine::{Engine, Settings};
    use crate::frame::Frame;

    #[test]
    fn what_is_heard_rises_to_one_over_any_tiles_and_changes_no_bit() {
        let noise = |y: usize, x: usize, c: usize| ((y * 7919 + x * 104_729 + c * 31) % 997) as f32 / 500.0;
        let frame = Frame::new(Array3::from_shape_fn((400, 640, 3), |(y, x, c)| noise(y, x, c)));
        let mut counts = Vec::new();
        let mut images = Vec::new();
        for memory in [None, Some(1 << 20)] {
            let engine = Engine::new(Settings { memory, ..Settings::default() }).unwrap();
            let encoded = engine.encode(frame.clone()).unwrap();
            let heard = Mutex::new(Vec::new());
            let (made, _) = engine.denoise_with(&encoded, &[], 2.0, engine.skip(), &|f| heard.lock().unwrap().push(f)).unwrap();
            let heard = heard.into_inner().unwrap();
            assert!(heard.windows(2).all(|w| w[1] >= w[0]) && heard[0] > 0.0 && heard[heard.len() - 1] > 0.999, "{heard:?}");
            counts.push(heard.len());
            images.push(made.colour);
            assert_eq!(images[0], engine.denoise(&encoded, &[], 2.0).unwrap().colour);
        }
        assert_eq!(images[0], images[1]);
        assert!(counts[1] >= 2 * counts[0], "{counts:?}");
    }
}
