//! What one motion does wrong, class by class and over time: the harm that motions are ranked by.
//!
//! Not here: which motions are judged (`recovery`).

use super::TURN_RATE_RAD_S_MIN;
use crate::dynamics::{Bend, Control, State};
use crate::exit::{ExitMap, is_outside};
use crate::plan::{Rolling, Sample};
use crate::scene::{Assumptions, LimitLayer, Place, Scene};
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
/// Too near an obstacle, how far beyond the tube the way back leads, metres.
const TOO_NEAR_BEYOND_M: f64 = 0.01;
/// Longest candidate, steps: whoever is not at rest by then is judged by what it did until then.
const N_STEPS_MAX: usize = 1200;

/// What stays the same for all candidates of one tick.
pub(super) struct Judge<'a, 'w> {
    scene: &'a Scene<'w>,
    exits: Option<&'a ExitMap>,
    start: Rolling,
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
    /// The steps of the last candidate: many begin alike, and what two have in common is judged once.
    pub trunk: Vec<Judged>,
    bend: Bend,
}

/// One step of a candidate.
#[derive(Clone, Copy, Debug)]
pub(super) struct Judged {
    control: Control,
    /// Where it ends, and what is wrong until there.
    to: Rolling,
    wrongs: Wrongs,
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
    pub(super) fn new(scene: &'a Scene<'w>, exits: Option<&'a ExitMap>, mut trunk: Vec<Judged>) -> Self {
        trunk.clear();
        let start_depth_m = soft_depth_m(scene, scene.start);
        let is_in_zone = scene.spatial.iter().any(|layer| layer.soft);
        let rate_rad_s = scene.limits_in_force().yaw_rate_rad_s_max.max(TURN_RATE_RAD_S_MIN);
        let compared_s = COMPARED_S + std::f64::consts::PI / rate_rad_s;
        let depth_weight = ((EXIT_WEIGHT - DEEPER_WEIGHT - 1.0) / compared_s).min(1.0);
        let mut judge = Judge {
            scene,
            exits,
            start: Rolling::from(scene.start),
            start_depth_m,
            is_in_zone,
            forgiven_m: 0.0,
            compared_s,
            depth_weight,
            trunk,
            bend: Bend::NONE,
        };
        let braking = judge.judge(std::iter::empty(), f64::INFINITY);
        let braking_short_m = braking.map_or(0.0, |(_, short_m)| short_m);
        let position_m = scene.assumptions.disturbance.position_m;
        Judge { forgiven_m: braking_short_m.min(position_m), ..judge }
    }

    /// The harm of a sequence and how near it comes to obstacles, metres; `None` as soon as it reaches `ceiling`.
    pub(super) fn judge(
        &mut self,
        mut controls: impl Iterator<Item = Control>,
        ceiling: f64,
    ) -> Option<(f64, f64)> {
        let scene = self.scene;
        let braking = Control { yaw_rate_rad_s: 0.0, accel_m_s2: -scene.assumptions.limits.accel_m_s2_max };
        let (mut from, mut wrongs) = (self.start, Wrongs::default());
        let mut n_steps = 0;
        loop {
            let is_moving = from.sample.state.speed_m_s > 0.0 && n_steps < N_STEPS_MAX;
            let Some(control) = controls.next().or(is_moving.then_some(braking)) else { break };
            let judged = match self.trunk.get(n_steps) {
                Some(judged) if judged.control == control => *judged,
                _ => {
                    let judged = self.judge_step(&from, wrongs, control, n_steps);
                    self.trunk.truncate(n_steps);
                    self.trunk.push(judged);
                    judged
                }
            };
            (from, wrongs) = (judged.to, judged.wrongs);
            n_steps += 1;
            if wrongs.harm(self.forgiven_m, self.depth_weight) >= ceiling {
                return None;
            }
        }
        let step_s = scene.assumptions.step_s;
        let end = from.sample.state;
        let end_depth_m = soft_depth_m(scene, end);
        // A short plan must not look harmless: it stays where it ends.
        wrongs.depth_m_s += end_depth_m * (self.compared_s - n_steps as f64 * step_s).max(0.0);
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
        (harm < ceiling).then_some((harm, wrongs.obstacle_m))
    }

    /// One step on from where some wrongs were done.
    fn judge_step(&mut self, from: &Rolling, wrongs: Wrongs, control: Control, n_before: usize) -> Judged {
        let (scene, mut wrongs) = (self.scene, wrongs);
        let Assumptions { limits, step_s, .. } = scene.assumptions;
        let next = from.after(control, step_s, &limits, &mut self.bend);
        let (from, to) = (&Sample { yaw_rate_rad_s: control.yaw_rate_rad_s, ..from.sample }, &next.sample);
        let tube_m = scene.tube_m(scene.start.speed_m_s, to.moving_s, to.path_m);
        let lost_m = tube_m + scene.loss_m(to.path_m - from.path_m, from.yaw_rate_rad_s * step_s);
        let counts_s = if (n_before + 1) as f64 * step_s <= self.compared_s { step_s } else { 0.0 };
        self.add_spatial(&mut wrongs, to, lost_m, counts_s);
        wrongs.over_s += limits_broken(scene, (from, to), tube_m, n_before == 0) * step_s;
        Judged { control, to: next, wrongs }
    }

    /// Adds what the place of one sample does wrong; `counts_s` is the time it counts for.
    fn add_spatial(&self, wrongs: &mut Wrongs, to: &Sample, lost_m: f64, counts_s: f64) {
        let position_m = self.scene.assumptions.disturbance.position_m;
        let fallen_m = FIELD_SLOPE * to.path_m + self.scene.assumptions.closing_speed_m_s * to.moving_s;
        // Of zones that overlap only the deepest counts: two are left by the same way as one.
        let mut soft_m = 0.0_f64;
        let place = &mut Place::at(to.state.position());
        for layer in &self.scene.spatial {
            let is_far = layer.start_m - fallen_m > lost_m.max(0.0);
            if is_far && !layer.soft && !layer.is_too_near(&self.scene.assumptions) {
                // Farther than anything lost: it adds nothing.
                continue;
            }
            let margin_m = layer.margin_at(place, to.moving_s);
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
    let (from_place, to_place) = (&mut Place::at(from.state.position()), &mut Place::at(to.state.position()));
    let is_near = |layer: &LimitLayer<'_>, sample: &Sample, place: &mut Place| {
        layer.start_m - FIELD_SLOPE * sample.path_m <= guard_m && layer.zone_margin_at(place) <= guard_m
    };
    let limits = scene.limits.iter();
    limits
        .filter(|layer| is_near(layer, from, from_place) || is_near(layer, to, to_place))
        .map(|layer| {
            let from_over = from.state.speed_m_s - measured_m_s - layer.speed_at(from.moving_s, accel_m_s2);
            let to_over = to.state.speed_m_s - layer.speed_at(to.moving_s, accel_m_s2);
            let turn_over = from.yaw_rate_rad_s.abs() - layer.yaw_rate_rad_s;
            from_over.max(to_over).max(0.0) + turn_over.max(0.0)
        })
        .sum()
}
