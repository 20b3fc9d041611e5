//! What vague words are worth in metres, and as shares of the robot's limits.

use geometry::Profile;

/// "avoid", "don't touch": just over a hull's radius, still through a 0.9 m doorway.
pub const AVOID_M: f64 = 0.3;
/// "keep away", "give it room": Hall's boundary between intimate and personal distance is 0.45 m.
pub const AWAY_M: f64 = 0.5;
/// "well away", "wide berth": Hall's boundary between personal and social distance.
pub const WIDE_M: f64 = 1.2;
/// "near", "by", "when close to": a bystander sees the robot slow down before it is there.
pub const ACTIVATION_M: f64 = 1.0;
/// "quiet near": noise carries further than sight of danger.
pub const QUIET_M: f64 = 1.5;
/// "careful near" a drop, water or fire.
pub const DROP_M: f64 = 0.5;

/// "slow": a third of the top speed, m/s.
#[must_use]
pub fn slow_m_s(profile: &Profile) -> f64 {
    floor(profile.speed_m_s_max / 3.0)
}

/// "crawl": a sixth of the top speed, never above the 0.25 m/s of ISO 10218 beside people.
#[must_use]
pub fn crawl_m_s(profile: &Profile) -> f64 {
    floor((profile.speed_m_s_max / 6.0).min(0.25))
}

/// "walking pace": 1.2 m/s, or all the robot can.
#[must_use]
pub fn walk_m_s(profile: &Profile) -> f64 {
    profile.speed_m_s_max.min(1.2)
}

/// "turn slowly": 0.4 of the largest turn rate, rad/s.
#[must_use]
pub fn turn_slow_rad_s(profile: &Profile) -> f64 {
    floor(0.4 * profile.yaw_rate_rad_s_max)
}

/// Down to a tenth of a millimetre per second, so that it is read back exactly.
#[must_use]
pub fn floor(value: f64) -> f64 {
    crate::quantity::round_safe(crate::quantity::Kind::Speed, value)
}
