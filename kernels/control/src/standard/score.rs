//! The score of one state: rounds of bounds, and the exact value of the few samples that can be the best.
//!
//! Not here: which states are scored, and which primitive is chosen (`runner`).

use super::exact::{Start, kept, perturbed};
use super::field::Field;
use super::model::{Euler, GAIN_MAX, ROUNDING_M, TURN_MAX};
use super::oracle::Pose;
use super::*;
use crate::fast::Isa;
use crate::fast::sweep::{From, Sampled, Sweep};
use crate::noise::Noise;

mod open;
mod settle;

pub(crate) use open::Open;

/// No value at all.
pub(crate) const NONE: f64 = f64::NEG_INFINITY;

/// What a score is computed for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Goal {
    /// Over as soon as the score is known to be at least this.
    pub enough: f64,
    /// A score below this is known well enough.
    pub rival: f64,
    /// Whether a score between the two is wanted to the last bit; else only on which side of `enough` it is.
    pub is_exact: bool,
}

/// What scores are computed with.
#[derive(Debug)]
pub(crate) struct Scorer<'s> {
    isa: Isa,
    sampling: Sampling,
    pub field: Field<'s>,
    /// How far above its bound a sample's value may lie, metres.
    error_m: f32,
    pub noise: Noise,
    /// Turn and gain of each step of the incumbent.
    held: Vec<[f32; 2]>,
    /// Which sample was best in each round of the last score: likely to be good in the next one, too.
    hints: Vec<Option<usize>>,
}

impl<'s> Scorer<'s> {
    pub(crate) fn new(isa: Isa, scene: &'s Scene, sampling: Sampling) -> Scorer<'s> {
        let field = Field::of(isa, scene);
        Scorer {
            isa,
            sampling,
            error_m: field.error_m() + 2.0 * ROUNDING_M,
            field,
            noise: Noise::on(isa).keeping_incumbents(),
            held: vec![[0.0; 2]; sampling.n_steps],
            hints: vec![None; sampling.n_rounds],
        }
    }

    /// Room for one score.
    pub(crate) fn open(&self) -> Open {
        Open::new(self.sampling)
    }

    /// Begins another step: its noise is drawn anew, when it is needed.
    pub(crate) fn begin(&mut self, tick: u64) {
        let Sampling { n_samples, n_rounds, n_steps, seed } = self.sampling;
        self.noise.begin(seed, tick, (n_rounds, n_samples), n_steps);
        self.hints.fill(None);
    }

    /// Bounds the score of a state as closely as the goal asks.
    ///
    /// `FULL` finishes every rollout. Otherwise rollouts end where they cannot matter.
    pub(crate) fn bound<const FULL: bool>(&mut self, open: &mut Open, pose: Pose, goal: Goal) {
        let start = Start::at(&self.field, pose);
        let cap = self.most(&start);
        open.begin(start, cap);
        if !FULL && (cap < goal.rival || (!goal.is_exact && cap < goal.enough)) {
            return;
        }
        open.is_begun = true;
        if !FULL {
            open.know(self.kept((&open.incumbent, &start), None, cap, NONE).unwrap_or(NONE));
        }
        for round in 0..self.sampling.n_rounds {
            // No sample keeps more than the margin at the start.
            if !FULL && open.low >= cap.min(goal.enough) {
                break;
            }
            self.round::<FULL>(open, round, goal);
        }
        if goal.is_exact && open.low < goal.enough {
            self.finish(open, goal.rival);
        }
    }

    /// Settles what is left open: the score exactly, or some value below the rival when it is below that.
    pub(crate) fn finish(&mut self, open: &mut Open, rival: f64) {
        if open.low >= open.high {
            return;
        }
        if !open.lanes.is_empty() {
            let last = self.sampling.n_rounds.saturating_sub(1);
            self.settle(open, last, None, (f64::INFINITY, rival));
        } else if open.exact > NONE {
            open.know(open.exact);
        } else {
            // The last rounds found nothing better than an incumbent that was never computed exactly.
            open.know(self.kept((&open.incumbent, &open.start), None, open.cap, NONE).unwrap_or(NONE));
        }
    }

    /// One round of samples around the incumbent; its best is the next incumbent.
    fn round<const FULL: bool>(
        &mut self,
        open: &mut Open,
        round: usize,
        Goal { enough, rival, is_exact }: Goal,
    ) {
        let is_last = round + 1 == self.sampling.n_rounds;
        self.noise.draw(round + 1);
        let rival = if is_last && !FULL { rival } else { NONE };
        let hint = if FULL { None } else { self.hints[round] };
        let hinted = hint.and_then(|lane| self.try_hint(open, round, lane));
        let best = hinted.map_or(open.low, |(value, _)| value);
        let floor = if FULL { NONE } else { best.max(rival) };
        let is_complete = self.sweep::<FULL>(open, round, floor, hint);

        let n_samples = self.sampling.n_samples;
        let most_m = f64::from(open.most_m(n_samples));
        let reach = if is_complete { most_m - f64::from(ROUNDING_M) } else { NONE };
        open.pick(self.isa, n_samples, floor.max(reach), self.error_m);
        let cap = open.cap;
        let low = if open.lanes.is_empty() { best } else { reach.min(cap).max(best) };
        let high = (most_m + f64::from(self.error_m)).min(cap).max(best).max(rival.next_down());
        if low >= cap && !open.lanes.is_empty() {
            // Some sample keeps the most that any can: no later round can better it, whatever its incumbent is.
            open.know(cap);
            return;
        }
        if is_last && !is_exact && (low >= enough || high < enough) {
            (open.low, open.high, open.exact) = (low, high, hinted.map_or(open.exact, |(value, _)| value));
            return;
        }
        match open.lanes[..] {
            // Exact values matter in the last round, and where two samples of another are too close to call.
            [lane] if !is_last && low > best => {
                self.hints[round] = Some(lane as usize);
                self.hold(open, round, lane as usize);
                open.lanes.clear();
                (open.low, open.high, open.exact) = (low, high, NONE);
            }
            [] if hinted.is_none() => open.high = open.high.max(rival.next_down()),
            _ => self.settle(open, round, hinted, (enough, rival)),
        }
    }

    /// What the sample keeps that was the best of this round in the last score, when it is better than what is
    /// known.
    fn try_hint(&self, open: &Open, round: usize, sample: usize) -> Option<(f64, usize)> {
        let from = (open.incumbent.as_slice(), &open.start);
        let value = self.kept(from, Some((round, sample)), open.cap, open.low.next_up())?;
        Some((value, sample))
    }

    /// What an incumbent or a sample of a round around it keeps, which is at most `most_m`; `None` when that is below
    /// `floor`.
    fn kept(
        &self,
        (incumbent, start): (&[[f64; 2]], &Start),
        sample: Option<(usize, usize)>,
        most_m: f64,
        floor: f64,
    ) -> Option<f64> {
        let Some((round, sample)) = sample else {
            return kept(&self.field, start, most_m, incumbent.iter().copied(), floor);
        };
        let draws = |step: usize| self.noise.pair(round, step, sample);
        let controls = incumbent.iter().enumerate().map(|(step, held)| perturbed(*held, draws(step)));
        kept(&self.field, start, most_m, controls, floor)
    }

    /// Sweeps all samples of a round; whether all were followed as far as they matter. The rest was few, and
    /// what is found for them are bounds from above.
    fn sweep<const FULL: bool>(
        &mut self,
        open: &mut Open,
        round: usize,
        floor: f64,
        known: Option<usize>,
    ) -> bool {
        for (to, [rate, accel]) in self.held.iter_mut().zip(&open.incumbent) {
            *to = [(*rate * STEP_S) as f32, (*accel * STEP_S) as f32];
        }
        let Start { pose, sin, cos, next_m } = open.start;
        let (ground, [x, y]) = self.field.ground(pose);
        let from = From {
            x,
            y,
            sin: sin as f32,
            cos: cos as f32,
            speed_m_s: pose[3] as f32,
            // So much above it that who keeps all of it is seen to.
            kept_m: open.cap as f32 + 3.0 * ROUNDING_M,
            next_m: next_m.map(|next_m| next_m as f32),
        };
        let sampled = Sampled {
            held: &self.held,
            draws: self.noise.round(round),
            n_lanes: self.noise.n_lanes(),
            scale: [(SIGMA_YAW_RATE_RAD_S * STEP_S) as f32, (SIGMA_ACCEL_M_S2 * STEP_S) as f32],
            limit: [TURN_MAX, GAIN_MAX],
        };
        let incumbent = (!FULL && open.exact > NONE).then_some(0);
        self.isa.run(Sweep::<_, FULL> {
            model: Euler,
            ground,
            from,
            sampled,
            n: self.sampling.n_samples,
            n_vector: self.isa.n_floats(),
            known: [incumbent, known],
            floor_m: (floor - f64::from(self.error_m)) as f32,
            kept_m: &mut open.kept_m,
        })
    }

    /// Makes a sample the incumbent.
    fn hold(&mut self, open: &mut Open, round: usize, lane: usize) {
        for (step, control) in open.incumbent.iter_mut().enumerate() {
            *control = perturbed(*control, self.noise.pair(round, step, lane));
        }
    }

    /// The most that any sample can keep: the margin at the start, and that of the next place, which no control
    /// changes; there the robot is at least as fast as after full braking.
    fn most(&self, Start { pose: [x, y, _, v], next_m: [clear, slow], .. }: &Start) -> f64 {
        let here = self.field.margin_m(*x, *y, *v);
        let braked = (v - ACCEL_M_S2_MAX * STEP_S).clamp(0.0, SPEED_M_S_MAX);
        let next = clear.min(slow.max(SLOW_SPEED_M_S - braked));
        (SPEED_M_S_LIMIT - v).min(YAW_RATE_RAD_S_LIMIT).min(here).min(next)
    }
}
