//! Turn-and-drive: the motions that lead out of a corner when sampling around braking does not.

use geometry::angle::turn;

use crate::dynamics::{Control, Limits, State};

/// Headings tried, evenly spread, the present one among them.
pub(crate) const N_HEADINGS: usize = 16;

/// One turn-and-drive motion.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TurnAndDrive {
    /// Where to drive, radians in `map`.
    pub heading_rad: f64,
    /// Speed while turning, m/s; 0 turns in place.
    pub turning_m_s: f64,
    /// Speed once aligned, m/s.
    pub driving_m_s: f64,
    /// Time of driving once aligned, seconds.
    pub driving_s: f64,
}

impl TurnAndDrive {
    /// The controls, one a step, into `controls`.
    pub(crate) fn write(&self, start: State, limits: &Limits, step_s: f64, controls: &mut Vec<Control>) {
        controls.clear();
        controls.extend(self.controls(start, limits, step_s));
    }

    /// The controls, one a step.
    pub(crate) fn controls(
        self,
        start: State,
        limits: &Limits,
        step_s: f64,
    ) -> impl Iterator<Item = Control> + Clone + use<> {
        let limits = *limits;
        let TurnAndDrive { heading_rad, turning_m_s, driving_m_s, driving_s } = self;
        let (mut speed_m_s, mut left_rad) = (start.speed_m_s, turn(start.yaw_rad, heading_rad));
        let mut n_drive = (driving_s / step_s).ceil() as usize;
        std::iter::from_fn(move || {
            let turns = left_rad.abs() > 1e-6;
            if !turns {
                n_drive = n_drive.checked_sub(1)?;
            }
            let rate_max = limits.yaw_rate_rad_s_max;
            let yaw_rate_rad_s = if turns { (left_rad / step_s).clamp(-rate_max, rate_max) } else { 0.0 };
            left_rad -= yaw_rate_rad_s * step_s;
            let wanted_m_s = if turns { turning_m_s } else { driving_m_s };
            let accel_m_s2 =
                ((wanted_m_s - speed_m_s) / step_s).clamp(-limits.accel_m_s2_max, limits.accel_m_s2_max);
            speed_m_s = limits.speed_after(speed_m_s, accel_m_s2, step_s);
            Some(Control { yaw_rate_rad_s, accel_m_s2 })
        })
    }
}

/// The headings to try from a start: evenly spread from the present one.
pub(crate) fn headings(start: State) -> impl Iterator<Item = f64> {
    (0..N_HEADINGS).map(move |i| start.yaw_rad + std::f64::consts::TAU * i as f64 / N_HEADINGS as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::Profile;

    #[test]
    fn a_turn_and_drive_ends_on_its_heading_at_its_speed() {
        let limits = Limits::of(&Profile::sim());
        let start = State { yaw_rad: 3.0, speed_m_s: 0.4, ..State::default() };
        let motion = TurnAndDrive { heading_rad: -2.5, turning_m_s: 0.0, driving_m_s: 0.45, driving_s: 0.5 };
        let mut controls = Vec::new();
        motion.write(start, &limits, 0.05, &mut controls);
        let end = controls.iter().fold(start, |s, c| s.after(*c, 0.05, &limits));
        assert!(turn(end.yaw_rad, -2.5).abs() < 1e-9);
        assert!((end.speed_m_s - 0.45).abs() < 1e-9);
        assert!(controls.iter().all(|c| c.yaw_rate_rad_s.abs() <= 1.0 && c.accel_m_s2.abs() <= 3.0));
    }
}
