//! `heedway-eval paper`: the suite of the paper, resumable, with its tables, charts and pictures.
//!
//! `results.csv`, `summary.md`, the charts and the pictures are written anew at the end, from what was played.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use clap::Args;
use heedway_simulator::scene::{Hull, Scene};

use super::options::robot;
use crate::condition::{Event, Method, Planner, Sensing};
use crate::outcome::{Line, Outcome};
use crate::picture::{self, Runs};
use crate::suite::{self, Chosen, Matrix};
use crate::trace::Trace;
use crate::{chart, summary};

/// Arguments of `heedway-eval paper`.
#[derive(Args, Debug)]
pub struct Arguments {
    /// Folder of scene files.
    #[arg(long, default_value = "scenes")]
    scenes: PathBuf,
    /// Where results are kept and written.
    #[arg(long, default_value = "target/evaluation")]
    out: PathBuf,
    /// Every good case of every scene, both planners, perfect and noisy; else one case a scene.
    #[arg(long)]
    full: bool,
    /// Every good case of every scene.
    #[arg(long)]
    all_cases: bool,
    /// Only these methods.
    #[arg(long, value_enum, value_delimiter = ',')]
    methods: Vec<Method>,
    /// How well the robot senses; several are crossed.
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = [Sensing::Perfect])]
    sensing: Vec<Sensing>,
    /// What the planner sees; several are crossed.
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = [Planner::Rules])]
    planner: Vec<Planner>,
    /// What happens beside driving; several are crossed.
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = [Event::None])]
    event: Vec<Event>,
    /// Trials of each case; seeds count up from 1.
    #[arg(long, default_value_t = 5)]
    trials: u64,
    /// Trials at a time.
    #[arg(long, default_value_t = 2)]
    jobs: usize,
    /// Each side of the camera's images is divided by this.
    #[arg(long, default_value_t = 2)]
    camera_divisor: u32,
}

impl Arguments {
    fn matrix(&self) -> Matrix {
        let (planners, sensings) = if self.full {
            (vec![Planner::Rules, Planner::Base], vec![Sensing::Perfect, Sensing::Noisy])
        } else {
            (self.planner.clone(), self.sensing.clone())
        };
        Matrix {
            all_cases: self.full || self.all_cases,
            methods: if self.methods.is_empty() { Method::ALL.to_vec() } else { self.methods.clone() },
            planners,
            sensings,
            events: self.event.clone(),
            n_trials: self.trials,
            camera_divisor: self.camera_divisor,
        }
    }
}

/// Plays what has not been played, and writes tables, charts and pictures.
///
/// # Errors
/// When a scene cannot be read or a file not be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let (profile, hull) = robot()?;
    let matrix = arguments.matrix();
    let scenes = read_scenes(&arguments.scenes, hull)?;
    let chosen = suite::choose(&scenes, matrix.all_cases, &profile)?;
    let jobs = suite::jobs(&chosen, &matrix);
    let lines = suite::play(&jobs, &arguments.out, arguments.jobs)?;
    let write = |name: &str, text: &str| {
        let file = arguments.out.join(name);
        std::fs::write(&file, text).with_context(|| format!("write {}", file.display()))
    };
    write("results.csv", &summary::csv(&lines))?;
    let page = summary::markdown(&lines);
    write("summary.md", &page)?;
    draw(&lines, &chosen, &arguments.out)?;
    writeln!(std::io::stdout().lock(), "{page}")?;
    Ok(ExitCode::SUCCESS)
}

fn read_scenes(folder: &Path, hull: Hull) -> anyhow::Result<Vec<Scene>> {
    let entries = std::fs::read_dir(folder).with_context(|| format!("folder {}", folder.display()))?;
    let mut files: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    files.retain(|file| file.extension().is_some_and(|extension| extension == "json"));
    files.sort();
    files.iter().map(|file| Ok(Scene::load(file, hull)?)).collect()
}

/// A chart for each condition, and a picture for each condition and case.
fn draw(lines: &[Line], chosen: &[Chosen<'_>], out: &Path) -> anyhow::Result<()> {
    let mut conditions: BTreeMap<String, Vec<&Line>> = BTreeMap::new();
    for line in lines {
        conditions.entry(summary::condition_of(line)).or_default().push(line);
    }
    for (condition, lines) in conditions {
        let word = condition.replace("planner ", "").replace("sensing ", "").replace("event ", "");
        let folder = out.join(word.replace(", ", "-"));
        std::fs::create_dir_all(&folder).with_context(|| format!("create {}", folder.display()))?;
        chart::write(&folder.join("rates.png"), &condition, &lines)?;
        for Chosen { scene, name, case_idx, .. } in chosen {
            let mut by_method: BTreeMap<Method, Runs> = BTreeMap::new();
            for line in lines.iter().filter(|l| l.scene == scene.name && l.case == *name) {
                let trace = Trace::read(&suite::path_file(out, &suite::key_of(line))).unwrap_or_default();
                let runs = by_method
                    .entry(line.method)
                    .or_insert_with(|| Runs { method: line.method, runs: Vec::new() });
                runs.runs.push((trace, line.outcome == Outcome::Success));
            }
            let all: Vec<Runs> = by_method.into_values().collect();
            let words = scene.cases.get(*case_idx).map_or("", |case| case.say.as_str());
            let file = folder.join(format!("{}-{case_idx}.png", scene.name));
            picture::write(&file, scene, &format!("{}: “{words}”", scene.name), &all)?;
        }
    }
    Ok(())
}
