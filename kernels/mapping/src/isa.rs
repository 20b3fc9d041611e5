//! Which vector instructions the processor has, and how a loop gets compiled for them.
//!
//! `wide` and its like choose their instructions when the crate is compiled, and a binary that runs on every
//! x86-64 would be left with SSE2. Here a loop is written once as [`Work`]; each instruction set has a function
//! that the loop is inlined into, and the compiler vectorises it there. This is the one module with `unsafe`.

use std::fmt;

/// A set of vector instructions that this processor has.
///
/// A value of it exists only once the processor was asked: that is what makes [`Isa::run`] sound.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Isa(Kind);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    #[cfg(target_arch = "x86_64")]
    Avx512,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "aarch64")]
    Neon,
    Scalar,
}

/// A loop to be compiled for every instruction set. `run` must be `#[inline(always)]`, and all it calls.
pub trait Work {
    /// What it computes.
    type Output;
    /// Computes it; `FUSED` where multiplying and adding is one instruction ([`fused`]).
    fn run<const FUSED: bool>(self) -> Self::Output;
}

impl Isa {
    /// What this processor has, the widest first; `scalar` always.
    #[must_use]
    pub fn available() -> Vec<Isa> {
        let mut kinds = Vec::new();
        #[cfg(target_arch = "x86_64")]
        {
            use std::arch::is_x86_feature_detected as has;
            let avx2 = has!("avx2") && has!("fma");
            if avx2 && has!("avx512f") && has!("avx512bw") && has!("avx512dq") && has!("avx512vl") {
                kinds.push(Kind::Avx512);
            }
            if avx2 {
                kinds.push(Kind::Avx2);
            }
        }
        #[cfg(target_arch = "aarch64")]
        if std::arch::is_aarch64_feature_detected!("neon") {
            kinds.push(Kind::Neon);
        }
        kinds.push(Kind::Scalar);
        kinds.into_iter().map(Isa).collect()
    }

    /// The widest that this processor has.
    #[must_use]
    pub fn detect() -> Isa {
        Isa::available().first().copied().unwrap_or(Isa(Kind::Scalar))
    }

    /// The one of this name, when the processor has it.
    #[must_use]
    pub fn named(name: &str) -> Option<Isa> {
        Isa::available().into_iter().find(|isa| isa.name() == name)
    }

    /// `avx512`, `avx2`, `neon` or `scalar`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => "avx512",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => "avx2",
            #[cfg(target_arch = "aarch64")]
            Kind::Neon => "neon",
            Kind::Scalar => "scalar",
        }
    }

    /// How many f32 a vector holds; a loop over whole vectors has no rest.
    #[must_use]
    pub fn n_floats(self) -> usize {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => 16,
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => 8,
            #[cfg(target_arch = "aarch64")]
            Kind::Neon => 4,
            Kind::Scalar => 4,
        }
    }

    /// Runs a loop with these instructions.
    #[allow(unsafe_code, reason = "instructions chosen at run time cannot be reached otherwise")]
    pub fn run<W: Work>(self, work: W) -> W::Output {
        match self.0 {
            // SAFETY: a value of this kind exists only where the processor was found to have every feature
            // that the function enables (`available`).
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => unsafe { with_avx512(work) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => unsafe { with_avx2(work) },
            // SAFETY: as above.
            #[cfg(target_arch = "aarch64")]
            Kind::Neon => unsafe { with_neon(work) },
            Kind::Scalar => work.run::<false>(),
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi2")]
fn with_avx512<W: Work>(work: W) -> W::Output {
    work.run::<true>()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,bmi2")]
fn with_avx2<W: Work>(work: W) -> W::Output {
    work.run::<true>()
}

#[cfg(target_arch = "aarch64")]
#[target_feature(enable = "neon")]
fn with_neon<W: Work>(work: W) -> W::Output {
    work.run::<true>()
}

/// a b + c, rounded once where that is one instruction, else twice.
#[must_use]
#[inline(always)]
pub fn fused<const FUSED: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FUSED { a.mul_add(b, c) } else { a * b + c }
}

impl fmt::Debug for Isa {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
