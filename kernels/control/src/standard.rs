//! The standard problem: one step of the paper's filters on given fields, to be timed against other
//! implementations of the same step.
//!
//! As printed in the paper, for comparison only: Euler's step, a margin that mixes metres with m/s, no
//! certificate ([`crate::Filter`] is what drives a robot). Everything is laid down: the fields' meaning by
//! their position, the limits, the spread of the noise, full braking as the incumbent, 26 scores a step.
//! [`oracle`] computes it slowly in f64, [`StandardFilter`] fast; both decide the same. Not here: files and
//! clocks (`heedway bench filter`).

pub mod oracle;
pub mod service;

mod exact;
mod field;
mod model;
mod runner;
mod scene;
mod score;

pub use runner::{Choice, StandardFilter};
pub use scene::{Scene, SceneError};

/// Side of a cell, metres; cell (i, j) lies at (0.05 i, 0.05 j).
pub const CELL_M: f64 = 0.05;
/// Length of a step, seconds.
pub const STEP_S: f64 = 0.05;
/// Speed limit everywhere, m/s.
pub const SPEED_M_S_LIMIT: f64 = 1.2;
/// Turn rate limit everywhere, rad/s.
pub const YAW_RATE_RAD_S_LIMIT: f64 = 1.0;
/// Top speed of the base, m/s.
pub const SPEED_M_S_MAX: f64 = 1.5;
/// Largest turn rate, rad/s.
pub const YAW_RATE_RAD_S_MAX: f64 = 1.0;
/// Largest acceleration, m/s².
pub const ACCEL_M_S2_MAX: f64 = 3.0;
/// Distance kept from the base map (layer 0), metres.
pub const RADIUS_M: f64 = 0.25;
/// Distance kept from an exclusion (layers 1, 2 and from 4 on), metres.
pub const BUFFER_M: f64 = 0.3;
/// How near the slow zone (layer 3) counts as in it, metres.
pub const SLOW_BUFFER_M: f64 = 0.8;
/// Speed limit in the slow zone, m/s.
pub const SLOW_SPEED_M_S: f64 = 0.4;
/// Spread of the sampled turn rates, rad/s.
pub const SIGMA_YAW_RATE_RAD_S: f64 = 0.5;
/// Spread of the sampled accelerations, m/s².
pub const SIGMA_ACCEL_M_S2: f64 = 1.5;
/// Share of the score that a primitive may lose: γ Δ.
pub const LOST_SHARE: f64 = 0.25;
/// Which layer is the slow zone.
pub(crate) const SLOW_LAYER: usize = 3;

/// How much is sampled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sampling {
    /// Control sequences a round, the paper's N; the first is the incumbent itself.
    pub n_samples: usize,
    /// Rounds, the paper's R.
    pub n_rounds: usize,
    /// Steps of a rollout, the paper's H.
    pub n_steps: usize,
    /// Seed of the noise.
    pub seed: u64,
}

#[cfg(test)]
mod tests;
