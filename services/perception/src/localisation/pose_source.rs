//! Who knows where `odom` lies in `map`.
//!
//! The seam at which scan matching comes in: a source is shown each scan with the base's pose in `odom` and
//! answers with `map_from_odom`. The one source there is takes odometry at its word.

use geometry::Pose2;
use proto::PoseQuality;

/// What a source makes of one scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// `odom` in `map`.
    pub map_from_odom: Pose2,
    /// Counts changes of the map frame.
    pub map_epoch: u64,
    /// How well the pose is known.
    pub quality: PoseQuality,
}

/// A source of the pose.
#[derive(Clone, Debug)]
pub enum PoseSource {
    /// Odometry is believed; its origin lies in the map where the configuration says.
    Odometry {
        /// `odom` in `map`.
        map_from_odom: Pose2,
        /// Epoch of the map frame.
        map_epoch: u64,
    },
}

impl PoseSource {
    /// The pose that holds now.
    #[must_use]
    pub fn estimate(&self) -> Estimate {
        match *self {
            PoseSource::Odometry { map_from_odom, map_epoch } => {
                Estimate { map_from_odom, map_epoch, quality: PoseQuality::Good }
            }
        }
    }

    /// The base has begun anew, and its `odom` frame with it: nobody knows how the new one lies to the old,
    /// so what was mapped before fits no more.
    pub fn restart(&mut self) {
        match self {
            PoseSource::Odometry { map_epoch, .. } => *map_epoch += 1,
        }
    }
}
