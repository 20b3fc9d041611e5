//! `heedway-eval generated`: trials in scenes drawn from seeds, a line each.

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use clap::Args;

use crate::generate::{Sort, scene};
use crate::outcome::judged;
use crate::setup::{Condition, Masks, Method, Planner, Sensing, profile};
use crate::trial::Task;

/// Arguments of `heedway-eval generated`.
#[derive(Args, Debug)]
pub struct Arguments {
    /// What is drawn.
    #[arg(long, value_enum, default_value_t = Sort::Room)]
    sort: Sort,
    /// Number of scenes; the seed counts up.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    scenes: u64,
    /// Seed of the first scene, and of its trial.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Who keeps the rules.
    #[arg(long, value_enum, default_value_t = Method::SmoothBlending)]
    method: Method,
    /// What the planner sees.
    #[arg(long, value_enum, default_value_t = Planner::Rules)]
    planner: Planner,
    /// How well the robot senses.
    #[arg(long, value_enum, default_value_t = Sensing::Perfect)]
    sensing: Sensing,
    /// Writes each scene here, to be replayed with `heedway-eval scene`.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Each side of the camera's images is divided by this.
    #[arg(long, default_value_t = 1)]
    camera_divisor: u32,
}

/// Plays one trial in each scene; JSON lines.
///
/// # Errors
/// When no scene can be drawn from a seed, or a file cannot be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let profile = profile(1)?;
    if let Some(folder) = &arguments.out {
        std::fs::create_dir_all(folder).with_context(|| format!("create {} (--out)", folder.display()))?;
    }
    for k in 0..arguments.scenes {
        let seed = arguments.seed.wrapping_add(k);
        let (scene, text) = scene(arguments.sort, seed, &profile)?;
        if let Some(folder) = &arguments.out {
            let name = format!("{}.json", scene.name);
            std::fs::write(folder.join(&name), text).with_context(|| format!("write {name}"))?;
        }
        let condition = Condition {
            method: arguments.method,
            planner: arguments.planner,
            sensing: arguments.sensing,
            masks: Masks::Models,
            filter_off: false,
            seed,
            camera_divisor: arguments.camera_divisor,
        };
        let case = scene.cases.first();
        let name = case.map_or_else(|| "no-rule".to_owned(), |case| format!("0:{}", case.kind));
        let task = Task { scene: &scene, say: case.map(|case| case.say.as_str()), case, condition };
        let (line, _) = judged(&task, &name)?;
        let mut out = std::io::stdout().lock();
        writeln!(out, "{}", serde_json::to_string(&line)?)?;
        out.flush().context("standard output")?;
    }
    Ok(ExitCode::SUCCESS)
}
