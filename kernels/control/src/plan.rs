//! A plan: what the base will do until it is at rest, and how far along it we are.
//!
//! Samples lie one step Δ apart, the last one at rest. A stored plan is never cut: time moves along it, so
//! that ticks may be faster than Δ, and what was certified once is the same set of segments later.

use std::ops::Range;

use geometry::Twist;

use crate::dynamics::{Bend, Control, Heading, Limits, State};

mod spares;

pub(crate) use spares::Spares;

/// Most samples of a plan: 400 steps and a tail of as many.
const N_SAMPLES_MAX: usize = 1200;

/// One moment of a plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Where the model is.
    pub state: State,
    /// Turn rate of the segment that starts here, rad/s.
    pub yaw_rate_rad_s: f64,
    /// Time from the start in which the base moves forward, seconds.
    pub moving_s: f64,
    /// Length of the path so far, metres.
    pub path_m: f64,
}

/// A motion that ends at rest, sampled every Δ, and the time that has passed along it.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    samples: Vec<Sample>,
    step_s: f64,
    at_s: f64,
}

impl Plan {
    /// Rolls controls out from a state, one a step; with `tail`, full straight braking is appended.
    ///
    /// Without the tail a plan may end moving, and is then never certified.
    #[must_use]
    pub fn roll(start: State, controls: &[Control], step_s: f64, limits: &Limits, tail: bool) -> Plan {
        let heading = Heading::of(start.yaw_rad);
        Plan::roll_into(Vec::new(), (start, heading), controls, step_s, limits, tail)
    }

    /// The same in the room of a plan that is no more, from a state and its heading.
    pub(crate) fn roll_into(
        mut samples: Vec<Sample>,
        (start, mut heading): (State, Heading),
        controls: &[Control],
        step_s: f64,
        limits: &Limits,
        tail: bool,
    ) -> Plan {
        samples.clear();
        samples.reserve(controls.len() + 32);
        samples.push(Sample { state: start, yaw_rate_rad_s: 0.0, moving_s: 0.0, path_m: 0.0 });
        let mut plan = Plan { samples, step_s, at_s: 0.0 };
        for &control in controls {
            plan.push(control, limits, &mut heading);
        }
        let braking = Control { yaw_rate_rad_s: 0.0, accel_m_s2: -limits.accel_m_s2_max };
        while tail && !plan.ends_at_rest() && plan.samples.len() < N_SAMPLES_MAX {
            plan.push(braking, limits, &mut heading);
        }
        plan
    }

    fn push(&mut self, control: Control, limits: &Limits, heading: &mut Heading) {
        let step_s = self.step_s;
        let Some(last) = self.samples.last_mut() else { return };
        last.yaw_rate_rad_s = control.yaw_rate_rad_s;
        let end_m_s = limits.speed_after(last.state.speed_m_s, control.accel_m_s2, step_s);
        let state = last.state.ramped_along(heading, control.yaw_rate_rad_s, end_m_s, step_s);
        let moves = last.state.speed_m_s > 0.0 || state.speed_m_s > 0.0;
        let next = Sample {
            state,
            yaw_rate_rad_s: 0.0,
            moving_s: last.moving_s + if moves { step_s } else { 0.0 },
            path_m: last.path_m + (last.state.speed_m_s + state.speed_m_s) / 2.0 * step_s,
        };
        self.samples.push(next);
    }

    /// The samples, from the plan's start; the past ones too.
    #[must_use]
    pub fn samples(&self) -> &[Sample] {
        &self.samples
    }

    /// A copy in the room of a plan that is no more.
    pub(crate) fn copied_into(&self, mut samples: Vec<Sample>) -> Plan {
        samples.clear();
        samples.extend_from_slice(&self.samples);
        Plan { samples, ..*self }
    }

    /// The samples of what is not past, the straddled segment's start first.
    #[must_use]
    pub fn rest(&self) -> &[Sample] {
        &self.samples[self.segment().min(self.samples.len() - 1)..]
    }

    /// Time between samples, seconds.
    #[must_use]
    pub fn step_s(&self) -> f64 {
        self.step_s
    }

    /// Lets time pass. A negative or NaN duration is none.
    pub fn advance(&mut self, seconds: f64) {
        self.at_s = (self.at_s + seconds.max(0.0)).min(self.step_s * self.samples.len() as f64);
    }

    /// True when the last sample stands still.
    #[must_use]
    pub fn ends_at_rest(&self) -> bool {
        self.samples.last().is_some_and(|last| last.state.speed_m_s <= 0.0)
    }

    /// True when nothing but rest is left.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.segment() + 1 >= self.samples.len()
    }

    /// The set-point to send now: the speed one step ahead, at the turn rate of the moment.
    #[must_use]
    pub fn command(&self) -> Twist {
        if self.is_over() {
            return Twist::ZERO;
        }
        Twist::new(self.speed_at(self.at_s + self.step_s), self.samples[self.segment()].yaw_rate_rad_s)
    }

    /// The control now in force, as far as it can be told from the plan's samples.
    #[must_use]
    pub fn control_at(&self, seconds_ahead: f64) -> Control {
        let at_s = self.at_s + seconds_ahead;
        let idx = ((at_s / self.step_s + 1e-6) as usize).min(self.samples.len() - 1);
        let gain_m_s = self.speed_at(at_s + self.step_s) - self.speed_at(at_s);
        Control { yaw_rate_rad_s: self.samples[idx].yaw_rate_rad_s, accel_m_s2: gain_m_s / self.step_s }
    }

    /// The controls of some of its steps, counted from now and made as they are asked for.
    pub(crate) fn controls(&self, steps: Range<usize>) -> impl Iterator<Item = Control> + Clone + '_ {
        steps.map(|k| self.control_at(k as f64 * self.step_s))
    }

    /// The modelled state at this moment.
    #[must_use]
    pub fn state_now(&self) -> State {
        let idx = self.segment().min(self.samples.len() - 1);
        let sample = self.samples[idx];
        let since_s = (self.at_s - idx as f64 * self.step_s).clamp(0.0, self.step_s);
        sample.state.ramped(sample.yaw_rate_rad_s, self.speed_at(self.at_s), since_s)
    }

    /// Time in motion up to this moment, seconds.
    #[must_use]
    pub fn moving_s_now(&self) -> f64 {
        let idx = self.segment().min(self.samples.len() - 1);
        let next_s = self.samples.get(idx + 1).map_or(f64::INFINITY, |next| next.moving_s);
        let sample_s = self.samples[idx].moving_s;
        let since_s = (self.at_s - idx as f64 * self.step_s).max(0.0);
        if next_s.is_finite() { (sample_s + since_s).min(next_s) } else { sample_s }
    }

    /// The modelled speed `at_s` seconds after the plan's start.
    fn speed_at(&self, at_s: f64) -> f64 {
        let steps = at_s / self.step_s;
        let last_idx = self.samples.len() - 1;
        // Rounding must not turn "the first sample" into "almost the first".
        let nearest = (steps + 0.5) as usize;
        if (steps - nearest as f64).abs() < 1e-6 {
            return self.samples[nearest.min(last_idx)].state.speed_m_s;
        }
        let idx = steps.max(0.0) as usize;
        if idx >= last_idx {
            return self.samples[last_idx].state.speed_m_s;
        }
        let (from, to) = (self.samples[idx].state.speed_m_s, self.samples[idx + 1].state.speed_m_s);
        from + (to - from) * (steps - idx as f64)
    }

    /// The segment that is being driven.
    fn segment(&self) -> usize {
        (self.at_s / self.step_s + 1e-6) as usize
    }
}

/// One moment of a plan that is rolled out step by step, for who may not want all of it.
///
/// The same as [`Plan::roll`]'s, to the rounding of a heading that is turned step by step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rolling {
    /// The turn rate of the segment that starts here is not known yet: 0.
    pub sample: Sample,
    cos: f64,
    sin: f64,
}

impl Rolling {
    pub(crate) fn from(start: State) -> Rolling {
        let (sin, cos) = start.yaw_rad.sin_cos();
        let sample = Sample { state: start, yaw_rate_rad_s: 0.0, moving_s: 0.0, path_m: 0.0 };
        Rolling { sample, cos, sin }
    }

    /// The next moment under a control; `bend` is the last step's.
    pub(crate) fn after(&self, control: Control, step_s: f64, limits: &Limits, bend: &mut Bend) -> Rolling {
        let Rolling { sample: Sample { state, moving_s, path_m, .. }, cos, sin } = *self;
        let State { x_m, y_m, yaw_rad, speed_m_s } = state;
        let end_m_s = limits.speed_after(speed_m_s, control.accel_m_s2, step_s);
        let turn_rad = control.yaw_rate_rad_s * step_s;
        let moved = bend.becomes(turn_rad).over(speed_m_s, end_m_s, step_s);
        let state = State {
            x_m: x_m + cos * moved.along_m - sin * moved.aside_m,
            y_m: y_m + sin * moved.along_m + cos * moved.aside_m,
            yaw_rad: yaw_rad + turn_rad,
            speed_m_s: end_m_s,
        };
        let moves = speed_m_s > 0.0 || end_m_s > 0.0;
        let sample = Sample {
            state,
            yaw_rate_rad_s: 0.0,
            moving_s: moving_s + if moves { step_s } else { 0.0 },
            path_m: path_m + (speed_m_s + end_m_s) / 2.0 * step_s,
        };
        Rolling {
            sample,
            cos: cos * moved.turn_cos - sin * moved.turn_sin,
            sin: sin * moved.turn_cos + cos * moved.turn_sin,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::Profile;
    use proptest::prelude::*;

    fn limits() -> Limits {
        Limits::of(&Profile::sim())
    }

    fn cruise(speed_m_s: f64, n: usize) -> Plan {
        let start = State { speed_m_s, ..State::default() };
        let control = Control { yaw_rate_rad_s: 0.5, accel_m_s2: 0.0 };
        Plan::roll(start, &vec![control; n], 0.05, &limits(), true)
    }

    #[test]
    fn a_plan_brakes_after_its_controls_and_then_commands_rest() {
        let mut plan = cruise(0.6, 3);
        assert!(plan.ends_at_rest());
        assert_eq!(plan.samples().len(), 1 + 3 + 4);
        assert_eq!(plan.command(), Twist::new(0.6, 0.5));
        plan.advance(0.15);
        assert!((plan.command().speed_m_s - 0.45).abs() < 1e-12);
        assert_eq!(plan.command().yaw_rate_rad_s, 0.0);
        plan.advance(10.0);
        assert!(plan.is_over());
        assert_eq!(plan.command(), Twist::ZERO);
    }

    #[test]
    fn without_a_tail_a_plan_may_end_moving() {
        let start = State { speed_m_s: 0.6, ..State::default() };
        let plan = Plan::roll(start, &[Control::default()], 0.05, &limits(), false);
        assert!(!plan.ends_at_rest());
    }

    proptest! {
        #[test]
        fn moments_one_by_one_are_those_of_the_plan(
            raw in prop::collection::vec((-1.0..1.0_f64, -3.0..3.0_f64), 0..40), speed_m_s in 0.0..1.5_f64,
        ) {
            let start = State { speed_m_s, yaw_rad: 0.7, ..State::default() };
            let control = |&(yaw_rate_rad_s, accel_m_s2): &(f64, f64)| Control { yaw_rate_rad_s, accel_m_s2 };
            let controls: Vec<Control> = raw.iter().map(control).collect();
            let plan = Plan::roll(start, &controls, 0.05, &limits(), true);
            let (mut here, mut bend) = (Rolling::from(start), Bend::NONE);
            for (control, other) in controls.into_iter().zip(&plan.samples()[1..]) {
                here = here.after(control, 0.05, &limits(), &mut bend);
                let one = here.sample;
                prop_assert!((one.state.x_m - other.state.x_m).abs() < 1e-9);
                prop_assert!((one.state.y_m - other.state.y_m).abs() < 1e-9);
                prop_assert_eq!(one.state.speed_m_s, other.state.speed_m_s);
                prop_assert_eq!((one.path_m, one.moving_s), (other.path_m, other.moving_s));
            }
        }

        #[test]
        fn time_passes_along_a_plan_the_same_in_one_or_many_ticks(n in 1..60_usize, part in 1..20_u32) {
            let (mut once, mut often) = (cruise(1.2, 10), cruise(1.2, 10));
            let total_s = 0.01 * n as f64;
            once.advance(total_s);
            for _ in 0..part {
                often.advance(total_s / f64::from(part));
            }
            let (a, b) = (once.state_now(), often.state_now());
            prop_assert!((a.x_m - b.x_m).abs() < 1e-9 && (a.speed_m_s - b.speed_m_s).abs() < 1e-9);
        }
    }
}
