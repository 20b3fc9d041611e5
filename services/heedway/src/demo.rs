//! `heedway demo`: the office twice, without and with an instruction, each time with fresh processes.
//!
//! The words are put on the network as any user would put them. What is judged is the ground truth, which
//! only this command reads and none of the services.

mod director;
pub mod judge;
mod picture;
pub mod record;
mod report;
pub mod stage;

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, bail};
use clap::Args;
use heedway_simulator::scene::{Case, Hull, Scene};

use crate::fleet::{self, Change, Method, OFFICE_SCENE, Planner, SceneSource};
use crate::terminal::Terminal;
use judge::Judge;
use record::Record;
use report::Expected;
use stage::Run;

/// Exit code after Ctrl-C or SIGTERM, as shells count it.
const EXIT_INTERRUPTED: u8 = 130;

/// Arguments of `heedway demo`.
#[derive(Args, Debug)]
pub struct Arguments {
    /// A scene file instead of the built-in office.
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// What is said in the second run; the scene's first case when not given.
    #[arg(long, value_name = "TEXT")]
    say: Option<String>,
    /// Seed of everything random in the simulation.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// No live status line.
    #[arg(long)]
    headless: bool,
    /// Where the picture is written.
    #[arg(long, value_name = "DIR", default_value = ".")]
    out: PathBuf,
    /// What the planner sees: with `base` it is the filter alone that keeps the rule.
    #[arg(long, value_enum, default_value_t = Planner::Rules)]
    planner: Planner,
    /// Which filter; as configured when not given.
    #[arg(long, value_enum)]
    method: Option<Method>,
    /// Changes a value of a service's configuration, as in `filter.rate_hz=100.0`; may be given again.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    changes: Vec<Change>,
}

/// What a demonstration shows.
struct Play {
    scene: Scene,
    words: String,
    case: Option<Case>,
    expected: Expected,
}

/// Runs the demonstration; the exit code tells whether both runs did what they should.
///
/// # Errors
/// When the scene cannot be read, or a service does not start or dies; nothing is left running.
pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    use tokio::signal::unix::{SignalKind, signal};
    let mut interrupt = signal(SignalKind::interrupt()).context("listen for SIGINT")?;
    let mut terminate = signal(SignalKind::terminate()).context("listen for SIGTERM")?;
    let mut terminal = Terminal::stdout();
    if arguments.headless {
        terminal = terminal.without_status();
    }
    // Whichever comes first: dropping the demonstration kills every process of it.
    tokio::select! {
        end = demonstrate(&arguments, &mut terminal) => end,
        _ = interrupt.recv() => Ok(ExitCode::from(EXIT_INTERRUPTED)),
        _ = terminate.recv() => Ok(ExitCode::from(EXIT_INTERRUPTED)),
    }
}

async fn demonstrate(arguments: &Arguments, terminal: &mut Terminal) -> anyhow::Result<ExitCode> {
    let play = read_play(arguments)?;
    std::fs::create_dir_all(&arguments.out)
        .with_context(|| format!("create {} (--out)", arguments.out.display()))?;
    let folder = tempfile::Builder::new().prefix("heedway-demo-").tempdir().context("temporary folder")?;
    let program = std::env::current_exe().context("find this program")?;
    terminal.line(&format!("{}: {}", play.scene.name, play.scene.title));

    let mut records = Vec::new();
    for (name, words) in [("without", None), ("with", Some(play.words.as_str()))] {
        let run = Run {
            name,
            words,
            goal_map: play.scene.goal_map,
            judge: Judge::new(play.case.as_ref()),
            options: fleet::FleetOptions {
                scene: arguments.scene.clone().map_or(SceneSource::Office, SceneSource::File),
                planner: arguments.planner,
                method: arguments.method,
                seed: arguments.seed,
                changes: arguments.changes.clone(),
                folder: Some(folder.path().join(name)),
                ..fleet::FleetOptions::office(program.clone())
            },
        };
        match stage::play(run, terminal).await {
            Ok(record) => records.push(record),
            Err(e) => {
                terminal.clear_status();
                eprintln!("heedway: {e:#}\nlogs are kept in {}", folder.keep().display());
                return Ok(ExitCode::FAILURE);
            }
        }
    }
    let [without, with] = records.as_slice() else { bail!("{} runs, must be 2", records.len()) };
    close(arguments, terminal, &play, without, with, folder)
}

/// Tells how it went: the table, the picture, the exit code.
fn close(
    arguments: &Arguments,
    terminal: &mut Terminal,
    play: &Play,
    without: &Record,
    with: &Record,
    folder: tempfile::TempDir,
) -> anyhow::Result<ExitCode> {
    terminal.clear_status();
    terminal.line(&report::table(&[without, with]));
    let file = arguments.out.join("heedway-demo.png");
    picture::write(&file, &play.scene, &play.words, without, with)
        .with_context(|| format!("write {}", file.display()))?;
    terminal.line(&format!("picture: {}", file.display()));
    let reasons = report::reasons(&play.expected, without, with);
    if reasons.is_empty() {
        terminal.line("both runs did what they should");
        return Ok(ExitCode::SUCCESS);
    }
    for reason in &reasons {
        terminal.line(&format!("not as it should be: {reason}"));
    }
    terminal.line(&format!("logs are kept in {}", folder.keep().display()));
    Ok(ExitCode::FAILURE)
}

fn read_play(arguments: &Arguments) -> anyhow::Result<Play> {
    let profile = fleet::profile();
    let hull = Hull { radius_m: profile.radius_m, height_m: profile.height_m };
    let scene = match &arguments.scene {
        Some(file) => Scene::load(file, hull)?,
        None => {
            let no_mesh = |_: &str| Err("the built-in scene has no meshes".to_owned());
            Scene::parse("office.json", OFFICE_SCENE, &no_mesh, hull)?
        }
    };
    let first = scene.cases.iter().find(|case| !case.rules.is_empty());
    let (words, case) = match &arguments.say {
        Some(words) => (words.clone(), find_case(&scene, words)),
        None => match first {
            Some(case) => (case.say.clone(), Some(case)),
            None => bail!("scene {:?} has no case with a rule: give the words with --say", scene.name),
        },
    };
    // Of scenes from elsewhere it is not known whether the short way breaks the rule.
    let breaks_without = arguments.scene.is_none() && case.is_some() && case == first;
    let expected = Expected { breaks_without, reaches_with: arguments.planner == Planner::Rules };
    Ok(Play { words, case: case.cloned(), expected, scene })
}

/// The case with these words, whatever their case and punctuation.
fn find_case<'a>(scene: &'a Scene, words: &str) -> Option<&'a Case> {
    let plain = |text: &str| -> String {
        let kept = text.chars().filter(|c| c.is_alphanumeric() || *c == ' ');
        kept.flat_map(char::to_lowercase).collect::<String>().split_whitespace().collect::<Vec<_>>().join(" ")
    };
    scene.cases.iter().find(|case| plain(&case.say) == plain(words))
}
