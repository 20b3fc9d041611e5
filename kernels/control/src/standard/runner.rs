//! The standard problem, fast: bounds for all samples, the exact value for the few that can be best.

use super::exact::{Controls, kept};
use super::field::Field;
use super::model::{Euler, GAIN_MAX, ROUNDING_M, TURN_MAX};
use super::oracle::{Pose, after, chosen, is_enough, least_enough, off};
use super::*;
use crate::fast::Isa;
use crate::fast::sweep::{From, Sampled, Sweep, padded};
use crate::noise::Noise;

/// What a step decides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// The score of the present state, metres (or the unit of the limit that binds).
    pub v_m: f64,
    /// The primitive chosen.
    pub primitive_idx: usize,
}

/// The standard problem made ready: fields merged, room for all that a step needs. Steps allocate nothing.
#[derive(Debug)]
pub struct StandardFilter<'s> {
    scene: &'s Scene,
    isa: Isa,
    sampling: Sampling,
    field: Field<'s>,
    /// How far above its bound a lane's value may lie, metres.
    error_m: f32,
    noise: Noise,
    scratch: Scratch,
    order: Vec<usize>,
    /// Bounds of the primitives' scores.
    scores: Vec<(f64, f64)>,
    values: Vec<f64>,
}

#[derive(Debug, Default)]
struct Scratch {
    kept_m: Vec<f32>,
    lanes: Vec<usize>,
    /// Turn and gain of each step of the incumbent.
    held: Vec<[f32; 2]>,
    incumbent: Controls,
    trial: Controls,
    found: Controls,
}

/// No value at all.
const NONE: f64 = f64::NEG_INFINITY;

impl<'s> StandardFilter<'s> {
    /// Merges the fields of a scene and makes room.
    #[must_use]
    pub fn new(isa: Isa, scene: &'s Scene, sampling: Sampling) -> StandardFilter<'s> {
        // The incumbent is always evaluated.
        let sampling = Sampling { n_samples: sampling.n_samples.max(1), ..sampling };
        let Sampling { n_samples, n_steps, .. } = sampling;
        let n_lanes = padded(n_samples);
        let field = Field::of(isa, scene);
        let scratch = Scratch {
            kept_m: vec![0.0; n_lanes],
            lanes: Vec::with_capacity(n_lanes),
            held: vec![[0.0; 2]; n_steps],
            incumbent: vec![[0.0; 2]; n_steps],
            trial: vec![[0.0; 2]; n_steps],
            found: vec![[0.0; 2]; n_steps],
        };
        let mut filter = StandardFilter {
            scene,
            isa,
            sampling,
            error_m: field.error_m() + 2.0 * ROUNDING_M,
            field,
            noise: Noise::on(isa).keeping_incumbents(),
            scratch,
            order: Vec::with_capacity(scene.primitives.len()),
            scores: vec![(NONE, NONE); scene.primitives.len()],
            values: vec![NONE; scene.primitives.len()],
        };
        filter.begin(0);
        filter
    }

    /// Merges the fields again, as when a map has changed.
    pub fn merge(&mut self) {
        self.field = Field::of(self.isa, self.scene);
    }

    /// Begins another step: its noise is drawn anew, when it is needed.
    pub fn begin(&mut self, tick: u64) {
        let Sampling { n_samples, n_rounds, n_steps, seed } = self.sampling;
        self.noise.begin(seed, tick, (n_rounds, n_samples), n_steps);
    }

    /// The noise of a sample, for the oracle; of this step.
    pub fn noise(&mut self, round: usize, step: usize, sample: usize) -> (f64, f64) {
        self.noise.draw(round + 1);
        self.noise.pair(round, step, sample)
    }

    /// One smooth-blending step with every rollout of all scores finished.
    pub fn full(&mut self, state: [f64; 6]) -> Choice {
        let [x, y, yaw, v, rate, accel] = state;
        let start = [x, y, yaw, v];
        let here = self.score_full(start);
        let needed = least_enough(here);
        for (idx, primitive) in self.scene.primitives.iter().enumerate() {
            self.scores[idx] = self.bounds::<true>(after(start, *primitive), needed, false);
        }
        Choice { v_m: here, primitive_idx: self.chosen::<true>(start, here, [rate, accel]) }
    }

    /// One smooth-blending step with nothing computed that cannot change the choice.
    pub fn shipped(&mut self, state: [f64; 6]) -> Choice {
        let [x, y, yaw, v, rate, accel] = state;
        let start = [x, y, yaw, v];
        let here = self.score(start, f64::INFINITY);
        let needed = least_enough(here);
        let primitives = &self.scene.primitives;
        let mut order = std::mem::take(&mut self.order);
        order.clear();
        order.extend(0..primitives.len());
        let off = |idx: usize| off(primitives[idx], [rate, accel]);
        order.sort_unstable_by(|a, b| off(*a).total_cmp(&off(*b)).then(a.cmp(b)));
        // Nearest first: the first that keeps enough is the choice.
        let nearest = order.iter().copied().find(|&idx| {
            self.scores[idx] = self.bounds::<false>(after(start, self.scene.primitives[idx]), needed, false);
            is_enough(self.scores[idx].0, here)
        });
        self.order = order;
        let primitive_idx = nearest.unwrap_or_else(|| self.chosen::<false>(start, here, [rate, accel]));
        Choice { v_m: here, primitive_idx }
    }

    /// The choice by the bounds of all scores, each of which is on one side of what is needed for sure.
    fn chosen<const FULL: bool>(&mut self, start: Pose, here: f64, nominal: [f64; 2]) -> usize {
        for (value, (low, _)) in self.values.iter_mut().zip(&self.scores) {
            *value = *low;
        }
        if !self.values.iter().any(|value| is_enough(*value, here)) {
            // The largest score is asked for: those that may be it are computed to the last bit, the most
            // promising first.
            let mut most = self.values.iter().copied().fold(NONE, f64::max);
            while let Some(idx) = self.most_promising(most) {
                let next = after(start, self.scene.primitives[idx]);
                let exact = self.bounds::<FULL>(next, f64::INFINITY, true).0;
                (self.scores[idx], self.values[idx]) = ((exact, exact), exact);
                most = most.max(exact);
            }
        }
        chosen(&self.values, here, &self.scene.primitives, nominal)
    }

    /// The score that is not exact yet and reaches highest, when it may be at least `most`.
    fn most_promising(&self, most: f64) -> Option<usize> {
        let open = self.scores.iter().enumerate().filter(|(_, (low, high))| low < high && *high >= most);
        open.max_by(|a, b| a.1.1.total_cmp(&b.1.1)).map(|(idx, _)| idx)
    }

    /// The score of a state with every rollout finished, exactly.
    pub fn score_full(&mut self, start: Pose) -> f64 {
        self.bounds::<true>(start, f64::INFINITY, true).0
    }

    /// The score of a state, exactly; or, once it is known to be at least `enough`, some value from there on.
    pub fn score(&mut self, start: Pose, enough: f64) -> f64 {
        self.bounds::<false>(start, enough, true).0
    }

    /// Bounds of the score of a state, the same when it is to be exact; else both on one side of `enough`.
    ///
    /// `FULL` finishes every rollout. Otherwise it is over as soon as the score is known to be at least `enough`,
    /// and rollouts end where they cannot matter.
    fn bounds<const FULL: bool>(&mut self, start: Pose, enough: f64, is_exact: bool) -> (f64, f64) {
        let cap = self.most(start);
        if !FULL && !is_exact && cap < enough {
            return (NONE, cap);
        }
        self.scratch.incumbent.fill([0.0, -ACCEL_M_S2_MAX]);
        // What the incumbent keeps: at least, at most, and exactly where that is known.
        let mut exact = NONE;
        if !FULL {
            exact =
                kept(&self.field, start, cap, self.scratch.incumbent.iter().copied(), NONE).unwrap_or(NONE);
        }
        let mut bounds = (exact, if FULL { cap } else { exact });
        let (rounding, error) = (f64::from(ROUNDING_M), f64::from(self.error_m));
        let n_rounds = self.sampling.n_rounds;
        for round in 0..n_rounds {
            // No sample keeps more than the margin at the start.
            if !FULL && bounds.0 >= cap.min(enough) {
                break;
            }
            self.noise.draw(round + 1);
            let floor = if FULL { NONE } else { bounds.0 - error };
            self.sweep::<FULL>(round, start, floor as f32);
            self.pick(if FULL { NONE } else { bounds.0 }, exact > NONE);
            let Scratch { kept_m, lanes, .. } = &self.scratch;
            if lanes.is_empty() {
                continue;
            }
            let most = f64::from(lanes.iter().map(|lane| kept_m[*lane]).fold(f32::NEG_INFINITY, f32::max));
            let (low, high) = ((most - rounding).min(cap), (most + error).min(cap));
            let is_last = round + 1 == n_rounds;
            // Exact values matter in the last round, and where two samples of another are too close to call.
            let is_sure = is_last && !is_exact && (low >= enough || high < enough);
            let lone = self.lone_best().filter(|_| !is_last && (FULL || low > bounds.0));
            match lone {
                _ if is_sure => bounds = (low.max(bounds.0), high.max(bounds.0)),
                Some(lane) => {
                    self.hold(round, lane);
                    (exact, bounds) = (NONE, (low, high));
                }
                None => {
                    exact = self.settle(round, start, (cap, cap.min(enough)), exact);
                    bounds = (exact, exact);
                }
            }
        }
        if is_exact && bounds.0 < bounds.1 && bounds.0 < enough {
            // The last rounds found nothing better than an incumbent that was never computed exactly.
            let incumbent = self.scratch.incumbent.iter().copied();
            exact = kept(&self.field, start, cap, incumbent, NONE).unwrap_or(NONE);
            bounds = (exact, exact);
        }
        bounds
    }

    /// Sweeps all samples of a round.
    fn sweep<const FULL: bool>(&mut self, round: usize, start: Pose, floor_m: f32) {
        let Scratch { kept_m, held, incumbent, .. } = &mut self.scratch;
        for (to, [rate, accel]) in held.iter_mut().zip(incumbent) {
            *to = [(*rate * STEP_S) as f32, (*accel * STEP_S) as f32];
        }
        let (sin, cos) = start[2].sin_cos();
        let (ground, [x, y]) = self.field.ground(start);
        let from = From {
            x,
            y,
            sin: sin as f32,
            cos: cos as f32,
            speed_m_s: start[3] as f32,
            kept_m: f32::INFINITY,
        };
        let sampled = Sampled {
            held,
            draws: self.noise.round(round),
            n_lanes: self.noise.n_lanes(),
            scale: [(SIGMA_YAW_RATE_RAD_S * STEP_S) as f32, (SIGMA_ACCEL_M_S2 * STEP_S) as f32],
            limit: [TURN_MAX, GAIN_MAX],
        };
        let n = self.sampling.n_samples;
        self.isa.run(Sweep::<_, FULL> { model: Euler, ground, from, sampled, n, floor_m, kept_m });
    }

    /// Picks the swept lanes that may keep more than `best`; the incumbent's not when it is known already.
    fn pick(&mut self, best: f64, knows_incumbent: bool) {
        let Scratch { lanes, kept_m, .. } = &mut self.scratch;
        let floor = (best as f32 - self.error_m).next_down();
        lanes.clear();
        lanes.extend(
            (usize::from(knows_incumbent)..self.sampling.n_samples).filter(|lane| kept_m[*lane] > floor),
        );
    }

    /// The picked lane that is best for sure.
    fn lone_best(&self) -> Option<usize> {
        let Scratch { kept_m, lanes, .. } = &self.scratch;
        let first = lanes.iter().copied().reduce(|a, b| if kept_m[b] > kept_m[a] { b } else { a })?;
        let is_close = |lane: &&usize| kept_m[**lane] + self.error_m >= kept_m[first];
        (lanes.iter().filter(is_close).count() == 1).then_some(first)
    }

    /// Makes a sample the incumbent.
    fn hold(&mut self, round: usize, lane: usize) {
        for (step, control) in self.scratch.incumbent.iter_mut().enumerate() {
            *control = perturbed(*control, self.noise.pair(round, step, lane));
        }
    }

    /// The most that any sample can keep: the margin at the start, and that of the next place, which no control
    /// changes; there the robot is at least as fast as after full braking.
    fn most(&self, [x, y, yaw, v]: Pose) -> f64 {
        let here = self.field.margin_m(x, y, v);
        let (sin, cos) = yaw.sin_cos();
        let braked = (v - ACCEL_M_S2_MAX * STEP_S).clamp(0.0, SPEED_M_S_MAX);
        let next = self.field.margin_m(x + v * cos * STEP_S, y + v * sin * STEP_S, braked);
        (SPEED_M_S_LIMIT - v).min(YAW_RATE_RAD_S_LIMIT).min(here).min(next)
    }

    /// Rolls out exactly those picked lanes that may keep more than `best`; the new best, the first of equals.
    ///
    /// Over as soon as one keeps `stop`.
    fn settle(&mut self, round: usize, start: Pose, (cap, stop): (f64, f64), mut best: f64) -> f64 {
        let Scratch { kept_m, lanes, incumbent, trial, found, .. } = &mut self.scratch;
        let error = f64::from(self.error_m);
        let mut best_lane = None;
        let mut consider = |lane: usize, best: &mut f64| {
            // Of equal values the first sample's counts, as in the oracle.
            let is_before = best_lane.is_some_and(|best_lane| lane < best_lane);
            let floor = if is_before { *best } else { best.next_up() };
            let controls = trial.iter_mut().enumerate().map(|(step, to)| {
                *to = perturbed(incumbent[step], self.noise.pair(round, step, lane));
                *to
            });
            if let Some(value) = kept(&self.field, start, cap, controls, floor) {
                (*best, best_lane) = (value, Some(lane));
                std::mem::swap(found, trial);
            }
        };
        // The most promising first: its exact value rules most of the others out.
        let first = lanes.iter().copied().reduce(|a, b| if kept_m[b] > kept_m[a] { b } else { a });
        let may_be = |lane: usize, best: f64| f64::from(kept_m[lane]) + error >= best;
        if let Some(first) = first.filter(|first| may_be(*first, best)) {
            consider(first, &mut best);
            for &lane in lanes.iter().filter(|lane| **lane != first) {
                if best < stop && may_be(lane, best) {
                    consider(lane, &mut best);
                }
            }
        }
        if best_lane.is_some() {
            std::mem::swap(incumbent, found);
        }
        best
    }
}

/// The control of one sample at a step, in f64.
fn perturbed([rate, accel]: [f64; 2], (rate_draw, accel_draw): (f64, f64)) -> [f64; 2] {
    let rate = rate + SIGMA_YAW_RATE_RAD_S * rate_draw;
    let accel = accel + SIGMA_ACCEL_M_S2 * accel_draw;
    [rate.clamp(-YAW_RATE_RAD_S_MAX, YAW_RATE_RAD_S_MAX), accel.clamp(-ACCEL_M_S2_MAX, ACCEL_M_S2_MAX)]
}
