//! The standard problem, fast: bounds for all samples, the exact value for the few that can be best.

use super::exact::{Controls, kept};
use super::field::Field;
use super::kinematics::{Lanes, Perturb, padded};
use super::oracle::{Pose, after, chosen, is_enough, least_enough, off};
use super::sweep::{ROUNDING_M, Sweep};
use super::*;
use crate::fast::{Isa, normal};

/// Below this many candidates each is rolled out exactly at once; chosen: a sweep costs about as many.
const N_FEW: usize = 4;

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
    tick: u64,
    drawn: Vec<bool>,
    noise: Vec<Lanes>,
    scratch: Scratch,
    order: Vec<usize>,
    scores: Vec<f64>,
}

#[derive(Debug, Default)]
struct Scratch {
    controls: Lanes,
    picked: Lanes,
    bounds: Vec<f32>,
    speeds: Vec<f32>,
    kept_m: Vec<f32>,
    lanes: Vec<usize>,
    /// Turn and gain of each step of the incumbent.
    held: Vec<[f32; 2]>,
    incumbent: Controls,
    trial: Controls,
    found: Controls,
}

impl<'s> StandardFilter<'s> {
    /// Merges the fields of a scene and makes room.
    #[must_use]
    pub fn new(isa: Isa, scene: &'s Scene, sampling: Sampling) -> StandardFilter<'s> {
        // The incumbent is always evaluated.
        let sampling = Sampling { n_samples: sampling.n_samples.max(1), ..sampling };
        let Sampling { n_samples, n_rounds, n_steps, .. } = sampling;
        let n_lanes = padded(n_samples);
        let lanes = || {
            let mut lanes = Lanes::default();
            lanes.resize(n_lanes, n_steps);
            lanes
        };
        let field = Field::of(isa, scene);
        let scratch = Scratch {
            controls: lanes(),
            picked: lanes(),
            bounds: vec![0.0; n_lanes],
            speeds: vec![0.0; n_lanes],
            kept_m: vec![0.0; n_lanes],
            lanes: Vec::with_capacity(n_lanes),
            held: vec![[0.0; 2]; n_steps],
            incumbent: vec![[0.0; 2]; n_steps],
            trial: vec![[0.0; 2]; n_steps],
            found: vec![[0.0; 2]; n_steps],
        };
        StandardFilter {
            scene,
            isa,
            sampling,
            error_m: field.error_m() + 2.0 * ROUNDING_M,
            field,
            tick: 0,
            drawn: vec![false; n_rounds],
            noise: (0..n_rounds).map(|_| lanes()).collect(),
            scratch,
            order: Vec::with_capacity(scene.primitives.len()),
            scores: vec![0.0; scene.primitives.len()],
        }
    }

    /// Merges the fields again, as when a map has changed.
    pub fn merge(&mut self) {
        self.field = Field::of(self.isa, self.scene);
    }

    /// Begins another step: its noise is drawn anew, when it is needed.
    pub fn begin(&mut self, tick: u64) {
        self.tick = tick;
        self.drawn.fill(false);
    }

    /// The noise of a sample, for the oracle; of this step.
    pub fn noise(&mut self, round: usize, step: usize, sample: usize) -> (f64, f64) {
        self.draw(round);
        let at = step * self.noise[round].n_lanes + sample;
        let Lanes { turn_rad, gain_m_s, .. } = &self.noise[round];
        let turn = f64::from(turn_rad[at]) / (SIGMA_YAW_RATE_RAD_S * STEP_S);
        (turn, f64::from(gain_m_s[at]) / (SIGMA_ACCEL_M_S2 * STEP_S))
    }

    /// One smooth-blending step with every rollout of all scores finished.
    pub fn full(&mut self, state: [f64; 6]) -> Choice {
        let [x, y, yaw, v, rate, accel] = state;
        let start = [x, y, yaw, v];
        let here = self.score_full(start);
        let needed = least_enough(here);
        let scene = self.scene;
        let mut none_is_enough = true;
        for (idx, primitive) in scene.primitives.iter().enumerate() {
            let next = after(start, *primitive);
            let (low, high) = self.bounds_full(next, false);
            // On which side of what is needed the score lies must be certain, and where it is does not matter.
            self.scores[idx] = if low >= needed {
                low
            } else if high < needed {
                high
            } else {
                self.score_full(next)
            };
            none_is_enough &= self.scores[idx] < needed;
        }
        if none_is_enough {
            // The largest score is asked for: those that may be it are computed to the last bit.
            let mut most = f64::NEG_INFINITY;
            for (idx, primitive) in scene.primitives.iter().enumerate() {
                if self.scores[idx] >= most {
                    self.scores[idx] = self.score_full(after(start, *primitive));
                    most = most.max(self.scores[idx]);
                }
            }
        }
        let primitive_idx = chosen(&self.scores, here, &scene.primitives, [rate, accel]);
        Choice { v_m: here, primitive_idx }
    }

    /// One smooth-blending step with nothing computed that cannot change the choice.
    pub fn shipped(&mut self, state: [f64; 6]) -> Choice {
        let [x, y, yaw, v, rate, accel] = state;
        let start = [x, y, yaw, v];
        let here = self.score(start, f64::INFINITY);
        let primitives = &self.scene.primitives;
        let mut order = std::mem::take(&mut self.order);
        order.clear();
        order.extend(0..primitives.len());
        let off = |idx: usize| off(primitives[idx], [rate, accel]);
        order.sort_unstable_by(|a, b| off(*a).total_cmp(&off(*b)).then(a.cmp(b)));
        let needed = least_enough(here);
        // Nearest first: the first that keeps enough is the choice.
        let nearest = order.iter().copied().find(|&idx| {
            self.scores[idx] = self.score(after(start, self.scene.primitives[idx]), needed);
            is_enough(self.scores[idx], here)
        });
        self.order = order;
        let scene = self.scene;
        // None: every score was computed to its end.
        let primitive_idx =
            nearest.unwrap_or_else(|| chosen(&self.scores, here, &scene.primitives, [rate, accel]));
        Choice { v_m: here, primitive_idx }
    }

    /// The score of a state with every rollout finished, exactly.
    pub fn score_full(&mut self, start: Pose) -> f64 {
        self.bounds_full(start, true).0
    }

    /// Bounds of the score of a state with every rollout finished: the same, when it is to be exact.
    fn bounds_full(&mut self, start: Pose, is_exact: bool) -> (f64, f64) {
        let cap = self.most(start);
        self.scratch.incumbent.fill([0.0, -ACCEL_M_S2_MAX]);
        let none = f64::NEG_INFINITY;
        let mut bounds = (none, none);
        for round in 0..self.sampling.n_rounds {
            self.draw(round);
            self.perturb(round, start);
            let Scratch { controls, kept_m, .. } = &mut self.scratch;
            let Sampling { n_samples, n_steps, n_rounds, .. } = self.sampling;
            let field = &self.field;
            let floor_m = f32::NEG_INFINITY;
            self.isa.run(Sweep::<true> {
                field,
                start,
                controls,
                n_lanes: n_samples,
                n_steps,
                floor_m,
                kept_m,
            });
            self.scratch.lanes.clear();
            self.scratch.lanes.extend(0..n_samples);
            let is_last = round + 1 == n_rounds;
            // Exact values matter in the last round, and where two samples of another are too close to call.
            match self.lone_best().filter(|_| !is_last) {
                Some(lane) => self.hold(round, lane),
                None if is_last && !is_exact => {
                    let Scratch { kept_m, .. } = &self.scratch;
                    let most =
                        f64::from(kept_m[..n_samples].iter().copied().fold(f32::NEG_INFINITY, f32::max));
                    let (rounding, error) = (f64::from(ROUNDING_M), f64::from(self.error_m));
                    bounds = ((most - rounding).min(cap), (most + error).min(cap));
                }
                None => {
                    let best = self.settle(round, start, (cap, cap), none);
                    bounds = (best, best);
                }
            }
        }
        bounds
    }

    /// The swept lane that is best for sure.
    fn lone_best(&self) -> Option<usize> {
        let Scratch { kept_m, lanes, .. } = &self.scratch;
        let first = lanes.iter().copied().reduce(|a, b| if kept_m[b] > kept_m[a] { b } else { a })?;
        let is_close = |lane: &&usize| kept_m[**lane] + self.error_m >= kept_m[first];
        (lanes.iter().filter(is_close).count() == 1).then_some(first)
    }

    /// Makes a sample the incumbent.
    fn hold(&mut self, round: usize, lane: usize) {
        let noise = &self.noise[round];
        for (step, control) in self.scratch.incumbent.iter_mut().enumerate() {
            *control = perturbed(*control, noise, step, lane);
        }
    }

    /// The score of a state, exactly; or, once it is known to be at least `enough`, some value from there on.
    pub fn score(&mut self, start: Pose, enough: f64) -> f64 {
        let cap = self.most(start);
        self.scratch.incumbent.fill([0.0, -ACCEL_M_S2_MAX]);
        let (floor, stop) = (f64::NEG_INFINITY, cap.min(enough));
        let mut best =
            kept(&self.field, start, cap, self.scratch.incumbent.iter().copied(), floor).unwrap_or(floor);
        for round in 0..self.sampling.n_rounds {
            // No sample keeps more than the margin at the start.
            if best >= stop {
                break;
            }
            self.draw(round);
            self.perturb(round, start);
            self.pick(best);
            if self.scratch.lanes.len() > N_FEW {
                self.sweep_picked(start, best);
            }
            best = self.settle(round, start, (cap, stop), best);
        }
        best
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

    fn draw(&mut self, round: usize) {
        if std::mem::replace(&mut self.drawn[round], true) {
            return;
        }
        let Lanes { n_lanes, turn_rad, gain_m_s } = &mut self.noise[round];
        let from = (round * turn_rad.len()) as u32;
        normal::fill(self.isa, normal::key(self.sampling.seed, self.tick), from, turn_rad, gain_m_s);
        let (turn, gain) = ((SIGMA_YAW_RATE_RAD_S * STEP_S) as f32, (SIGMA_ACCEL_M_S2 * STEP_S) as f32);
        turn_rad.iter_mut().for_each(|v| *v *= turn);
        gain_m_s.iter_mut().for_each(|v| *v *= gain);
        // Sample 0 is the incumbent itself.
        for step in 0..self.sampling.n_steps {
            turn_rad[step * *n_lanes] = 0.0;
            gain_m_s[step * *n_lanes] = 0.0;
        }
    }

    fn perturb(&mut self, round: usize, start: Pose) {
        let Scratch { controls, bounds, speeds, held, incumbent, .. } = &mut self.scratch;
        for (to, [rate, accel]) in held.iter_mut().zip(incumbent) {
            *to = [(*rate * STEP_S) as f32, (*accel * STEP_S) as f32];
        }
        let (speed_m_s, noise) = (start[3] as f32, &self.noise[round]);
        self.isa.run(Perturb { incumbent: held, speed_m_s, noise, controls, bounds, speeds });
    }

    /// Picks the lanes that speeds and turn rates alone do not rule out.
    fn pick(&mut self, best: f64) {
        let Scratch { bounds, lanes, kept_m, .. } = &mut self.scratch;
        let floor = best as f32 - ROUNDING_M;
        lanes.clear();
        lanes.extend((1..self.sampling.n_samples).filter(|lane| bounds[*lane] > floor));
        // What is not swept may still keep all that its controls leave.
        kept_m.copy_from_slice(bounds);
    }

    /// Sweeps the picked lanes and drops those that cannot keep more than `best`.
    fn sweep_picked(&mut self, start: Pose, best: f64) {
        let n_steps = self.sampling.n_steps;
        let floor_m = best as f32 - self.error_m;
        let Scratch { controls, picked, lanes, kept_m, .. } = &mut self.scratch;
        let n_lanes = lanes.len();
        picked.n_lanes = padded(n_lanes);
        for step in 0..n_steps {
            let (from, to) = (step * controls.n_lanes, step * picked.n_lanes);
            for (at, lane) in lanes.iter().enumerate() {
                picked.turn_rad[to + at] = controls.turn_rad[from + lane];
                picked.gain_m_s[to + at] = controls.gain_m_s[from + lane];
            }
        }
        let field = &self.field;
        self.isa.run(Sweep::<false> { field, start, controls: picked, n_lanes, n_steps, floor_m, kept_m });
        // Lane by lane in place: lanes only move forward to where they belong.
        for at in (0..n_lanes).rev() {
            kept_m[lanes[at]] = kept_m[at];
        }
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
            let noise = &self.noise[round];
            let controls = trial.iter_mut().enumerate().map(|(step, to)| {
                *to = perturbed(incumbent[step], noise, step, lane);
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
fn perturbed([rate, accel]: [f64; 2], noise: &Lanes, step: usize, lane: usize) -> [f64; 2] {
    let at = step * noise.n_lanes + lane;
    let rate = rate + f64::from(noise.turn_rad[at]) / STEP_S;
    let accel = accel + f64::from(noise.gain_m_s[at]) / STEP_S;
    [rate.clamp(-YAW_RATE_RAD_S_MAX, YAW_RATE_RAD_S_MAX), accel.clamp(-ACCEL_M_S2_MAX, ACCEL_M_S2_MAX)]
}
