//! Rollouts of the standard problem, exactly: to settle what the fast bounds leave open.
//!
//! One by one, or many side by side with the same arithmetic: to the last bit the same, on all instructions.

use std::ops::Range;

use super::field::Field;
use super::oracle::Pose;
use super::*;
use crate::fast::isa::Work;
use crate::noise::Noise;

/// Sequences of controls as the oracle has them, in f64.
pub(crate) type Controls = Vec<[f64; 2]>;

/// Where a rollout starts, its heading's sine and cosine known.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Start {
    pub pose: Pose,
    pub sin: f64,
    pub cos: f64,
    /// The margins at the place after the first step, to what must be kept clear of and to the slow zone, metres: no
    /// control changes it.
    pub next_m: [f64; 2],
}

impl Start {
    pub(crate) fn at(field: &Field<'_>, pose: Pose) -> Start {
        let [x, y, yaw, v] = pose;
        let (sin, cos) = yaw.sin_cos();
        let (cell_idx, place) = field.cell(x + v * cos * STEP_S, y + v * sin * STEP_S);
        Start { pose, sin, cos, next_m: [field.clear_m(cell_idx, place), field.slow_m(cell_idx, place)] }
    }

    /// The margins at the next place and what they may fall by until there, `fall` a metre: as if they had been
    /// read before the first step.
    #[inline]
    fn before_first(&self, fall: f64) -> [f64; 2] {
        self.next_m.map(|next_m| next_m + fallen(fall, self.pose[3]))
    }
}

/// The smallest margin along a rollout from `start`, which is at most `most_m`; `None` once it is known to be
/// below `floor`.
///
/// Fields are read only where they can lower it: margins cannot fall faster than their true Lipschitz
/// constant lets them.
pub(crate) fn kept(
    field: &Field<'_>,
    start: &Start,
    most_m: f64,
    controls: impl Iterator<Item = [f64; 2]>,
    floor: f64,
) -> Option<f64> {
    let Start { pose: [mut x, mut y, _, mut v], mut sin, mut cos, .. } = *start;
    let fall = f64::from(field.slope_m()) / CELL_M;
    let mut kept = most_m;
    let [mut clear, mut slow] = start.before_first(fall);
    for [rate, accel] in controls {
        x += v * cos * STEP_S;
        y += v * sin * STEP_S;
        let fallen = fallen(fall, v);
        (sin, cos) = turned((sin, cos), rate * STEP_S);
        v = held_within(v + accel * STEP_S, 0.0, SPEED_M_S_MAX);
        (clear, slow) = (clear - fallen, slow - fallen);
        kept = smaller(smaller(SPEED_M_S_LIMIT - v, YAW_RATE_RAD_S_LIMIT - rate.abs()), kept);
        let (needs_clear, needs_slow) = (clear < kept, SLOW_SPEED_M_S - v < kept && slow < kept);
        if needs_clear || needs_slow {
            let (cell_idx, place) = field.cell(x, y);
            if needs_clear {
                clear = field.clear_m(cell_idx, place);
                kept = smaller(clear, kept);
            }
            if needs_slow {
                slow = field.slow_m(cell_idx, place);
                kept = smaller(larger(slow, SLOW_SPEED_M_S - v), kept);
            }
        }
        if kept < floor {
            return None;
        }
    }
    Some(kept)
}

/// The most that margins fall in a step at a speed, `fall` a metre.
#[inline(always)]
fn fallen(fall: f64, v: f64) -> f64 {
    fall * v * STEP_S + 1e-9
}

/// A heading's sine and cosine after a turn of at most 0.05 rad: Taylor, error below 1e-16.
#[inline(always)]
fn turned((sin, cos): (f64, f64), turn: f64) -> (f64, f64) {
    let square = turn * turn;
    let by_cos =
        1.0 + square * (-0.5 + square * (1.0 / 24.0 + square * (-1.0 / 720.0 + square * (1.0 / 40_320.0))));
    let by_sin = turn
        * (1.0
            + square
                * (-1.0 / 6.0
                    + square * (1.0 / 120.0 + square * (-1.0 / 5040.0 + square * (1.0 / 362_880.0)))));
    (sin * by_cos + cos * by_sin, cos * by_cos - sin * by_sin)
}

/// Rollouts that are followed side by side.
pub(super) const N_TOGETHER: usize = 32;
/// They are counted in whole vectors of so many.
const N_VECTOR: usize = 8;

/// Some samples of a round, followed side by side: where each is, and what it keeps so far, with the same
/// arithmetic as [`kept`].
pub(super) struct Together {
    n: usize,
    x: [f64; N_TOGETHER],
    y: [f64; N_TOGETHER],
    sin: [f64; N_TOGETHER],
    cos: [f64; N_TOGETHER],
    v: [f64; N_TOGETHER],
    /// How low the margins may have fallen since they were read.
    clear: [f64; N_TOGETHER],
    slow: [f64; N_TOGETHER],
    /// Draws of this step.
    rate: [f64; N_TOGETHER],
    accel: [f64; N_TOGETHER],
    /// What is kept so far: at most this is kept at the end. Lowered by the caller where that is all one to it.
    pub kept: [f64; N_TOGETHER],
}

impl Together {
    /// As many as there are values that they keep at most.
    pub(super) fn at(field: &Field<'_>, start: &Start, most_m: impl Iterator<Item = f64>) -> Together {
        let Start { pose: [x, y, _, v], sin, cos, .. } = *start;
        let all = |value: f64| [value; N_TOGETHER];
        let [clear, slow] = start.before_first(f64::from(field.slope_m()) / CELL_M).map(all);
        let (x, y, sin, cos, v) = (all(x), all(y), all(sin), all(cos), all(v));
        let (mut n, mut kept) = (0, all(f64::NEG_INFINITY));
        for (to, most_m) in kept.iter_mut().zip(most_m) {
            (*to, n) = (most_m, n + 1);
        }
        Together { n, x, y, sin, cos, v, clear, slow, rate: all(0.0), accel: all(0.0), kept }
    }

    /// One step of every rollout, and what its controls alone leave.
    #[inline(always)]
    fn advance(&mut self, held: [f64; 2], fall: f64) {
        let Together { n, x, y, sin, cos, v, clear, slow, rate, accel, kept } = self;
        let n = n.next_multiple_of(N_VECTOR);
        step_lanes(n, held, fall, x, y, sin, cos, v, clear, slow, rate, accel, kept);
    }

    /// Reads the fields where they can lower what is kept.
    #[inline(always)]
    fn read(&mut self, field: &Field<'_>, floor: f64) {
        for lane in 0..self.n.min(N_TOGETHER) {
            let (least, spare) = (self.kept[lane], SLOW_SPEED_M_S - self.v[lane]);
            let (needs_clear, needs_slow) =
                (self.clear[lane] < least, spare < least && self.slow[lane] < least);
            if least >= floor && (needs_clear || needs_slow) {
                let (cell_idx, place) = field.cell(self.x[lane], self.y[lane]);
                if needs_clear {
                    self.clear[lane] = field.clear_m(cell_idx, place);
                    self.kept[lane] = smaller(self.clear[lane], self.kept[lane]);
                }
                if needs_slow {
                    self.slow[lane] = field.slow_m(cell_idx, place);
                    self.kept[lane] = smaller(larger(self.slow[lane], spare), self.kept[lane]);
                }
            }
        }
    }
}

/// Follows samples side by side for some steps on; those that keep less than `floor` need not be right.
pub(super) struct Follow<'a, 's> {
    pub together: &'a mut Together,
    pub field: &'a Field<'s>,
    pub samples: &'a [u32],
    pub incumbent: &'a [[f64; 2]],
    pub noise: &'a Noise,
    pub round: usize,
    pub steps: Range<usize>,
    pub floor: f64,
}

impl Work for Follow<'_, '_> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Follow { together, field, samples, incumbent, noise, round, steps, floor } = self;
        let fall = f64::from(field.slope_m()) / CELL_M;
        let (draws, n_drawn) = (noise.round(round), noise.n_lanes());
        let n = samples.len().min(N_TOGETHER);
        for (step, held) in incumbent.iter().enumerate().take(steps.end).skip(steps.start) {
            let [rates, accels] = draws.map(|draws| &draws[step * n_drawn..(step + 1) * n_drawn]);
            for (lane, sample) in samples[..n].iter().enumerate() {
                together.rate[lane] = f64::from(rates[*sample as usize]);
                together.accel[lane] = f64::from(accels[*sample as usize]);
            }
            together.advance(*held, fall);
            together.read(field, floor);
        }
    }
}

#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "arrays in a struct would not be known to be apart")]
fn step_lanes(
    n: usize,
    [held_rate, held_accel]: [f64; 2],
    fall: f64,
    x: &mut [f64; N_TOGETHER],
    y: &mut [f64; N_TOGETHER],
    sin: &mut [f64; N_TOGETHER],
    cos: &mut [f64; N_TOGETHER],
    v: &mut [f64; N_TOGETHER],
    clear: &mut [f64; N_TOGETHER],
    slow: &mut [f64; N_TOGETHER],
    rate: &[f64; N_TOGETHER],
    accel: &[f64; N_TOGETHER],
    kept: &mut [f64; N_TOGETHER],
) {
    for lane in 0..n.min(N_TOGETHER) {
        let [rate, accel] = perturbed([held_rate, held_accel], (rate[lane], accel[lane]));
        let from = v[lane];
        x[lane] += from * cos[lane] * STEP_S;
        y[lane] += from * sin[lane] * STEP_S;
        let fallen = fallen(fall, from);
        (sin[lane], cos[lane]) = turned((sin[lane], cos[lane]), rate * STEP_S);
        let to = held_within(from + accel * STEP_S, 0.0, SPEED_M_S_MAX);
        v[lane] = to;
        clear[lane] -= fallen;
        slow[lane] -= fallen;
        let bound = smaller(SPEED_M_S_LIMIT - to, YAW_RATE_RAD_S_LIMIT - rate.abs());
        kept[lane] = smaller(bound, kept[lane]);
    }
}

/// The control of one sample at a step, in f64.
#[inline(always)]
pub(super) fn perturbed([rate, accel]: [f64; 2], (rate_draw, accel_draw): (f64, f64)) -> [f64; 2] {
    let rate = rate + SIGMA_YAW_RATE_RAD_S * rate_draw;
    let accel = accel + SIGMA_ACCEL_M_S2 * accel_draw;
    [
        held_within(rate, -YAW_RATE_RAD_S_MAX, YAW_RATE_RAD_S_MAX),
        held_within(accel, -ACCEL_M_S2_MAX, ACCEL_M_S2_MAX),
    ]
}

// As comparisons, not `f64::min`: one instruction each where NaN is not asked about.

#[inline(always)]
fn smaller(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

#[inline(always)]
fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

#[inline(always)]
fn held_within(value: f64, low: f64, high: f64) -> f64 {
    smaller(larger(value, low), high)
}
