//! Nominal command, maps and rules to a safe command, every tick.
//!
//! The decider ([`FilterDecider`]) takes whatever was heard and, at each tick, sends one command; it knows
//! neither clock nor bus. [`serve`] is the shell around it. The control loop never waits on perception or
//! language: distance fields are computed beside it, and what does not come in time slows or stops the
//! robot ([`ages`]). Not here: the mathematics of the filter (`control`), the last guard before the motors
//! (`envelope`).

pub mod ages;
pub mod config;
pub mod decider;
pub mod fields;
pub mod gate;
pub mod heard;
pub mod inputs;
mod motion;
mod rule_layers;
mod senses;
mod shell;
mod status;
#[cfg(test)]
mod tests;

pub use config::FilterSettings;
pub use decider::{FilterDecider, Input, Note, Output};
pub use heard::Heard;
pub use shell::serve;
