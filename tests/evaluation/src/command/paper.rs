//! `heedway-eval paper`: the suite of the paper, resumable, with its tables.
//!
//! Every trial is one line of `results.jsonl` in the output folder; a trial that has its line is not played again.
//! `results.csv` and `summary.md` are written anew at the end.

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::{Context, anyhow};
use clap::Args;
use heedway_simulator::scene::{Hull, Scene};

use crate::check::{Best, Survey};
use crate::condition::{Condition, Event, Masks, Method, Planner, Sensing};
use crate::outcome::{Line, judged};
use crate::setup::profile;
use crate::summary;
use crate::trial::Task;

/// Arguments of `heedway-eval paper`.
#[derive(Args, Debug)]
pub struct Arguments {
    /// Folder of scene files.
    #[arg(long, default_value = "scenes")]
    scenes: PathBuf,
    /// Where results are kept and written.
    #[arg(long, default_value = "target/evaluation")]
    out: PathBuf,
    /// Every good case of every scene, both planners, both sensings; else one case a scene, planner with rules, perfect.
    #[arg(long)]
    full: bool,
    /// Only these methods.
    #[arg(long, value_enum, value_delimiter = ',')]
    methods: Vec<Method>,
    /// How well the robot senses, without `--full`.
    #[arg(long, value_enum, default_value_t = Sensing::Perfect)]
    sensing: Sensing,
    /// What the planner sees, without `--full`.
    #[arg(long, value_enum, default_value_t = Planner::Rules)]
    planner: Planner,
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

/// One trial to play.
struct Job<'a> {
    scene: &'a Scene,
    case_idx: usize,
    name: String,
    condition: Condition,
    best: Option<Best>,
}

impl Job<'_> {
    fn key(&self) -> String {
        let c = &self.condition;
        key(&self.scene.name, &self.name, c.method, c.planner, c.sensing, c.seed)
    }
}

fn key(scene: &str, case: &str, method: Method, planner: Planner, sensing: Sensing, seed: u64) -> String {
    format!("{scene}/{case}/{}/{planner:?}/{sensing:?}/{seed}", method.word())
}

/// Plays what has not been played, and writes the tables.
///
/// # Errors
/// When a scene cannot be read or a file not be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    std::fs::create_dir_all(&arguments.out)
        .with_context(|| format!("create {} (--out)", arguments.out.display()))?;
    let scenes = read_scenes(&arguments.scenes)?;
    let jobs = plan(arguments, &scenes)?;
    let file = arguments.out.join("results.jsonl");
    let done = read_lines(&file)?;
    let played: BTreeSet<String> =
        done.iter().map(|l| key(&l.scene, &l.case, l.method, l.planner, l.sensing, l.seed)).collect();
    let wanted: BTreeSet<String> = jobs.iter().map(Job::key).collect();
    let left: Vec<&Job<'_>> = jobs.iter().filter(|job| !played.contains(&job.key())).collect();
    eprintln!("{} trials, {} played before", jobs.len(), jobs.len() - left.len());
    play_all(&left, &file, arguments.jobs.max(1))?;
    let mut lines = read_lines(&file)?;
    lines.retain(|l| wanted.contains(&key(&l.scene, &l.case, l.method, l.planner, l.sensing, l.seed)));
    lines.sort_by(|a, b| {
        let by = |l: &Line| (l.scene.clone(), l.case.clone(), l.method, l.planner, l.sensing, l.seed);
        by(a).cmp(&by(b))
    });
    std::fs::write(arguments.out.join("results.csv"), summary::csv(&lines)).context("write results.csv")?;
    let page = summary::markdown(&lines);
    std::fs::write(arguments.out.join("summary.md"), &page).context("write summary.md")?;
    writeln!(std::io::stdout().lock(), "{page}")?;
    Ok(ExitCode::SUCCESS)
}

fn read_scenes(folder: &Path) -> anyhow::Result<Vec<Scene>> {
    let profile = profile(1)?;
    let hull = Hull { radius_m: profile.radius_m, height_m: profile.height_m };
    let entries = std::fs::read_dir(folder).with_context(|| format!("folder {}", folder.display()))?;
    let mut files: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    files.retain(|file| file.extension().is_some_and(|extension| extension == "json"));
    files.sort();
    files.iter().map(|file| Ok(Scene::load(file, hull)?)).collect()
}

fn plan<'a>(arguments: &Arguments, scenes: &'a [Scene]) -> anyhow::Result<Vec<Job<'a>>> {
    let profile = profile(1)?;
    let methods = if arguments.methods.is_empty() { &Method::ALL[..] } else { &arguments.methods };
    let (planners, sensings) = if arguments.full {
        (vec![Planner::Rules, Planner::Base], vec![Sensing::Perfect, Sensing::Noisy])
    } else {
        (vec![arguments.planner], vec![arguments.sensing])
    };
    let mut jobs = Vec::new();
    for (scene_idx, scene) in scenes.iter().enumerate() {
        let survey = Survey::new(scene, &profile)?;
        let mut good: Vec<usize> = (0..scene.cases.len()).collect();
        good.retain(|idx| scene.cases.get(*idx).is_some_and(|case| survey.check(case).refused.is_empty()));
        if !arguments.full && !good.is_empty() {
            // Another kind in each scene, so that one case a scene covers them all.
            good = vec![good[scene_idx % good.len()]];
        }
        for case_idx in good {
            let best = survey.best(scene.cases.get(case_idx));
            let kind = scene.cases.get(case_idx).map_or("", |case| case.kind.as_str());
            for method in methods {
                for planner in &planners {
                    for sensing in &sensings {
                        jobs.extend((1..=arguments.trials).map(|seed| Job {
                            scene,
                            case_idx,
                            name: format!("{case_idx}:{kind}"),
                            best,
                            condition: Condition {
                                method: *method,
                                planner: *planner,
                                sensing: *sensing,
                                event: Event::None,
                                masks: Masks::Models,
                                filter_off: false,
                                seed,
                                camera_divisor: arguments.camera_divisor,
                            },
                        }));
                    }
                }
            }
        }
    }
    Ok(jobs)
}

fn read_lines(file: &Path) -> anyhow::Result<Vec<Line>> {
    let Ok(text) = std::fs::read_to_string(file) else { return Ok(Vec::new()) };
    // A line that was cut off when the last run was ended is played again.
    Ok(text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect())
}

fn play_all(jobs: &[&Job<'_>], file: &Path, n_threads: usize) -> anyhow::Result<()> {
    let out = std::fs::OpenOptions::new().create(true).append(true).open(file);
    let out = Mutex::new(out.with_context(|| format!("open {}", file.display()))?);
    let (next, n_done) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let work = || -> anyhow::Result<()> {
        while let Some(job) = jobs.get(next.fetch_add(1, Ordering::Relaxed)) {
            let case = job.scene.cases.get(job.case_idx);
            let say = case.map(|case| case.say.as_str());
            let task = Task { scene: job.scene, say, case, condition: job.condition, best: job.best };
            let (line, _) = judged(&task, &job.name)?;
            let text = serde_json::to_string(&line)?;
            writeln!(out.lock().map_err(|_| anyhow!("another trial failed"))?, "{text}")?;
            let n_done = n_done.fetch_add(1, Ordering::Relaxed) + 1;
            eprintln!("{n_done}/{} {} {:?}", jobs.len(), job.key(), line.outcome);
        }
        Ok(())
    };
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..n_threads).map(|_| scope.spawn(work)).collect();
        threads.into_iter().try_for_each(|t| t.join().map_err(|_| anyhow!("a trial panicked"))?)
    })
}
