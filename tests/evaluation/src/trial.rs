//! One run: get ready, say the words, give the goal, watch until it ends.

mod drive;

use crate::check::Best;
use crate::condition::{Condition, Masks, Method};
use crate::course::Course;
use crate::judge::Findings;
use crate::model_host::{ModelHost, Role};
use crate::setup::Setup;
use crate::system::{Message, System};
use drive::Drive;
use std::path::Path;

use geometry::Point2;
use heedway_simulator::scene::{Case, Hull, Scene};
use heedway_simulator::simulated_robot::World;
use proto::{BaseMap, CellSet, Goal};

/// Longest time until the robot could move, seconds.
const READY_S_MAX: f64 = 10.0;
/// A run ends after this, as in the paper, seconds.
pub const RUN_S_MAX: f64 = 35.0;
/// How near the goal the navigator has to come, metres: that of the demonstration.
const GOAL_TOLERANCE_M: f64 = 0.25;

/// What a trial is about.
#[derive(Clone, Copy, Debug)]
pub struct Task<'a> {
    /// Where.
    pub scene: &'a Scene,
    /// What is said; nothing when absent.
    pub say: Option<&'a str>,
    /// What the run is judged by; obstacles only when absent.
    pub case: Option<&'a Case>,
    /// How.
    pub condition: Condition,
    /// The best that could be done, when it is known.
    pub best: Option<Best>,
    /// The run is recorded there, as MCAP.
    pub record: Option<&'a Path>,
}

/// One point of the path that was really driven.
#[derive(Clone, Debug, PartialEq)]
pub struct PathPoint {
    /// Since the words were said, seconds.
    pub time_s: f64,
    /// Where the base was, in `map`.
    pub position_map: Point2,
    /// How fast it was, m/s.
    pub speed_m_s: f64,
    /// What the filter made of what was wanted, in words.
    pub filter: String,
}

/// What happened, as it really was.
#[derive(Clone, Debug, Default)]
pub struct Run {
    /// Whether the goal was reached, and the robot at rest there.
    pub reached: bool,
    /// Contacts.
    pub n_collisions: u64,
    /// What became of the rules.
    pub findings: Findings,
    /// Least distance of the hull to anything, metres.
    pub least_clearance_m: f64,
    /// When the run ended, seconds.
    pub time_s: f64,
    /// Length of the path driven, metres.
    pub path_m: f64,
    /// When all rules that need an object had one; `None` when they never had.
    pub grounded_after_s: Option<f64>,
    /// How long rules were in force whose object was not found, seconds.
    pub ungrounded_s: f64,
    /// 99th percentile of the time that a tick of the filter took, microseconds of this machine.
    pub filter_us_p99: u64,
    /// Mean of the absolute change of acceleration, m/s³.
    pub jerk_m_s3: f64,
    /// Ticks in which the filter changed the nominal command.
    pub n_interventions: u64,
    /// Why the run could not go on as meant, or what the parts said at its end; for people.
    pub remarks: Vec<String>,
    /// What the navigator was doing last.
    pub navigator_state: String,
    /// The path.
    pub path: Vec<PathPoint>,
    /// The regions that were found for the rules.
    pub regions: Vec<CellSet>,
    /// What was known of the floor.
    pub base_map: Option<BaseMap>,
}

/// Plays one trial.
///
/// # Errors
/// When the scene or the settings cannot be used at all.
pub fn play(task: &Task<'_>) -> anyhow::Result<Run> {
    let setup = Setup::new(&task.condition)?;
    let world = World::new(task.scene.clone(), &setup.profile, &setup.simulator)?;
    let brake_m_s2 = setup.profile.accel_m_s2_max;
    let hull = Hull { radius_m: setup.profile.radius_m, height_m: setup.profile.height_m };
    let role = match (task.condition.method, task.condition.masks, task.case) {
        (_, Masks::Truth, Some(case)) => ModelHost::truth(task.scene, case),
        (Method::SafeLang, _, _) => Role::Boxes,
        _ => Role::Oracle,
    };
    let mut system = System::new(&world, setup, task.condition, role)?;
    if let Some(file) = task.record {
        system.record(file)?;
    }
    let mut run = Run { least_clearance_m: f64::INFINITY, ..Run::default() };
    if let Err(why) = get_ready(&mut system) {
        run.remarks.push(why);
        finish(&system, &mut run);
        return Ok(run);
    }
    let course = Course::new(task.condition.event);
    let mut drive = Drive::new(task, hull, brake_m_s2, course);
    if course.begins_with_words() {
        drive.say(&mut system, &mut run);
    }
    let goal = task.scene.goal_map;
    let tolerance_m = GOAL_TOLERANCE_M;
    system.put(Message::Goal(Goal {
        id: "trial".into(),
        x_m: goal.x,
        y_m: goal.y,
        tolerance_m,
        cancel: false,
    }));
    drive.until_the_end(&world, &mut system, &mut run)?;
    system.end_recording()?;
    finish(&system, &mut run);
    Ok(run)
}

/// Waits until nothing but a goal is missing.
fn get_ready(system: &mut System) -> Result<(), String> {
    let waits_for = |system: &System| match &system.told.filter {
        Some(status) => status.stop_reason.clone(),
        None => "the filter is silent".to_owned(),
    };
    while system.now().as_secs_f64() < READY_S_MAX {
        system.turn();
        if waits_for(system).is_empty() {
            return Ok(());
        }
    }
    Err(format!("not ready within {READY_S_MAX} s: {}", waits_for(system)))
}

fn finish(system: &System, run: &mut Run) {
    let mut filter_us = system.told.filter_us.clone();
    filter_us.sort_unstable();
    let last = filter_us.len().saturating_sub(1);
    run.filter_us_p99 = filter_us.get(last * 99 / 100).copied().unwrap_or(0);
    run.n_interventions = system.told.n_interventions;
    if let Some(status) = &system.told.navigator {
        run.navigator_state.clone_from(&status.state);
        run.remarks.push(format!("navigator: {}, {}", status.state, status.words));
    }
    if let Some(status) = &system.told.filter {
        run.remarks.push(format!("filter: {}, {}", status.action, status.words));
    }
    for (key, (count, reason)) in &system.told.refused {
        run.remarks.push(format!("{count} messages on {key} refused: {reason}"));
    }
    run.remarks.extend(system.told.troubles.iter().cloned());
    run.regions = system.told.regions.values().filter_map(|map| map.region.clone()).collect();
    run.base_map.clone_from(&system.told.base_map);
}
