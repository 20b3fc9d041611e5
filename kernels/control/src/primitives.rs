//! The first controls that smooth blending chooses from.
//!
//! A library only around the nominal control has no braking in it and freezes or fails next to a wall, so
//! the full range is covered by a 5 × 5 grid, beside controls that keep what they can of the nominal one.

use crate::dynamics::{Control, Limits};

/// Five shares of the full range.
const SHARES: [f64; 5] = [-1.0, -0.5, 0.0, 0.5, 1.0];

/// The primitives, closest to the nominal control first, the nominal control itself at the front.
///
/// `capped` is the nominal control held to the limits now in force, whose turn rate is the range of the grid:
/// where no more than 0.4 rad/s is allowed, half of 1 rad/s is of no use. Distance is Euclidean in (ω, a),
/// each scaled by the robot's own limit. They take the place of what is in `all`.
pub(crate) fn primitives(
    nominal: Control,
    capped: Control,
    limits: &Limits,
    in_force: &Limits,
    mut all: Vec<Control>,
) -> Vec<Control> {
    let (rate_max, accel_max) = (in_force.yaw_rate_rad_s_max, limits.accel_m_s2_max);
    let control = |yaw_rate_rad_s, accel_m_s2| Control { yaw_rate_rad_s, accel_m_s2 };
    all.clear();
    all.extend([nominal, capped]);
    for rate in SHARES {
        all.extend(SHARES.map(|accel| control(rate * rate_max, accel * accel_max)));
    }
    all.extend(SHARES.map(|accel| control(nominal.yaw_rate_rad_s, accel * accel_max)));
    all.extend(SHARES.map(|accel| control(capped.yaw_rate_rad_s, accel * accel_max)));
    all.push(control(nominal.yaw_rate_rad_s, nominal.accel_m_s2 / 2.0));
    all.push(control(nominal.yaw_rate_rad_s / 2.0, nominal.accel_m_s2));
    // Stable: of two equally close controls the earlier one stays first.
    all.sort_by(|a, b| deviation(*a, nominal, limits).total_cmp(&deviation(*b, nominal, limits)));
    all
}

/// Distance between two controls, each part scaled by its limit; 0 when equal.
#[must_use]
pub fn deviation(a: Control, b: Control, limits: &Limits) -> f64 {
    ((a.yaw_rate_rad_s - b.yaw_rate_rad_s) / limits.yaw_rate_rad_s_max)
        .hypot((a.accel_m_s2 - b.accel_m_s2) / limits.accel_m_s2_max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::Profile;

    #[test]
    fn the_nominal_control_is_first_and_full_braking_is_there() {
        let limits = Limits::of(&Profile::sim());
        let nominal = Control { yaw_rate_rad_s: 0.3, accel_m_s2: 2.0 };
        let all = primitives(nominal, nominal, &limits, &limits, Vec::new());
        assert_eq!(all[0], nominal);
        assert!(all.contains(&Control { yaw_rate_rad_s: 0.0, accel_m_s2: -3.0 }));
        assert!(
            all.windows(2)
                .all(|w| { deviation(w[0], nominal, &limits) <= deviation(w[1], nominal, &limits) })
        );
    }
}
