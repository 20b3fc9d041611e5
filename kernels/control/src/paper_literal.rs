//! The paper's filters as printed, for comparison: Euler rollouts, margins that mix metres with m/s, no
//! incumbent, no certificate. What it does wrong is kept on purpose; never run it on a robot.
//!
//! Where the paper is silent: the radius is ε = radius off the score in both filters, and the 25 primitives
//! are a 5 × 5 grid around the nominal control, spaced by a quarter of each limit.

use crate::config::FilterConfig;
use crate::decision::{Action, Certified};
use crate::dynamics::{Control, Limits, State};
use crate::filter::Choice;
use crate::margin::{Demand, World};
use crate::noise::Noise;
use crate::plan::Plan;
use crate::primitives::deviation;
use crate::scene::Scene;
use crate::score::Search;

/// The state that the printed algorithm carries: its last solution.
#[derive(Debug)]
pub(crate) struct PaperLiteral {
    is_blending: bool,
    last: Vec<Control>,
}

impl PaperLiteral {
    pub(crate) fn new(is_blending: bool) -> Self {
        PaperLiteral { is_blending, last: Vec::new() }
    }

    /// The choice of the printed filter; its plan is one step and a braking tail, certified by nothing.
    pub(crate) fn choose(
        &mut self,
        world: &World,
        scene: &Scene<'_>,
        wanted: Control,
        noise: &Noise,
        search: &Search,
        config: &FilterConfig,
    ) -> Choice {
        let (limits, epsilon_m) = (scene.assumptions.limits, scene.assumptions.radius_m);
        let step_s = config.step_s;
        let judge = Judge { world, limits, step_s, noise, search };
        let (v_safe, safest) = judge.score(scene.start, &self.last);
        let safest_first = safest.first().copied().unwrap_or_default();
        let after = |control: Control| {
            let next = euler(scene.start, control, step_s, &limits);
            judge.score(next, safest.get(1..).unwrap_or(&[])).0.min(judge.margin(scene.start))
        };
        let v_nominal = after(wanted);
        let (first, v_sent) = if self.is_blending {
            let (v, keep) = (v_safe - epsilon_m, 1.0 - config.gamma_per_s);
            let mut allowed: Vec<(Control, f64)> = Vec::new();
            for control in grid_around(wanted, &limits) {
                let v_prim = after(control) - epsilon_m;
                // V_prim − V ≥ −γ V, per step as printed.
                if v_prim >= keep * v {
                    allowed.push((control, v_prim + epsilon_m));
                }
            }
            let closest = allowed
                .into_iter()
                .min_by(|a, b| deviation(a.0, wanted, &limits).total_cmp(&deviation(b.0, wanted, &limits)));
            closest.unwrap_or((safest_first, v_safe))
        } else if v_nominal > epsilon_m {
            (wanted, v_nominal)
        } else {
            (safest_first, v_safe)
        };
        self.last = safest.get(1..).unwrap_or(&[]).to_vec();
        let action = if first == wanted { Action::Passed } else { Action::Backup };
        Choice {
            plan: Plan::roll(scene.start, &[first], step_s, &limits, true),
            action,
            v_safe_m: v_safe,
            v_sent_m: v_sent,
            certified: Certified::No { why: "the paper's filter has no certificate" },
            held_by: None,
        }
    }
}

struct Judge<'a> {
    world: &'a World,
    limits: Limits,
    step_s: f64,
    noise: &'a Noise,
    search: &'a Search,
}

impl Judge<'_> {
    /// Alg. 1: no incumbent among the samples, so the score may fall from round to round.
    fn score(&self, start: State, guess: &[Control]) -> (f64, Vec<Control>) {
        let mut sequence = guess.to_vec();
        sequence.resize(self.search.n_steps, Control::default());
        let mut value = f64::NEG_INFINITY;
        for round in 0..self.search.n_rounds.max(1) {
            let mut best: Option<(f64, Vec<Control>)> = None;
            for sample in 0..self.search.n_samples {
                let draws = self.noise.sequence(round * self.search.n_samples + sample);
                let trial: Vec<Control> = sequence
                    .iter()
                    .zip(draws)
                    .map(|(control, (rate, accel))| {
                        self.limits.clamped(Control {
                            yaw_rate_rad_s: control.yaw_rate_rad_s + self.search.sigma.yaw_rate_rad_s * rate,
                            accel_m_s2: control.accel_m_s2 + self.search.sigma.accel_m_s2 * accel,
                        })
                    })
                    .collect();
                let worth = self.worst_margin(start, &trial);
                if best.as_ref().is_none_or(|(best, _)| worth > *best) {
                    best = Some((worth, trial));
                }
            }
            if let Some((worth, trial)) = best {
                (value, sequence) = (worth, trial);
            }
        }
        (value, sequence)
    }

    fn worst_margin(&self, start: State, controls: &[Control]) -> f64 {
        let (mut state, mut worst) = (start, self.margin(start));
        for &control in controls {
            state = euler(state, control, self.step_s, &self.limits);
            worst = worst.min(self.margin(state));
        }
        worst
    }

    /// l(x) of the paper's table; ω is a control, so the printed l(x) cannot see it.
    fn margin(&self, state: State) -> f64 {
        let place = state.position();
        let base = self.world.base.iter().map(|layer| layer.field.sample(place));
        let points = self.world.points.iter().map(|point| (point - place).norm());
        let rules = self.world.rules.iter().map(|rule| match &rule.demand {
            Demand::Exclusion { zone, buffer_m } => zone.sample(place) - buffer_m,
            Demand::SpeedCap { speed_m_s_max } => speed_m_s_max - state.speed_m_s,
            Demand::Limit { zone, buffer_m, speed_m_s_max, .. } => {
                let kinematic = speed_m_s_max.map_or(f64::INFINITY, |limit| limit - state.speed_m_s);
                let outside = zone.as_ref().map_or(f64::NEG_INFINITY, |zone| zone.sample(place));
                outside.max(kinematic) - buffer_m
            }
        });
        base.chain(points).chain(rules).fold(f64::INFINITY, f64::min)
    }
}

/// The paper's dynamics: the position moves with the old heading and speed.
fn euler(state: State, control: Control, step_s: f64, limits: &Limits) -> State {
    let (sin, cos) = state.yaw_rad.sin_cos();
    State {
        x_m: state.x_m + state.speed_m_s * cos * step_s,
        y_m: state.y_m + state.speed_m_s * sin * step_s,
        yaw_rad: state.yaw_rad + control.yaw_rate_rad_s * step_s,
        speed_m_s: limits.speed_after(state.speed_m_s, control.accel_m_s2, step_s),
    }
}

fn grid_around(nominal: Control, limits: &Limits) -> impl Iterator<Item = Control> {
    (0..25).map(move |i| {
        let (rate, accel) = (f64::from(i % 5 - 2) / 4.0, f64::from(i / 5 - 2) / 4.0);
        limits.clamped(Control {
            yaw_rate_rad_s: nominal.yaw_rate_rad_s + rate * limits.yaw_rate_rad_s_max,
            accel_m_s2: nominal.accel_m_s2 + accel * limits.accel_m_s2_max,
        })
    })
}
