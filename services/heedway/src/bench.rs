//! `heedway bench`: times the parts that a robot's computer waits for.

use std::process::ExitCode;

use clap::Subcommand;

pub mod filter;
pub mod floor;
pub mod timing;
pub mod tsdf;
pub mod worlds;

/// What is timed.
#[derive(Subcommand, Debug)]
pub enum Bench {
    /// The filter on the standard problem, from raw files.
    Filter(filter::Arguments),
    /// An object's TSDF, from recorded RGB-D.
    Tsdf(tsdf::Arguments),
    /// The distance transform of a floor.
    Edt(floor::Arguments),
    /// A scan's beams through the base map.
    Raycast(floor::Arguments),
    /// The planner's search through mazes.
    Astar(floor::Arguments),
}

/// Times it.
///
/// # Errors
/// When files are missing or are not what they should be.
pub fn run(bench: &Bench) -> anyhow::Result<ExitCode> {
    match bench {
        Bench::Filter(arguments) => filter::run(arguments),
        Bench::Tsdf(arguments) => tsdf::run(arguments),
        Bench::Edt(arguments) => floor::edt(arguments),
        Bench::Raycast(arguments) => floor::raycast(arguments),
        Bench::Astar(arguments) => floor::astar(arguments),
    }
}
