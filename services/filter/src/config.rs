//! `[filter]`: how the command is chosen, how often, and against which errors it is made safe.

use control::{ConfigError, Disturbance, FilterConfig, Method};
use geometry::Profile;
use proto::codec::within;
use proto::{Invalid, topics};
use serde::{Deserialize, Serialize};
use service::realtime::PRIORITY_MAX;

/// Which control is chosen once the safety score is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MethodName {
    /// The certified control closest to the nominal one whose score does not fall too fast.
    SmoothBlending,
    /// The nominal control while its score stays above ε, else the safest control.
    LeastRestrictive,
    /// The paper's least-restrictive filter as printed, without certificate: for comparison only.
    PaperLiteral,
    /// The paper's smooth-blending filter as printed, without certificate: for comparison only.
    PaperLiteralBlending,
}

/// How far reality may differ from the model.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DisturbanceSettings {
    /// Largest error of the position, metres.
    pub position_m: f64,
    /// Largest error of the heading, radians.
    pub yaw_rad: f64,
    /// Largest error of the speed while moving, m/s.
    pub speed_m_s: f64,
    /// Largest time by which commands act later than the latency says, seconds.
    pub delay_s: f64,
}

/// The section `[filter]`. What has no default is a matter of safety and must be written down.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FilterSettings {
    /// How the control is chosen.
    pub method: MethodName,
    /// Ticks, and so commands, per second.
    pub rate_hz: f64,
    /// Control sequences sampled in each round, the paper's N.
    pub n_samples: usize,
    /// Rounds of refinement, the paper's R.
    pub n_rounds: usize,
    /// Steps before the braking tail, the paper's H.
    pub n_steps: usize,
    /// Length of a step, seconds, the paper's Δ.
    pub step_s: f64,
    /// How fast the score may fall while blending, 1/s, the paper's γ.
    pub gamma_per_s: f64,
    /// Margin beyond the hull that the least-restrictive filter keeps, metres.
    pub epsilon_m: f64,
    /// Seed of the sampled controls.
    pub seed: u64,
    /// Priority of the thread that ticks, under `SCHED_FIFO`, 1 to 99; 0 is the usual scheduling.
    #[serde(default)]
    pub realtime_priority: u8,
    /// The tube around every plan.
    pub disturbance: DisturbanceSettings,
    /// Spread of the sampled turn rates, rad/s; half the profile's limit when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma_yaw_rate_rad_s: Option<f64>,
    /// Spread of the sampled accelerations, m/s²; half the profile's limit when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma_accel_m_s2: Option<f64>,
    /// A control that keeps this much margin passes unchanged, metres; 1 m when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ample_m: Option<f64>,
    /// Time from a command to its effect, seconds; the profile's actuation delay when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub latency_s: Option<f64>,
    /// Speed at which scan hits that are on no map may come closer, m/s; none when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub closing_speed_m_s: Option<f64>,
    /// Turns of the LiDAR per second; the topic table's when absent. A slower LiDAR may be older.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scan_rate_hz: Option<f64>,
}

impl FilterSettings {
    /// The settings that suit a robot: the paper's N, R, H and Δ, 20 Hz, smooth blending.
    #[must_use]
    pub fn for_profile(profile: &Profile) -> Self {
        let config = FilterConfig::for_profile(profile);
        let Disturbance { position_m, yaw_rad, speed_m_s, delay_s } = config.disturbance;
        FilterSettings {
            method: MethodName::SmoothBlending,
            rate_hz: topics::SAFE.rate_hz,
            n_samples: config.n_samples,
            n_rounds: config.n_rounds,
            n_steps: config.n_steps,
            step_s: config.step_s,
            gamma_per_s: config.gamma_per_s,
            epsilon_m: config.epsilon_m,
            seed: config.seed,
            realtime_priority: 0,
            disturbance: DisturbanceSettings { position_m, yaw_rad, speed_m_s, delay_s },
            sigma_yaw_rate_rad_s: None,
            sigma_accel_m_s2: None,
            ample_m: None,
            latency_s: None,
            closing_speed_m_s: None,
            scan_rate_hz: None,
        }
    }

    /// The configuration of the kernel.
    #[must_use]
    pub fn filter_config(&self, profile: &Profile) -> FilterConfig {
        let base = FilterConfig::for_profile(profile);
        let DisturbanceSettings { position_m, yaw_rad, speed_m_s, delay_s } = self.disturbance;
        FilterConfig {
            method: match self.method {
                MethodName::SmoothBlending => Method::SmoothBlending,
                MethodName::LeastRestrictive => Method::LeastRestrictive,
                MethodName::PaperLiteral => Method::PaperLiteral,
                MethodName::PaperLiteralBlending => Method::PaperLiteralBlending,
            },
            n_samples: self.n_samples,
            n_rounds: self.n_rounds,
            n_steps: self.n_steps,
            step_s: self.step_s,
            gamma_per_s: self.gamma_per_s,
            epsilon_m: self.epsilon_m,
            seed: self.seed,
            disturbance: Disturbance { position_m, yaw_rad, speed_m_s, delay_s },
            sigma_yaw_rate_rad_s: self.sigma_yaw_rate_rad_s.unwrap_or(base.sigma_yaw_rate_rad_s),
            sigma_accel_m_s2: self.sigma_accel_m_s2.unwrap_or(base.sigma_accel_m_s2),
            ample_m: self.ample_m.unwrap_or(base.ample_m),
            latency_s: self.latency_s.unwrap_or(base.latency_s),
            closing_speed_m_s: self.closing_speed_m_s.unwrap_or(base.closing_speed_m_s),
            ..base
        }
    }
}

impl service::Settings for FilterSettings {
    const SECTION: &'static str = "filter";

    fn check(&self, profile: &Profile) -> Result<(), Invalid> {
        // A command must come at least twice within its own age limit at the robot.
        within("rate_hz", self.rate_hz, topics::SAFE.rate_hz, 200.0)?;
        within("realtime_priority", f64::from(self.realtime_priority), 0.0, f64::from(PRIORITY_MAX))?;
        if let Some(rate_hz) = self.scan_rate_hz {
            within("scan_rate_hz", rate_hz, 2.0, 100.0)?;
        }
        self.filter_config(profile).checked(profile).map(|_| ()).map_err(|e| match e {
            ConfigError::Range { key, value, low, high } => {
                Invalid::new(key, value, format_args!("{low} to {high}"))
            }
            ConfigError::CannotBrake { n_steps, needed } => {
                Invalid::new("n_steps", n_steps, format_args!("at least {needed} to brake within"))
            }
        })?;
        // A base that jumps to its set-point is ahead of the plan by half a step; by a whole one when it is
        // given the speed of a step later at every one of several ticks a step (see `control::certificate`).
        let ticks_per_step = self.rate_hz * self.step_s;
        let ahead_s = if ticks_per_step > 1.0 + 1e-9 { self.step_s } else { self.step_s / 2.0 };
        within("disturbance.delay_s", self.disturbance.delay_s, ahead_s, 0.5)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use service::Settings;

    #[track_caller]
    fn check(change: impl Fn(&mut FilterSettings), wanted_key: &str, wanted_value: &str) {
        let mut settings = FilterSettings::for_profile(&Profile::sim());
        change(&mut settings);
        let refused = settings.check(&Profile::sim()).unwrap_err();
        assert_eq!((refused.field, refused.value.as_str()), (wanted_key, wanted_value));
        assert!(!refused.limit.is_empty());
    }

    #[test]
    fn the_suggested_settings_are_good_for_both_profiles() {
        for profile in [Profile::sim(), Profile::turtlebot2()] {
            assert_eq!(FilterSettings::for_profile(&profile).check(&profile), Ok(()));
        }
    }

    #[test]
    fn a_value_out_of_range_is_named_with_its_limit() {
        check(|s| s.rate_hz = 19.9, "rate_hz", "19.9");
        check(|s| s.rate_hz = f64::NAN, "rate_hz", "NaN");
        check(|s| s.realtime_priority = 100, "realtime_priority", "100");
        check(|s| s.step_s = 0.2, "step_s", "0.2");
        check(|s| s.gamma_per_s = 20.5, "gamma_per_s", "20.5");
        check(|s| s.n_steps = 0, "n_steps", "0");
        check(|s| s.disturbance.position_m = -0.01, "disturbance.position_m", "-0.01");
        check(|s| s.scan_rate_hz = Some(1.0), "scan_rate_hz", "1");
        check(|s| s.disturbance.delay_s = 0.02, "disturbance.delay_s", "0.02");
    }

    #[test]
    fn ticks_faster_than_the_step_need_a_whole_step_of_delay_allowed_for() {
        check(|s| s.rate_hz = 100.0, "disturbance.delay_s", "0.025");
        let mut fast = FilterSettings { rate_hz: 100.0, ..FilterSettings::for_profile(&Profile::sim()) };
        fast.disturbance.delay_s = fast.step_s;
        assert_eq!(fast.check(&Profile::sim()), Ok(()));
    }
}
