//! Which instructions the convolutions may use.

use std::sync::OnceLock;

/// An instruction set, from the slowest to the fastest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Isa {
    /// Plain Rust that the compiler vectorises for the target: NEON on aarch64, SSE2 on x86-64.
    Portable,
    /// AVX2 and FMA, 8 lanes.
    Avx2,
    /// AVX-512F, 16 lanes.
    Avx512,
}

impl Isa {
    /// The fastest level of this CPU, or what `HUSH_SIMD` (`avx512`, `avx2` or `portable`) lowers it to. A level that the CPU
    /// lacks, or another word, is ignored. Read once.
    pub fn detect() -> Self {
        static CHOSEN: OnceLock<Isa> = OnceLock::new();
        *CHOSEN.get_or_init(|| Self::lowered(Self::best(), std::env::var("HUSH_SIMD").ok().as_deref()))
    }

    /// Every level that this CPU can run, slowest first.
    pub fn available() -> Vec<Self> {
        [Self::Portable, Self::Avx2, Self::Avx512].into_iter().filter(|isa| *isa <= Self::best()).collect()
    }

    /// The name that `HUSH_SIMD` understands.
    pub fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }

    /// This level, or the CPU's best where it lacks this one.
    pub(super) fn supported(self) -> Self {
        self.min(Self::best())
    }

    fn best() -> Self {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            return if is_x86_feature_detected!("avx512f") { Self::Avx512 } else { Self::Avx2 };
        }
        Self::Portable
    }

    fn lowered(best: Self, wish: Option<&str>) -> Self {
        let wish = wish.map(|word| word.trim().to_ascii_lowercase());
        [Self::Portable, Self::Avx2, Self::Avx512]
            .into_iter()
            .find(|isa| Some(isa.name()) == wish.as_deref())
            .unwrap_or(best)
            .min(best)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wish_lowers_only() {
        assert_eq!(Isa::lowered(Isa::Avx512, Some("avx2")), Isa::Avx2);
        assert_eq!(Isa::lowered(Isa::Avx512, Some(" Portable ")), Isa::Portable);
        assert_eq!(Isa::lowered(Isa::Avx2, Some("avx512")), Isa::Avx2);
        assert_eq!(Isa::lowered(Isa::Avx2, Some("sse9")), Isa::Avx2);
        assert_eq!(Isa::lowered(Isa::Avx2, None), Isa::Avx2);
    }

    #[test]
    fn portable_is_always_there() {
        assert_eq!(Isa::available().first(), Some(&Isa::Portable));
        assert!(Isa::available().contains(&Isa::detect()));
    }
}
