//! What the commands that play trials have in common.

use anyhow::Context;
use clap::Args;
use geometry::Profile;
use heedway_simulator::scene::Hull;

use crate::condition::{Condition, Event, Masks, Method, Planner, SearchSize, Sensing};
use crate::setup::profile;

/// How trials are played.
#[derive(Args, Clone, Debug)]
pub struct Options {
    /// Who keeps the rules.
    #[arg(long, value_enum, default_value_t = Method::SmoothBlending)]
    pub method: Method,
    /// What the planner sees.
    #[arg(long, value_enum, default_value_t = Planner::Rules)]
    pub planner: Planner,
    /// How well the robot senses.
    #[arg(long, value_enum, default_value_t = Sensing::Perfect)]
    pub sensing: Sensing,
    /// What happens beside driving.
    #[arg(long, value_enum, default_value_t = Event::None)]
    pub event: Event,
    /// Seed of the first trial: start, noise, samples, and the scene when it is drawn. It counts up.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Each side of the camera's images is divided by this: faster, and coarser.
    #[arg(long, default_value_t = 1)]
    pub camera_divisor: u32,
    /// How much the filter samples: sequences, rounds and steps; as shipped when not given.
    #[arg(long, value_name = "N,R,H")]
    pub search: Option<SearchSize>,
}

impl Options {
    /// The condition of the `k`-th trial, from 0.
    #[must_use]
    pub fn condition(&self, k: u64) -> Condition {
        Condition {
            method: self.method,
            planner: self.planner,
            sensing: self.sensing,
            event: self.event,
            masks: Masks::Models,
            filter_off: false,
            seed: self.seed.wrapping_add(k),
            camera_divisor: self.camera_divisor,
            search: self.search,
        }
    }
}

/// The robot, and the hull that scenes are read for.
///
/// # Errors
/// When the shipped profile is not sound.
pub fn robot() -> anyhow::Result<(Profile, Hull)> {
    let profile = profile(1).context("shipped profile")?;
    let hull = Hull { radius_m: profile.radius_m, height_m: profile.height_m };
    Ok((profile, hull))
}
