//! Which instruction set the kernels run on.

/// An instruction set with kernels of its own; a greater one is faster.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Isa {
    /// Plain Rust on any CPU.
    Portable,
    /// x86-64 with AVX2 and FMA.
    Avx2,
    /// x86-64 with AVX-512 F, VL, BW and DQ.
    Avx512,
}

impl Isa {
    /// Every instruction set that this CPU runs, slowest first.
    pub fn available() -> Vec<Self> {
        #[allow(unused_mut)]
        let mut all = vec![Self::Portable];
        #[cfg(target_arch = "x86_64")]
        {
            all.extend(super::lanes::Avx2::new().map(|_| Self::Avx2));
            all.extend(super::lanes::Avx512::new().map(|_| Self::Avx512));
        }
        all
    }

    /// The fastest that this CPU runs; the environment variable `HUSH_SIMD` (avx512, avx2 or portable) lowers it.
    pub fn detect() -> Self {
        let limit = match std::env::var("HUSH_SIMD").as_deref() {
            Ok("portable") => Self::Portable,
            Ok("avx2") => Self::Avx2,
            _ => Self::Avx512,
        };
        Self::available().into_iter().rfind(|isa| *isa <= limit).unwrap_or(Self::Portable)
    }
}
