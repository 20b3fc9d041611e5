//! Starts localisation or semantics, whichever the configuration names.
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    heedway_perception::run_with(&arguments)
}
