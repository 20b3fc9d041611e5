//! `heedway bench`: times the parts that a robot's computer waits for. It prints figures and judges none.

use clap::Subcommand;

pub mod filter;
pub mod floor;
pub mod instruction;
pub mod timing;
pub mod tsdf;
pub mod worlds;

/// What is timed.
#[derive(Subcommand, Debug)]
pub enum Bench {
    /// The filter on the standard problem, from raw files.
    Filter(filter::Arguments),
    /// From an instruction to the filter's acknowledgement of the rule, with all services running.
    Instruction(instruction::Arguments),
    /// An object's TSDF, from recorded RGB-D.
    Tsdf(tsdf::Arguments),
    /// The distance transform of a floor.
    Edt(floor::Arguments),
    /// A scan's beams through the base map.
    Raycast(floor::Arguments),
    /// The planner's search through mazes.
    Astar(floor::Arguments),
}
