//! Where the robot is and was: odometry of the last seconds, what was heard when, and the laser's hits.
//!
//! Stamps of one robot are compared with each other only, to carry poses to the right moment and to make
//! data *older* than its receipt says; never to prove it fresh.

use std::collections::VecDeque;
use std::time::Duration;

use geometry::profile::LidarMount;
use geometry::{Point2, Pose2, Time};
use proto::{Invalid, Odometry, Scan};

use crate::heard::{Heard, Order, Thread};

/// Odometry messages kept: ten seconds at 100 Hz, longer than any echo may be old.
const N_KEPT: usize = 1024;
/// Odometry that others may have heard before this process did.
const N_AHEAD_MAX: u64 = 16;
/// Age of a thought whose odometry nobody remembers: older than any limit.
const UNKNOWN_AGE: Duration = Duration::from_secs(60);
/// Farthest time over which odometry is carried beyond what was heard, seconds.
const EXTRAPOLATED_S_MAX: f64 = 0.1;

/// One odometry message.
#[derive(Clone, Debug)]
struct Moment {
    at: Time,
    odometry: Odometry,
}

/// The odometry of the last seconds, oldest first; one run of the robot only.
#[derive(Debug, Default)]
pub(crate) struct Motion {
    thread: Thread,
    moments: VecDeque<Moment>,
}

impl Motion {
    /// Takes odometry in. After [`Order::NewRun`] the odometry frame may be another one.
    pub(crate) fn take(&mut self, heard: Heard<Odometry>) -> Order {
        let order = self.thread.follow(heard.message.header, heard.at);
        match order {
            Order::Old => return order,
            Order::NewRun => self.moments.clear(),
            Order::Next => {}
        }
        if self.moments.len() == N_KEPT {
            self.moments.pop_front();
        }
        self.moments.push_back(Moment { at: heard.at, odometry: heard.message });
        order
    }

    /// The newest odometry, and when it came.
    pub(crate) fn newest(&self) -> Option<(&Odometry, Time)> {
        self.moments.back().map(|moment| (&moment.odometry, moment.at))
    }

    /// Stamp of the oldest odometry of this run that is kept.
    pub(crate) fn oldest_stamp_ns(&self) -> Option<u64> {
        self.moments.front().map(|moment| moment.odometry.header.stamp_ns)
    }

    /// How long ago the odometry that an echo names came; `None` when it names none.
    ///
    /// Odometry that is not remembered, of another run say, is as old as can be.
    pub(crate) fn age_of_echo(&self, echo: u64, now: Time) -> Option<Duration> {
        if echo == 0 {
            return None;
        }
        let newest = self.moments.back().map_or(0, |moment| moment.odometry.header.seq);
        if echo > newest {
            return Some(if echo - newest <= N_AHEAD_MAX { Duration::ZERO } else { UNKNOWN_AGE });
        }
        let found = self.moments.binary_search_by_key(&echo, |moment| moment.odometry.header.seq);
        let moment = found.ok().and_then(|idx| self.moments.get(idx));
        Some(moment.map_or(UNKNOWN_AGE, |moment| now.since(moment.at)))
    }

    /// How old something stamped by the robot's clock is: at least this, whenever it came.
    pub(crate) fn age_by_stamp(&self, stamp_ns: u64, now: Time) -> Duration {
        let Some((odometry, at)) = self.newest() else { return Duration::ZERO };
        let behind = Duration::from_nanos(odometry.header.stamp_ns.saturating_sub(stamp_ns));
        if behind.is_zero() { Duration::ZERO } else { now.since(at) + behind }
    }

    /// The base in `odom` at a moment by the robot's clock; `None` when it was not heard then.
    pub(crate) fn odom_from_base_at(&self, stamp_ns: u64) -> Option<Pose2> {
        let after = self.moments.partition_point(|moment| moment.odometry.header.stamp_ns < stamp_ns);
        let next = self.moments.get(after).map(|moment| &moment.odometry);
        let last = after.checked_sub(1).and_then(|idx| self.moments.get(idx)).map(|moment| &moment.odometry);
        let seconds = |from_ns: u64, to_ns: u64| (to_ns as f64 - from_ns as f64) * 1e-9;
        match (last, next) {
            (Some(last), Some(next)) => {
                let span_s = seconds(last.header.stamp_ns, next.header.stamp_ns);
                let share = seconds(last.header.stamp_ns, stamp_ns) / span_s.max(1e-9);
                Some(between(last.odom_from_base, next.odom_from_base, share))
            }
            (Some(only), None) | (None, Some(only)) => {
                let beyond_s = seconds(only.header.stamp_ns, stamp_ns);
                (beyond_s.abs() <= EXTRAPOLATED_S_MAX).then(|| carried(only, beyond_s))
            }
            (None, None) => None,
        }
    }

    /// The base in `odom` now, carried on from the newest odometry with its own motion.
    pub(crate) fn odom_from_base_now(&self, now: Time) -> Option<Pose2> {
        let (odometry, at) = self.newest()?;
        Some(carried(odometry, now.since(at).as_secs_f64().min(EXTRAPOLATED_S_MAX)))
    }

    /// The hits of a turn of the LiDAR, in `odom`, each from where the robot was when its beam came back.
    ///
    /// # Errors
    /// [`Invalid`] when no beam measured anything, or the robot's place at that time is not known.
    pub(crate) fn hits_odom(&self, scan: &Scan, lidar: &LidarMount) -> Result<Vec<Point2>, Invalid> {
        if scan.ranges_m.iter().all(|range_m| range_m.is_nan()) {
            return Err(Invalid::new("ranges_m", "NaN throughout", "measured, one at least"));
        }
        let start_ns = scan.header.stamp_ns;
        let end_ns = start_ns.saturating_add(Duration::from_secs_f64(scan.duration_s).as_nanos() as u64);
        let (Some(start), Some(end)) = (self.odom_from_base_at(start_ns), self.odom_from_base_at(end_ns))
        else {
            return Err(Invalid::new("stamp_ns", start_ns, "within the odometry that was heard"));
        };
        let base_from_lidar = Pose2::new(lidar.x_m, lidar.y_m, lidar.yaw_rad);
        let n_steps = scan.ranges_m.len().saturating_sub(1).max(1) as f64;
        let hit = |(beam, range_m): (usize, &f32)| {
            let range_m = f64::from(*range_m);
            if !(scan.range_m_min..=scan.range_m_max).contains(&range_m) {
                return None;
            }
            let odom_from_lidar = between(start, end, beam as f64 / n_steps) * base_from_lidar;
            let (sin, cos) = (scan.angle_min_rad + beam as f64 * scan.angle_step_rad).sin_cos();
            Some(odom_from_lidar.transform(Point2::new(range_m * cos, range_m * sin)))
        };
        Ok(scan.ranges_m.iter().enumerate().filter_map(hit).collect())
    }
}

/// A pose on the way from one to another, the short way round.
fn between(from: Pose2, to: Pose2, share: f64) -> Pose2 {
    let step = from.inverse() * to;
    from * Pose2::new(step.x_m * share, step.y_m * share, step.yaw_rad * share)
}

fn carried(odometry: &Odometry, seconds: f64) -> Pose2 {
    odometry.odom_from_base.along_arc(odometry.twist.speed_m_s, odometry.twist.yaw_rate_rad_s, seconds)
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::{Profile, Twist};
    use proto::Header;

    fn driving(n: u64) -> Motion {
        let mut motion = Motion::default();
        for i in 0..n {
            let message = Odometry {
                header: Header { seq: i + 1, stamp_ns: i * 20_000_000, echo: 0 },
                odom_from_base: Pose2::new(i as f64 * 0.02, 0.0, 0.0),
                twist: Twist::new(1.0, 0.0),
                fault: None,
            };
            motion.take(Heard { message, at: Time::from_nanos(i * 20_000_000 + 5_000_000), wall_ns: 0 });
        }
        motion
    }

    fn scan(stamp_ns: u64, duration_s: f64, ranges_m: Vec<f32>) -> Scan {
        Scan {
            header: Header { seq: 1, stamp_ns, echo: 0 },
            angle_min_rad: 0.0,
            angle_step_rad: 0.1,
            duration_s,
            range_m_min: 0.1,
            range_m_max: 10.0,
            ranges_m,
        }
    }

    #[test]
    fn the_pose_at_a_stamp_lies_between_what_was_heard_and_not_far_beyond() {
        let motion = driving(11);
        let x_at = |ms: u64| motion.odom_from_base_at(ms * 1_000_000).map(|pose| pose.x_m);
        assert!((x_at(50).unwrap() - 0.05).abs() < 1e-9);
        assert!((x_at(300).unwrap() - 0.3).abs() < 1e-9);
        assert_eq!(x_at(301), None);
    }

    #[test]
    fn each_beam_starts_where_the_robot_was_when_it_came_back() {
        let hits = driving(11).hits_odom(&scan(0, 0.1, vec![1.0; 2]), &Profile::sim().lidar).unwrap();
        assert!((hits[0] - Point2::new(1.0, 0.0)).norm() < 1e-9);
        assert!((hits[1] - Point2::new(0.1 + 0.1_f64.cos(), 0.1_f64.sin())).norm() < 1e-9);
    }

    #[test]
    fn a_blind_scan_is_no_scan_and_an_empty_room_is_one() {
        let lidar = Profile::sim().lidar;
        assert!(driving(11).hits_odom(&scan(0, 0.1, vec![f32::NAN; 9]), &lidar).is_err());
        assert_eq!(driving(11).hits_odom(&scan(0, 0.1, vec![f32::INFINITY; 9]), &lidar), Ok(vec![]));
        assert!(driving(11).hits_odom(&scan(9_000_000_000, 0.1, vec![1.0; 9]), &lidar).is_err());
    }

    #[test]
    fn a_stamp_makes_data_older_and_never_newer() {
        let motion = driving(11);
        let now = Time::from_nanos(225_000_000);
        assert_eq!(motion.age_by_stamp(0, now), Duration::from_millis(220));
        assert_eq!(motion.age_by_stamp(900_000_000, now), Duration::ZERO);
        assert_eq!(motion.age_of_echo(11, now), Some(Duration::from_millis(20)));
        assert_eq!(motion.age_of_echo(0, now), None);
        assert_eq!(motion.age_of_echo(27, now), Some(Duration::ZERO));
        assert_eq!(motion.age_of_echo(28, now), Some(UNKNOWN_AGE));
    }
}
