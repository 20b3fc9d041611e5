//! What can be told to the mapping.

use geometry::Pose2;

use super::motion::MotionConfig;
use crate::base_map::BaseMapConfig;

/// How a map is made of scans.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlamConfig {
    /// Where the LiDAR sits.
    pub base_from_lidar: Pose2,
    /// Side of a cell that scans are matched in, metres.
    pub cell_m: f64,
    /// Returns are matched up to this range, metres.
    pub range_used_m: f64,
    /// A scan is put into the map after this way, metres, ...
    pub keyframe_shift_m: f64,
    /// ... or after this turn, radians.
    pub keyframe_turn_rad: f64,
    /// A new sub-map begins after this way, metres; each lasts twice as long.
    pub submap_length_m: f64,
    /// How motion is foreseen.
    pub motion: MotionConfig,
    /// How the base map is drawn.
    pub base_map: BaseMapConfig,
    /// Radius of the robot, metres: where it starts, nothing else can be, and no beam will ever show it.
    pub radius_m: f64,
}

impl Default for SlamConfig {
    fn default() -> Self {
        SlamConfig {
            base_from_lidar: Pose2::IDENTITY,
            cell_m: 0.05,
            range_used_m: 30.0,
            keyframe_shift_m: 0.2,
            keyframe_turn_rad: 0.15,
            submap_length_m: 5.0,
            motion: MotionConfig::default(),
            base_map: BaseMapConfig::default(),
            radius_m: 0.0,
        }
    }
}
