//! How old each input may be, derived from the topic table; each limit is written once, there.

use std::time::Duration;

use proto::{Topic, topics};

use crate::config::FilterSettings;

/// The age limits of the filter's inputs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AgeLimits {
    /// Nominal command: older, and it ramps to zero.
    pub nominal: Duration,
    /// Base feedback: older, and zero is sent at once.
    pub odometry: Duration,
    /// Odometry as the part that carries the pose on between scans: older, and the pose is not known.
    pub pose_carried: Duration,
    /// LiDAR turn: older, and the robot stops.
    pub scan: Duration,
    /// Scan-matched pose: older, and the robot stops.
    pub pose: Duration,
    /// Semantics' beat while rules with objects are active: older, and the robot goes slowly.
    pub semantics_slow: Duration,
    /// Semantics' beat while rules with objects are active: older, and the robot stops.
    pub semantics_stop: Duration,
    /// Oldest command that the base has not taken up yet: older, and the robot stops.
    pub round_trip: Duration,
}

impl AgeLimits {
    /// The limits of the topic table, longer only where the LiDAR turns more slowly than the table says.
    #[must_use]
    pub fn of(settings: &FilterSettings) -> Self {
        // A row without a limit would be a mistake in the table: then nothing is fresh.
        let age_max = |topic: &Topic| topic.age_max.unwrap_or_default();
        let periods = |n: f64, rate_hz: f64| Duration::from_secs_f64((n / rate_hz).clamp(0.0, 60.0));
        let scan_rate_hz = settings.scan_rate_hz.unwrap_or(topics::SCAN.rate_hz);
        let scan = age_max(&topics::SCAN).max(periods(2.5, scan_rate_hz));
        let beat = &topics::SEMANTICS_BEAT;
        AgeLimits {
            nominal: age_max(&topics::NOMINAL),
            odometry: age_max(&topics::ODOMETRY),
            pose_carried: 2 * age_max(&topics::ODOMETRY),
            scan,
            pose: age_max(&topics::POSE).max(3 * scan),
            semantics_slow: age_max(beat).max(periods(3.0, beat.rate_hz)),
            semantics_stop: (3 * age_max(beat)).max(periods(6.0, beat.rate_hz)),
            // As at the robot: a command may be as old as its limit, made from odometry as old as its own.
            round_trip: age_max(&topics::SAFE) + age_max(&topics::ODOMETRY),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::Profile;

    #[test]
    fn the_limits_are_those_of_the_table_of_inputs() {
        let mut settings = FilterSettings::for_profile(&Profile::sim());
        let ms = Duration::from_millis;
        let wanted = AgeLimits {
            nominal: ms(250),
            odometry: ms(100),
            pose_carried: ms(200),
            scan: ms(300),
            pose: ms(900),
            semantics_slow: ms(1000),
            semantics_stop: ms(3000),
            round_trip: ms(250),
        };
        assert_eq!(AgeLimits::of(&settings), wanted);
        settings.scan_rate_hz = Some(5.0);
        assert_eq!(AgeLimits::of(&settings), AgeLimits { scan: ms(500), pose: ms(1500), ..wanted });
        settings.scan_rate_hz = Some(40.0);
        assert_eq!(AgeLimits::of(&settings), wanted);
    }
}
