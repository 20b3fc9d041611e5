//! The plan of least harm, when something is broken already or cannot be kept.
//!
//! The paper's score is blind there: every sample is worth l(x₀). Instead motions are ranked by what they do
//! wrong over time: first hitting an obstacle, then entering a zone the robot is not in or breaking a limit,
//! then the depth in the zones it is in, and how far the exit is at the end. Turn-then-drive motions are
//! always among the candidates. Deliberately not here: whether to recover (`filter`), how harm is reckoned (`judge`).

use crate::dynamics::{Control, Limits};
use crate::exit::ExitMap;
use crate::manoeuvres::{TurnAndDrive, headings};
use crate::plan::{Plan, Sample};
use crate::scene::{Assumptions, Scene};

mod judge;

use judge::{Judge, Judged};

/// Lengths along the way out that are driven to straight, metres.
const ALONG_M: [f64; 4] = [0.2, 0.4, 0.8, 1.6];
/// A slight preference for what is under way, so that two equal ways do not alternate.
const UNDER_WAY_FAVOUR: f64 = 0.98;
/// Under a limit of the turn rate, the slowest that turns are planned with, rad/s.
const TURN_RATE_RAD_S_MIN: f64 = 0.1;
/// Lengths of the drive after the turn, metres: out of a corner, and out of a large zone.
const DRIVES_M: [f64; 2] = [0.4, 2.0];

/// The plan of least harm.
#[derive(Clone, Debug)]
pub(crate) struct Ranked {
    pub plan: Plan,
    obstacle_m: f64,
}

impl Ranked {
    /// Whether the plan keeps clear of obstacles, or at least comes no nearer to the one it is too near to.
    pub(crate) fn spares_obstacles(&self) -> bool {
        self.obstacle_m <= 0.0
    }
}

/// What a ranking leaves to the next one, so that nothing is allocated.
#[derive(Debug, Default)]
pub(crate) struct Room {
    trunk: Vec<Judged>,
    controls: Vec<Control>,
}

/// The candidate of least harm: what is left of the last plan, brakes, arcs, and turn-then-drive motions. The plan
/// is written in the room of one that is no more.
pub(crate) fn least_harm(
    scene: &Scene<'_>,
    exits: Option<&ExitMap>,
    kept: Option<&Plan>,
    room: &mut Room,
    samples: Vec<Sample>,
) -> Option<Ranked> {
    let judge = Judge::new(scene, exits, std::mem::take(&mut room.trunk));
    let mut ranking = Ranking { judge, best: None, controls: std::mem::take(&mut room.controls) };
    ranking.controls.clear();
    if let Some(kept) = kept {
        ranking.consider(remaining_controls(kept), UNDER_WAY_FAVOUR);
    }
    consider_candidates(scene, exits, &mut ranking);
    let Assumptions { limits, step_s, .. } = scene.assumptions;
    let Ranking { judge, best, controls } = ranking;
    let plan = Plan::roll_into(samples, (scene.start, scene.heading), &controls, step_s, &limits, true);
    *room = Room { trunk: judge.trunk, controls };
    best.map(|(_, obstacle_m)| Ranked { plan, obstacle_m })
}

/// The best candidate so far; the others are followed no farther than they are harmless enough.
struct Ranking<'a, 'w> {
    judge: Judge<'a, 'w>,
    /// Harm, and how much too near it comes to an obstacle, metres.
    best: Option<(f64, f64)>,
    controls: Vec<Control>,
}

impl Ranking<'_, '_> {
    fn consider(&mut self, controls: impl Iterator<Item = Control> + Clone, favour: f64) {
        let ceiling = self.best.map_or(f64::INFINITY, |(harm, _)| harm);
        if let Some((harm, obstacle_m)) = self.judge.judge(controls.clone(), ceiling) {
            self.best = Some((harm * favour, obstacle_m));
            self.controls.clear();
            self.controls.extend(controls);
        }
    }
}

/// What is left of a plan, resampled from this moment.
pub(crate) fn remaining_controls(plan: &Plan) -> impl Iterator<Item = Control> + Clone + '_ {
    plan.controls(0..plan.rest().len() - 1)
}

fn consider_candidates(scene: &Scene<'_>, exits: Option<&ExitMap>, ranking: &mut Ranking<'_, '_>) {
    let limits = scene.assumptions.limits;
    let step_s = scene.assumptions.step_s;
    let (rate_max, accel_max, speed_max) =
        (limits.yaw_rate_rad_s_max, limits.accel_m_s2_max, limits.speed_m_s_max);
    // Who turns before driving has time to heed a limit of the turn rate.
    let in_force = scene.limits_in_force().yaw_rate_rad_s_max.max(TURN_RATE_RAD_S_MIN);
    let turning = Limits { yaw_rate_rad_s_max: in_force, ..limits };
    let n_stop = (limits.braking_s(scene.start.speed_m_s) / step_s).ceil() as usize + 1;
    let n_drive = (DRIVES_M[0] / speed_max / step_s).ceil() as usize;
    // The likeliest first: who comes later is followed only as far as it may still be better.
    let place = scene.start.position();
    for target in exits.into_iter().flat_map(|e| ALONG_M.map(|m| e.along_way_out(place, m))).flatten() {
        let (sight, heading_rad) = (target - place, (target.y - place.y).atan2(target.x - place.x));
        for driving_m_s in [speed_max, 0.3 * speed_max] {
            let driving_s = sight.norm() / driving_m_s;
            for turning_m_s in [0.0, 0.3 * driving_m_s] {
                let motion = TurnAndDrive { heading_rad, turning_m_s, driving_m_s, driving_s };
                ranking.consider(motion.controls(scene.start, &turning, step_s), 1.0);
            }
        }
    }
    for rate in [0.0, 0.5, -0.5, 1.0, -1.0] {
        let yaw_rate_rad_s = rate * rate_max;
        for (accel, n) in [(-accel_max, n_stop), (0.0, n_drive), (accel_max, n_drive)] {
            let control = Control { yaw_rate_rad_s, accel_m_s2: accel };
            ranking.consider(std::iter::repeat_n(control, n), 1.0);
        }
    }
    let slowest = scene.limits.iter().map(|layer| layer.speed_m_s).fold(speed_max, f64::min);
    for heading_rad in headings(scene.start) {
        for driving_m_s in [speed_max, 0.3 * speed_max, slowest - 0.01] {
            for (turning_share, drive_m) in [(0.0, DRIVES_M[0]), (0.0, DRIVES_M[1]), (0.3, DRIVES_M[1])] {
                let turning_m_s = turning_share * driving_m_s;
                let driving_s = (drive_m / driving_m_s.max(0.1)).min(DRIVES_M[1] / (0.3 * speed_max));
                let motion = TurnAndDrive { heading_rad, turning_m_s, driving_m_s, driving_s };
                ranking.consider(motion.controls(scene.start, &turning, step_s), 1.0);
            }
        }
    }
}
