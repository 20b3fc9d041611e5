//! `heedway-eval generated`: trials in scenes drawn from seeds, a line each.

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use clap::Args;

use super::options::{Options, robot};
use crate::check::Survey;
use crate::generate::{Sort, scene};
use crate::outcome::judged;
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
    #[command(flatten)]
    options: Options,
    /// Writes each scene here, to be replayed with `heedway-eval scene`.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Plays one trial in each scene; JSON lines.
///
/// # Errors
/// When no scene can be drawn from a seed, or a file cannot be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let (profile, _) = robot()?;
    if let Some(folder) = &arguments.out {
        std::fs::create_dir_all(folder).with_context(|| format!("create {} (--out)", folder.display()))?;
    }
    for k in 0..arguments.scenes {
        let condition = arguments.options.condition(k);
        let (scene, text) = scene(arguments.sort, condition.seed, &profile)?;
        if let Some(folder) = &arguments.out {
            let name = format!("{}.json", scene.name);
            std::fs::write(folder.join(&name), text).with_context(|| format!("write {name}"))?;
        }
        let case = scene.cases.first();
        let name = case.map_or_else(|| "no-rule".to_owned(), |case| format!("0:{}", case.kind));
        let best = Survey::new(&scene, &profile)?.best(case);
        let task = Task {
            scene: &scene,
            say: case.map(|case| case.say.as_str()),
            case,
            condition,
            best,
            record: None,
        };
        let (line, _) = judged(&task, &name)?;
        let mut out = std::io::stdout().lock();
        writeln!(out, "{}", serde_json::to_string(&line)?)?;
        out.flush().context("standard output")?;
    }
    Ok(ExitCode::SUCCESS)
}
