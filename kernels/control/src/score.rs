//! The safety score by sampling (SB-MPC): the largest margin that some certified motion keeps.
//!
//! The paper's Alg. 1 with its gaps closed: the incumbent is evaluated in every round, so the score never
//! falls; full braking (straight, turning hard either way, at the present rate) and what is left of the last
//! plan are always evaluated; and only motions that end at rest and pass the certificate count. Reproducible
//! from the seed. A rollout is given up as soon as it cannot beat the best one: that changes nothing but
//! the time. Deliberately not here: which control is sent (`filter`).

use geometry::Point2;

use crate::dynamics::{Control, Moved, State};
use crate::noise::Noise;
use crate::scene::{Assumptions, Place, Scene, Shape};

mod bounds;

pub(crate) use bounds::Bounds;

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
    /// Bit i: the last sample may lie in the zone of limit i.
    zones: u64,
    /// The smallest margin sure to be kept so far, metres.
    pub kept_m: f64,
}

impl Runner {
    /// A rollout that has not moved yet.
    pub(crate) fn start(scene: &Scene<'_>) -> Runner {
        let State { x_m, y_m, yaw_rad, speed_m_s } = scene.start;
        let (sin, cos) = yaw_rad.sin_cos();
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
            zones: 0,
            kept_m: f64::INFINITY,
        };
        for layer in scene.spatial.iter().filter(|layer| !layer.soft) {
            runner.here_m = runner.here_m.min(layer.start_m);
        }
        runner.kept_m = runner.here_m - scene.assumptions.disturbance.position_m;
        let place = &mut Place::at(scene.start.position());
        runner.zones = runner.zones_here(scene, scene.tube_m(speed_m_s, 0.0, 0.0), place);
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
    #[inline]
    pub(crate) fn step(&mut self, scene: &Scene<'_>, control: Control, floor_m: f64) -> bool {
        let step_s = scene.assumptions.step_s;
        let limits = &scene.assumptions.limits;
        let end_m_s = limits.speed_after(self.speed_m_s, control.accel_m_s2, step_s);
        let turn_rad = control.yaw_rate_rad_s * step_s;
        let moved = Moved::over(self.speed_m_s, end_m_s, turn_rad, step_s);
        let length_m = (self.speed_m_s + end_m_s) / 2.0 * step_s;
        let moving = length_m > 0.0;

        let (from_m_s, from_s, from_zones) = (self.speed_m_s, self.moving_s, self.zones);
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
        let before_m = self.here_m;
        let place = &mut Place::at(Point2::new(self.x_m, self.y_m));
        if moving {
            self.here_m = self.nearest_m(scene, scene.zone_guard_m(tube_m), place);
        }
        self.kept_m = self.kept_m.min(before_m.min(self.here_m) - lost_m);
        if self.kept_m <= floor_m || self.kept_m.is_nan() {
            return false;
        }
        if scene.limits.is_empty() {
            return true;
        }
        if moving {
            self.zones = self.zones_here(scene, tube_m, place);
        }
        let measured_m_s = if from_s == 0.0 { scene.assumptions.disturbance.speed_m_s } else { 0.0 };
        let from = (from_m_s - measured_m_s, from_s);
        self.heeds_limits(scene, from_zones | self.zones, from, control.yaw_rate_rad_s.abs())
    }

    /// The smallest margin here, metres; exact unless it could not lower `kept_m` even after `guard_m` is
    /// lost from it.
    #[inline]
    fn nearest_m(&self, scene: &Scene<'_>, guard_m: f64, place: &mut Place) -> f64 {
        let fallen_m = FIELD_SLOPE * self.path_m + scene.assumptions.closing_speed_m_s * self.moving_s;
        let (mut nearest_m, mut skipped_m) = (f64::INFINITY, f64::INFINITY);
        for layer in &scene.spatial {
            let bound_m = layer.start_m - fallen_m;
            // Layers are sorted by their margin at the start: the rest is farther still.
            if bound_m >= nearest_m || bound_m - guard_m >= self.kept_m {
                skipped_m = skipped_m.min(bound_m);
                break;
            }
            if let Shape::Points(_, closing_m_s) = layer.shape {
                // The distance to a point falls no faster than the robot moves.
                let bound_m = layer.start_m - self.path_m - closing_m_s * self.moving_s;
                if bound_m >= nearest_m || bound_m - guard_m >= self.kept_m {
                    skipped_m = skipped_m.min(bound_m);
                    continue;
                }
            }
            if !layer.soft {
                nearest_m = nearest_m.min(layer.margin_at(place, self.moving_s));
            }
        }
        nearest_m.min(skipped_m)
    }

    fn zones_here(&self, scene: &Scene<'_>, tube_m: f64, place: &mut Place) -> u64 {
        let guard_m = scene.zone_guard_m(tube_m);
        let fallen_m = FIELD_SLOPE * self.path_m;
        let mut zones = 0;
        for (idx, layer) in scene.limits.iter().enumerate() {
            let outside = layer.start_m - fallen_m > guard_m || layer.zone_margin_at(place) > guard_m;
            // More limits than bits share the last bit: inside one of them is inside all.
            zones |= u64::from(!outside) << idx.min(63);
        }
        zones
    }

    #[inline]
    fn heeds_limits(&self, scene: &Scene<'_>, zones: u64, from: (f64, f64), rate_rad_s: f64) -> bool {
        if zones == 0 {
            return true;
        }
        let accel_m_s2 = scene.assumptions.limits.accel_m_s2_max;
        let (from_m_s, from_s) = from;
        scene.limits.iter().enumerate().all(|(idx, layer)| {
            zones >> idx.min(63) & 1 == 0
                || (from_m_s <= layer.speed_at(from_s, accel_m_s2)
                    && self.speed_m_s <= layer.speed_at(self.moving_s, accel_m_s2)
                    && rate_rad_s <= layer.yaw_rate_rad_s)
        })
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
        for control in controls {
            if !self.step(scene, control, floor_m) {
                return None;
            }
        }
        let accel_m_s2 = -scene.assumptions.limits.accel_m_s2_max;
        while self.speed_m_s > 0.0 {
            let braking = Control { yaw_rate_rad_s: 0.0, accel_m_s2 };
            if !scene.assumptions.braking_tail || !self.step(scene, braking, floor_m) {
                return None;
            }
        }
        Some(self.kept_m)
    }
}

/// The best continuation found, kept between calls so that nothing is allocated in the loops.
#[derive(Clone, Debug, Default)]
pub(crate) struct Best {
    /// The margin sure to be kept, metres; `None` when nothing is certified.
    pub value_m: Option<f64>,
    /// The controls after the runner's position.
    pub controls: Vec<Control>,
    trial: Vec<Control>,
    floor_m: f64,
    bounds: Bounds,
}

impl Best {
    /// What must be kept more than to count, metres.
    fn above_m(&self) -> f64 {
        self.value_m.unwrap_or(self.floor_m)
    }

    fn consider(
        &mut self,
        scene: &Scene<'_>,
        runner: Runner,
        controls: impl Iterator<Item = Control> + Clone,
    ) {
        self.consider_above(scene, runner, controls, self.above_m());
    }

    /// Follows a sequence; whether it keeps more than `floor_m`, and so is the best now.
    fn consider_above(
        &mut self,
        scene: &Scene<'_>,
        runner: Runner,
        controls: impl Iterator<Item = Control> + Clone,
        floor_m: f64,
    ) -> bool {
        let Some(value_m) = runner.follow(scene, controls.clone(), floor_m) else { return false };
        self.value_m = Some(value_m);
        self.controls.clear();
        self.controls.extend(controls);
        true
    }

    fn suffices(&self, enough_m: f64) -> bool {
        self.value_m.is_some_and(|value_m| value_m >= enough_m)
    }
}

/// What a search is for: motions that keep no more than `above_m` do not count, and it is over as soon as one
/// keeps `enough_m`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wanted {
    pub above_m: f64,
    pub enough_m: f64,
}

/// Searches the continuation of `runner` that keeps the largest margin.
///
/// `rate_rad_s` is the turn rate of the moment; `warm` are sequences to try first: the last solution, the
/// rest of the last plan. The answer is in `best`.
pub(crate) fn search(
    scene: &Scene<'_>,
    search: &Search,
    noise: &mut Noise,
    runner: Runner,
    (rate_rad_s, warm): (f64, &[&[Control]]),
    Wanted { above_m, enough_m }: Wanted,
    best: &mut Best,
) {
    best.value_m = None;
    best.floor_m = above_m.max(0.0);
    // What no motion can keep more than is enough.
    let enough_m = enough_m.min(runner.most_m(scene));
    best.controls.clear();
    let limits = scene.assumptions.limits;
    let rate_max = limits.yaw_rate_rad_s_max;
    let n_braking = (limits.braking_s(runner.speed_m_s) / scene.assumptions.step_s - 1e-9).ceil() as usize;
    for rate_rad_s in [0.0, rate_rad_s, rate_max, -rate_max] {
        let braking = Control { yaw_rate_rad_s: rate_rad_s, accel_m_s2: -limits.accel_m_s2_max };
        best.consider(scene, runner, std::iter::repeat_n(braking, n_braking));
        if best.suffices(enough_m) {
            return;
        }
    }
    for sequence in warm {
        best.consider(scene, runner, sequence.iter().copied());
        if best.suffices(enough_m) {
            return;
        }
    }
    for round in 0..search.n_rounds {
        noise.draw(round + 1);
        let mut incumbent = std::mem::take(&mut best.trial);
        incumbent.clear();
        // Nothing certified yet: sample around the last solution, else around braking.
        let first_warm: &[Control] = warm.first().copied().unwrap_or(&[]);
        let around = if best.value_m.is_some() { &best.controls[..] } else { first_warm };
        incumbent.extend(around.iter().take(search.n_steps));
        let braking = Control { yaw_rate_rad_s: 0.0, accel_m_s2: -limits.accel_m_s2_max };
        incumbent.resize(search.n_steps, braking);
        let mut bounds = std::mem::take(&mut best.bounds);
        bounds.find(scene, search, (noise, round), &runner, &incumbent, best.above_m());
        let sampled = |sample: usize| {
            let draws = noise.sequence(round * search.n_samples + sample);
            incumbent.iter().zip(draws).map(|(control, (rate, accel))| {
                limits.clamped(Control {
                    yaw_rate_rad_s: control.yaw_rate_rad_s + search.sigma.yaw_rate_rad_s * rate,
                    accel_m_s2: control.accel_m_s2 + search.sigma.accel_m_s2 * accel,
                })
            })
        };
        let mut taken = None;
        // The most promising first: what it keeps rules most of the others out.
        let first = bounds.highest();
        for sample in first.into_iter().chain((0..search.n_samples).filter(|sample| Some(*sample) != first)) {
            // Of equal values the first sample's counts, as when all are looked at in order.
            let is_before = taken.is_some_and(|taken| sample < taken);
            let floor_m = if is_before { best.above_m().next_down() } else { best.above_m() };
            if bounds.most_m(sample) > floor_m && best.consider_above(scene, runner, sampled(sample), floor_m)
            {
                taken = Some(sample);
            }
        }
        best.bounds = bounds;
        best.trial = incumbent;
        if best.suffices(enough_m) {
            return;
        }
    }
}
