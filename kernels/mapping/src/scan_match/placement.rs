//! A pose ready to place many points.

use geometry::Pose2;
use nalgebra::{Point2, Vector2};

/// A pose in single precision, with its sine and cosine.
#[derive(Clone, Copy)]
pub(super) struct Placement {
    shift: Vector2<f32>,
    sin: f32,
    cos: f32,
}

impl Placement {
    pub(super) fn new(pose: Pose2) -> Self {
        let (sin, cos) = pose.yaw_rad.sin_cos();
        Placement { shift: Vector2::new(pose.x_m as f32, pose.y_m as f32), sin: sin as f32, cos: cos as f32 }
    }

    #[inline]
    pub(super) fn point(&self, at: Point2<f32>) -> Point2<f32> {
        Point2::from(self.direction(at.coords) + self.shift)
    }

    #[inline]
    pub(super) fn direction(&self, v: Vector2<f32>) -> Vector2<f32> {
        Vector2::new(self.cos * v.x - self.sin * v.y, self.sin * v.x + self.cos * v.y)
    }
}

/// The largest whole number that is no larger. Where processors have no instruction for it, `floor` is a call.
#[inline]
pub(super) fn floor(value: f32) -> i32 {
    let truncated = value as i32;
    truncated.saturating_sub(i32::from(value < truncated as f32))
}

/// A sum of unit normals made unit again; zero stays zero.
pub(super) fn unit(normal: Vector2<f32>) -> Vector2<f32> {
    let norm = normal.norm();
    if norm > 1e-3 { normal / norm } else { Vector2::zeros() }
}
