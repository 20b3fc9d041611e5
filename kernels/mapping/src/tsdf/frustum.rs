//! What a camera can see of the grid of blocks.

use geometry::{Point3, Pose3};
use nalgebra::{Vector2, Vector3};

use super::{BLOCK_SIDE, Block, TsdfConfig};
use crate::image::DepthFrame;

/// A camera's field of view, and where it stood.
pub(super) struct Frustum {
    camera_from_map: Pose3,
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
        // As in single precision, which voxels are placed by.
        let side_m = f64::from(config.voxel_m as f32) * BLOCK_SIDE as f64;
        let planes = |focal: f64, centre: f64, n: u32| {
            // The outermost pixels reach half a pixel beyond their centres.
            let (low, high) = ((centre + 0.5) / focal, (f64::from(n) - centre) / focal);
            [Vector2::new(1.0, low).normalize(), Vector2::new(-1.0, high).normalize()]
        };
        Frustum {
            camera_from_map: frame.map_from_camera().inverse(),
            side_m,
            radius_m: config.voxel_m * BLOCK_SIDE as f64 * 3.0_f64.sqrt() / 2.0,
            across: [planes(camera.fx, camera.cx, camera.width), planes(camera.fy, camera.cy, camera.height)],
        }
    }

    /// Whether any voxel of a block may be in view: all are that are, and some blocks beside it.
    pub(super) fn sees(&self, block: &Block) -> bool {
        let middle = self.in_camera(block, 0.5);
        let is_inside = |along: f64, planes: &[Vector2<f64>; 2]| {
            planes.iter().all(|normal| normal.dot(&Vector2::new(along, middle.z)) > -self.radius_m)
        };
        middle.z >= -self.radius_m
            && is_inside(middle.x, &self.across[0])
            && is_inside(middle.y, &self.across[1])
    }

    /// A point of a block, in `camera`: its low corner and `share` of its sides.
    pub(super) fn in_camera(&self, block: &Block, share: f64) -> Point3 {
        self.camera_from_map
            * Point3::from(Vector3::from(block.key.map(|k| (f64::from(k) + share) * self.side_m)))
    }

    /// Steps of one voxel along x, y and z of `map`, in `camera`.
    pub(super) fn steps(&self, voxel_m: f64) -> [[f32; 3]; 3] {
        [Vector3::x(), Vector3::y(), Vector3::z()]
            .map(|axis: Vector3<f64>| (self.camera_from_map.rotation * axis * voxel_m).cast::<f32>().into())
    }
}
