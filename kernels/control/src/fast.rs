//! The fast path: many rollouts at once, in f32, by whatever vector instructions the processor has.
//!
//! Loops over structures of arrays, compiled once for each instruction set and chosen at run time ([`isa`]).
//! They are plain Rust. What they compute are *bounds*: which rollouts can be the best, and which cannot. The
//! few that can are computed again exactly in f64, so that neither rounding nor packing ever decides.
//! Deliberately not here: what a rollout must keep (`standard`, `score`).

pub(crate) mod merge;
pub(crate) mod normal;
pub(crate) mod packed;
pub(crate) mod rollouts;
pub(crate) mod sweep;

pub(crate) use mapping::isa;
pub use mapping::isa::Isa;
