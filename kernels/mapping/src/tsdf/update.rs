//! What one frame tells the voxels of one block.

use nalgebra::{Point3, Vector3};

use super::tiles::{Tile, Tiles};
use super::{BLOCK_SIDE, Block, Integrated, TsdfConfig};
use crate::image::DepthFrame;
use crate::projection::TrustedDepth;

/// Least cosine between ray and surface normal that is believed: below it a slope is mostly noise.
const COSINE_MIN: f32 = 0.1;
/// Three inverse depths in line, times depth, may bend this much and still be one plane.
const PLANE_BEND_MAX: f32 = 0.04;

/// Nearer to the camera nothing is seen, metres.
const NEAR_M: f32 = 0.05;
/// Above this cosine the foot of a voxel on its plane is less than a voxel beside it.
const COSINE_FACING: f32 = 0.9;

/// A voxel looks closely at a pixel on no tile's plane within this many truncations.
const EDGE_BAND: f32 = 4.0;

/// Finds planes in a depth image.
pub(super) struct Planes<'a> {
    depth_mm: &'a [u16],
    width: i32,
    height: i32,
    focal: [f32; 2],
    centre: [f32; 2],
    voxel_m: f32,
}

/// One frame, ready to be asked by voxels. Single precision: a camera sees metres, not kilometres.
pub(super) struct View<'a> {
    depth_mm: &'a [u16],
    trusted: &'a TrustedDepth<'a>,
    planes: &'a Planes<'a>,
    tiles: &'a Tiles,
    width: i32,
    height: i32,
    /// Width and height again.
    size: [f32; 2],
    focal: [f32; 2],
    centre: [f32; 2],
    camera_from_map: geometry::Pose3,
    /// Steps of one voxel along x, y and z of `map`, in `camera`.
    steps: [Vector3<f32>; 3],
    voxel_m: f32,
    truncation_m: f32,
    weight_max: f32,
    carve_step: f32,
    absent_step: f32,
    block_radius_m: f64,
}

/// A row of voxels as the camera sees them.
struct Row {
    /// The first one, and from one to the next, in `camera`.
    begin: Point3<f32>,
    step: Vector3<f32>,
    /// Along the optical axis.
    depth_m: [f32; BLOCK_SIDE],
    /// Pixel and half a pixel.
    u: [f32; BLOCK_SIDE],
    v: [f32; BLOCK_SIDE],
}

/// What a voxel learns.
enum Evidence {
    /// Nothing: out of view, hidden, or depth that is not trusted.
    None,
    /// The object's surface is this far in front of it, metres; negative is behind it.
    Surface(f32),
    /// A ray passed through it.
    Through,
    /// A surface is seen here that is not in the mask.
    Other,
}

impl<'a> View<'a> {
    pub(super) fn new(
        frame: &DepthFrame<'a>,
        trusted: &'a TrustedDepth<'a>,
        (planes, tiles): (&'a Planes<'a>, &'a Tiles),
        config: &TsdfConfig,
    ) -> Self {
        let camera = frame.intrinsics();
        let camera_from_map = frame.map_from_camera().inverse();
        let step = |axis: Vector3<f64>| (camera_from_map.rotation * axis * config.voxel_m).cast::<f32>();
        View {
            depth_mm: frame.depth().depth_mm(),
            trusted,
            planes,
            tiles,
            width: camera.width as i32,
            height: camera.height as i32,
            size: [camera.width as f32, camera.height as f32],
            focal: [camera.fx as f32, camera.fy as f32],
            centre: [camera.cx as f32, camera.cy as f32],
            camera_from_map,
            steps: [step(Vector3::x()), step(Vector3::y()), step(Vector3::z())],
            voxel_m: config.voxel_m as f32,
            truncation_m: config.truncation_m as f32,
            weight_max: config.weight_max,
            carve_step: config.carve_step,
            absent_step: config.absent_step,
            block_radius_m: config.voxel_m * BLOCK_SIDE as f64 * 3.0_f64.sqrt() / 2.0,
        }
    }

    /// Whether blocks that hold no surface of this frame are looked at too.
    pub(super) fn clears(&self) -> bool {
        self.carve_step > 0.0 || self.absent_step > 0.0
    }

    /// Whether any voxel of a block may be in view.
    pub(super) fn sees(&self, block: &Block) -> bool {
        let middle = self.camera_from_map * self.corner_map(block, 0.5);
        let radius_m = self.block_radius_m;
        if middle.z < -radius_m {
            return false;
        }
        // A sphere against the image's four side planes.
        let inside = |along: f64, focal: f32, centre: f32, n: i32| {
            let focal = f64::from(focal);
            let low = f64::from(centre) / focal;
            let high = (f64::from(n) - f64::from(centre)) / focal;
            along + low * middle.z > -radius_m * 1.0_f64.hypot(low)
                && high * middle.z - along > -radius_m * 1.0_f64.hypot(high)
        };
        inside(middle.x, self.focal[0], self.centre[0], self.width)
            && inside(middle.y, self.focal[1], self.centre[1], self.height)
    }

    /// A point of a block: its low corner and `share` of its sides, in `map`.
    fn corner_map(&self, block: &Block, share: f64) -> geometry::Point3 {
        let side_m = f64::from(self.voxel_m) * BLOCK_SIDE as f64;
        geometry::Point3::from(Vector3::from(block.key.map(|k| (f64::from(k) + share) * side_m)))
    }

    /// Lets every voxel of a block look at its pixel.
    pub(super) fn update(&self, block: &mut Block, reserved: bool, done: &mut Integrated) {
        let corner: Point3<f32> = (self.camera_from_map * self.corner_map(block, 0.0)).cast();
        let first = corner + (self.steps[0] + self.steps[1] + self.steps[2]) * 0.5;
        let rows = block.sdf_m.chunks_exact_mut(BLOCK_SIDE).zip(block.weight.chunks_exact_mut(BLOCK_SIDE));
        for (nth, (sdf_m, weight)) in rows.enumerate() {
            if !reserved && weight.iter().all(|w| *w <= 0.0) {
                continue;
            }
            let (y, z) = (nth % BLOCK_SIDE, nth / BLOCK_SIDE);
            let begin = first + self.steps[1] * y as f32 + self.steps[2] * z as f32;
            let row = self.row(begin);
            for (x, (mean_m, weight)) in sdf_m.iter_mut().zip(weight).enumerate() {
                if *weight <= 0.0 && !reserved {
                    continue;
                }
                let lost = match self.look(&row, x, *weight > 0.0) {
                    Evidence::None => continue,
                    Evidence::Surface(sdf_m) => {
                        *mean_m += (sdf_m - *mean_m) / (*weight + 1.0);
                        *weight = (*weight + 1.0).min(self.weight_max);
                        done.n_voxels_hit += 1;
                        continue;
                    }
                    Evidence::Through => self.carve_step,
                    Evidence::Other => self.absent_step,
                };
                if lost > 0.0 {
                    *weight = (*weight - lost).max(0.0);
                    done.n_voxels_cleared += 1;
                }
            }
        }
    }

    /// Where the voxels of a row are seen. In loops over arrays, which compilers turn into vectors.
    #[inline]
    fn row(&self, begin: Point3<f32>) -> Row {
        let step = self.steps[0];
        let mut row =
            Row { begin, step, depth_m: [0.0; BLOCK_SIDE], u: [-1.0; BLOCK_SIDE], v: [-1.0; BLOCK_SIDE] };
        let mut inverse = [0.0_f32; BLOCK_SIDE];
        for (x, inverse) in inverse.iter_mut().enumerate() {
            row.depth_m[x] = begin.z + step.z * x as f32;
            *inverse = 1.0 / row.depth_m[x];
        }
        for (x, inverse) in inverse.iter().enumerate() {
            row.u[x] = self.focal[0] * (begin.x + step.x * x as f32) * inverse + (self.centre[0] + 0.5);
            row.v[x] = self.focal[1] * (begin.y + step.y * x as f32) * inverse + (self.centre[1] + 0.5);
        }
        row
    }

    /// What the frame says of a voxel of a row; `has_weight` when there is something to lose.
    #[inline]
    fn look(&self, row: &Row, x: usize, has_weight: bool) -> Evidence {
        let (u, v, z) = (row.u[x], row.v[x], row.depth_m[x]);
        // Compared before the cast, which then rounds down: `floor` is a call on a plain x86-64.
        let in_view = u >= 0.0 && v >= 0.0 && u < self.size[0] && v < self.size[1] && z >= NEAR_M;
        if !in_view {
            return Evidence::None;
        }
        let (u, v) = (u as i32, v as i32);
        let idx = v.wrapping_mul(self.width).wrapping_add(u) as usize;
        let mm = self.depth_mm.get(idx).copied().unwrap_or(0);
        let depth_m = f32::from(mm) * 0.001;
        let ahead_m = depth_m - z;
        // So far off that no slope brings the surface near, and nothing to lose.
        let is_far = ahead_m > self.truncation_m / COSINE_MIN && !has_weight;
        if mm == 0 || ahead_m * COSINE_MIN < -self.truncation_m || is_far {
            return Evidence::None;
        }
        let at = row.begin + row.step * x as f32;
        if self.trusted.in_mask(idx) {
            if ahead_m * COSINE_MIN <= self.truncation_m {
                match self.tiles.at(u, v).filter(|tile| tile.holds(u, v, depth_m)) {
                    Some(tile) => {
                        let sdf_m = ahead_m * tile.cosine;
                        if sdf_m < -self.truncation_m {
                            return Evidence::None;
                        }
                        if sdf_m <= self.truncation_m {
                            let is_near = ahead_m.abs() <= self.voxel_m || tile.cosine >= COSINE_FACING;
                            let is_over = is_near || self.is_over_object(at + tile.normal * sdf_m);
                            return if is_over { Evidence::Surface(sdf_m) } else { Evidence::None };
                        }
                    }
                    // At an edge slopes are guesses: only what is close is looked at closely.
                    None if ahead_m.abs() > EDGE_BAND * self.truncation_m => {
                        if ahead_m < 0.0 {
                            return Evidence::None;
                        }
                    }
                    None => {
                        if let Some(evidence) = self.look_closely(at, (u, v), depth_m) {
                            return evidence;
                        }
                    }
                }
            }
        } else if ahead_m.abs() <= self.voxel_m && has_weight {
            return if self.beside_mask(u, v) { Evidence::None } else { Evidence::Other };
        }
        if has_weight && ahead_m > self.voxel_m { self.look_around(at, u, v) } else { Evidence::None }
    }

    /// What a masked pixel that lies on no tile's plane says; `None` when its surface is far behind.
    fn look_closely(&self, at: Point3<f32>, (u, v): (i32, i32), depth_m: f32) -> Option<Evidence> {
        let ahead_m = depth_m - at.z;
        let (normal, cosine) = self.planes.plane(u, v, depth_m);
        let sdf_m = ahead_m * cosine;
        if sdf_m < -self.truncation_m {
            return Some(Evidence::None);
        }
        if sdf_m > self.truncation_m {
            return None;
        }
        let is_near = ahead_m.abs() <= self.voxel_m || self.is_over_object(at + normal * sdf_m);
        Some(match self.trusted.at(u as usize, v as usize) {
            Some(_) if is_near => Evidence::Surface(sdf_m),
            _ => Evidence::None,
        })
    }

    /// Whether the foot of a voxel on the plane of its pixel, in `camera`, is object: at a grazing angle the
    /// two are far apart, and beyond the object's edge its plane goes on without it.
    fn is_over_object(&self, foot: Point3<f32>) -> bool {
        let Some((_, _, idx)) = self.pixel(foot) else { return false };
        let depth_m = f32::from(self.depth_mm[idx]) * 0.001;
        self.trusted.in_mask(idx) && (depth_m - foot.z).abs() <= self.voxel_m
    }

    /// The pixel (column, row, index) that shows a point in `camera`.
    #[inline]
    fn pixel(&self, at: Point3<f32>) -> Option<(i32, i32, usize)> {
        if at.z < NEAR_M {
            return None;
        }
        let inverse = 1.0 / at.z;
        let u = self.focal[0] * at.x * inverse + self.centre[0] + 0.5;
        let v = self.focal[1] * at.y * inverse + self.centre[1] + 0.5;
        // Compared before the cast, which then rounds down: `floor` is a call on a plain x86-64.
        let in_view = u >= 0.0 && v >= 0.0 && u < self.size[0] && v < self.size[1];
        in_view.then(|| {
            let (u, v) = (u as i32, v as i32);
            (u, v, (v * self.width + u) as usize)
        })
    }

    /// What a ray that passes through the voxel's centre means, by the pixels at the voxel's rim: a pose that
    /// is a little off must not carve away what is thin, nor what touches the floor stay for ever.
    fn look_around(&self, at: Point3<f32>, u: i32, v: i32) -> Evidence {
        let off = ((0.5 * self.voxel_m * self.focal[0] / at.z) as i32 + 1).min(16);
        let mut evidence = Evidence::Through;
        for (du, dv) in [(off, 0), (-off, 0), (0, off), (0, -off)] {
            let (u, v) = (u + du, v + dv);
            if u < 0 || v < 0 || u >= self.width || v >= self.height {
                continue;
            }
            let idx = (v * self.width + u) as usize;
            let ahead_m = f32::from(self.depth_mm[idx]) * 0.001 - at.z;
            // Zero, no depth, tells nothing.
            if ahead_m > self.voxel_m || self.depth_mm[idx] == 0 {
                continue;
            }
            if self.trusted.in_mask(idx) {
                return Evidence::None;
            }
            // A surface where the voxel is. What is clearly in front hides the rim and no more.
            if ahead_m >= -2.0 * self.voxel_m {
                evidence = Evidence::Other;
            }
        }
        evidence
    }

    /// Whether the mask is within two pixels: its border is not exact enough to tell absence.
    fn beside_mask(&self, u: i32, v: i32) -> bool {
        [(2, 0), (-2, 0), (0, 2), (0, -2)].into_iter().any(|(du, dv)| {
            let (u, v) = (u + du, v + dv);
            let in_image = u >= 0 && v >= 0 && u < self.width && v < self.height;
            in_image && self.trusted.in_mask((v * self.width + u) as usize)
        })
    }
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

    /// The plane at the middle of a tile.
    pub(super) fn tile(&self, col: usize, row: usize, depth_m: f32) -> Tile {
        let (u, v) = (col as i32, row as i32);
        let [a, b] = self.slopes(u, v, depth_m);
        let (normal, cosine) = self.plane_of(u, v, depth_m, [a, b]);
        Tile::new(normal, cosine, [1.0 / depth_m, a, b], (col, row))
    }

    /// The plane at a pixel: its unit normal, away from the camera, and how far it is for each metre along the
    /// optical axis.
    fn plane(&self, u: i32, v: i32, depth_m: f32) -> (Vector3<f32>, f32) {
        self.plane_of(u, v, depth_m, self.slopes(u, v, depth_m))
    }

    /// By inverse depth, which is linear on a plane: with 1/z = a·u + b·v + c the plane is n·P = 1 with
    /// n = (a·fx, b·fy, a·cx + b·cy + c), and a point P = ray·z is (1 − z/depth) / |n| in front of it.
    fn plane_of(&self, u: i32, v: i32, depth_m: f32, [a, b]: [f32; 2]) -> (Vector3<f32>, f32) {
        let inverse = 1.0 / depth_m;
        let (x, y) = (u as f32 - self.centre[0], v as f32 - self.centre[1]);
        let normal = Vector3::new(a * self.focal[0], b * self.focal[1], inverse - a * x - b * y);
        let norm = normal.norm();
        (normal / norm, (inverse / norm).clamp(COSINE_MIN, 1.0))
    }

    /// Slopes of inverse depth by column and row.
    fn slopes(&self, u: i32, v: i32, depth_m: f32) -> [f32; 2] {
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
        let a = slope(at(u - off, v), inverse, at(u + off, v)) / off as f32;
        let b = slope(at(u, v - off), inverse, at(u, v + off)) / off as f32;
        [a, b]
    }
}

/// Slope of inverse depth at the middle of three pixels in line, per distance between them. Next to an edge
/// the side with the smaller step is on the same surface. NaN is a pixel without depth; with none on either
/// side the surface is taken to face the camera.
fn slope(before: f32, here: f32, after: f32) -> f32 {
    let (from, to) = (here - before, after - here);
    if from.is_nan() || to.is_nan() {
        return if !from.is_nan() {
            from
        } else if !to.is_nan() {
            to
        } else {
            0.0
        };
    }
    if (to - from).abs() <= PLANE_BEND_MAX * here {
        (from + to) / 2.0
    } else if from.abs() < to.abs() {
        from
    } else {
        to
    }
}
