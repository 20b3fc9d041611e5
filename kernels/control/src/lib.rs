//! What decides how the robot moves: dynamics, margins, the two safety filters with their certificate, and
//! the planner and tracker of the nominal policy.
//!
//! Start at [`Filter::step`]; its promise is proven in [`certificate`]. Everything here is pure: time and
//! seed are arguments, nothing reads a clock, a file or the network.

pub mod astar;
pub mod certificate;
pub mod config;
pub mod costmap;
pub mod decision;
pub mod dynamics;
mod exit;
mod fast;
pub mod filter;
mod latency;
mod manoeuvres;
pub mod margin;
mod noise;
#[cfg(test)]
mod oracle;
mod paper_literal;
pub mod plan;
mod points;
mod primitives;
mod recovery;
mod scene;
mod score;
pub mod standard;
pub mod tracker;
mod unfreeze;

pub use astar::{NoPath, shortest_path};
pub use config::{ConfigError, Disturbance, FilterConfig, Method};
pub use costmap::{Blocked, Costmap, planner_clearance_m};
pub use decision::{Action, Binding, Certified, Decision, MarginUnit};
pub use dynamics::{Control, Limits, State};
pub use fast::Isa;
pub use filter::Filter;
pub use margin::{BaseLayer, Demand, DemandError, RuleLayer, World};
pub use plan::{Plan, Sample};
pub use scene::LIMIT_TOLERANCE;
pub use tracker::{Tracker, TrackerGains};
