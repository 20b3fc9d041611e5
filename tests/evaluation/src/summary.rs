//! Tables of trials: one row a trial as CSV, and rates by kind of instruction and method as Markdown.

use std::collections::BTreeMap;

use crate::condition::{Method, Planner, Sensing};
use crate::outcome::{Line, Outcome};

/// One row a trial.
#[must_use]
pub fn csv(lines: &[Line]) -> String {
    let mut text = "scene,case,method,planner,sensing,seed,outcome,reached,collisions,violation_s,violation_depth_m,\
                    violation_excess,least_clearance_m,time_s,path_m,grounded_after_s,jerk_m_s3,interventions\n"
        .to_owned();
    for l in lines {
        let grounded = l.grounded_after_s.map_or_else(String::new, |s| s.to_string());
        text += &format!(
            "{},{},{},{:?},{:?},{},{:?},{},{},{},{},{},{},{},{},{grounded},{},{}\n",
            l.scene,
            l.case,
            l.method.word(),
            l.planner,
            l.sensing,
            l.seed,
            l.outcome,
            l.reached,
            l.collisions,
            l.violation_s,
            l.violation_depth_m,
            l.violation_excess,
            l.least_clearance_m,
            l.time_s,
            l.path_m,
            l.jerk_m_s3,
            l.interventions
        );
    }
    text
}

/// Rates by condition, method and kind, then every trial of ours that failed.
#[must_use]
pub fn markdown(lines: &[Line]) -> String {
    let mut groups: BTreeMap<(Planner, Sensing, Method, String), Vec<&Line>> = BTreeMap::new();
    for line in lines {
        let kind = line.case.split_once(':').map_or(line.case.as_str(), |(_, kind)| kind);
        for kind in [kind, "all"] {
            let group = (line.planner, line.sensing, line.method, kind.to_owned());
            groups.entry(group).or_default().push(line);
        }
    }
    let mut page = "| planner | sensing | method | kind | trials | success | semantic safety | collisions | \
                    time-out: perception | filter | planner | mean time of successes |\n\
                    |---|---|---|---|---|---|---|---|---|---|---|---|\n"
        .to_owned();
    for ((planner, sensing, method, kind), group) in &groups {
        let n = group.len();
        let count = |outcome: Outcome| group.iter().filter(|l| l.outcome == outcome).count();
        let share = |k: usize| format!("{:.1} %", 100.0 * k as f64 / n.max(1) as f64);
        let kept = group.iter().filter(|l| l.violation_s <= 0.0).count();
        let n_success = count(Outcome::Success);
        let time_s: f64 = group.iter().filter(|l| l.outcome == Outcome::Success).map(|l| l.time_s).sum();
        let mean = if n_success > 0 { format!("{:.1} s", time_s / n_success as f64) } else { "–".into() };
        page += &format!(
            "| {planner:?} | {sensing:?} | {} | {kind} | {n} | {} | {} | {} | {} | {} | {} | {mean} |\n",
            method.word(),
            share(n_success),
            share(kept),
            count(Outcome::Collision),
            count(Outcome::TimeoutPerception),
            count(Outcome::TimeoutFilter),
            count(Outcome::TimeoutPlanner)
        );
    }
    let ours = |l: &&Line| matches!(l.method, Method::SmoothBlending | Method::LeastRestrictive);
    let failed: Vec<&Line> = lines.iter().filter(ours).filter(|l| l.outcome != Outcome::Success).collect();
    page += &format!("\nFailures of ours: {}\n\n", failed.len());
    for l in failed {
        page += &format!(
            "- {} {} {} {:?} {:?} seed {}: {:?}, {}\n",
            l.scene,
            l.case,
            l.method.word(),
            l.planner,
            l.sensing,
            l.seed,
            l.outcome,
            l.why
        );
    }
    page
}
