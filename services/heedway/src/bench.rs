//! `heedway bench`: times the parts that a robot's computer waits for.

use std::process::ExitCode;

use clap::Subcommand;

pub mod filter;

/// What is timed.
#[derive(Subcommand, Debug)]
pub enum Bench {
    /// The filter on the standard problem, from raw files.
    Filter(filter::Arguments),
}

/// Times it.
///
/// # Errors
/// When files are missing or are not what they should be.
pub fn run(bench: &Bench) -> anyhow::Result<ExitCode> {
    match bench {
        Bench::Filter(arguments) => filter::run(arguments),
    }
}
