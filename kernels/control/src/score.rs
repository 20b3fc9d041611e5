//! The safety score by sampling (SB-MPC): the largest margin that some certified motion keeps.
//!
//! The paper's Alg. 1 with its gaps closed: the incumbent is evaluated in every round, so the score never
//! falls; full braking (straight, turning hard either way, at the present rate) and what is left of the last
//! plan are always evaluated; and only motions that end at rest and pass the certificate count. Reproducible
//! from the seed. A rollout is given up as soon as it cannot beat the best one: that changes nothing but
//! the time. Deliberately not here: which control is sent (`filter`).

use geometry::Point2;

use crate::dynamics::{Bend, Control, State};
use crate::scene::{Assumptions, LimitLayer, Place, Scene, Shape};

mod bounds;
mod search;

#[cfg(test)]
pub(crate) use bounds::Bounds;
pub(crate) use search::{Best, Wanted, search};

/// Fields interpolated bilinearly change by at most this much a metre.
pub(crate) const FIELD_SLOPE: f64 = std::f64::consts::SQRT_2;

/// How the score is searched.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Search {
    pub n_samples: usize,
    pub n_rounds: usize,
    pub n_steps: usize,
    pub sigma: Control,
}

/// A rollout under way. Copied, it continues in two ways.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Runner {
    x_m: f64,
    y_m: f64,
    cos: f64,
    sin: f64,
    speed_m_s: f64,
    start_m_s: f64,
    moving_s: f64,
    path_m: f64,
    /// Smallest margin at the last sample, metres (or a bound above `kept_m` where that is enough).
    here_m: f64,
    /// The smallest margin sure to be kept so far, metres.
    pub kept_m: f64,
}

impl Runner {
    /// A rollout that has not moved yet.
    pub(crate) fn start(scene: &Scene<'_>) -> Runner {
        let State { x_m, y_m, speed_m_s, .. } = scene.start;
        let (sin, cos) = scene.heading.sin_cos();
        let mut runner = Runner {
            x_m,
            y_m,
            cos,
            sin,
            speed_m_s,
            start_m_s: speed_m_s,
            moving_s: 0.0,
            path_m: 0.0,
            here_m: f64::INFINITY,
            kept_m: f64::INFINITY,
        };
        for layer in scene.spatial.iter().filter(|layer| !layer.soft) {
            runner.here_m = runner.here_m.min(layer.start_m);
        }
        runner.kept_m = runner.here_m - scene.assumptions.disturbance.position_m;
        runner
    }

    /// The most that any motion from here can keep, metres: the margin here less what is lost on the next
    /// segment even by braking, straight on.
    fn most_m(&self, scene: &Scene<'_>) -> f64 {
        let Assumptions { limits, step_s, .. } = scene.assumptions;
        if self.speed_m_s <= 0.0 {
            return self.kept_m;
        }
        let end_m_s = limits.speed_after(self.speed_m_s, -limits.accel_m_s2_max, step_s);
        let length_m = (self.speed_m_s + end_m_s) / 2.0 * step_s;
        let tube_m = scene.tube_m(self.start_m_s, self.moving_s + step_s, self.path_m + length_m);
        // Added up as in `step`, so that braking reaches it to the last bit.
        self.kept_m.min(self.here_m - (scene.loss_m(length_m, 0.0) + tube_m))
    }

    /// One step on; `false` as soon as the rollout cannot keep more than `floor_m`, or breaks a limit.
    pub(crate) fn step(&mut self, scene: &Scene<'_>, control: Control, floor_m: f64) -> bool {
        let mut bend = Bend::NONE;
        self.step_bent(scene, control, floor_m, &mut bend)
    }

    /// The same; `bend` is the last step's.
    #[inline]
    fn step_bent(&mut self, scene: &Scene<'_>, control: Control, floor_m: f64, bend: &mut Bend) -> bool {
        let step_s = scene.assumptions.step_s;
        let limits = &scene.assumptions.limits;
        let end_m_s = limits.speed_after(self.speed_m_s, control.accel_m_s2, step_s);
        let turn_rad = control.yaw_rate_rad_s * step_s;
        let moved = bend.becomes(turn_rad).over(self.speed_m_s, end_m_s, step_s);
        let length_m = (self.speed_m_s + end_m_s) / 2.0 * step_s;
        let moving = length_m > 0.0;

        let from = *self;
        self.x_m += self.cos * moved.along_m - self.sin * moved.aside_m;
        self.y_m += self.sin * moved.along_m + self.cos * moved.aside_m;
        (self.cos, self.sin) = (
            self.cos * moved.turn_cos - self.sin * moved.turn_sin,
            self.sin * moved.turn_cos + self.cos * moved.turn_sin,
        );
        self.speed_m_s = end_m_s;
        self.path_m += length_m;
        if moving {
            self.moving_s += step_s;
        }

        let tube_m = scene.tube_m(self.start_m_s, self.moving_s, self.path_m);
        let lost_m = scene.loss_m(length_m, turn_rad) + tube_m;
        if moving {
            self.here_m = self.nearest_m(scene, scene.zone_guard_m(tube_m));
        }
        self.kept_m = least(least(from.here_m, self.here_m) - lost_m, self.kept_m);
        if self.kept_m <= floor_m || self.kept_m.is_nan() {
            return false;
        }
        self.heeds_limits(scene, &from, control.yaw_rate_rad_s.abs())
    }

    /// The smallest margin here, metres; exact unless it could not lower `kept_m` even after `guard_m` is
    /// lost from it.
    #[inline]
    fn nearest_m(&self, scene: &Scene<'_>, guard_m: f64) -> f64 {
        let place = &mut Place::at(self.place());
        let fallen_m = FIELD_SLOPE * self.path_m + scene.assumptions.closing_speed_m_s * self.moving_s;
        let (mut nearest_m, mut skipped_m) = (f64::INFINITY, f64::INFINITY);
        for layer in &scene.spatial {
            let bound_m = layer.start_m - fallen_m;
            // Layers are sorted by their margin at the start: the rest is farther still.
            if bound_m >= nearest_m || bound_m - guard_m >= self.kept_m {
                skipped_m = least(bound_m, skipped_m);
                break;
            }
            if let Shape::Points(_, closing_m_s) = layer.shape {
                // The distance to a point falls no faster than the robot moves.
                let bound_m = layer.start_m - self.path_m - closing_m_s * self.moving_s;
                if bound_m >= nearest_m || bound_m - guard_m >= self.kept_m {
                    skipped_m = least(bound_m, skipped_m);
                    continue;
                }
            }
            if !layer.soft {
                nearest_m = least(layer.margin_at(place, self.moving_s), nearest_m);
            }
        }
        least(nearest_m, skipped_m)
    }

    fn place(&self) -> Point2 {
        Point2::new(self.x_m, self.y_m)
    }

    /// Whether the step from another moment to this one heeds every limit of the zones that it may touch.
    #[inline]
    fn heeds_limits(&self, scene: &Scene<'_>, from: &Runner, rate_rad_s: f64) -> bool {
        let Assumptions { limits, disturbance, .. } = scene.assumptions;
        let measured_m_s = if from.moving_s == 0.0 { disturbance.speed_m_s } else { 0.0 };
        let from_m_s = from.speed_m_s - measured_m_s;
        scene.limits.iter().all(|layer| {
            let is_heeded = from_m_s <= layer.speed_at(from.moving_s, limits.accel_m_s2_max)
                && self.speed_m_s <= layer.speed_at(self.moving_s, limits.accel_m_s2_max)
                && rate_rad_s <= layer.yaw_rate_rad_s;
            // Who heeds a limit may be anywhere: its zone is asked for only by who does not.
            is_heeded || !(from.may_be_in(scene, layer) || self.may_be_in(scene, layer))
        })
    }

    /// Whether the base may be in the zone of a limit at this moment.
    fn may_be_in(&self, scene: &Scene<'_>, layer: &LimitLayer<'_>) -> bool {
        let guard_m = scene.zone_guard_m(scene.tube_m(self.start_m_s, self.moving_s, self.path_m));
        let is_outside = layer.start_m - FIELD_SLOPE * self.path_m > guard_m
            || layer.zone_margin_m(self.place()) > guard_m;
        !is_outside
    }

    /// Follows a sequence to rest; what is kept when that is more than `floor_m`, metres.
    pub(crate) fn follow(
        mut self,
        scene: &Scene<'_>,
        controls: impl Iterator<Item = Control>,
        floor_m: f64,
    ) -> Option<f64> {
        if self.kept_m <= floor_m || self.kept_m.is_nan() {
            return None;
        }
        let mut bend = Bend::NONE;
        for control in controls {
            if !self.step_bent(scene, control, floor_m, &mut bend) {
                return None;
            }
        }
        let accel_m_s2 = -scene.assumptions.limits.accel_m_s2_max;
        while self.speed_m_s > 0.0 {
            let braking = Control { yaw_rate_rad_s: 0.0, accel_m_s2 };
            if !scene.assumptions.braking_tail || !self.step_bent(scene, braking, floor_m, &mut bend) {
                return None;
            }
        }
        Some(self.kept_m)
    }
}

/// The smaller of two: one instruction where NaN is not asked about. The second, where the first is no number.
#[inline(always)]
fn least(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}
