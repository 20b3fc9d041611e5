//! One run: get ready, say the words, give the goal, watch until it ends.

use geometry::{Point2, Pose2};
use heedway_simulator::scene::{Case, Hull, Scene};
use heedway_simulator::simulated_robot::World;
use proto::{BaseMap, CellSet, Goal, Instruction};
use rules::Outcome;

use crate::judge::{Findings, Judge, Moment};
use crate::model_host::{ModelHost, Role};
use crate::setup::{Condition, Masks, Method, Setup};
use crate::system::{Message, System, TURN};

/// Longest time until the robot could move, seconds.
const READY_S_MAX: f64 = 10.0;
/// A run ends after this, as in the paper, seconds.
pub const RUN_S_MAX: f64 = 35.0;
/// How near the goal the navigator has to come, metres: that of the demonstration.
const GOAL_TOLERANCE_M: f64 = 0.25;
/// How near the goal counts as there, metres.
const REACHED_M: f64 = GOAL_TOLERANCE_M + 0.05;
/// Slower than this is at rest, m/s and rad/s.
const REST: f64 = 0.02;
/// A point of the path is kept at every so many-th turn.
const N_TURNS_A_POINT: u64 = 5;

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
    let hull = Hull { radius_m: setup.profile.radius_m, height_m: setup.profile.height_m };
    let role = match (task.condition.method, task.condition.masks, task.case) {
        (_, Masks::Truth, Some(case)) => ModelHost::truth(task.scene, case),
        (Method::SafeLang, _, _) => Role::Boxes,
        _ => Role::Oracle,
    };
    let mut system = System::new(&world, setup, task.condition, role)?;
    let mut run = Run { least_clearance_m: f64::INFINITY, ..Run::default() };
    if let Err(why) = get_ready(&mut system) {
        run.remarks.push(why);
        finish(&system, &mut run);
        return Ok(run);
    }
    if let Some(words) = task.say.filter(|_| system.listens()) {
        system.put(Message::Instruction(Instruction::plain(words)));
        let reply = system.told.replies.last().map(|told| &told.reply);
        if reply.is_none_or(|reply| reply.outcome != Outcome::Accept) {
            let said = reply.map_or("nothing", |reply| reply.say.as_str());
            run.remarks.push(format!("the words were not taken as a rule; the reply is: {said}"));
        }
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
    drive(task, &world, hull, &mut system, &mut run);
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

/// Until the goal, a collision, or the end of time.
fn drive(task: &Task<'_>, world: &World, hull: Hull, system: &mut System, run: &mut Run) {
    let begun = system.now();
    let (mut last, _, _) = system.truth();
    let mut judge = Judge::new(task.case, task.scene, last);
    let elapsed_s = TURN.as_secs_f64();
    let (mut speed_m_s, mut accel_m_s2, mut jerk_sum) = (0.0_f64, 0.0_f64, 0.0_f64);
    let mut n_turns = 0_u64;
    loop {
        let (map_from_base, twist, n_collisions) = system.truth();
        let time_s = system.now().since(begun).as_secs_f64();
        let centre_map = map_from_base.position();
        run.least_clearance_m = run.least_clearance_m.min(world.truth.clearance_m(centre_map));
        judge.see(&Moment {
            time_s,
            elapsed_s,
            map_from_base,
            twist,
            gaps: &world.truth.objects(centre_map),
            radius_m: hull.radius_m,
        });
        run.path_m += way_m(last, map_from_base);
        last = map_from_base;
        let accel = (twist.speed_m_s - speed_m_s) / elapsed_s;
        jerk_sum += (accel - accel_m_s2).abs();
        (speed_m_s, accel_m_s2) = (twist.speed_m_s, accel);
        if n_turns.is_multiple_of(N_TURNS_A_POINT) {
            let filter = in_words(system);
            run.path.push(PathPoint { time_s, position_map: centre_map, speed_m_s: twist.speed_m_s, filter });
        }
        if run.grounded_after_s.is_none() && is_grounded(system) {
            run.grounded_after_s = Some(time_s);
        }
        run.time_s = time_s;
        run.n_collisions = n_collisions;
        let is_there = (task.scene.goal_map - centre_map).norm() <= REACHED_M;
        run.reached = is_there && twist.speed_m_s.abs() < REST && twist.yaw_rate_rad_s.abs() < REST;
        if run.reached || n_collisions > 0 || time_s >= RUN_S_MAX {
            break;
        }
        n_turns += 1;
        system.turn();
    }
    run.findings = judge.findings().clone();
    run.jerk_m_s3 = if run.time_s > 0.0 { jerk_sum / run.time_s } else { 0.0 };
}

/// What was wanted and what was sent, and why.
fn in_words(system: &System) -> String {
    let Some(status) = &system.told.filter else { return String::new() };
    let wanted = status.nominal.map_or_else(String::new, |twist| {
        format!("wanted {:.2} m/s {:.2} rad/s, ", twist.speed_m_s, twist.yaw_rate_rad_s)
    });
    let v_m = |value: Option<f64>| value.map_or("-".to_owned(), |v| format!("{v:.3}"));
    format!(
        "{wanted}sent {:.2} m/s {:.2} rad/s; V {} of {}; {}: {}",
        status.sent.speed_m_s,
        status.sent.yaw_rate_rad_s,
        v_m(status.v_sent_m),
        v_m(status.v_safe_m),
        status.action,
        status.words
    )
}

fn way_m(from: Pose2, to: Pose2) -> f64 {
    (to.position() - from.position()).norm()
}

/// Whether every rule in force that needs an object has one.
fn is_grounded(system: &System) -> bool {
    let status = system.told.filter.as_ref();
    status.is_some_and(|status| {
        !status.rules.is_empty() && status.rules.iter().all(|rule| rule.grounding.is_usable())
    })
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
