//! A frame as semantics keeps it: decoded, and where the base was when it was taken.

use geometry::{CameraIntrinsics, Pose2, Pose3};
use proto::RgbdFrame;

/// A colour image and its depth, with the base's pose at its own stamp.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// The camera's count.
    pub seq: u64,
    /// When it was taken, by the robot's clock.
    pub stamp_ns: u64,
    /// The pinhole of both images.
    pub intrinsics: CameraIntrinsics,
    /// Red, green, blue; `height × width × 3`.
    pub rgb: Vec<u8>,
    /// Depth along the optical axis, millimetres, 0 for none; `height × width`.
    pub depth_mm: Vec<u16>,
    /// The base in `odom`. The map frame may change while the frame is kept; this does not.
    pub odom_from_base: Pose2,
    /// Which run of the base's odometry that is.
    pub odometry_run: u32,
    /// Where the camera was on the base, if not where the profile says: in a recording from the hand.
    pub base_from_camera: Option<Pose3>,
}

impl Frame {
    /// A frame that was taken with the base at `odom_from_base`.
    #[must_use]
    pub fn new(rgbd: RgbdFrame, odom_from_base: Pose2, odometry_run: u32) -> Self {
        Frame {
            seq: rgbd.header.seq,
            stamp_ns: rgbd.header.stamp_ns,
            intrinsics: rgbd.intrinsics,
            depth_mm: rgbd.depth_mm(),
            rgb: rgbd.rgb,
            odom_from_base,
            odometry_run,
            base_from_camera: None,
        }
    }

    /// Memory that its images take.
    #[must_use]
    pub fn n_bytes(&self) -> usize {
        self.rgb.len() + 2 * self.depth_mm.len()
    }

    /// How far the base has moved and turned since another frame: metres, radians.
    #[must_use]
    pub fn moved_since(&self, other: &Frame) -> (f64, f64) {
        let between = other.odom_from_base.inverse() * self.odom_from_base;
        (between.position().coords.norm(), between.yaw_rad.abs())
    }
}
