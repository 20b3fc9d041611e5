//! The same trial with the real services, each a process of its own, over the real network.
//!
//! For a sample: a run takes its own time there, and the machine's load is in it. [`agreement`] says how far the two
//! may differ. Only what the network lets through is used; the judge is the one of every other trial.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use heedway_cli::carry::ServiceName;
use heedway_cli::demo::judge::Judge as NoJudge;
use heedway_cli::demo::record::Record;
use heedway_cli::demo::stage;
use heedway_cli::fleet::{self, Change, FleetOptions, SceneSource};
use heedway_cli::terminal::Terminal;
use heedway_simulator::scene::Hull;
use heedway_simulator::truth::GroundTruth;
use toml::Value;

use crate::condition::{Event, Method, Planner, Sensing};
use crate::judge::{Findings, Judge, Moment};
use crate::outcome::{Line, Outcome};
use crate::setup::{START_JITTER_M, Setup};
use crate::trial::Task;

/// Times may differ by this share …
const TIME_SHARE: f64 = 0.25;
/// … and this much more, seconds: processes start to move a plan or a frame later.
const TIME_S: f64 = 2.0;
/// Lengths of paths may differ by this share.
const PATH_SHARE: f64 = 0.15;

/// What came of a trial with real processes.
#[derive(Clone, Debug)]
pub struct Played {
    /// At the goal and at rest, seconds after the goal was given.
    pub reached_s: Option<f64>,
    /// Contacts.
    pub n_collisions: u64,
    /// What became of the rules.
    pub findings: Findings,
    /// Length of the path, metres.
    pub path_m: f64,
}

/// Plays a trial with real processes; `heedway` is the binary that carries them, `scene_file` the scene's file.
///
/// # Errors
/// When the condition has no processes of its own, or one does not start or dies.
pub fn play(task: &Task<'_>, scene_file: &Path, heedway: &Path) -> anyhow::Result<Played> {
    let run = stage::Run {
        name: "processes",
        words: task.say,
        goal_map: task.scene.goal_map,
        judge: NoJudge::default(),
        options: options(task, scene_file, heedway)?,
    };
    // `zenoh` needs the multi-threaded scheduler; the services die with the thread that started them: this one.
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build();
    let runtime = runtime.context("start the runtime")?;
    let mut terminal = Terminal::stdout().without_status();
    let record = runtime.block_on(stage::play(run, &mut terminal))?;
    runtime.shutdown_background();
    Ok(judged(task, &record))
}

fn options(task: &Task<'_>, scene_file: &Path, heedway: &Path) -> anyhow::Result<FleetOptions> {
    let condition = &task.condition;
    if condition.event != Event::None {
        bail!("event is {}, must be none with --processes", condition.event.word());
    }
    let method = match condition.method {
        Method::SmoothBlending => fleet::Method::SmoothBlending,
        Method::LeastRestrictive => fleet::Method::LeastRestrictive,
        Method::PaperLiteral => fleet::Method::PaperLiteral,
        other => bail!("method is {}, which has no processes of its own", other.word()),
    };
    let setup = Setup::new(condition)?;
    let (noise, models) = (&setup.simulator.noise, &setup.simulator.models);
    let disturbance = &setup.filter.disturbance;
    let number =
        |service, key: &str, value: f64| Change { service, key: key.into(), value: Value::Float(value) };
    let mut changes = vec![
        number(ServiceName::Simulator, "simulator.start_jitter_m", START_JITTER_M),
        number(ServiceName::Simulator, "simulator.noise.depth_m_at_1_m", noise.depth_m_at_1_m),
        number(ServiceName::Simulator, "simulator.noise.depth_dropout", noise.depth_dropout),
        number(ServiceName::Simulator, "simulator.noise.range_m", noise.range_m),
        number(ServiceName::Simulator, "simulator.noise.odometry_scale", noise.odometry_scale),
        number(
            ServiceName::Simulator,
            "simulator.noise.odometry_yaw_rad_per_m",
            noise.odometry_yaw_rad_per_m,
        ),
        number(ServiceName::Simulator, "simulator.models.missed", models.missed),
        number(ServiceName::Simulator, "simulator.models.wrong", models.wrong),
        number(ServiceName::Simulator, "simulator.models.split", models.split),
        number(ServiceName::Filter, "filter.disturbance.position_m", disturbance.position_m),
        number(ServiceName::Filter, "filter.disturbance.yaw_rad", disturbance.yaw_rad),
    ];
    if condition.sensing == Sensing::Drift {
        let value = Value::String("slam".into());
        changes.push(Change { service: ServiceName::Localisation, key: "localisation.pose".into(), value });
    }
    Ok(FleetOptions {
        scene: SceneSource::File(scene_file.to_owned()),
        planner: match condition.planner {
            Planner::Base => fleet::Planner::Base,
            Planner::Rules => fleet::Planner::Rules,
        },
        method: Some(method),
        seed: condition.seed,
        changes,
        ..FleetOptions::office(heedway.to_owned())
    })
}

/// Judges what really happened as every other trial is judged.
fn judged(task: &Task<'_>, record: &Record) -> Played {
    let profile = fleet::profile();
    let hull = Hull { radius_m: profile.radius_m, height_m: profile.height_m };
    let truth = GroundTruth::new(task.scene, hull);
    let anchor = record.moments.first().map_or(task.scene.map_from_start, |first| first.map_from_base);
    let mut judge = Judge::new(task.case, task.scene, anchor);
    let mut last_s = 0.0;
    for moment in &record.moments {
        let gaps = truth.objects(moment.map_from_base.position());
        judge.see(&Moment {
            time_s: moment.time_s,
            elapsed_s: moment.time_s - last_s,
            map_from_base: moment.map_from_base,
            twist: moment.twist,
            gaps: &gaps,
            radius_m: hull.radius_m,
        });
        last_s = moment.time_s;
    }
    Played {
        reached_s: record.reached_s,
        n_collisions: record.n_collisions,
        findings: judge.findings().clone(),
        path_m: record.path_m(),
    }
}

/// The `heedway` binary: the given one, or the one beside this program.
///
/// # Errors
/// When there is none.
pub fn heedway(given: Option<&Path>) -> anyhow::Result<PathBuf> {
    let beside = || Ok::<_, anyhow::Error>(std::env::current_exe()?.with_file_name("heedway"));
    let file = given.map_or_else(beside, |file| Ok(file.to_owned()))?;
    if !file.is_file() {
        bail!("no `heedway` at {}: build it, or name it with --heedway", file.display());
    }
    Ok(file)
}

/// What differs by more than the tolerances; nothing when the two agree.
///
/// The goal is reached in both or in neither, rules are kept and nothing is touched in both or in neither; times
/// differ by at most 25 % and 2 s, lengths by at most 15 %.
#[must_use]
pub fn agreement(line: &Line, played: &Played) -> Vec<String> {
    let mut differences = Vec::new();
    let mut same = |what: &str, here: bool, there: bool| {
        if here != there {
            differences.push(format!("{what}: {here} in one thread, {there} in processes"));
        }
    };
    same("reached", line.reached, played.reached_s.is_some());
    same("rules kept", line.violation_s <= 0.0, played.findings.first.is_none());
    same("nothing touched", line.outcome != Outcome::Collision, played.n_collisions == 0);
    if let (true, Some(reached_s)) = (line.reached, played.reached_s) {
        let limit_s = TIME_SHARE * line.time_s + TIME_S;
        if (line.time_s - reached_s).abs() > limit_s {
            let here_s = line.time_s;
            differences
                .push(format!("time: {here_s:.1} s and {reached_s:.1} s, at most {limit_s:.1} s apart"));
        }
        let limit_m = PATH_SHARE * line.path_m;
        if (line.path_m - played.path_m).abs() > limit_m {
            let (here_m, there_m) = (line.path_m, played.path_m);
            differences.push(format!("path: {here_m:.1} m and {there_m:.1} m, at most {limit_m:.1} m apart"));
        }
    }
    differences
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A success of 10 s and 8 m in one thread, beside this.
    #[track_caller]
    fn check(reached_s: Option<f64>, path_m: f64, broken: Option<&str>, wanted: &[&str]) {
        let line: Line = serde_json::from_value(serde_json::json!({
            "scene": "s", "case": "0:pace", "method": "smooth_blending", "planner": "rules", "sensing": "perfect",
            "seed": 1, "outcome": "success", "reached": true, "collisions": 0, "violation_s": 0.0,
            "violation_depth_m": 0.0, "violation_excess": 0.0, "least_clearance_m": 0.1, "time_s": 10.0,
            "path_m": 8.0, "best_path_m": null, "time_ratio": null, "ungrounded_s": 0.0, "recovery_s": 0.0,
            "grounded_after_s": 0.3, "filter_us_p99": 100, "jerk_m_s3": 1.0, "interventions": 1, "why": ""
        }))
        .unwrap();
        let findings = Findings { first: broken.map(str::to_owned), ..Findings::default() };
        let differences = agreement(&line, &Played { reached_s, n_collisions: 0, findings, path_m });
        let subjects: Vec<&str> = differences.iter().filter_map(|d| d.split(':').next()).collect();
        assert_eq!(subjects, wanted);
    }

    #[test]
    fn a_little_later_is_the_same_and_much_later_is_not() {
        check(Some(14.4), 8.9, None, &[]);
        check(Some(14.6), 8.9, None, &["time"]);
        check(Some(10.0), 9.3, None, &["path"]);
        check(None, 3.0, None, &["reached"]);
        check(Some(10.0), 8.0, Some("on the rug"), &["rules kept"]);
    }
}
