//! `heedway-eval`: see `heedway-eval --help`.

use std::process::ExitCode;

fn main() -> ExitCode {
    evaluation::run()
}
