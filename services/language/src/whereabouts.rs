//! Where the robot stands in the map, for rules that speak of "past" and "left of".

use geometry::{Pose2, Time};
use proto::{Odometry, PoseEstimate, PoseQuality, Topic, topics};

/// The latest odometry and localisation, with the time they came.
#[derive(Clone, Debug, Default)]
pub struct Whereabouts {
    odom_from_base: Option<(Time, Pose2)>,
    map_from_odom: Option<(Time, Pose2)>,
}

impl Whereabouts {
    /// The wheels were heard.
    pub fn hear_odometry(&mut self, now: Time, odometry: &Odometry) {
        self.odom_from_base = Some((now, odometry.odom_from_base));
    }

    /// Localisation was heard; a lost pose is none, and one in doubt is as if none had come.
    pub fn hear_pose(&mut self, now: Time, estimate: &PoseEstimate) {
        self.map_from_odom = match estimate.quality {
            PoseQuality::Good => Some((now, estimate.map_from_odom)),
            PoseQuality::Uncertain => self.map_from_odom,
            PoseQuality::Lost => None,
        };
    }

    /// The robot's pose in the map as [x, y, yaw], while both parts of it are fresh.
    #[must_use]
    pub fn anchor(&self, now: Time) -> Option<[f64; 3]> {
        let map_from_odom = fresh(now, self.map_from_odom, &topics::POSE)?;
        let odom_from_base = fresh(now, self.odom_from_base, &topics::ODOMETRY)?;
        let map_from_base = map_from_odom * odom_from_base;
        map_from_base.is_finite().then_some([map_from_base.x_m, map_from_base.y_m, map_from_base.yaw_rad])
    }
}

fn fresh(now: Time, heard: Option<(Time, Pose2)>, topic: &Topic) -> Option<Pose2> {
    let (at, pose) = heard?;
    topic.age_max.is_none_or(|age_max| now.since(at) <= age_max).then_some(pose)
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::Twist;
    use proto::Header;
    use std::f64::consts::FRAC_PI_2;

    fn odometry(x_m: f64) -> Odometry {
        Odometry {
            header: Header::default(),
            odom_from_base: Pose2::new(x_m, 0.0, 0.0),
            twist: Twist::default(),
            fault: None,
        }
    }

    fn pose(quality: PoseQuality) -> PoseEstimate {
        let map_from_odom = Pose2::new(10.0, 0.0, FRAC_PI_2);
        PoseEstimate { header: Header::default(), map_epoch: 0, map_from_odom, quality }
    }

    fn ms(ms: u64) -> Time {
        Time::from_nanos(ms * 1_000_000)
    }

    #[test]
    fn the_anchor_is_the_base_in_the_map() {
        let mut whereabouts = Whereabouts::default();
        assert_eq!(whereabouts.anchor(ms(0)), None);
        whereabouts.hear_pose(ms(0), &pose(PoseQuality::Good));
        assert_eq!(whereabouts.anchor(ms(0)), None);
        whereabouts.hear_odometry(ms(10), &odometry(2.0));
        let [x_m, y_m, yaw_rad] = whereabouts.anchor(ms(10)).unwrap();
        assert!((x_m - 10.0).abs() < 1e-9 && (y_m - 2.0).abs() < 1e-9 && (yaw_rad - FRAC_PI_2).abs() < 1e-9);
    }

    #[test]
    fn a_stale_or_lost_part_is_no_anchor() {
        let mut whereabouts = Whereabouts::default();
        whereabouts.hear_pose(ms(0), &pose(PoseQuality::Good));
        whereabouts.hear_odometry(ms(0), &odometry(2.0));
        assert!(whereabouts.anchor(ms(100)).is_some());
        assert_eq!(whereabouts.anchor(ms(101)), None);
        whereabouts.hear_odometry(ms(900), &odometry(2.0));
        assert!(whereabouts.anchor(ms(900)).is_some());
        whereabouts.hear_odometry(ms(901), &odometry(2.0));
        whereabouts.hear_pose(ms(901), &pose(PoseQuality::Uncertain));
        assert_eq!(whereabouts.anchor(ms(901)), None, "doubt makes nothing fresh");
        whereabouts.hear_pose(ms(902), &pose(PoseQuality::Lost));
        assert_eq!(whereabouts.anchor(ms(902)), None);
    }
}
