//! Starts the navigator.

use std::process::ExitCode;

fn main() -> ExitCode {
    service::run("heedway-navigator", heedway_navigator::serve)
}
