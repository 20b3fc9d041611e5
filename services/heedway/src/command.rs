//! The command line: what can be asked for, and where it goes.

use std::future::Future;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use service::life::{EXIT_FAILED, EXIT_OK, EXIT_USAGE};

use crate::bench::{self, Bench};
use crate::{audit, carry, demo, ground, models, parse, record, rules_list, say, slam, watch};

/// Tell a robot in plain words what to heed, and see that it does.
#[derive(Parser, Debug)]
#[command(name = "heedway", version, propagate_version = true)]
struct CommandLine {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand, Debug)]
enum Command {
    /// Run the office scene twice, without and with an instruction, and show both paths.
    Demo(demo::Arguments),
    /// Say something to a robot, and hear what it makes of it.
    Say(say::Arguments),
    /// Show the rules in force, and how far each is enforced.
    Rules(rules_list::Arguments),
    /// Show live what a robot does and why, until Ctrl-C.
    Watch(watch::Arguments),
    /// Record what a robot sees, finds and does, for Foxglove or Lichtblick.
    Record(record::Arguments),
    /// Parse sentences without a robot: JSON lines in, JSON lines out.
    Parse(parse::Arguments),
    /// Map a recorded laser log.
    Slam(slam::Arguments),
    /// Time the parts that a robot's computer waits for.
    #[command(subcommand)]
    Bench(Bench),
    /// Find what rules speak of in recorded RGB-D, without a robot: overlays, maps, a summary.
    Ground(ground::Arguments),
    /// Show the audit log, and whether it still holds.
    Audit(audit::Arguments),
    /// List the models that semantics uses, check them, and tell where to get what is missing.
    Models(models::Arguments),
    /// Run one service in this process.
    Service(carry::Arguments),
}

/// Runs the command that this process was called with.
#[must_use]
pub fn run() -> ExitCode {
    let command_line = match CommandLine::try_parse() {
        Ok(command_line) => command_line,
        Err(e) => {
            // When the terminal is gone there is nobody to tell.
            let _ = e.print();
            return ExitCode::from(if e.use_stderr() { EXIT_USAGE } else { EXIT_OK });
        }
    };
    match command_line.command {
        Command::Demo(arguments) => in_runtime(demo::run(arguments)),
        Command::Say(arguments) => in_runtime(say::run(arguments)),
        Command::Rules(arguments) => in_runtime(rules_list::run(arguments)),
        Command::Watch(arguments) => in_runtime(watch::run(arguments)),
        Command::Record(arguments) => in_runtime(record::run(arguments)),
        Command::Parse(arguments) => told(parse::run(&arguments)),
        Command::Slam(arguments) => told(slam::run(&arguments)),
        Command::Bench(what) => timed(what),
        Command::Ground(arguments) => told(ground::run(&arguments)),
        Command::Audit(arguments) => told(audit::run(&arguments)),
        Command::Models(arguments) => told(models::run(&arguments)),
        // It starts a runtime of its own.
        Command::Service(arguments) => carry::run(&arguments),
    }
}

fn timed(what: Bench) -> ExitCode {
    match what {
        Bench::Filter(arguments) => told(bench::filter::run(&arguments)),
        Bench::Tsdf(arguments) => told(bench::tsdf::run(&arguments)),
        Bench::Edt(arguments) => told(bench::floor::edt(&arguments)),
        Bench::Raycast(arguments) => told(bench::floor::raycast(&arguments)),
        Bench::Astar(arguments) => told(bench::floor::astar(&arguments)),
        Bench::Instruction(arguments) => in_runtime(bench::instruction::run(arguments)),
    }
}

fn in_runtime(work: impl Future<Output = anyhow::Result<ExitCode>>) -> ExitCode {
    // `zenoh` needs the multi-threaded scheduler.
    let runtime = match tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build() {
        Ok(runtime) => runtime,
        Err(e) => return told(Err(anyhow::Error::new(e).context("start runtime"))),
    };
    // Polled on this thread: children that the demo starts die with the thread that started them.
    let end = runtime.block_on(work);
    // A read from the terminal that nobody waits for any more does not hold up the exit.
    runtime.shutdown_background();
    told(end)
}

fn told(end: anyhow::Result<ExitCode>) -> ExitCode {
    match end {
        Ok(code) => code,
        Err(e) => {
            eprintln!("heedway: {e:#}");
            ExitCode::from(EXIT_FAILED)
        }
    }
}
