//! Which instruction sets there are, which of them this CPU has, and how a loop gets to run on one.

use std::sync::OnceLock;

use super::vector::{Simd, SimdOp};
use crate::error::{Error, Result};

/// The one table of back ends, slowest first: variant, the name that `HUSH_SIMD` understands, token, where it can be compiled.
macro_rules! back_ends {
    ($($(#[$doc:meta])+ $variant:ident = $name:literal: $token:path, $cfg:meta;)+) => {
        /// An instruction set, from the slowest to the fastest.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[non_exhaustive]
        pub enum Isa {
            $($(#[$doc])+ $variant,)+
        }

        impl Isa {
            const ALL: &[Self] = &[$(Self::$variant),+];

            /// The name that `HUSH_SIMD` understands.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)+
                }
            }

            fn is_available(self) -> bool {
                match self {
                    $(#[cfg($cfg)] Self::$variant => <$token>::detect().is_some(),)+
                    #[allow(unreachable_patterns, reason = "on a target that every back end is for")]
                    _ => false,
                }
            }

            /// Runs `op` on this instruction set, or on the CPU's best where it lacks this one.
            pub fn run<Op: SimdOp>(self, op: Op) -> Op::Output {
                match self {
                    $(#[cfg($cfg)] Self::$variant => if let Some(simd) = <$token>::detect() { return simd.run(op) },)+
                    #[allow(unreachable_patterns, reason = "on a target that every back end is for")]
                    _ => {}
                }
                Self::best().run(op)
            }
        }
    };
}

back_ends! {
    /// Plain Rust that the compiler vectorises for the target: SSE2 on x86-64.
    Portable = "portable": super::portable::Portable, all();
    /// NEON.
    Neon = "neon": super::neon::Neon, target_arch = "aarch64";
    /// AVX2, FMA and F16C.
    Avx2 = "avx2": super::avx2::Avx2, target_arch = "x86_64";
    /// AVX-512F.
    Avx512 = "avx512": super::avx512::Avx512, target_arch = "x86_64";
}

impl Isa {
    /// The fastest instruction set of this CPU, or what `HUSH_SIMD` (`avx512`, `avx2`, `neon` or `portable`) lowers it to. One that
    /// the CPU lacks, or another word, is ignored. Read once.
    pub fn detect() -> Self {
        static CHOSEN: OnceLock<Isa> = OnceLock::new();
        *CHOSEN.get_or_init(|| Self::lowered(&Self::available(), std::env::var("HUSH_SIMD").ok().as_deref()))
    }

    /// # Errors
    /// `HUSH_SIMD` says a word that names no instruction set, of whatever CPU.
    pub fn check_wish() -> Result<()> {
        let wish = std::env::var_os("HUSH_SIMD").map(|wish| word(&wish.to_string_lossy())).unwrap_or_default();
        let names: Vec<&str> = Self::ALL.iter().map(|isa| isa.name()).collect();
        if wish.is_empty() || names.contains(&wish.as_str()) {
            return Ok(());
        }
        let reason = format!("'{wish}' is no instruction set: there are {}", names.join(", "));
        Err(Error::BadInput { input: "HUSH_SIMD".into(), reason })
    }

    /// Every instruction set that this CPU has, slowest first.
    pub fn available() -> Vec<Self> {
        Self::ALL.iter().copied().filter(|isa| isa.is_available()).collect()
    }

    fn best() -> Self {
        Self::ALL.iter().rev().copied().find(|isa| isa.is_available()).unwrap_or(Self::Portable)
    }

    /// The one of `available` that is wished for, or the last.
    fn lowered(available: &[Self], wish: Option<&str>) -> Self {
        let wish = wish.map(word);
        let wished = available.iter().find(|isa| Some(isa.name()) == wish.as_deref());
        wished.or(available.last()).copied().unwrap_or(Self::Portable)
    }
}

/// What `HUSH_SIMD` says, in the letters of [`Isa::name`].
fn word(wish: &str) -> String {
    wish.trim().to_ascii_lowercase()
}

/// Defines `fn name(isa: Isa, args…)` that runs the generic `body::<S: Simd>(simd, args…)` compiled for the instruction set.
///
/// `body` must be `#[inline(always)]`.
macro_rules! dispatch {
    ($(#[$meta:meta])* $vis:vis fn $name:ident($($arg:ident: $ty:ty),* $(,)?) = $body:ident) => {
        $(#[$meta])*
        #[allow(clippy::too_many_arguments, reason = "those of the loop and the instruction set")]
        $vis fn $name(isa: $crate::simd::Isa, $($arg: $ty),*) {
            struct Call<Args>(Args);
            impl $crate::simd::SimdOp for Call<($($ty,)*)> {
                type Output = ();
                #[inline(always)]
                fn run<S: $crate::simd::Simd>(self, simd: S) {
                    let ($($arg,)*) = self.0;
                    $body(simd, $($arg),*)
                }
            }
            isa.run(Call(($($arg,)*)))
        }
    };
}
pub(crate) use dispatch;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wish_lowers_only() {
        let (avx2, avx512) = ([Isa::Portable, Isa::Avx2], [Isa::Portable, Isa::Avx2, Isa::Avx512]);
        assert_eq!(Isa::lowered(&avx512, Some("avx2")), Isa::Avx2);
        assert_eq!(Isa::lowered(&avx512, Some(" Portable ")), Isa::Portable);
        assert_eq!(Isa::lowered(&avx2, Some("avx512")), Isa::Avx2);
        assert_eq!(Isa::lowered(&avx2, Some("neon")), Isa::Avx2);
        assert_eq!(Isa::lowered(&[Isa::Portable, Isa::Neon], Some("neon")), Isa::Neon);
        assert_eq!(Isa::lowered(&avx2, Some("sse9")), Isa::Avx2);
        assert_eq!(Isa::lowered(&avx2, None), Isa::Avx2);
    }

    /// What an instruction set's loops are compiled for.
    struct Registers;
    impl SimdOp for Registers {
        type Output = usize;
        #[inline(always)]
        fn run<S: Simd>(self, _simd: S) -> usize {
            S::REGISTERS
        }
    }

    #[test]
    fn one_that_the_cpu_lacks_is_its_best() {
        for isa in Isa::ALL.iter().filter(|isa| !isa.is_available()) {
            assert_eq!(isa.run(Registers), Isa::best().run(Registers), "{isa:?}");
        }
    }

    #[test]
    fn portable_is_always_there() {
        assert_eq!(Isa::available().first(), Some(&Isa::Portable));
        assert!(Isa::Neon.is_available() || cfg!(not(target_arch = "aarch64")));
        assert!(Isa::available().contains(&Isa::detect()));
    }
}
