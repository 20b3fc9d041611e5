//! The committed result of the suite, and a sample of it played again: it fails when a method gets worse.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test may fail loudly")]

use std::path::{Path, PathBuf};

use evaluation::condition::{Event, Method, Planner, Sensing};
use evaluation::setup::profile;
use evaluation::suite::{self, Job, Matrix};
use evaluation::summary::csv;
use heedway_simulator::scene::{Hull, Scene};

const REFERENCE: &str = include_str!("../reference/results.csv");
const OUTCOME_COLUMN: usize = 7;

fn scenes(names: &[&str]) -> Vec<Scene> {
    let profile = profile(1).unwrap();
    let hull = Hull { radius_m: profile.radius_m, height_m: profile.height_m };
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
    names.iter().map(|name| Scene::load(&folder.join(format!("{name}.json")), hull).unwrap()).collect()
}

fn matrix(methods: Vec<Method>) -> Matrix {
    Matrix {
        all_cases: true,
        methods,
        planners: vec![Planner::Rules],
        sensings: vec![Sensing::Perfect],
        events: vec![Event::None],
        n_trials: 1,
        camera_divisor: 2,
    }
}

fn out() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().to_owned();
    (folder, path)
}

/// Scene, case, method, planner, sensing, event, seed and outcome of a row.
fn named(row: &str) -> (String, String) {
    let cells: Vec<&str> = row.split(',').collect();
    (cells[..OUTCOME_COLUMN].join(","), cells[OUTCOME_COLUMN].to_owned())
}

#[test]
fn no_method_of_ours_does_worse_than_in_the_reference() {
    let scenes = scenes(&["office", "studio", "ward"]);
    let chosen = suite::choose(&scenes, true, &profile(1).unwrap()).unwrap();
    let methods = vec![Method::SmoothBlending];
    let jobs: Vec<Job<'_>> = suite::jobs(&chosen, &matrix(methods))
        .into_iter()
        .filter(|job| {
            let start = format!(
                "{},{},{},rules,perfect,none,1,",
                job.chosen.scene.name,
                job.chosen.name,
                job.condition.method.word()
            );
            REFERENCE.lines().any(|row| row.starts_with(&start))
        })
        .collect();
    assert!(jobs.len() >= 3, "{} rows of the reference are played again", jobs.len());
    let (_folder, out) = out();
    let lines = suite::play(&jobs, &out, 2).unwrap();
    for row in csv(&lines).lines().skip(1) {
        let (name, outcome) = named(row);
        let wanted = REFERENCE.lines().map(named).find(|(other, _)| *other == name).unwrap().1;
        assert!(outcome == wanted || outcome == "success", "{name}: {outcome}, was {wanted}\n{row}");
    }
}

#[test]
fn the_reference_holds_what_was_promised() {
    let rows: Vec<(String, String)> = REFERENCE.lines().skip(1).map(named).collect();
    let of =
        |method: Method| rows.iter().filter(move |(name, _)| name.split(',').nth(2) == Some(method.word()));
    let n = |method: Method, outcome: &str| of(method).filter(|(_, o)| o == outcome).count();
    for ours in [Method::SmoothBlending, Method::LeastRestrictive] {
        assert_eq!((n(ours, "semantic"), n(ours, "collision")), (0, 0), "{}", ours.word());
        assert_eq!(of(ours).count(), 60);
        assert!(n(ours, "success") >= 59, "{}: {} of 60", ours.word(), n(ours, "success"));
    }
    // Who is told nothing breaks the rules; boxes keep them where a distance is all, and close ways.
    let [geom, lang] = [Method::SafeGeom, Method::SafeLang];
    assert!(n(geom, "semantic") >= 50, "{} of {}", n(geom, "semantic"), of(geom).count());
    assert!(n(lang, "timeout_perception") >= 5 && n(lang, "semantic") < n(geom, "semantic") / 2);
}

#[test]
fn a_trial_that_has_its_line_is_not_played_again() {
    let scenes = scenes(&["studio"]);
    let chosen = suite::choose(&scenes, false, &profile(1).unwrap()).unwrap();
    let jobs = suite::jobs(&chosen, &matrix(vec![Method::SafeGeom]));
    let (_folder, out) = out();
    let first = suite::play(&jobs, &out, 1).unwrap();
    let file = out.join("results.jsonl");
    let written = std::fs::read_to_string(&file).unwrap();
    assert_eq!(suite::play(&jobs, &out, 1).unwrap(), first);
    assert_eq!(std::fs::read_to_string(&file).unwrap(), written);
    // Cut off in the middle of its line, it is.
    std::fs::write(&file, &written[..written.len() / 2]).unwrap();
    assert_eq!(csv(&suite::play(&jobs, &out, 1).unwrap()), csv(&first));
}
