//! `heedway-eval check`: whether each case of a scene is worth playing.

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use heedway_simulator::scene::Scene;

use super::options::robot;
use crate::check::Survey;

/// Arguments of `heedway-eval check`.
#[derive(Args, Debug)]
pub struct Arguments {
    /// Scene files.
    #[arg(required = true)]
    files: Vec<PathBuf>,
}

/// Checks the cases; the exit code tells whether all are good.
///
/// # Errors
/// When a scene cannot be read.
pub fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let (profile, hull) = robot()?;
    let mut out = std::io::stdout().lock();
    let mut n_refused = 0;
    for file in &arguments.files {
        let scene = Scene::load(file, hull)?;
        let survey = Survey::new(&scene, &profile)?;
        let way = survey.nominal_m().map_or_else(|why| why, |m| format!("{m:.1} m"));
        writeln!(out, "{}: {} cases, nominal way {way}", scene.name, scene.cases.len())?;
        for (idx, case) in scene.cases.iter().enumerate() {
            let checked = survey.check(case);
            n_refused += u32::from(!checked.refused.is_empty());
            let verdict = if checked.refused.is_empty() {
                "good".into()
            } else {
                format!("REFUSED: {}", checked.refused)
            };
            let broken: Vec<String> = checked.broken.into_iter().map(|(_, words)| words).collect();
            let passage = checked.passage_m.map_or("none".into(), |m| format!("{m:.2} m"));
            let broken = broken.join(", ");
            writeln!(out, "  {idx} {} {:?}: {verdict} ({broken}; passage {passage})", case.kind, case.say)?;
        }
    }
    Ok(if n_refused == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
