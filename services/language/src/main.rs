//! The language service as a process of its own.

use std::process::ExitCode;

fn main() -> ExitCode {
    service::run("heedway-language", heedway_language::serve)
}
