//! Where an engine's time goes: one counter a stage, read by the report.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use serde::Serialize;

/// A stage of the work on one frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Stage {
    /// Sanitising a frame and computing its features, once a frame.
    Encode,
    /// Fetching the neighbours' pixels along the motion.
    Warp,
    /// The temporal extractor.
    Temporal,
    /// The body of the network.
    Body,
    /// The pyramid's images, and prediction and kernels at its coarser levels.
    Coarse,
    /// Prediction and kernels at full resolution.
    Full,
    /// Putting the result into images.
    Unpack,
    /// Averaging the result with those around it, where a second pass over time follows.
    SecondPass,
}

/// All stages, in the order of the work.
pub const STAGES: [Stage; 8] =
    [Stage::Encode, Stage::Warp, Stage::Temporal, Stage::Body, Stage::Coarse, Stage::Full, Stage::Unpack, Stage::SecondPass];

impl Stage {
    /// In a few words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Encode => "encode",
            Self::Warp => "warp",
            Self::Temporal => "temporal",
            Self::Body => "body",
            Self::Coarse => "coarse levels",
            Self::Full => "full level",
            Self::Unpack => "unpack",
            Self::SecondPass => "second pass",
        }
    }
}

/// Nanoseconds by stage since the engine was made, all calls together.
#[derive(Default)]
pub(super) struct Clock([AtomicU64; STAGES.len()]);

impl Clock {
    /// Does the work and counts its time.
    pub fn time<T>(&self, stage: Stage, work: impl FnOnce() -> T) -> T {
        let began = Instant::now();
        let done = work();
        self.0[stage as usize].fetch_add(began.elapsed().as_nanos() as u64, Ordering::Relaxed);
        done
    }

    /// Seconds by stage, in the order of [`STAGES`].
    pub fn seconds(&self) -> [f64; STAGES.len()] {
        std::array::from_fn(|i| self.0[i].load(Ordering::Relaxed) as f64 * 1e-9)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_are_counted_apart() {
        let clock = Clock::default();
        assert_eq!(clock.time(Stage::Body, || std::thread::sleep(std::time::Duration::from_millis(3))), ());
        clock.time(Stage::Warp, || ());
        let seconds = clock.seconds();
        assert!(seconds[Stage::Body as usize] >= 0.003 && seconds[Stage::Warp as usize] < seconds[Stage::Body as usize]);
        assert_eq!(seconds[Stage::Encode as usize], 0.0);
        assert!(STAGES.iter().enumerate().all(|(i, s)| *s as usize == i));
    }
}
