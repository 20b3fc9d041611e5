//! `[navigator]`: what it plans on, how often, and how it follows.

use control::TrackerGains;
use geometry::Profile;
use proto::codec::within;
use proto::{Invalid, topics};
use serde::{Deserialize, Serialize};

/// What the planner sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Planner {
    /// Obstacles only: rules are kept by the filter alone.
    Base,
    /// Obstacles, and the regions that rules keep the robot out of.
    BaseAndRules,
}

/// How hard it turns and how it slows; the kernel's defaults suit both profiles.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GainSettings {
    /// Turn rate per heading error, 1/s.
    pub yaw_per_s: f64,
    /// Share of the line of sight's own turn that is fed forward.
    pub sight: f64,
    /// Heading error above which it turns in place, radians.
    pub turn_in_place_rad: f64,
    /// Share of the top deceleration used to slow towards the goal.
    pub braking_share: f64,
}

impl Default for GainSettings {
    fn default() -> Self {
        let TrackerGains { yaw_per_s, sight, turn_in_place_rad, braking_share, .. } = TrackerGains::default();
        GainSettings { yaw_per_s, sight, turn_in_place_rad, braking_share }
    }
}

/// The section `[navigator]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NavigatorSettings {
    /// Plans per second.
    pub plan_rate_hz: f64,
    /// Commands per second.
    pub track_rate_hz: f64,
    /// What the planner sees.
    pub planner: Planner,
    /// Distance that plans keep between hull and obstacle, metres. Below what the filter keeps, it would lead
    /// the robot where the filter does not let it through.
    pub clearance_m: f64,
    /// How it follows.
    #[serde(default)]
    pub gains: GainSettings,
}

impl Default for NavigatorSettings {
    /// The paper's rates, on the base map alone, with the clearance that planner and filter share at 5 cm.
    fn default() -> Self {
        NavigatorSettings {
            plan_rate_hz: topics::NAVIGATOR_STATUS.rate_hz,
            track_rate_hz: topics::NOMINAL.rate_hz,
            planner: Planner::Base,
            clearance_m: 0.05,
            gains: GainSettings::default(),
        }
    }
}

impl service::Settings for NavigatorSettings {
    const SECTION: &'static str = "navigator";

    fn check(&self, profile: &Profile) -> Result<(), Invalid> {
        within("plan_rate_hz", self.plan_rate_hz, 0.2, 20.0)?;
        within("track_rate_hz", self.track_rate_hz, 5.0, 200.0)?;
        within("clearance_m", self.clearance_m, 0.0, 1.0)?;
        within("gains.yaw_per_s", self.gains.yaw_per_s, 0.1, 20.0)?;
        within("gains.sight", self.gains.sight, 0.0, 2.0)?;
        within("gains.turn_in_place_rad", self.gains.turn_in_place_rad, 0.1, 1.5)?;
        within("gains.braking_share", self.gains.braking_share, 0.05, 1.0)?;
        // Nothing here depends on the robot but its speed, which the profile has checked.
        debug_assert!(profile.speed_m_s_max > 0.0);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use service::Settings;

    #[track_caller]
    fn check(change: impl Fn(&mut NavigatorSettings), wanted_key: &str) {
        let mut settings = NavigatorSettings::default();
        change(&mut settings);
        assert_eq!(settings.check(&Profile::sim()).unwrap_err().field, wanted_key);
    }

    #[test]
    fn the_suggested_settings_are_good_and_others_are_named() {
        assert_eq!(NavigatorSettings::default().check(&Profile::sim()), Ok(()));
        check(|s| s.plan_rate_hz = 0.0, "plan_rate_hz");
        check(|s| s.track_rate_hz = f64::NAN, "track_rate_hz");
        check(|s| s.clearance_m = -0.01, "clearance_m");
        check(|s| s.gains.braking_share = 1.1, "gains.braking_share");
    }
}
