//! The plane that a depth image shows around a pixel.
//!
//! By inverse depth, which is linear on a plane, over a span as wide as a voxel: over less, slopes are mostly the
//! noise of depth. Not here: which pixels are worth asking for (`tiles`).

use nalgebra::Vector3;

use super::tiles::Tile;
use crate::image::DepthFrame;

/// Least cosine between ray and surface normal that is believed: below it a slope is mostly noise.
const COSINE_MIN: f32 = 0.1;
/// Three inverse depths in line, times depth, may bend this much and still be one plane.
const PLANE_BEND_MAX: f32 = 0.04;
/// One step from an edge, in inverse depth times depth, may be this large and still be of the same plane: a table top
/// seen at a grazing angle.
const STEP_MAX: f32 = 0.1;

/// Finds planes in a depth image.
pub(super) struct Planes<'a> {
    depth_mm: &'a [u16],
    width: i32,
    height: i32,
    focal: [f32; 2],
    centre: [f32; 2],
    voxel_m: f32,
}

impl<'a> Planes<'a> {
    pub(super) fn new(frame: &DepthFrame<'a>, voxel_m: f64) -> Self {
        let camera = frame.intrinsics();
        Planes {
            depth_mm: frame.depth().depth_mm(),
            width: camera.width as i32,
            height: camera.height as i32,
            focal: [camera.fx as f32, camera.fy as f32],
            centre: [camera.cx as f32, camera.cy as f32],
            voxel_m: voxel_m as f32,
        }
    }

    /// The plane at the middle of a tile; `None` at something thin, where a slope would be a guess.
    pub(super) fn tile(&self, col: usize, row: usize, depth_m: f32) -> Option<Tile> {
        let (u, v) = (col as i32, row as i32);
        let [a, b] = self.slopes(u, v, depth_m)?;
        let (normal, cosine) = self.plane_of(u, v, depth_m, [a, b]);
        Some(Tile::new(normal, cosine, [1.0 / depth_m, a, b], (col, row)))
    }

    /// The plane through a pixel: its unit normal, away from the camera, and how far it is for each metre along the
    /// optical axis. With 1/z = a·u + b·v + c the plane is n·P = 1 with
    /// n = (a·fx, b·fy, a·cx + b·cy + c), and a point P = ray·z is (1 − z/depth) / |n| in front of it.
    fn plane_of(&self, u: i32, v: i32, depth_m: f32, [a, b]: [f32; 2]) -> (Vector3<f32>, f32) {
        let inverse = 1.0 / depth_m;
        let (x, y) = (u as f32 - self.centre[0], v as f32 - self.centre[1]);
        let normal = Vector3::new(a * self.focal[0], b * self.focal[1], inverse - a * x - b * y);
        let norm = normal.norm();
        (normal / norm, (inverse / norm).clamp(COSINE_MIN, 1.0))
    }

    /// Slopes of inverse depth by column and row.
    fn slopes(&self, u: i32, v: i32, depth_m: f32) -> Option<[f32; 2]> {
        // As wide as a voxel: over less, slopes are mostly the noise of depth.
        let off = ((self.focal[0] * self.voxel_m / depth_m) as i32).clamp(2, 10);
        let inverse = 1.0 / depth_m;
        let at = |u: i32, v: i32| {
            if u < 0 || v < 0 || u >= self.width || v >= self.height {
                return f32::NAN;
            }
            let mm = self.depth_mm[(v * self.width + u) as usize];
            if mm == 0 { f32::NAN } else { 1000.0 / f32::from(mm) }
        };
        let a = slope(at(u - off, v), inverse, at(u + off, v))? / off as f32;
        let b = slope(at(u, v - off), inverse, at(u, v + off))? / off as f32;
        Some([a, b])
    }
}

/// Slope of inverse depth at the middle of three pixels in line, per distance between them. Next to an edge
/// the side with the smaller step is on the same surface, if that step is small: neither side of a leg is. NaN is a
/// pixel without depth; with none on either side the surface is taken to face the camera.
fn slope(before: f32, here: f32, after: f32) -> Option<f32> {
    let (from, to) = (here - before, after - here);
    let nearer = match (from.is_nan(), to.is_nan()) {
        (true, true) => return Some(0.0),
        (true, false) => to,
        (false, true) => from,
        (false, false) if (to - from).abs() <= PLANE_BEND_MAX * here => return Some((from + to) / 2.0),
        (false, false) if from.abs() < to.abs() => from,
        (false, false) => to,
    };
    (nearer.abs() <= STEP_MAX * here).then_some(nearer)
}
