//! A small ray caster of boxes over a floor: depth and labels, as exact as the pixels are.
//!
//! The slow, obvious world that the whole chain is tested against; it shares no code with it.

use geometry::{CameraIntrinsics, Point2, Point3, Pose2, Pose3};
use mapping::{DepthFrame, DepthImage, Grid, HeatMap, Segments};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// The label of the floor; things have others.
pub const FLOOR: u16 = 1;
/// The label of walls.
pub const WALL: u16 = 2;

pub const CAMERA: CameraIntrinsics =
    CameraIntrinsics { width: 320, height: 240, fx: 290.0, fy: 290.0, cx: 159.5, cy: 119.5 };

/// A box on its own pose in the plane, from `low_m` to `high_m` in height.
#[derive(Clone)]
pub struct Solid {
    pub label: u16,
    pub map_from_solid: Pose2,
    pub size: [f64; 2],
    pub low_m: f64,
    pub high_m: f64,
}

#[derive(Clone, Default)]
pub struct Scene {
    pub solids: Vec<Solid>,
}

pub struct Image {
    pub depth_mm: Vec<u16>,
    pub labels: Vec<u16>,
    pub camera: CameraIntrinsics,
    pub map_from_camera: Pose3,
}

impl Scene {
    /// A room of 8 × 8 m around the origin.
    pub fn room() -> Self {
        let mut scene = Scene::default();
        for (x, y, size) in
            [(4.0, 0.0, [0.1, 8.2]), (-4.0, 0.0, [0.1, 8.2]), (0.0, 4.0, [8.2, 0.1]), (0.0, -4.0, [8.2, 0.1])]
        {
            scene.add(WALL, Pose2::new(x, y, 0.0), size, 0.0, 2.5);
        }
        scene
    }

    pub fn add(&mut self, label: u16, at: Pose2, size: [f64; 2], low_m: f64, high_m: f64) {
        self.solids.push(Solid { label, map_from_solid: at, size, low_m, high_m });
    }

    /// A table: a top 3 cm thick, its upper side at `height_m`, on four legs of 5 cm.
    pub fn add_table(&mut self, label: u16, at: Pose2, size: [f64; 2], height_m: f64) {
        self.add(label, at, size, height_m - 0.03, height_m);
        for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            let leg = Pose2::new(x * (size[0] / 2.0 - 0.05), y * (size[1] / 2.0 - 0.05), 0.0);
            self.add(label, at * leg, [0.05, 0.05], 0.0, height_m - 0.03);
        }
    }

    /// A chair that looks along +x of its pose: a seat of 45 cm, a back, four legs of 4 cm.
    pub fn add_chair(&mut self, label: u16, at: Pose2) {
        self.add(label, at, [0.45, 0.45], 0.42, 0.46);
        self.add(label, at * Pose2::new(-0.2, 0.0, 0.0), [0.05, 0.45], 0.46, 0.9);
        for (x, y) in [(-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2)] {
            self.add(label, at * Pose2::new(x, y, 0.0), [0.04, 0.04], 0.0, 0.42);
        }
    }

    /// What the camera sees, pixel by pixel.
    pub fn render(&self, map_from_camera: Pose3) -> Image {
        self.render_by(CAMERA, map_from_camera)
    }

    /// What a given camera sees, pixel by pixel.
    pub fn render_by(&self, camera: CameraIntrinsics, map_from_camera: Pose3) -> Image {
        let mut depth_mm = Vec::new();
        let mut labels = Vec::new();
        let eye = Point3::from(map_from_camera.translation.vector);
        let solids: Vec<_> = self
            .solids
            .iter()
            .map(|solid| {
                let solid_from_map = solid.map_from_solid.lifted(0.0).inverse();
                let rotation = *solid_from_map.rotation.to_rotation_matrix().matrix()
                    * map_from_camera.rotation.to_rotation_matrix().matrix();
                (solid, solid_from_map * eye, rotation)
            })
            .collect();
        for row in 0..camera.height {
            for col in 0..camera.width {
                let ray_camera = camera.unproject(f64::from(col), f64::from(row), 1.0).coords;
                let ray_map = map_from_camera.rotation * ray_camera;
                let floor_m = -eye.z / ray_map.z;
                let mut best = if floor_m > 0.0 { (floor_m, FLOOR) } else { (f64::INFINITY, 0) };
                for (solid, eye, rotation) in &solids {
                    let hit_m = solid.hit_m(eye, &(rotation * ray_camera));
                    if hit_m < best.0 {
                        best = (hit_m, solid.label);
                    }
                }
                depth_mm.push((best.0 * 1000.0).round().min(65_535.0) as u16);
                labels.push(best.1);
            }
        }
        Image { depth_mm, labels, camera, map_from_camera }
    }

    /// Whether a point of the floor lies under (or in) a solid of this label that reaches above a height.
    pub fn covers(&self, label: u16, above_m: f64, point: Point2) -> bool {
        self.solids.iter().filter(|s| s.label == label && s.high_m > above_m).any(|solid| {
            let p = solid.map_from_solid.inverse().transform(point);
            p.x.abs() <= solid.size[0] / 2.0 && p.y.abs() <= solid.size[1] / 2.0
        })
    }
}

impl Solid {
    /// Share of the ray at which it enters the box; infinite when it misses.
    fn hit_m(&self, eye: &Point3, ray: &Vector3<f64>) -> f64 {
        let low = [-self.size[0] / 2.0, -self.size[1] / 2.0, self.low_m];
        let high = [self.size[0] / 2.0, self.size[1] / 2.0, self.high_m];
        let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
        for axis in 0..3 {
            let (a, b) = ((low[axis] - eye[axis]) / ray[axis], (high[axis] - eye[axis]) / ray[axis]);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        if enter <= leave && enter > 0.0 { enter } else { f64::INFINITY }
    }
}

impl Image {
    pub fn frame(&self) -> DepthFrame<'_> {
        let depth = DepthImage::new(self.camera.width, self.camera.height, &self.depth_mm).unwrap();
        DepthFrame::new(depth, self.camera, self.map_from_camera).unwrap()
    }

    pub fn segments(&self) -> Segments {
        let n = self.labels.iter().copied().max().unwrap();
        Segments::new(self.camera.width, self.camera.height, self.labels.clone(), n).unwrap()
    }

    /// What an open-vocabulary model says: one value for each 7 × 7 pixels, blurred by two cells.
    pub fn heat(&self, label: u16) -> HeatMap {
        coarse_heat(self.camera.width as usize, self.camera.height as usize, |idx| self.labels[idx] == label)
    }

    /// Depth noise of 1.5 mm at 1 m, growing with depth squared, and one pixel in ten without depth.
    pub fn with_noise(mut self, seed: u64) -> Self {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        for mm in &mut self.depth_mm {
            let depth_m = f64::from(*mm) / 1000.0;
            // The sum of twelve uniform numbers less six is close to normal.
            let normal = (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
            let noisy_m = depth_m + 0.0015 * depth_m * depth_m * normal;
            *mm = if random.random::<f64>() < 0.1 {
                0
            } else {
                (noisy_m * 1000.0).round().clamp(0.0, 65_535.0) as u16
            };
        }
        self
    }
}

pub fn coarse_heat(width: usize, height: usize, is_hot: impl Fn(usize) -> bool) -> HeatMap {
    let (n_cols, n_rows) = (width / 7, height / 7);
    let mut share = vec![0.0_f32; n_cols * n_rows];
    let mut total = vec![0.0_f32; n_cols * n_rows];
    for idx in 0..width * height {
        let cell = (idx / width * n_rows / height) * n_cols + idx % width * n_cols / width;
        total[cell] += 1.0;
        share[cell] += f32::from(u8::from(is_hot(idx)));
    }
    let share: Vec<f32> = share.iter().zip(&total).map(|(s, t)| s / t).collect();
    let blur = |values: &[f32], along: usize, n: usize| {
        let mut out = vec![0.0; values.len()];
        for (idx, out) in out.iter_mut().enumerate() {
            let at = (idx / along % n) as i64;
            let (mut sum, mut weight) = (0.0_f32, 0.0_f32);
            for off in -5..=5_i64 {
                if (0..n as i64).contains(&(at + off)) {
                    let w = (-(off as f32).powi(2) / 8.0).exp();
                    weight += w;
                    sum += w * values[(idx as i64 + off * along as i64) as usize];
                }
            }
            *out = sum / weight;
        }
        out
    };
    let rows = blur(&share, 1, n_cols);
    let both = blur(&rows, n_cols, n_rows);
    HeatMap::new(n_cols as u32, n_rows as u32, both.iter().map(|v| v.clamp(0.0, 1.0)).collect()).unwrap()
}

/// A camera at `at`, `height_m` above the floor, that looks towards `to`, pitched down.
pub fn looking(at: Point2, height_m: f64, to: Point2, down_rad: f64) -> Pose3 {
    let yaw_rad = (to.y - at.y).atan2(to.x - at.x);
    let base = Pose2::new(at.x, at.y, yaw_rad).lifted(height_m);
    // Optical axes in the base's frame: x right, y down, z forward.
    let optical = Rotation3::from_matrix_unchecked(nalgebra::Matrix3::new(
        0.0, 0.0, 1.0, //
        -1.0, 0.0, 0.0, //
        0.0, -1.0, 0.0,
    ));
    let pitch = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), down_rad);
    base * Pose3::from_parts(
        nalgebra::Translation3::identity(),
        pitch * UnitQuaternion::from_rotation_matrix(&optical),
    )
}

/// Intersection over union of a grid with what is true at its cells' centres, and of the truth outside it.
pub fn iou(found: &Grid<bool>, truth: impl Fn(Point2) -> bool) -> f64 {
    let h = found.layout().resolution_m;
    let (mut both, mut either) = (0, 0);
    let n = (5.0 / h) as i64;
    for row in -n..n {
        for col in -n..n {
            let p = Point2::new((col as f64 + 0.5) * h, (row as f64 + 0.5) * h);
            let (a, b) = (found.at(p) == Some(&true), truth(p));
            both += i32::from(a && b);
            either += i32::from(a || b);
        }
    }
    f64::from(both) / f64::from(either)
}
