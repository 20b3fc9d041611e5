//! The command line.

mod check;
mod generated;
mod language;
mod options;
mod paper;
mod scene;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Evaluates Heedway by ground truth, faster than real time.
#[derive(Parser, Debug)]
#[command(name = "heedway-eval", version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand, Debug)]
enum Command {
    /// Plays trials in one scene file.
    Scene(scene::Arguments),
    /// Plays the paper's suite.
    Paper(paper::Arguments),
    /// Plays trials in scenes drawn from seeds.
    Generated(generated::Arguments),
    /// Asks a parser the paper's kinds of instructions, several times each.
    Language(language::Arguments),
    /// Checks whether the cases of scene files are worth playing.
    Check(check::Arguments),
}

/// Runs the command line of this process.
#[must_use]
pub fn run() -> ExitCode {
    let done = match Arguments::parse().command {
        Command::Scene(arguments) => scene::run(&arguments),
        Command::Paper(arguments) => paper::run(&arguments),
        Command::Generated(arguments) => generated::run(&arguments),
        Command::Language(arguments) => language::run(&arguments),
        Command::Check(arguments) => check::run(&arguments),
    };
    match done {
        Ok(code) => code,
        Err(e) => {
            eprintln!("heedway-eval: {e:#}");
            ExitCode::FAILURE
        }
    }
}
