//! Poses in the plane and in space.

use std::ops::Mul;

use crate::angle::wrapped;

/// A point in the plane, metres. Its name says in which frame.
pub type Point2 = nalgebra::Point2<f64>;
/// A point in space, metres. Its name says in which frame.
pub type Point3 = nalgebra::Point3<f64>;
/// A rigid pose in space: `a_from_b` maps coordinates in `b` to coordinates in `a`.
pub type Pose3 = nalgebra::Isometry3<f64>;

/// A rigid pose in the plane: `a_from_b` maps coordinates in `b` to coordinates in `a`.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Pose2 {
    /// Position along x, metres.
    pub x_m: f64,
    /// Position along y, metres.
    pub y_m: f64,
    /// Heading, radians, counter-clockwise from +x.
    pub yaw_rad: f64,
}

impl Pose2 {
    /// The pose that changes nothing.
    pub const IDENTITY: Pose2 = Pose2 { x_m: 0.0, y_m: 0.0, yaw_rad: 0.0 };

    /// A pose from its parts; the heading is wrapped into (−π, π].
    #[must_use]
    pub fn new(x_m: f64, y_m: f64, yaw_rad: f64) -> Self {
        Pose2 { x_m, y_m, yaw_rad: wrapped(yaw_rad) }
    }

    /// The origin of the inner frame, in the outer one.
    #[must_use]
    pub fn position(&self) -> Point2 {
        Point2::new(self.x_m, self.y_m)
    }

    /// `b_from_a` for this `a_from_b`.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let (sin, cos) = self.yaw_rad.sin_cos();
        Pose2::new(-(cos * self.x_m + sin * self.y_m), sin * self.x_m - cos * self.y_m, -self.yaw_rad)
    }

    /// The same point, told in the outer frame.
    #[must_use]
    pub fn transform(&self, point: Point2) -> Point2 {
        let (sin, cos) = self.yaw_rad.sin_cos();
        Point2::new(self.x_m + cos * point.x - sin * point.y, self.y_m + sin * point.x + cos * point.y)
    }

    /// The pose that lies this share of the way to another one, 0 here and 1 there: straight, turning the shorter way.
    #[must_use]
    pub fn towards(&self, other: &Pose2, share: f64) -> Self {
        Pose2::new(
            self.x_m + share * (other.x_m - self.x_m),
            self.y_m + share * (other.y_m - self.y_m),
            self.yaw_rad + share * wrapped(other.yaw_rad - self.yaw_rad),
        )
    }

    /// The pose reached by an exact arc: `twist` held for `seconds`, starting here.
    #[must_use]
    pub fn along_arc(&self, speed_m_s: f64, yaw_rate_rad_s: f64, seconds: f64) -> Self {
        let turn_rad = yaw_rate_rad_s * seconds;
        // sin(x)/x and (1 − cos x)/x by series near zero: the quotient loses all digits there.
        let (along, aside) = if turn_rad.abs() < 1e-4 {
            (1.0 - turn_rad * turn_rad / 6.0, turn_rad / 2.0)
        } else {
            (turn_rad.sin() / turn_rad, (1.0 - turn_rad.cos()) / turn_rad)
        };
        let length_m = speed_m_s * seconds;
        *self * Pose2::new(length_m * along, length_m * aside, turn_rad)
    }

    /// This pose in space, at height `z_m`, level.
    #[must_use]
    pub fn lifted(&self, z_m: f64) -> Pose3 {
        Pose3::new(nalgebra::Vector3::new(self.x_m, self.y_m, z_m), nalgebra::Vector3::z() * self.yaw_rad)
    }

    /// True when no part is NaN or infinite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.x_m.is_finite() && self.y_m.is_finite() && self.yaw_rad.is_finite()
    }
}

impl Mul for Pose2 {
    type Output = Pose2;

    /// `a_from_c = a_from_b * b_from_c`.
    #[allow(clippy::suspicious_arithmetic_impl, reason = "turns add up when poses are composed")]
    fn mul(self, b_from_c: Pose2) -> Pose2 {
        let p = self.transform(b_from_c.position());
        Pose2::new(p.x, p.y, self.yaw_rad + b_from_c.yaw_rad)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn close(a: Pose2, b: Pose2) -> bool {
        (a.x_m - b.x_m).abs() < 1e-9
            && (a.y_m - b.y_m).abs() < 1e-9
            && wrapped(a.yaw_rad - b.yaw_rad).abs() < 1e-9
    }

    fn any_pose() -> impl Strategy<Value = Pose2> {
        (-50.0..50.0, -50.0..50.0, -3.1..3.1).prop_map(|(x, y, yaw)| Pose2::new(x, y, yaw))
    }

    proptest! {
        #[test]
        fn composition_with_the_inverse_is_identity(a in any_pose()) {
            prop_assert!(close(a * a.inverse(), Pose2::IDENTITY));
            prop_assert!(close(a.inverse() * a, Pose2::IDENTITY));
        }

        #[test]
        fn composition_is_associative(a in any_pose(), b in any_pose(), c in any_pose()) {
            prop_assert!(close((a * b) * c, a * (b * c)));
        }

        #[test]
        fn the_way_to_another_pose_ends_there_and_turns_by_no_more_than_half_a_circle(a in any_pose(), b in any_pose()) {
            prop_assert!(close(a.towards(&b, 0.0), a) && close(a.towards(&b, 1.0), b));
            let half = a.towards(&b, 0.5);
            prop_assert!((half.position() - nalgebra::center(&a.position(), &b.position())).norm() < 1e-9);
            prop_assert!(wrapped(half.yaw_rad - a.yaw_rad).abs() <= std::f64::consts::FRAC_PI_2 + 1e-9);
        }

        #[test]
        fn two_half_arcs_are_one_arc(a in any_pose(), v in -2.0..2.0, w in -3.0..3.0, t in 0.0..2.0) {
            let halves = a.along_arc(v, w, t / 2.0).along_arc(v, w, t / 2.0);
            prop_assert!(close(a.along_arc(v, w, t), halves));
        }

        #[test]
        fn lifting_agrees_with_the_plane(a in any_pose(), x in -5.0..5.0, y in -5.0..5.0) {
            let flat = a.transform(Point2::new(x, y));
            let tall = a.lifted(0.3) * Point3::new(x, y, 0.0);
            prop_assert!((flat.x - tall.x).abs() < 1e-9 && (flat.y - tall.y).abs() < 1e-9);
            prop_assert!((tall.z - 0.3).abs() < 1e-12);
        }
    }
}
