//! `heedway-eval scene`: trials in any scene file, a line each.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail};
use clap::Args;
use heedway_simulator::scene::{Case, Scene};

use super::options::{Options, robot};
use crate::check::Survey;
use crate::outcome::{Line, judged};
use crate::processes;
use crate::trial::{Run, Task};

/// Arguments of `heedway-eval scene`.
#[derive(Args, Debug)]
pub struct Arguments {
    /// The scene, a JSON file with its meshes beside it.
    file: PathBuf,
    /// Which case: its number in the file, from 0, or its kind; the first one with a rule when not given.
    #[arg(long, value_name = "K", conflicts_with_all = ["say", "no_rule"])]
    case: Option<String>,
    /// Other words; judged by the case that says the same, and by obstacles alone when none does.
    #[arg(long, value_name = "TEXT", conflicts_with = "no_rule")]
    say: Option<String>,
    /// Says nothing.
    #[arg(long)]
    no_rule: bool,
    #[command(flatten)]
    options: Options,
    /// Number of trials; the seed counts up.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    trials: u64,
    /// Writes `results.jsonl` and each path here.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Records each trial as MCAP, for Foxglove or Lichtblick; with several, their numbers become part of the name.
    #[arg(long, value_name = "FILE")]
    mcap: Option<PathBuf>,
    /// Plays each trial with the real services as processes too, and compares; the exit code tells whether they agree.
    #[arg(long)]
    processes: bool,
    /// The `heedway` binary for `--processes`; the one beside this program when not given.
    #[arg(long, value_name = "FILE", requires = "processes")]
    heedway: Option<PathBuf>,
    /// One JSON object a line, and nothing else, on standard output.
    #[arg(long)]
    json: bool,
}

/// What is said in a trial, and what judges it.
struct Words<'a> {
    name: String,
    say: Option<&'a str>,
    case: Option<&'a Case>,
}

/// Plays the trials.
///
/// # Errors
/// When the scene cannot be read, there is no such case, or a file cannot be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let (profile, hull) = robot()?;
    let scene = Scene::load(&arguments.file, hull)?;
    let words = words(arguments, &scene)?;
    if let Some(folder) = &arguments.out {
        std::fs::create_dir_all(folder).with_context(|| format!("create {} (--out)", folder.display()))?;
    }
    let best = Survey::new(&scene, &profile)?.best(words.case);
    let heedway =
        arguments.processes.then(|| processes::heedway(arguments.heedway.as_deref())).transpose()?;
    let (mut lines, mut agrees) = (Vec::new(), true);
    for k in 0..arguments.trials {
        let condition = arguments.options.condition(k);
        let record = arguments.mcap.as_ref().map(|file| numbered(file, k, arguments.trials));
        let task = Task {
            scene: &scene,
            say: words.say,
            case: words.case,
            condition,
            best,
            record: record.as_deref(),
        };
        let (line, run) = judged(&task, &words.name)?;
        tell(arguments, &line)?;
        if let Some(heedway) = &heedway {
            agrees &= compare(&task, &line, &arguments.file, heedway)?;
        }
        if let Some(folder) = &arguments.out {
            let name = format!("{}-{}-{}.csv", line.scene, line.method.word(), line.seed);
            std::fs::write(folder.join(&name), path_csv(&run)).with_context(|| format!("write {name}"))?;
            let name = name.replace(".csv", "-regions.json");
            let regions = serde_json::to_string(&run.regions)?;
            std::fs::write(folder.join(&name), regions).with_context(|| format!("write {name}"))?;
        }
        lines.push(line);
    }
    if let Some(folder) = &arguments.out {
        let texts = lines.iter().map(serde_json::to_string).collect::<Result<Vec<_>, _>>()?;
        std::fs::write(folder.join("results.jsonl"), texts.join("\n") + "\n")
            .context("write results.jsonl")?;
    }
    Ok(if agrees { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Plays a trial again with real processes; tells, and gives, whether both agree.
fn compare(task: &Task<'_>, line: &Line, file: &Path, heedway: &Path) -> anyhow::Result<bool> {
    let played = processes::play(task, file, heedway)?;
    let differences = processes::agreement(line, &played);
    let reached =
        played.reached_s.map_or_else(|| "not reached".to_owned(), |s| format!("reached in {s:.1} s"));
    let kept = played.findings.first.as_deref().unwrap_or("rules kept");
    eprintln!("processes: {reached}, {:.1} m, {} contacts, {kept}", played.path_m, played.n_collisions);
    for difference in &differences {
        eprintln!("differs: {difference}");
    }
    Ok(differences.is_empty())
}

fn words<'a>(arguments: &'a Arguments, scene: &'a Scene) -> anyhow::Result<Words<'a>> {
    if arguments.no_rule {
        return Ok(Words { name: "no-rule".into(), say: None, case: None });
    }
    if let Some(say) = &arguments.say {
        let case = scene.cases.iter().find(|case| plain(&case.say) == plain(say));
        return Ok(Words { name: say.clone(), say: Some(say), case });
    }
    let wanted = |(idx, case): &(usize, &Case)| match &arguments.case {
        Some(key) => *key == idx.to_string() || *key == case.kind,
        None => !case.rules.is_empty(),
    };
    match scene.cases.iter().enumerate().find(wanted) {
        Some((idx, case)) => {
            Ok(Words { name: format!("{idx}:{}", case.kind), say: Some(&case.say), case: Some(case) })
        }
        None => {
            let n_cases = scene.cases.len();
            let asked = arguments.case.as_deref().unwrap_or("with a rule");
            bail!("scene {:?} has no case {asked}, its {n_cases} cases count from 0", scene.name)
        }
    }
}

/// The file of the `k`-th trial, from 0: `run.mcap`, or `run-1.mcap` and so on.
fn numbered(file: &Path, k: u64, n_trials: u64) -> PathBuf {
    if n_trials == 1 {
        return file.to_owned();
    }
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    let extension = file.extension().map_or_else(String::new, |e| format!(".{}", e.to_string_lossy()));
    file.with_file_name(format!("{stem}-{}{extension}", k + 1))
}

/// Words without case and punctuation.
fn plain(text: &str) -> String {
    let kept: String = text.chars().filter(|c| c.is_alphanumeric() || c.is_whitespace()).collect();
    kept.to_lowercase().split_whitespace().collect::<Vec<_>>().join(" ")
}

fn tell(arguments: &Arguments, line: &Line) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    if arguments.json {
        writeln!(out, "{}", serde_json::to_string(line)?)?;
    } else {
        writeln!(
            out,
            "{} {} {} seed {}: {:?}, {:.1} s, {:.1} m, clearance {:.3} m, broken {:.2} s by {:.3} m {}",
            line.scene,
            line.case,
            line.method.word(),
            line.seed,
            line.outcome,
            line.time_s,
            line.path_m,
            line.least_clearance_m,
            line.violation_s,
            line.violation_depth_m,
            line.why
        )?;
    }
    out.flush().context("standard output")
}

fn path_csv(run: &Run) -> String {
    let mut text = "time_s,x_m,y_m,speed_m_s,filter\n".to_owned();
    for point in &run.path {
        let at = point.position_map;
        text += &format!(
            "{:.2},{:.4},{:.4},{:.4},\"{}\"\n",
            point.time_s,
            at.x,
            at.y,
            point.speed_m_s,
            point.filter.replace('"', "'")
        );
    }
    text
}
