//! Where the wheels say the base was at a given moment: a short, bounded memory of odometry, by stamp.
//!
//! Scans and frames carry the stamp of when they were taken, and a moving robot is elsewhere by the time they
//! arrive. Between two samples the pose is interpolated; across a gap it is not guessed. All stamps are of
//! the robot's own clock and are compared with each other only.

use std::collections::VecDeque;
use std::time::Duration;

use geometry::Pose2;
use proto::Odometry;

/// Most samples kept: ten seconds at 50 Hz.
const N_SAMPLES_MAX: usize = 500;
/// So many samples in a row that look old mean that the publisher's clock and count began anew.
const N_STALE_MAX: u32 = 5;

/// What one odometry message did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heard {
    /// It goes on from the last one.
    Continued,
    /// The base has begun anew: its `odom` frame is another one, and what was kept is forgotten.
    Restarted,
    /// It is a late or repeated one.
    Ignored,
}

/// Why there is no pose for a moment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NoPose {
    /// Odometry has not got there yet.
    NotYet,
    /// It never will: the moment lies before the memory, or in a gap. In words.
    Never(String),
}

/// The recent odometry.
#[derive(Clone, Debug)]
pub struct OdometryTrack {
    gap_max: Duration,
    samples: VecDeque<(u64, Pose2)>,
    seq: u64,
    n_stale: u32,
    run: u32,
}

impl OdometryTrack {
    /// An empty track that interpolates over at most `gap_max`.
    #[must_use]
    pub fn new(gap_max: Duration) -> Self {
        OdometryTrack { gap_max, samples: VecDeque::new(), seq: 0, n_stale: 0, run: 0 }
    }

    /// Sequence number of the odometry last heard; 0 when none was.
    #[must_use]
    pub fn seq(&self) -> u64 {
        self.seq
    }

    /// Counts restarts of the base: poses in `odom` of another run are in another frame.
    #[must_use]
    pub fn run(&self) -> u32 {
        self.run
    }

    /// Stamp of the newest sample.
    #[must_use]
    pub fn newest_ns(&self) -> Option<u64> {
        self.samples.back().map(|(stamp_ns, _)| *stamp_ns)
    }

    /// Takes in one message.
    pub fn push(&mut self, odometry: &Odometry) -> Heard {
        let header = odometry.header;
        let newest_ns = self.newest_ns();
        let is_later = newest_ns.is_none_or(|newest_ns| header.stamp_ns > newest_ns);
        let heard = match (header.seq > self.seq, is_later) {
            (true, true) => Heard::Continued,
            // The count goes on and the clock was set back: same frame, but old stamps mean nothing now.
            (true, false) => {
                self.samples.clear();
                Heard::Continued
            }
            (false, true) => Heard::Restarted,
            (false, false) => {
                self.n_stale += 1;
                if self.n_stale < N_STALE_MAX {
                    return Heard::Ignored;
                }
                Heard::Restarted
            }
        };
        if heard == Heard::Restarted {
            self.samples.clear();
            self.run = self.run.wrapping_add(1);
        }
        self.n_stale = 0;
        self.seq = header.seq;
        if self.samples.len() == N_SAMPLES_MAX {
            self.samples.pop_front();
        }
        self.samples.push_back((header.stamp_ns, odometry.odom_from_base));
        heard
    }

    /// `odom_from_base` at a moment.
    ///
    /// # Errors
    /// [`NoPose`] when odometry is not there yet, or never will be.
    pub fn at(&self, stamp_ns: u64) -> Result<Pose2, NoPose> {
        let after = self.samples.partition_point(|(sample_ns, _)| *sample_ns < stamp_ns);
        let Some(&(later_ns, later)) = self.samples.get(after) else { return Err(NoPose::NotYet) };
        if later_ns == stamp_ns {
            return Ok(later);
        }
        let Some(&(earlier_ns, earlier)) = after.checked_sub(1).and_then(|idx| self.samples.get(idx)) else {
            let early_ms = (later_ns - stamp_ns) / 1_000_000;
            return Err(NoPose::Never(format!("odometry begins {early_ms} ms later")));
        };
        let gap = Duration::from_nanos(later_ns - earlier_ns);
        if gap > self.gap_max {
            let (gap_ms, limit_ms) = (gap.as_millis(), self.gap_max.as_millis());
            return Err(NoPose::Never(format!("odometry has a gap of {gap_ms} ms, at most {limit_ms}")));
        }
        let share = (stamp_ns - earlier_ns) as f64 / (later_ns - earlier_ns) as f64;
        Ok(earlier.towards(&later, share))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::Twist;
    use proptest::prelude::*;
    use proto::Header;

    fn odometry(seq: u64, stamp_ms: u64, odom_from_base: Pose2) -> Odometry {
        let header = Header { seq, stamp_ns: stamp_ms * 1_000_000, echo: 0 };
        Odometry { header, odom_from_base, twist: Twist::default(), fault: None }
    }

    fn track(samples: &[(u64, u64, Pose2)]) -> OdometryTrack {
        let mut track = OdometryTrack::new(Duration::from_millis(100));
        for &(seq, stamp_ms, pose) in samples {
            track.push(&odometry(seq, stamp_ms, pose));
        }
        track
    }

    proptest! {
        #[test]
        fn along_a_straight_line_the_pose_is_exact(stamp_ms in 1000..1900_u64, v in -1.5..1.5) {
            let at = |ms: u64| Pose2::new(v * ms as f64 / 1000.0, 0.0, 0.0);
            let samples: Vec<_> = (0..50).map(|k| (k + 1, 1000 + 20 * k, at(1000 + 20 * k))).collect();
            let pose = track(&samples).at(stamp_ms * 1_000_000).unwrap();
            prop_assert!((pose.x_m - at(stamp_ms).x_m).abs() < 1e-9);
        }
    }

    #[test]
    fn a_turn_is_interpolated_the_short_way() {
        let turn = track(&[(1, 0, Pose2::new(0.0, 0.0, 3.1)), (2, 50, Pose2::new(0.0, 0.0, -3.1))]);
        let yaw_rad = turn.at(25_000_000).unwrap().yaw_rad;
        assert!(yaw_rad.abs() > 3.13, "{yaw_rad}");
    }

    #[test]
    fn a_gap_is_not_guessed_across() {
        let gap = track(&[(1, 0, Pose2::IDENTITY), (2, 101, Pose2::IDENTITY), (3, 200, Pose2::IDENTITY)]);
        assert!(matches!(gap.at(50_000_000), Err(NoPose::Never(words)) if words.contains("101 ms")));
        assert!(gap.at(150_000_000).is_ok());
        assert_eq!(gap.at(200_000_001), Err(NoPose::NotYet));
        assert_eq!(OdometryTrack::new(Duration::from_millis(100)).at(0), Err(NoPose::NotYet));
        let late = track(&[(1, 100, Pose2::IDENTITY)]);
        assert!(matches!(late.at(50_000_000), Err(NoPose::Never(_))));
    }

    #[test]
    fn a_restarted_base_is_told_from_a_late_message() {
        let mut track = track(&[(7, 100, Pose2::IDENTITY), (8, 120, Pose2::IDENTITY)]);
        assert_eq!(track.push(&odometry(7, 100, Pose2::IDENTITY)), Heard::Ignored);
        assert_eq!((track.run(), track.seq()), (0, 8));
        assert_eq!(track.push(&odometry(1, 140, Pose2::IDENTITY)), Heard::Restarted);
        assert_eq!((track.run(), track.seq()), (1, 1));
        assert!(track.at(110_000_000).is_err());
    }

    #[test]
    fn a_clock_that_was_set_back_does_not_silence_odometry() {
        let mut track = track(&[(7, 100_000, Pose2::IDENTITY)]);
        assert_eq!(track.push(&odometry(8, 50, Pose2::IDENTITY)), Heard::Continued);
        assert_eq!(track.newest_ns(), Some(50_000_000));
        // Both count and clock begin anew.
        let heard: Vec<_> = (1..=5).map(|k| track.push(&odometry(k, k, Pose2::IDENTITY))).collect();
        assert_eq!(heard.last(), Some(&Heard::Restarted));
        assert_eq!(track.run(), 1);
    }

    #[test]
    fn the_memory_is_bounded() {
        let samples: Vec<_> = (1..2000).map(|k| (k, 20 * k, Pose2::IDENTITY)).collect();
        assert_eq!(track(&samples).samples.len(), N_SAMPLES_MAX);
    }
}
