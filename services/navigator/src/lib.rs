//! The nominal policy: A* at 2 Hz and a tracker at 20 Hz.
//!
//! It wants to be at the goal and asks for the motion that leads there; keeping safe is the filter's task.
//! It plans on the base map alone, or on the base map and the regions that rules keep the robot out of, as
//! the paper has it either way. Not here: speed limits of rules (the filter's), maps (perception's).

pub mod config;
pub mod decider;
pub mod plan;
mod shell;
#[cfg(test)]
mod tests;

pub use config::NavigatorSettings;
pub use decider::{Input, NavigatorDecider, Output};
pub use shell::serve;
