//! The search for the motion that keeps most: what is tried, and in which order.
//!
//! Not here: what a motion keeps (`score`), which samples cannot be the best (`bounds`).

use super::bounds::Bounds;
use super::{Runner, Search};
use crate::dynamics::Control;
use crate::noise::Noise;
use crate::scene::Scene;

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
/// `rate_rad_s` is the turn rate of the moment; `warm` are sequences to try first, made as they are asked for: the
/// last solution, the rest of the last plan. The answer is in `best`.
pub(crate) fn search<W: Iterator<Item = Control> + Clone>(
    scene: &Scene<'_>,
    search: &Search,
    noise: &mut Noise,
    runner: Runner,
    (rate_rad_s, warm): (f64, impl Iterator<Item = W> + Clone),
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
    for sequence in warm.clone() {
        best.consider(scene, runner, sequence);
        if best.suffices(enough_m) {
            return;
        }
    }
    for round in 0..search.n_rounds {
        sample(scene, search, (noise, round), runner, warm.clone().next(), best);
        if best.suffices(enough_m) {
            return;
        }
    }
}

/// Samples one round around the best so far; around `first_warm`, else braking, where nothing is certified yet.
fn sample(
    scene: &Scene<'_>,
    search: &Search,
    (noise, round): (&mut Noise, usize),
    runner: Runner,
    first_warm: Option<impl Iterator<Item = Control>>,
    best: &mut Best,
) {
    if search.n_samples == 0 {
        return;
    }
    let limits = scene.assumptions.limits;
    let mut incumbent = std::mem::take(&mut best.trial);
    incumbent.clear();
    match best.value_m {
        Some(_) => incumbent.extend(best.controls.iter().take(search.n_steps)),
        None => incumbent.extend(first_warm.into_iter().flatten().take(search.n_steps)),
    }
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
        if bounds.most_m(sample) > floor_m && best.consider_above(scene, runner, sampled(sample), floor_m) {
            taken = Some(sample);
        }
    }
    best.bounds = bounds;
    best.trial = incumbent;
}
