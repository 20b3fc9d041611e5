//! What came of a trial, in one word and one line, and who is to blame for a time-out.
//!
//! A time-out is played again with the same seed and one part made perfect: with masks of the ground truth (then
//! it was *perception*), and without the filter (then it was the *filter*; who times out or bumps into something
//! without it too was led wrong by the *planner*).

use serde::{Deserialize, Serialize};

use crate::condition::{Condition, Event, Masks, Method, Planner, Sensing};
use crate::trial::{Run, Task, play};

/// What came of a trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// At the goal; nothing touched, every rule kept.
    Success,
    /// A rule was broken.
    Semantic,
    /// Something was touched.
    Collision,
    /// Not at the goal in time: masks too large, too small, or too late.
    TimeoutPerception,
    /// Not at the goal in time: the filter let the planner's way not be driven.
    TimeoutFilter,
    /// Not at the goal in time: the planner did not lead there.
    TimeoutPlanner,
}

impl Outcome {
    /// As in a line of results.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Outcome::Success => "success",
            Outcome::Semantic => "semantic",
            Outcome::Collision => "collision",
            Outcome::TimeoutPerception => "timeout_perception",
            Outcome::TimeoutFilter => "timeout_filter",
            Outcome::TimeoutPlanner => "timeout_planner",
        }
    }

    /// Whether the goal was not reached in time, and nothing else went wrong.
    #[must_use]
    pub fn is_timeout(self) -> bool {
        matches!(self, Outcome::TimeoutPerception | Outcome::TimeoutFilter | Outcome::TimeoutPlanner)
    }
}

/// One trial, as it is reported.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Line {
    /// Name of the scene.
    pub scene: String,
    /// The case: its number in the file from 0 and its kind, the words that were said, or `no-rule`.
    pub case: String,
    /// Who kept the rules.
    pub method: Method,
    /// What the planner saw.
    pub planner: Planner,
    /// How well the robot sensed.
    pub sensing: Sensing,
    /// What happened beside driving.
    #[serde(default)]
    pub event: Event,
    /// Replays the trial.
    pub seed: u64,
    /// What came of it.
    pub outcome: Outcome,
    /// Whether the robot was at rest at the goal.
    pub reached: bool,
    /// Contacts.
    pub collisions: u64,
    /// Time in violation of any rule, seconds.
    pub violation_s: f64,
    /// How far inside a zone that it may not be in the hull was at most, metres.
    pub violation_depth_m: f64,
    /// By how much a speed limit was exceeded at most, m/s or rad/s.
    pub violation_excess: f64,
    /// Least distance of the hull to anything, metres.
    pub least_clearance_m: f64,
    /// When the run ended, seconds after the words.
    pub time_s: f64,
    /// Length of the path driven, metres.
    pub path_m: f64,
    /// Length of the shortest way that keeps the rules, metres; absent when it is not known.
    pub best_path_m: Option<f64>,
    /// Time over the least time for that way; absent when it is not known or the goal was not reached.
    pub time_ratio: Option<f64>,
    /// How long rules were in force whose object was not found, seconds.
    pub ungrounded_s: f64,
    /// Time until rules that were broken when they were given were kept, seconds.
    pub recovery_s: f64,
    /// When every rule's object was found, seconds; absent when never, or when no rule needs one.
    pub grounded_after_s: Option<f64>,
    /// 99th percentile of a tick of the filter, microseconds of the machine that played the trial.
    pub filter_us_p99: u64,
    /// Mean absolute jerk, m/s³.
    pub jerk_m_s3: f64,
    /// Ticks in which the filter changed the nominal command.
    pub interventions: u64,
    /// Why, for people.
    pub why: String,
}

/// Plays a trial and names what came of it.
///
/// # Errors
/// As [`play`].
pub fn judged(task: &Task<'_>, case_name: &str) -> anyhow::Result<(Line, Run)> {
    let run = play(task)?;
    let outcome = match plain_outcome(&run) {
        Some(outcome) => outcome,
        None => blame(task)?,
    };
    let condition = &task.condition;
    let rounded = |value: f64| (value * 1e4).round() / 1e4;
    let line = Line {
        scene: task.scene.name.clone(),
        case: case_name.to_owned(),
        method: condition.method,
        planner: condition.planner,
        sensing: condition.sensing,
        event: condition.event,
        seed: condition.seed,
        outcome,
        reached: run.reached,
        collisions: run.n_collisions,
        violation_s: rounded(run.findings.violation_s),
        violation_depth_m: rounded(run.findings.violation_depth_m),
        violation_excess: rounded(run.findings.violation_excess),
        least_clearance_m: rounded(run.least_clearance_m),
        time_s: rounded(run.time_s),
        path_m: rounded(run.path_m),
        best_path_m: task.best.map(|best| rounded(best.length_m)),
        time_ratio: task.best.filter(|_| run.reached).map(|best| rounded(run.time_s / best.time_s.max(0.1))),
        ungrounded_s: rounded(run.ungrounded_s),
        recovery_s: rounded(run.findings.recovery_s),
        grounded_after_s: run.grounded_after_s.map(rounded),
        filter_us_p99: run.filter_us_p99,
        jerk_m_s3: rounded(run.jerk_m_s3),
        interventions: run.n_interventions,
        why: why(&run, outcome),
    };
    Ok((line, run))
}

/// `None` for a time-out.
fn plain_outcome(run: &Run) -> Option<Outcome> {
    if run.n_collisions > 0 {
        Some(Outcome::Collision)
    } else if run.findings.first.is_some() {
        Some(Outcome::Semantic)
    } else if run.reached {
        Some(Outcome::Success)
    } else {
        None
    }
}

fn arrives(run: &Run) -> bool {
    run.reached && run.n_collisions == 0
}

fn blame(task: &Task<'_>) -> anyhow::Result<Outcome> {
    let again = |condition: Condition| play(&Task { condition, record: None, ..*task });
    if task.case.is_some() && task.condition.masks == Masks::Models {
        // Whether a rule was broken on the way is another question: some methods know nothing of speeds.
        let run = again(Condition { masks: Masks::Truth, ..task.condition })?;
        if arrives(&run) {
            return Ok(Outcome::TimeoutPerception);
        }
    }
    let run = again(Condition { filter_off: true, ..task.condition })?;
    Ok(if arrives(&run) { Outcome::TimeoutFilter } else { Outcome::TimeoutPlanner })
}

fn why(run: &Run, outcome: Outcome) -> String {
    let mut clauses: Vec<String> = run.findings.first.iter().cloned().collect();
    clauses.extend(run.findings.not_judged.iter().map(|why| format!("a rule is not judged: {why}")));
    if outcome != Outcome::Success {
        clauses.extend(run.remarks.iter().take(6).cloned());
    } else {
        clauses.extend(run.remarks.iter().filter(|remark| is_worth_saying(remark)).cloned());
    }
    clauses.join("; ")
}

/// What belongs to a success, too: that the words were not taken, or that something did or did not happen.
fn is_worth_saying(remark: &str) -> bool {
    ["the words", "a box", "there was no occasion"].iter().any(|start| remark.starts_with(start))
}
