//! `heedway bench`: times the parts that a robot's computer waits for. It prints figures and judges none.

use clap::Subcommand;

pub mod filter;
pub mod instruction;

/// What is timed.
#[derive(Subcommand, Debug)]
pub enum Bench {
    /// The filter on the standard problem, from raw files.
    Filter(filter::Arguments),
    /// From an instruction to the filter's acknowledgement of the rule, with all services running.
    Instruction(instruction::Arguments),
}
