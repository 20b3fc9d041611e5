//! Angles on the circle.

use std::f64::consts::{PI, TAU};

/// The same angle in (−π, π], in radians. A non-finite angle comes back as NaN.
#[must_use]
pub fn wrapped(angle_rad: f64) -> f64 {
    let turned = angle_rad.rem_euclid(TAU);
    if turned > PI { turned - TAU } else { turned }
}

/// The shortest turn that leads from `from_rad` to `to_rad`, in (−π, π].
#[must_use]
pub fn turn(from_rad: f64, to_rad: f64) -> f64 {
    wrapped(to_rad - from_rad)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn wrapping_keeps_the_direction_and_lands_in_half_open_range(a in -1e3..1e3_f64) {
            let w = wrapped(a);
            prop_assert!(w > -PI && w <= PI);
            prop_assert!((w.sin() - a.sin()).abs() < 1e-9 && (w.cos() - a.cos()).abs() < 1e-9);
        }
    }

    #[test]
    fn the_short_way_is_taken_across_the_seam() {
        assert!((turn(3.0, -3.0) - (TAU - 6.0)).abs() < 1e-12);
        assert_eq!(wrapped(PI), PI);
        assert!((wrapped(-PI) - PI).abs() < 1e-12);
    }
}
