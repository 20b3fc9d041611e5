//! Tables of trials: one row a trial as CSV, and rates by kind of instruction and method as Markdown.

use std::collections::BTreeMap;

use crate::condition::{Event, Method};
use crate::outcome::{Line, Outcome};

/// The kinds of instruction, in the order of the paper's Fig. 4.
pub const KINDS: [&str; 5] = ["exclusion_zone", "spatial_relation", "pace", "intent", "hybrid"];

/// The kind of instruction of a trial.
#[must_use]
pub fn kind_of(line: &Line) -> &str {
    line.case.split_once(':').map_or(line.case.as_str(), |(_, kind)| kind)
}

/// What tells one condition from the other, in words.
#[must_use]
pub fn condition_of(line: &Line) -> String {
    let Line { planner, sensing, event, .. } = line;
    let mut words = format!("planner {}, sensing {}", planner.word(), sensing.word());
    if *event != Event::None {
        words += &format!(", event {}", event.word());
    }
    words
}

/// One row a trial; without what differs from machine to machine.
#[must_use]
pub fn csv(lines: &[Line]) -> String {
    let mut text = "scene,case,method,planner,sensing,event,seed,outcome,reached,collisions,violation_s,\
                    violation_depth_m,violation_excess,least_clearance_m,time_s,path_m,best_path_m,time_ratio,\
                    grounded_after_s,ungrounded_s,recovery_s,jerk_m_s3,interventions\n"
        .to_owned();
    for l in lines {
        let number = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
        let names = [&l.scene, &l.case, l.method.word(), l.planner.word(), l.sensing.word(), l.event.word()];
        let figures = [
            l.violation_s.to_string(),
            l.violation_depth_m.to_string(),
            l.violation_excess.to_string(),
            l.least_clearance_m.to_string(),
            l.time_s.to_string(),
            l.path_m.to_string(),
            number(l.best_path_m),
            number(l.time_ratio),
            number(l.grounded_after_s),
            l.ungrounded_s.to_string(),
            l.recovery_s.to_string(),
            l.jerk_m_s3.to_string(),
            l.interventions.to_string(),
        ];
        let (outcome, seed, reached, collisions) = (l.outcome.word(), l.seed, l.reached, l.collisions);
        let row = names.join(",");
        text += &format!("{row},{seed},{outcome},{reached},{collisions},{}\n", figures.join(","));
    }
    text
}

/// Rates by condition, method and kind, then every trial of ours that failed.
#[must_use]
pub fn markdown(lines: &[Line]) -> String {
    let mut groups: BTreeMap<(String, Method, usize), Vec<&Line>> = BTreeMap::new();
    for line in lines {
        let kind = KINDS.iter().position(|kind| *kind == kind_of(line)).unwrap_or(KINDS.len());
        for kind in [kind, ALL_KINDS] {
            groups.entry((condition_of(line), line.method, kind)).or_default().push(line);
        }
    }
    let mut page = String::new();
    let mut condition_before = None;
    for ((condition, method, kind), group) in &groups {
        if condition_before != Some(condition) {
            page += &format!("\n## {condition}\n\n{HEAD}");
            condition_before = Some(condition);
        }
        let kind = if *kind == ALL_KINDS { "all" } else { KINDS.get(*kind).copied().unwrap_or("other") };
        page += &row(*method, kind, group);
    }
    let ours = |l: &&Line| matches!(l.method, Method::SmoothBlending | Method::LeastRestrictive);
    let failed: Vec<&Line> = lines.iter().filter(ours).filter(|l| l.outcome != Outcome::Success).collect();
    page += &format!("\n## Failures of ours: {}\n\n", failed.len());
    for l in failed {
        page += &format!(
            "- {} case {}, {}, {}, seed {}: {}, {}\n",
            l.scene,
            l.case,
            l.method.word(),
            condition_of(l),
            l.seed,
            l.outcome.word(),
            l.why
        );
    }
    page
}

/// After all kinds.
const ALL_KINDS: usize = usize::MAX;

const HEAD: &str = "| method | kind | trials | success | semantic safety | collisions | time-out: perception | \
                    filter | planner | time of successes | over the least |\n\
                    |---|---|---|---|---|---|---|---|---|---|---|\n";

fn row(method: Method, kind: &str, group: &[&Line]) -> String {
    let n = group.len();
    let count = |outcome: Outcome| group.iter().filter(|l| l.outcome == outcome).count();
    let share = |k: usize| format!("{:.1} %", 100.0 * k as f64 / n.max(1) as f64);
    let kept = group.iter().filter(|l| l.violation_s <= 0.0).count();
    let good = || group.iter().filter(|l| l.outcome == Outcome::Success);
    let mean =
        |values: Vec<f64>| (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64);
    let time = mean(good().map(|l| l.time_s).collect()).map_or("–".into(), |s| format!("{s:.1} s"));
    let ratio =
        mean(good().filter_map(|l| l.time_ratio).collect()).map_or("–".into(), |r| format!("× {r:.2}"));
    format!(
        "| {} | {kind} | {n} | {} | {} | {} | {} | {} | {} | {time} | {ratio} |\n",
        method.word(),
        share(count(Outcome::Success)),
        share(kept),
        count(Outcome::Collision),
        count(Outcome::TimeoutPerception),
        count(Outcome::TimeoutFilter),
        count(Outcome::TimeoutPlanner)
    )
}
