//! A fast subset of the evaluation: it fails when a method gets worse, or when nothing could fail any more.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test may fail loudly")]

use std::path::Path;

use evaluation::check::Survey;
use evaluation::condition::{Condition, Event, Masks, Method, Planner, Sensing};
use evaluation::generate::{self, Sort};
use evaluation::outcome::{Line, Outcome, judged};
use evaluation::setup::profile;
use evaluation::trial::Task;
use heedway_simulator::scene::{Hull, Scene};

fn scene(name: &str) -> Scene {
    let profile = profile(1).unwrap();
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes").join(name);
    Scene::load(&file, Hull { radius_m: profile.radius_m, height_m: profile.height_m }).unwrap()
}

fn condition(method: Method, planner: Planner, seed: u64) -> Condition {
    Condition {
        method,
        planner,
        sensing: Sensing::Perfect,
        event: Event::None,
        masks: Masks::Models,
        filter_off: false,
        search: None,
        seed,
        camera_divisor: 4,
    }
}

fn played(scene: &Scene, case_idx: usize, condition: Condition) -> Line {
    let case = &scene.cases[case_idx];
    let task = Task { scene, say: Some(&case.say), case: Some(case), condition, best: None, record: None };
    judged(&task, &format!("{case_idx}:{}", case.kind)).unwrap().0
}

#[track_caller]
fn check(name: &str, case_idx: usize, method: Method, wanted: Outcome) {
    let line = played(&scene(name), case_idx, condition(method, Planner::Rules, 1));
    assert_eq!(line.outcome, wanted, "{line:?}");
}

#[test]
fn ours_keeps_each_kind_of_rule_and_reaches_the_goal() {
    check("office.json", 0, Method::SmoothBlending, Outcome::Success);
    check("home.json", 0, Method::SmoothBlending, Outcome::Success);
    // A quarter of the camera's pixels are too few for the bars of a crib.
    let all_pixels = Condition { camera_divisor: 1, ..condition(Method::SmoothBlending, Planner::Rules, 1) };
    let line = played(&scene("nursery.json"), 4, all_pixels);
    assert_eq!(line.outcome, Outcome::Success, "{line:?}");
    check("office.json", 0, Method::LeastRestrictive, Outcome::Success);
    // Its limit of the turn rate is below what the tracker asks for all the time.
    check("pool_yard.json", 3, Method::LeastRestrictive, Outcome::Success);
}

#[test]
fn who_is_not_told_breaks_the_rule() {
    check("office.json", 0, Method::SafeGeom, Outcome::Semantic);
    check("home.json", 0, Method::SafeGeom, Outcome::Semantic);
}

#[test]
fn with_a_planner_that_knows_no_rules_the_filter_alone_keeps_them() {
    let line = played(&scene("home.json"), 0, condition(Method::SmoothBlending, Planner::Base, 1));
    assert_eq!((line.violation_s, line.collisions), (0.0, 0), "{line:?}");
}

#[test]
fn the_same_seed_gives_the_same_line_byte_for_byte() {
    let office = scene("office.json");
    let line = |seed, sensing| {
        let condition = Condition { sensing, ..condition(Method::SmoothBlending, Planner::Rules, seed) };
        let mut line = played(&office, 0, condition);
        // The only figure that depends on the machine's load.
        line.filter_us_p99 = 0;
        serde_json::to_string(&line).unwrap()
    };
    assert_eq!(line(1, Sensing::Perfect), line(1, Sensing::Perfect));
    assert_eq!(line(1, Sensing::Noisy), line(1, Sensing::Noisy));
    assert_ne!(line(1, Sensing::Perfect), line(2, Sensing::Perfect));
}

#[track_caller]
fn check_condition(name: &str, case_idx: usize, sensing: Sensing, event: Event) -> Line {
    let condition = Condition {
        sensing,
        event,
        camera_divisor: 2,
        ..condition(Method::SmoothBlending, Planner::Rules, 1)
    };
    let line = played(&scene(name), case_idx, condition);
    assert_eq!(line.outcome, Outcome::Success, "{line:?}");
    assert!(!line.why.contains("no occasion"), "{line:?}");
    line
}

#[test]
fn rules_are_kept_when_masks_err_and_when_wheels_drift() {
    check_condition("home.json", 0, Sensing::MissedMasks, Event::None);
    check_condition("home.json", 0, Sensing::WrongMasks, Event::None);
    check_condition("office.json", 0, Sensing::Drift, Event::None);
}

#[test]
fn what_happens_in_mid_run_is_heeded() {
    let boxed = check_condition("home.json", 0, Sensing::Perfect, Event::Obstacle);
    assert!(boxed.why.contains("a box appeared"), "{boxed:?}");
    let inside = check_condition("home.json", 0, Sensing::Perfect, Event::ToldInside);
    assert!(inside.recovery_s > 0.0, "{inside:?}");
    check_condition("office.json", 0, Sensing::Perfect, Event::ToldLate);
    check_condition("home.json", 0, Sensing::Perfect, Event::Revoked);
}

/// Its crib is seen from one face only until the robot has passed.
#[test]
fn a_limit_holds_along_a_face_that_the_camera_never_sees() {
    let profile = profile(1).unwrap();
    for seed in [21, 33] {
        let (room, _) = generate::scene(Sort::Room, seed, &profile).unwrap();
        let line = played(&room, 0, condition(Method::SmoothBlending, Planner::Rules, seed));
        assert_eq!((line.outcome, line.violation_s), (Outcome::Success, 0.0), "{line:?}");
    }
}

#[test]
fn every_case_of_the_furnished_scenes_is_worth_playing() {
    let profile = profile(1).unwrap();
    let names = [
        "office",
        "home",
        "corridor_flat",
        "dining_hall",
        "ward",
        "shop",
        "warehouse",
        "pool_yard",
        "garden",
        "garage",
        "nursery",
        "studio",
    ];
    for name in names {
        let scene = scene(&format!("{name}.json"));
        let survey = Survey::new(&scene, &profile).unwrap();
        assert_eq!(scene.cases.len(), 5, "{name}");
        for case in &scene.cases {
            let checked = survey.check(case);
            assert_eq!(checked.refused, "", "{name}: {:?}", case.say);
        }
    }
}

#[test]
fn a_case_that_nothing_breaks_is_refused() {
    let profile = profile(1).unwrap();
    let office = scene("office.json");
    let mut case = office.cases[1].clone();
    case.rules[0].objects = vec!["water-cooler".into()];
    let refused = Survey::new(&office, &profile).unwrap().check(&case).refused;
    assert!(refused.contains("breaks no rule clearly"), "{refused}");
}

#[test]
fn a_seed_draws_the_same_scene_each_time_and_another_seed_another() {
    let profile = profile(1).unwrap();
    let text = |sort, seed| generate::scene(sort, seed, &profile).unwrap().1;
    for sort in [Sort::Room, Sort::Cylinders] {
        assert_eq!(text(sort, 3), text(sort, 3));
        assert_ne!(text(sort, 3), text(sort, 4));
    }
}
