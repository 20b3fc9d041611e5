//! Commands on their way: where the base will be when the next one takes effect.

use std::collections::VecDeque;

use geometry::Twist;

use crate::dynamics::{Limits, State};

/// Most commands remembered: half a second at 400 Hz.
const N_COMMANDS_MAX: usize = 200;

/// The commands of the last moments, newest last, each with its age.
#[derive(Clone, Debug, Default)]
pub(crate) struct OnTheWay {
    commands: VecDeque<(f64, Twist)>,
}

impl OnTheWay {
    /// Lets time pass.
    pub(crate) fn advance(&mut self, seconds: f64) {
        for (age_s, _) in &mut self.commands {
            *age_s += seconds;
        }
    }

    /// Remembers a command that was sent just now.
    pub(crate) fn push(&mut self, command: Twist) {
        if self.commands.len() == N_COMMANDS_MAX {
            self.commands.pop_front();
        }
        self.commands.push_back((0.0, command));
    }

    /// The state `latency_s` from now, with the commands that act until then.
    pub(crate) fn predict(&mut self, now: State, latency_s: f64, limits: &Limits) -> State {
        // All but the newest of those in force already are history.
        while self.commands.len() > 1 && self.commands[1].0 >= latency_s {
            self.commands.pop_front();
        }
        let (mut state, mut at_s) = (now, 0.0);
        for idx in 0..self.commands.len() {
            let until_s = match self.commands.get(idx + 1) {
                Some((age_s, _)) => latency_s - age_s,
                None => latency_s,
            };
            if until_s > at_s {
                state = follow(state, self.commands[idx].1, until_s - at_s, limits);
                at_s = until_s;
            }
        }
        state
    }
}

/// The base follows a set-point: it ramps at its limit, then holds.
fn follow(state: State, set_point: Twist, seconds: f64, limits: &Limits) -> State {
    let gain_m_s = set_point.speed_m_s.max(0.0) - state.speed_m_s;
    let ramp_s = (gain_m_s.abs() / limits.accel_m_s2_max).min(seconds);
    let end_m_s = state.speed_m_s + gain_m_s.signum() * limits.accel_m_s2_max * ramp_s;
    let ramped = state.ramped(set_point.yaw_rate_rad_s, end_m_s.max(0.0), ramp_s);
    ramped.ramped(set_point.yaw_rate_rad_s, ramped.speed_m_s, seconds - ramp_s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::Profile;

    #[test]
    fn without_latency_the_state_is_the_measured_one() {
        let mut way = OnTheWay::default();
        way.push(Twist::new(1.0, 0.5));
        let now = State { speed_m_s: 0.4, ..State::default() };
        assert_eq!(way.predict(now, 0.0, &Limits::of(&Profile::sim())), now);
    }

    #[test]
    fn each_command_acts_from_its_arrival_to_the_next_ones() {
        let limits = Limits::of(&Profile::sim());
        let mut way = OnTheWay::default();
        way.push(Twist::new(0.6, 0.0));
        way.advance(0.05);
        way.push(Twist::new(0.6, 1.0));
        way.advance(0.05);
        // At a latency of 80 ms the second command, 50 ms old, acts 30 ms from now.
        let now = State { speed_m_s: 0.6, ..State::default() };
        let then = way.predict(now, 0.08, &limits);
        assert!((then.yaw_rad - 0.05).abs() < 1e-9);
        assert!((then.x_m - 0.6 * 0.08).abs() < 1e-4);
    }
}
