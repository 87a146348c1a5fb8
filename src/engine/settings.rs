//! How an engine works.

use crate::rules::skip::Skip;
use crate::simd::Isa;

/// How to denoise.
#[derive(Clone, Debug, Default)]
pub struct Settings {
    /// Bytes that the frames in the window and the buffers of one tile may take together; None is 3.1 GiB, and 320 MiB for a tile
    /// in any case. Less memory means more and smaller tiles, and the same bits.
    pub memory: Option<u64>,
    /// What may be left out.
    pub skip: Skip,
    /// Whether a second pass over time follows, where the weights have one.
    pub second_pass: bool,
    /// The instruction set; None is the fastest. AVX2, AVX-512 and NEON give the same bits, the portable path agrees to 1e-4.
    pub isa: Option<Isa>,
    /// Threads that compute; None is rayon's pool of all cores. Any number gives the same bits.
    pub threads: Option<usize>,
}
