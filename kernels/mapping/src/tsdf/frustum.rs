//! What a camera can see of the grid of blocks, and where it sees voxels.

use geometry::{Point3, Pose3};
use nalgebra::{Vector2, Vector3};

use super::{BLOCK_SIDE, BlockKey, TsdfConfig};
use crate::image::DepthFrame;

/// A camera's field of view, and where it stood.
pub(super) struct Frustum {
    camera_from_map: Pose3,
    focal: [f64; 2],
    centre: [f64; 2],
    /// Side of a block, metres.
    side_m: f64,
    /// Radius of the ball around a block, metres.
    radius_m: f64,
    /// The four side planes: unit normals into the view, by the ray's direction across (x or y) and ahead.
    across: [[Vector2<f64>; 2]; 2],
}

impl Frustum {
    pub(super) fn new(frame: &DepthFrame<'_>, config: &TsdfConfig) -> Self {
        let camera = frame.intrinsics();
        let planes = |focal: f64, centre: f64, n: u32| {
            // The outermost pixels reach half a pixel beyond their centres, and rounding no farther than one.
            let (low, high) = ((centre + 1.0) / focal, (f64::from(n) - centre) / focal);
            [Vector2::new(1.0, low).normalize(), Vector2::new(-1.0, high).normalize()]
        };
        Frustum {
            camera_from_map: frame.map_from_camera().inverse(),
            focal: [camera.fx, camera.fy],
            centre: [camera.cx, camera.cy],
            side_m: config.voxel_m * BLOCK_SIDE as f64,
            radius_m: config.voxel_m * BLOCK_SIDE as f64 * 3.0_f64.sqrt() / 2.0,
            across: [planes(camera.fx, camera.cx, camera.width), planes(camera.fy, camera.cy, camera.height)],
        }
    }

    /// Whether any voxel of a block may be in view: all are that are, and some blocks beside it.
    pub(super) fn sees(&self, key: BlockKey) -> bool {
        let middle = self.in_camera(key, 0.5);
        let is_inside = |along: f64, planes: &[Vector2<f64>; 2]| {
            planes.iter().all(|normal| normal.dot(&Vector2::new(along, middle.z)) > -self.radius_m)
        };
        middle.z >= -self.radius_m
            && is_inside(middle.x, &self.across[0])
            && is_inside(middle.y, &self.across[1])
    }

    /// A point of a block, in `camera`: its low corner and `share` of its sides.
    fn in_camera(&self, key: BlockKey, share: f64) -> Point3 {
        self.camera_from_map * Point3::from(Vector3::from(key.map(|k| (f64::from(k) + share) * self.side_m)))
    }

    /// Of a vector in `camera`: column times depth, row times depth, and depth along the optical axis. All three are
    /// linear in place; the image's are what a pinhole makes of them by one division.
    fn in_image(&self, at: Vector3<f64>) -> [f32; 3] {
        let across = |axis: usize| self.focal[axis] * at[axis] + self.centre[axis] * at.z;
        [across(0) as f32, across(1) as f32, at.z as f32]
    }

    /// A point in `map`, as [`Self::in_image`].
    pub(super) fn at(&self, point_map: &Point3) -> [f32; 3] {
        self.in_image((self.camera_from_map * point_map).coords)
    }

    /// The first voxel of a block, as [`Self::in_image`].
    pub(super) fn first(&self, key: BlockKey) -> [f32; 3] {
        self.in_image(self.in_camera(key, 0.0).coords)
    }

    /// Steps of one voxel along x, y and z of `map`, as [`Self::in_image`].
    pub(super) fn steps(&self, voxel_m: f64) -> [[f32; 3]; 3] {
        [Vector3::x(), Vector3::y(), Vector3::z()]
            .map(|axis: Vector3<f64>| self.in_image(self.camera_from_map.rotation * axis * voxel_m))
    }
}
