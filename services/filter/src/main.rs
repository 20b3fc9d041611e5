//! Starts the filter.

use std::process::ExitCode;

fn main() -> ExitCode {
    service::run("heedway-filter", heedway_filter::serve)
}
