//! What a log's odometry says of the motion between scans, and how it is made worse on purpose.

use std::str::FromStr;

use geometry::Pose2;

use super::carmen::LaserScan;

/// Odometry cannot be right beyond this between two scans, metres: the log was cut or reset.
const LEAP_MAX_M: f64 = 20.0;
/// A laser sits no farther from the middle of its robot, metres.
const MOUNT_MAX_M: f64 = 0.6;
/// The most that odometry is made to drift: percent, and degrees for each metre.
const DRIFT_MAX: [f64; 2] = [50.0, 45.0];

/// How odometry is made to drift.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Drift {
    share: f64,
    turn_rad_m: f64,
}

impl FromStr for Drift {
    type Err = String;

    fn from_str(words: &str) -> Result<Self, String> {
        let wrong = || {
            format!(
                "{words:?} is no drift: percent (at most {}) and degrees for each metre (at most {}), as `5,2`",
                DRIFT_MAX[0], DRIFT_MAX[1]
            )
        };
        let (percent, degrees) = words.split_once(',').ok_or_else(wrong)?;
        let number = |word: &str, limit: f64| {
            word.trim().parse().ok().filter(|n: &f64| n.abs() <= limit).ok_or_else(wrong)
        };
        let (percent, degrees) = (number(percent, DRIFT_MAX[0])?, number(degrees, DRIFT_MAX[1])?);
        Ok(Drift { share: percent / 100.0, turn_rad_m: degrees.to_radians() })
    }
}

impl Drift {
    /// A motion as wheels that drift tell it.
    fn of(&self, last_from_now: Pose2) -> Pose2 {
        let way_m = last_from_now.position().coords.norm();
        let scale = 1.0 + self.share;
        let yaw_rad = last_from_now.yaw_rad + self.turn_rad_m * way_m;
        Pose2::new(scale * last_from_now.x_m, scale * last_from_now.y_m, yaw_rad)
    }
}

/// The log's odometry.
#[derive(Clone, Debug, Default)]
pub(super) struct Wheels {
    drift: Drift,
    last: Option<Pose2>,
    base_from_laser: Option<Pose2>,
}

impl Wheels {
    pub(super) fn new(drift: Drift) -> Self {
        Wheels { drift, ..Wheels::default() }
    }

    /// How the laser moved since the last scan, told from where it sits on the robot; `None` at first, and
    /// where the log was cut.
    pub(super) fn since_last(&mut self, scan: &LaserScan) -> Option<Pose2> {
        let odometry = scan.odometry?;
        let base_from_laser = *self.base_from_laser.get_or_insert_with(|| mount_of(scan));
        let now = odometry * base_from_laser;
        let before = self.last.replace(now)?;
        let last_from_now = before.inverse() * now;
        let is_leap = last_from_now.position().coords.norm() > LEAP_MAX_M;
        (!is_leap).then(|| self.drift.of(last_from_now))
    }
}

/// Where the laser sits on the robot, by the two poses of a line. A corrected log holds corrected and raw poses
/// that lie far apart: then it is not told, and taken to sit in the middle.
fn mount_of(scan: &LaserScan) -> Pose2 {
    let both = scan.laser.zip(scan.odometry).map(|(laser, robot)| robot.inverse() * laser);
    let near = |mount: &Pose2| mount.position().coords.norm() < MOUNT_MAX_M && mount.yaw_rad.abs() < 1e-3;
    both.filter(near).unwrap_or(Pose2::IDENTITY)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drift_is_percent_and_degrees_and_anything_else_is_named() {
        let drift: Drift = "5,2".parse().unwrap();
        let step = drift.of(Pose2::new(2.0, 0.0, 0.1));
        assert!((step.x_m - 2.1).abs() < 1e-12 && (step.yaw_rad - 0.1 - 4.0_f64.to_radians()).abs() < 1e-12);
        assert!("-5,-2".parse::<Drift>().is_ok());
        for wrong in ["5", "5,x", "nan,2", "99,2", "5,99", ""] {
            assert!(wrong.parse::<Drift>().unwrap_err().contains("no drift"), "{wrong:?} was taken");
        }
    }

    #[test]
    fn a_cut_in_the_log_is_no_motion_and_a_scan_without_odometry_tells_none() {
        let scan = |odometry: Option<Pose2>| LaserScan {
            stamp: String::new(),
            ranges_m: vec![1.0; 3],
            angle_min_rad: 0.0,
            angle_step_rad: 0.1,
            range_max_m: 10.0,
            laser: odometry,
            odometry,
        };
        let mut wheels = Wheels::new(Drift::default());
        assert_eq!(wheels.since_last(&scan(Some(Pose2::IDENTITY))), None);
        assert_eq!(wheels.since_last(&scan(None)), None);
        assert_eq!(
            wheels.since_last(&scan(Some(Pose2::new(1.0, 0.0, 0.0)))),
            Some(Pose2::new(1.0, 0.0, 0.0))
        );
        assert_eq!(wheels.since_last(&scan(Some(Pose2::new(99.0, 0.0, 0.0)))), None);
        assert_eq!(
            wheels.since_last(&scan(Some(Pose2::new(99.5, 0.0, 0.0)))),
            Some(Pose2::new(0.5, 0.0, 0.0))
        );
    }
}
