//! The plan of least harm, when something is broken already or cannot be kept.
//!
//! The paper's score is blind there: every sample is worth l(x₀). Instead motions are ranked by what they do
//! wrong over time: first hitting an obstacle, then entering a zone the robot is not in or breaking a limit,
//! then the depth in the zones it is in, and how far the exit is at the end. Turn-then-drive motions are
//! always among the candidates. Deliberately not here: whether to recover (`filter`).

use crate::dynamics::{Control, Limits, State};
use crate::exit::{ExitMap, is_outside};
use crate::manoeuvres::{TurnAndDrive, headings};
use crate::plan::{Plan, Rolling, Sample};
use crate::scene::{Assumptions, Scene};
use crate::score::FIELD_SLOPE;

/// Weights of the ranking, in falling importance: an order of a thousand keeps the classes apart.
const OBSTACLE_WEIGHT: f64 = 1e6;
/// See [`OBSTACLE_WEIGHT`]: for entering zones and breaking limits.
const RULE_WEIGHT: f64 = 1e3;
/// Cost of a metre to the exit at the end of a plan, against a metre of depth for a second. More than a metre
/// deeper can cost all along ([`Judge::depth_weight`]): a metre nearer to the exit always pays.
const EXIT_WEIGHT: f64 = 8.0;
/// Stands for "no way out": farther than any exit.
const NO_EXIT_M: f64 = 50.0;
/// Already too near an obstacle, the field may be followed down by rounding only, metres.
const ROUNDING_M: f64 = 1e-4;
/// Cost of a metre deeper into the zones than at the start: less than what the way out gains by it, or
/// nobody whose way out leads deeper would go, but enough to turn round at an edge rather than cross.
const DEEPER_WEIGHT: f64 = 2.0;
/// Plans are compared over the time of half a turn and this much, seconds.
const COMPARED_S: f64 = 2.0;
/// Lengths along the way out that are driven to straight, metres.
const ALONG_M: [f64; 4] = [0.2, 0.4, 0.8, 1.6];
/// A slight preference for what is under way, so that two equal ways do not alternate.
const UNDER_WAY_FAVOUR: f64 = 0.98;
/// Too near an obstacle, how far beyond the tube the way back leads, metres.
const TOO_NEAR_BEYOND_M: f64 = 0.01;
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

/// The candidate of least harm: what is left of the last plan, brakes, arcs, and turn-then-drive motions.
pub(crate) fn least_harm(scene: &Scene<'_>, exits: Option<&ExitMap>, kept: Option<&Plan>) -> Option<Ranked> {
    let judge = Judge::new(scene, exits);
    let mut ranking = Ranking { judge, best: None, controls: Vec::new() };
    if let Some(kept) = kept {
        ranking.consider(remaining_controls(kept), UNDER_WAY_FAVOUR);
    }
    consider_candidates(scene, exits, &mut ranking);
    let Assumptions { limits, step_s, .. } = scene.assumptions;
    let (_, obstacle_m) = ranking.best?;
    Some(Ranked { plan: Plan::roll(scene.start, &ranking.controls, step_s, &limits, true), obstacle_m })
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
        if let Some((harm, obstacle_m)) = self.judge.judge(controls.clone(), ceiling)
            && harm * favour < ceiling
        {
            self.best = Some((harm * favour, obstacle_m));
            self.controls.clear();
            self.controls.extend(controls);
        }
    }
}

/// What is left of a plan, resampled from this moment.
pub(crate) fn remaining_controls(plan: &Plan) -> impl Iterator<Item = Control> + Clone + '_ {
    let n_left = plan.rest().len() - 1;
    (0..n_left).map(|k| plan.control_at(k as f64 * plan.step_s()))
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

/// What stays the same for all candidates of one tick.
struct Judge<'a, 'w> {
    scene: &'a Scene<'w>,
    exits: Option<&'a ExitMap>,
    start_depth_m: f64,
    is_in_zone: bool,
    /// What full braking falls short of the obstacles' margins, as far as an error of the position explains
    /// it, metres: who falls short by no more has nothing to gain by breaking a rule.
    forgiven_m: f64,
    /// Time over which plans are compared, seconds.
    compared_s: f64,
    /// Cost of a metre of depth for a second: a metre deeper, all the time that is compared and at the deepest, costs
    /// less than a metre of the way out.
    depth_weight: f64,
}

/// What a plan does wrong, class by class; every part only grows along the plan.
#[derive(Clone, Copy, Debug, Default)]
struct Wrongs {
    /// By how much it comes too near to an obstacle, metres.
    obstacle_m: f64,
    /// By how much it enters a zone that it was not in, metres.
    entered_m: f64,
    /// By how much and how long it breaks limits, in m/s or rad/s times seconds.
    over_s: f64,
    /// Depth times time in the zones it is in, m s.
    depth_m_s: f64,
    /// Depth beyond that of the start, metres.
    deeper_m: f64,
}

impl Wrongs {
    fn harm(&self, forgiven_m: f64, depth_weight: f64) -> f64 {
        OBSTACLE_WEIGHT * (self.obstacle_m - forgiven_m).max(0.0)
            + RULE_WEIGHT * (self.entered_m + self.over_s)
            + depth_weight * self.depth_m_s
            + DEEPER_WEIGHT * self.deeper_m
    }
}

impl<'a, 'w> Judge<'a, 'w> {
    fn new(scene: &'a Scene<'w>, exits: Option<&'a ExitMap>) -> Self {
        let start_depth_m = soft_depth_m(scene, scene.start);
        let is_in_zone = scene.spatial.iter().any(|layer| layer.soft);
        let rate_rad_s = scene.limits_in_force().yaw_rate_rad_s_max.max(TURN_RATE_RAD_S_MIN);
        let compared_s = COMPARED_S + std::f64::consts::PI / rate_rad_s;
        let depth_weight = ((EXIT_WEIGHT - DEEPER_WEIGHT - 1.0) / compared_s).min(1.0);
        let judge =
            Judge { scene, exits, start_depth_m, is_in_zone, forgiven_m: 0.0, compared_s, depth_weight };
        let braking = judge.judge(std::iter::empty(), f64::INFINITY);
        let braking_short_m = braking.map_or(0.0, |(_, short_m)| short_m);
        let position_m = scene.assumptions.disturbance.position_m;
        Judge { forgiven_m: braking_short_m.min(position_m), ..judge }
    }

    /// The harm of a sequence and how near it comes to obstacles, metres; `None` as soon as it exceeds `ceiling`.
    fn judge(&self, controls: impl Iterator<Item = Control>, ceiling: f64) -> Option<(f64, f64)> {
        let scene = self.scene;
        let Assumptions { limits, step_s, .. } = scene.assumptions;
        let mut wrongs = Wrongs::default();
        let mut samples = Rolling::new(scene.start, controls, step_s, &limits);
        let mut from = samples.next()?;
        let mut n_steps = 0;
        for to in samples {
            n_steps += 1;
            let tube_m = scene.tube_m(scene.start.speed_m_s, to.moving_s, to.path_m);
            let lost_m = tube_m + scene.loss_m(to.path_m - from.path_m, from.yaw_rate_rad_s * step_s);
            let counts_s = if f64::from(n_steps) * step_s <= self.compared_s { step_s } else { 0.0 };
            self.add_spatial(&mut wrongs, &to, lost_m, counts_s);
            wrongs.over_s += limits_broken(scene, (&from, &to), tube_m, n_steps == 1) * step_s;
            if wrongs.harm(self.forgiven_m, self.depth_weight) > ceiling {
                return None;
            }
            from = to;
        }
        let end = from.state;
        let end_depth_m = soft_depth_m(scene, end);
        // A short plan must not look harmless: it stays where it ends.
        wrongs.depth_m_s += end_depth_m * (self.compared_s - f64::from(n_steps) * step_s).max(0.0);
        let exit_m = match self.exits {
            Some(exits) => match exits.distance_m(end.position()) {
                far_m if far_m <= NO_EXIT_M => far_m,
                // The map reaches a little beyond the nearest exit only.
                _ if is_outside(scene, end.position()) => 0.0,
                _ => NO_EXIT_M,
            },
            None if self.is_in_zone => end_depth_m,
            None => 0.0,
        };
        let harm =
            wrongs.harm(self.forgiven_m, self.depth_weight) + EXIT_WEIGHT * (exit_m + self.still_near_m(end));
        (harm <= ceiling).then_some((harm, wrongs.obstacle_m))
    }

    /// Adds what the place of one sample does wrong; `counts_s` is the time it counts for.
    fn add_spatial(&self, wrongs: &mut Wrongs, to: &Sample, lost_m: f64, counts_s: f64) {
        let position_m = self.scene.assumptions.disturbance.position_m;
        let fallen_m = FIELD_SLOPE * to.path_m + self.scene.assumptions.closing_speed_m_s * to.moving_s;
        // Of zones that overlap only the deepest counts: two are left by the same way as one.
        let mut soft_m = 0.0_f64;
        for layer in &self.scene.spatial {
            let is_far = layer.start_m - fallen_m > lost_m.max(0.0);
            if is_far && !layer.soft && !layer.is_too_near(&self.scene.assumptions) {
                // Farther than anything lost: it adds nothing.
                continue;
            }
            let margin_m = layer.margin_m(to.state.position(), to.moving_s);
            if layer.soft {
                soft_m = soft_m.max(position_m - margin_m);
                wrongs.deeper_m = wrongs.deeper_m.max(-margin_m - self.start_depth_m);
                continue;
            }
            // Too near already: no plan can keep the margin, and none needs to come nearer.
            let too_near = layer.is_too_near(&self.scene.assumptions);
            let short_m = if too_near { layer.start_m - ROUNDING_M - margin_m } else { lost_m - margin_m };
            if layer.is_base() {
                wrongs.obstacle_m = wrongs.obstacle_m.max(short_m);
            } else {
                wrongs.entered_m = wrongs.entered_m.max(short_m);
                wrongs.depth_m_s += short_m.max(0.0) * counts_s;
            }
            if too_near {
                wrongs.depth_m_s += (position_m + TOO_NEAR_BEYOND_M - margin_m).max(0.0) * counts_s;
            }
        }
        wrongs.depth_m_s += soft_m * counts_s;
    }

    /// How much is missing at the end of a plan to be clear of what the start is too near to, metres.
    fn still_near_m(&self, end: State) -> f64 {
        let assumptions = &self.scene.assumptions;
        let clear_m = assumptions.disturbance.position_m + TOO_NEAR_BEYOND_M;
        let near = self.scene.spatial.iter().filter(|layer| layer.is_too_near(assumptions));
        near.map(|layer| clear_m - layer.margin_m(end.position(), 0.0)).fold(0.0, f64::max)
    }
}

fn soft_depth_m(scene: &Scene<'_>, state: State) -> f64 {
    let soft = scene.spatial.iter().filter(|layer| layer.soft);
    soft.map(|layer| (-layer.margin_m(state.position(), 0.0)).max(0.0)).fold(0.0, f64::max)
}

/// By how much a segment breaks the limits where it may be in their zones; speeds and rates added.
fn limits_broken(scene: &Scene<'_>, (from, to): (&Sample, &Sample), tube_m: f64, is_first: bool) -> f64 {
    let accel_m_s2 = scene.assumptions.limits.accel_m_s2_max;
    let measured_m_s = if is_first { scene.assumptions.disturbance.speed_m_s } else { 0.0 };
    let guard_m = scene.zone_guard_m(tube_m);
    let inside = |sample: &Sample, margin: &dyn Fn(&Sample) -> f64| margin(sample) <= guard_m;
    scene
        .limits
        .iter()
        .filter(|layer| {
            let margin = |sample: &Sample| layer.zone_margin_m(sample.state.position());
            inside(from, &margin) || inside(to, &margin)
        })
        .map(|layer| {
            let from_over = from.state.speed_m_s - measured_m_s - layer.speed_at(from.moving_s, accel_m_s2);
            let to_over = to.state.speed_m_s - layer.speed_at(to.moving_s, accel_m_s2);
            let turn_over = from.yaw_rate_rad_s.abs() - layer.yaw_rate_rad_s;
            from_over.max(to_over).max(0.0) + turn_over.max(0.0)
        })
        .sum()
}
