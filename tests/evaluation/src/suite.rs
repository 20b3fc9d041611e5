//! Which trials a suite has, which of them were played before, and playing the rest.
//!
//! Every trial is one line of `results.jsonl`, and a file of its path below `paths/`; a trial that has its line is not
//! played again. Deliberately not here: what the results look like.

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::{Context, anyhow};
use geometry::Profile;
use heedway_simulator::scene::Scene;

use crate::check::{Best, Survey};
use crate::condition::{Condition, Event, Masks, Method, Planner, Sensing};
use crate::outcome::{Line, judged};
use crate::progress::Progress;
use crate::trace::Trace;
use crate::trial::Task;

/// What a suite crosses.
#[derive(Clone, Debug)]
pub struct Matrix {
    /// Every good case of every scene; else one a scene, another kind in each.
    pub all_cases: bool,
    /// Who keeps the rules.
    pub methods: Vec<Method>,
    /// What the planner sees.
    pub planners: Vec<Planner>,
    /// How well the robot senses.
    pub sensings: Vec<Sensing>,
    /// What happens beside driving.
    pub events: Vec<Event>,
    /// Seeds, from 1.
    pub n_trials: u64,
    /// Each side of the camera's images is divided by this.
    pub camera_divisor: u32,
}

/// One case that is played.
pub struct Chosen<'a> {
    /// Where.
    pub scene: &'a Scene,
    /// Its place in the scene.
    pub case_idx: usize,
    /// Its place and its kind.
    pub name: String,
    /// The best that can be done in it.
    pub best: Option<Best>,
}

/// One trial.
pub struct Job<'a> {
    /// The case.
    pub chosen: &'a Chosen<'a>,
    /// How it is played.
    pub condition: Condition,
}

/// What tells trials apart, as one word that can be a file's name.
#[must_use]
pub fn key_of(line: &Line) -> String {
    key(&line.scene, &line.case, line.method, line.planner, line.sensing, line.event, line.seed)
}

fn key(
    scene: &str,
    case: &str,
    method: Method,
    planner: Planner,
    sensing: Sensing,
    event: Event,
    seed: u64,
) -> String {
    let case = case.replace(':', "-");
    let (method, planner) = (method.word(), planner.word());
    format!("{scene}.{case}.{method}.{planner}.{}.{}.{seed}", sensing.word(), event.word())
}

impl Job<'_> {
    /// What tells it apart from the others.
    #[must_use]
    pub fn key(&self) -> String {
        let c = &self.condition;
        let Chosen { scene, name, .. } = self.chosen;
        key(&scene.name, name, c.method, c.planner, c.sensing, c.event, c.seed)
    }
}

/// The cases of a suite: those that are worth playing, or one of each scene's.
///
/// # Errors
/// When a floor is too large for a grid.
pub fn choose<'a>(
    scenes: &'a [Scene],
    all_cases: bool,
    profile: &Profile,
) -> anyhow::Result<Vec<Chosen<'a>>> {
    let of_scene = |scene_idx: usize, scene: &'a Scene| -> anyhow::Result<Vec<Chosen<'a>>> {
        let survey = Survey::new(scene, profile)?;
        let mut good: Vec<usize> = (0..scene.cases.len()).collect();
        good.retain(|idx| scene.cases.get(*idx).is_some_and(|case| survey.check(case).refused.is_empty()));
        if !all_cases && !good.is_empty() {
            // Another kind in each scene, so that one case a scene covers them all.
            good = good.get(scene_idx % good.len()).copied().into_iter().collect();
        }
        let chosen = good.into_iter().filter_map(|case_idx| {
            let case = scene.cases.get(case_idx)?;
            let name = format!("{case_idx}:{}", case.kind);
            Some(Chosen { scene, case_idx, name, best: survey.best(Some(case)) })
        });
        Ok(chosen.collect())
    };
    // A survey takes a second of one core.
    let half = scenes.len() / 2;
    std::thread::scope(|scope| {
        let other = scope.spawn(move || {
            scenes.iter().enumerate().skip(half).map(|(idx, scene)| of_scene(idx, scene)).collect::<Vec<_>>()
        });
        let mut all: Vec<_> =
            scenes.iter().enumerate().take(half).map(|(idx, scene)| of_scene(idx, scene)).collect();
        all.extend(other.join().map_err(|_| anyhow!("a survey panicked"))?);
        Ok(all.into_iter().collect::<anyhow::Result<Vec<_>>>()?.into_iter().flatten().collect())
    })
}

/// Every trial of the matrix, case by case.
#[must_use]
pub fn jobs<'a>(chosen: &'a [Chosen<'a>], matrix: &Matrix) -> Vec<Job<'a>> {
    let mut jobs = Vec::new();
    for chosen in chosen {
        for &method in &matrix.methods {
            for &planner in &matrix.planners {
                // It cannot tell one planner from the other: it is told of no rules.
                if method == Method::SafeGeom && planner == Planner::Base && matrix.planners.len() > 1 {
                    continue;
                }
                for (&sensing, &event) in
                    matrix.sensings.iter().flat_map(|s| matrix.events.iter().map(move |e| (s, e)))
                {
                    jobs.extend((1..=matrix.n_trials).map(|seed| Job {
                        chosen,
                        condition: Condition {
                            method,
                            planner,
                            sensing,
                            event,
                            masks: Masks::Models,
                            filter_off: false,
                            search: None,
                            seed,
                            camera_divisor: matrix.camera_divisor,
                        },
                    }));
                }
            }
        }
    }
    jobs
}

/// The file that keeps a trial's path.
#[must_use]
pub fn path_file(out: &Path, key: &str) -> PathBuf {
    out.join("paths").join(format!("{key}.json"))
}

/// Plays what has not been played, and gives the lines of all jobs, in order.
///
/// # Errors
/// When a file cannot be written, or a trial cannot be played at all.
pub fn play(jobs: &[Job<'_>], out: &Path, n_threads: usize) -> anyhow::Result<Vec<Line>> {
    std::fs::create_dir_all(out.join("paths"))
        .with_context(|| format!("create {} (--out)", out.display()))?;
    let file = out.join("results.jsonl");
    drop_half_line(&file)?;
    let played: BTreeSet<String> = read_lines(&file).iter().map(key_of).collect();
    let left: Vec<&Job<'_>> = jobs.iter().filter(|job| !played.contains(&job.key())).collect();
    let progress = Progress::new(jobs.len(), jobs.len() - left.len());
    play_all(&left, out, &file, n_threads, &progress)?;
    progress.finish();
    let wanted: BTreeSet<String> = jobs.iter().map(Job::key).collect();
    let mut lines = read_lines(&file);
    lines.retain(|line| wanted.contains(&key_of(line)));
    lines.sort_by_key(|l| (l.scene.clone(), l.case.clone(), l.method, l.planner, l.sensing, l.event, l.seed));
    Ok(lines)
}

/// Takes away a line that was cut off when the last run was ended: its trial is played again.
fn drop_half_line(file: &Path) -> anyhow::Result<()> {
    let Ok(text) = std::fs::read_to_string(file) else { return Ok(()) };
    let whole = text.rfind('\n').map_or("", |end| &text[..=end]);
    if whole.len() < text.len() {
        std::fs::write(file, whole).with_context(|| format!("write {}", file.display()))?;
    }
    Ok(())
}

fn read_lines(file: &Path) -> Vec<Line> {
    // Nothing has been played when there is no file yet.
    let text = std::fs::read_to_string(file).unwrap_or_default();
    text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect()
}

fn play_all(
    jobs: &[&Job<'_>],
    out: &Path,
    file: &Path,
    n_threads: usize,
    progress: &Progress,
) -> anyhow::Result<()> {
    let results = std::fs::OpenOptions::new().create(true).append(true).open(file);
    let results = Mutex::new(results.with_context(|| format!("open {}", file.display()))?);
    let next = AtomicUsize::new(0);
    let work = || -> anyhow::Result<()> {
        while let Some(job) = jobs.get(next.fetch_add(1, Ordering::Relaxed)) {
            let Chosen { scene, case_idx, name, best } = job.chosen;
            let case = scene.cases.get(*case_idx);
            let say = case.map(|case| case.say.as_str());
            let task = Task { scene, say, case, condition: job.condition, best: *best, record: None };
            let (line, run) = judged(&task, name)?;
            Trace::of(&run).write(&path_file(out, &job.key()))?;
            let text = serde_json::to_string(&line)?;
            writeln!(results.lock().map_err(|_| anyhow!("another trial failed"))?, "{text}")?;
            progress.done(&job.key(), line.outcome);
        }
        Ok(())
    };
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..n_threads.max(1)).map(|_| scope.spawn(work)).collect();
        threads.into_iter().try_for_each(|t| t.join().map_err(|_| anyhow!("a trial panicked"))?)
    })
}
