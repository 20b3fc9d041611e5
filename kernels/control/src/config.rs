//! The numbers of the filter, and their check against the robot's profile.

use geometry::Profile;

use crate::dynamics::Limits;

/// Which control is chosen once the safety score is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// The certified primitive closest to the nominal control whose score has not fallen too far.
    SmoothBlending,
    /// The nominal control while its score stays above ε, else the safest control.
    LeastRestrictive,
    /// The paper's least-restrictive filter as printed: no certificate, kept for comparison.
    PaperLiteral,
    /// The paper's smooth-blending filter as printed: no certificate, kept for comparison.
    PaperLiteralBlending,
}

/// How far reality may differ from the model: the radii of the tube around every plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disturbance {
    /// Largest error of the position, metres.
    pub position_m: f64,
    /// Largest error of the heading, radians.
    pub yaw_rad: f64,
    /// Largest error of the speed while moving, m/s.
    pub speed_m_s: f64,
    /// Largest time by which commands act later than `latency_s` says, seconds. A first-order lag of τ
    /// counts as 2 τ.
    pub delay_s: f64,
}

/// The parameters of the filter; SI units. Checked by [`FilterConfig::checked`].
#[derive(Clone, Debug, PartialEq)]
pub struct FilterConfig {
    /// How the control is chosen.
    pub method: Method,
    /// Control sequences sampled in each round, the paper's N.
    pub n_samples: usize,
    /// Rounds of refinement, the paper's R.
    pub n_rounds: usize,
    /// Steps before the braking tail, the paper's H.
    pub n_steps: usize,
    /// Length of a step, seconds, the paper's Δ.
    pub step_s: f64,
    /// Spread of the sampled turn rates, rad/s.
    pub sigma_yaw_rate_rad_s: f64,
    /// Spread of the sampled accelerations, m/s².
    pub sigma_accel_m_s2: f64,
    /// How fast the score may fall while blending, 1/s, the paper's γ; γ Δ ≤ 1.
    pub gamma_per_s: f64,
    /// Margin beyond the hull that the least-restrictive filter keeps, metres, our ε.
    pub epsilon_m: f64,
    /// A control that keeps this much margin passes unchanged, whatever the score, metres.
    pub ample_m: f64,
    /// Seed of the sampled controls.
    pub seed: u64,
    /// The tube around every plan.
    pub disturbance: Disturbance,
    /// Measured time from a command to its effect, seconds: the state is predicted over it.
    pub latency_s: f64,
    /// Speed at which scan hits that are not on the base map may come closer, m/s.
    pub closing_speed_m_s: f64,
    /// Whether every plan gets a braking tail after its H steps. Without, H itself must suffice to brake.
    pub braking_tail: bool,
}

/// A number outside its range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ConfigError {
    /// A number outside the range that the profile leaves it.
    #[error("{key} = {value}, must be within {low} to {high}")]
    Range {
        /// The key as written in the configuration.
        key: &'static str,
        /// The value found.
        value: f64,
        /// Smallest value allowed.
        low: f64,
        /// Largest value allowed.
        high: f64,
    },
    /// A horizon within which the robot cannot stop, and no braking tail after it.
    #[error("n_steps = {n_steps} without a braking tail, must be at least {needed} to brake within")]
    CannotBrake {
        /// The steps found.
        n_steps: usize,
        /// The steps that braking from the top speed takes.
        needed: usize,
    },
}

impl FilterConfig {
    /// The defaults for a robot: the paper's N, R, H and Δ, our certificate.
    ///
    /// The radii are chosen, not measured: 5 mm and 0.3° are the error of a scan-matched pose against the
    /// same scan, half a step of delay covers a base that jumps to its set-point instead of ramping.
    #[must_use]
    pub fn for_profile(profile: &Profile) -> Self {
        FilterConfig {
            method: Method::SmoothBlending,
            n_samples: 50,
            n_rounds: 2,
            n_steps: 20,
            step_s: 0.05,
            sigma_yaw_rate_rad_s: 0.5 * profile.yaw_rate_rad_s_max,
            sigma_accel_m_s2: 0.5 * profile.accel_m_s2_max,
            gamma_per_s: 5.0,
            epsilon_m: 0.02,
            ample_m: 1.0,
            seed: 1,
            disturbance: Disturbance { position_m: 0.005, yaw_rad: 0.005, speed_m_s: 0.01, delay_s: 0.025 },
            latency_s: profile.actuation_delay_s,
            closing_speed_m_s: 0.0,
            braking_tail: true,
        }
    }

    /// The configuration, once every number is within the range that the profile leaves it.
    ///
    /// # Errors
    /// [`ConfigError`] names the first key outside its limits, the value and the limits.
    pub fn checked(self, profile: &Profile) -> Result<Self, ConfigError> {
        let rate_max = profile.yaw_rate_rad_s_max;
        // Between samples a disc of radius r is followed by chords: half a chord must fit into it, and a
        // step must not turn by more than half a radian (see `certificate`).
        let step_s_max = (profile.radius_m / profile.speed_m_s_max).min(0.5 / rate_max).min(0.25);
        for (key, value, low, high) in [
            ("step_s", self.step_s, 0.005, step_s_max),
            ("n_samples", self.n_samples as f64, 0.0, 10_000.0),
            ("n_rounds", self.n_rounds as f64, 0.0, 20.0),
            ("n_steps", self.n_steps as f64, 1.0, 400.0),
            ("sigma_yaw_rate_rad_s", self.sigma_yaw_rate_rad_s, 0.0, 2.0 * rate_max),
            ("sigma_accel_m_s2", self.sigma_accel_m_s2, 0.0, 2.0 * profile.accel_m_s2_max),
            ("gamma_per_s", self.gamma_per_s, 0.0, 1.0 / self.step_s),
            ("epsilon_m", self.epsilon_m, 0.0, 0.5),
            ("ample_m", self.ample_m, 0.05, 10.0),
            ("disturbance.position_m", self.disturbance.position_m, 0.0, 0.2),
            ("disturbance.yaw_rad", self.disturbance.yaw_rad, 0.0, 0.2),
            ("disturbance.speed_m_s", self.disturbance.speed_m_s, 0.0, 0.2),
            ("disturbance.delay_s", self.disturbance.delay_s, 0.0, 0.5),
            ("latency_s", self.latency_s, 0.0, 0.5),
            ("closing_speed_m_s", self.closing_speed_m_s, 0.0, 3.0),
        ] {
            // Written so that NaN fails.
            if !(low..=high).contains(&value) {
                return Err(ConfigError::Range { key, value, low, high });
            }
        }
        let stop_s = Limits::of(profile).braking_s(profile.speed_m_s_max);
        let needed = (stop_s / self.step_s - 1e-9).ceil() as usize + 1;
        if !self.braking_tail && self.n_steps < needed {
            return Err(ConfigError::CannotBrake { n_steps: self.n_steps, needed });
        }
        Ok(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn base() -> FilterConfig {
        FilterConfig::for_profile(&Profile::sim())
    }

    #[track_caller]
    fn check(config: FilterConfig, wanted_key: &str) {
        match config.checked(&Profile::sim()) {
            Err(ConfigError::Range { key, .. }) => assert_eq!(key, wanted_key),
            other => panic!("{wanted_key}: {other:?}"),
        }
    }

    #[test]
    fn the_defaults_fit_both_profiles() {
        for profile in [Profile::sim(), Profile::turtlebot2()] {
            assert!(FilterConfig::for_profile(&profile).checked(&profile).is_ok());
        }
    }

    #[test]
    fn a_number_out_of_range_is_named() {
        check(FilterConfig { step_s: f64::NAN, ..base() }, "step_s");
        check(FilterConfig { step_s: 0.17, ..base() }, "step_s");
        check(FilterConfig { gamma_per_s: 20.1, ..base() }, "gamma_per_s");
        check(FilterConfig { n_steps: 0, ..base() }, "n_steps");
        check(FilterConfig { epsilon_m: -0.01, ..base() }, "epsilon_m");
        let disturbance = Disturbance { delay_s: f64::INFINITY, ..base().disturbance };
        check(FilterConfig { disturbance, ..base() }, "disturbance.delay_s");
    }

    #[test]
    fn a_horizon_too_short_to_brake_within_needs_the_tail() {
        // Braking from 1.5 m/s at 3 m/s² takes ten steps, after the one under way.
        let short = FilterConfig { n_steps: 10, braking_tail: false, ..base() };
        let wanted = ConfigError::CannotBrake { n_steps: 10, needed: 11 };
        assert_eq!(short.clone().checked(&Profile::sim()), Err(wanted));
        assert!(FilterConfig { n_steps: 11, ..short.clone() }.checked(&Profile::sim()).is_ok());
        assert!(FilterConfig { braking_tail: true, ..short }.checked(&Profile::sim()).is_ok());
    }
}
