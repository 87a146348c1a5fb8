//! How an engine works.

use crate::error::{Error, Result};
use crate::rules::skip::Skip;
use crate::simd::Isa;

/// Levels of the kernels' pyramid at most; weights may have one fewer.
pub use crate::network::weights::LEVELS;

/// How to denoise.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Bytes that the frames in the window and the buffers of one tile may take together; None is 3.1 GiB, and 320 MiB for a tile
    /// in any case. Less memory means more and smaller tiles, and the same bits.
    pub memory: Option<u64>,
    /// What may be left out.
    pub skip: Skip,
    /// Levels of the kernels' pyramid that are used, 1 to 4, at most those that the weights have. Below that the coarsest are not
    /// computed, and the kernels do without their taps: faster, what is noisy over many pixels stays so, and wide holes of bad
    /// pixels are filled less far. The network was trained with all.
    pub levels: usize,
    /// The instruction set; None is the fastest. AVX2 and AVX-512 give the same bits, the portable path agrees to 1e-4.
    pub isa: Option<Isa>,
    /// Threads that compute; None is rayon's pool of all cores. Any number gives the same bits.
    pub threads: Option<usize>,
}

impl Default for Settings {
    fn default() -> Self {
        Self { memory: None, skip: Skip::default(), levels: LEVELS, isa: None, threads: None }
    }
}

/// Whether there are that many levels.
pub(super) fn check_levels(levels: usize) -> Result<()> {
    let fits = (1..=LEVELS).contains(&levels);
    fits.then_some(()).ok_or_else(|| Error::BadSetting { name: "levels", reason: format!("{levels} is not in 1…{LEVELS}") })
}
