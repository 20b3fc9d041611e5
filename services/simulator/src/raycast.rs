//! What sensors see of a scene, by casting rays: colour, depth and instance of each pixel, LiDAR ranges.
//!
//! All surfaces are merged into one triangle mesh with one hierarchy over it, and a table from triangle
//! to instance; the floor is the plane z = 0, on which floor areas are drawn. Rays are exact on these
//! surfaces, in `f32`. Noise is not made here (`sensor_noise`).

mod tile;

use geometry::{CameraIntrinsics, Point2, Point3, Pose2, Pose3};
use parry3d::math::Vector;
use parry3d::query::{Ray, RayCast};
use parry3d::shape::TriMesh;
use rayon::prelude::*;
use tile::Tile;

use crate::footprint::Footprint;
use crate::scene::{Kind, OUTSIDE_HEIGHT_M, Object, Scene};
use crate::solid::Band;

/// Instance of a pixel that shows nothing.
pub const INSTANCE_NONE: u16 = 0;
/// Instance of the floor.
pub const INSTANCE_FLOOR: u16 = 1;
/// Instance of all walls and of the outside of the floor.
pub const INSTANCE_WALL: u16 = 2;
/// Instance of the scene's first object; the others follow in its order.
pub const INSTANCE_OBJECTS: u16 = 3;

/// Colours are seen this far, metres; depth has a reach of its own.
const SIGHT_M: f64 = 100.0;
/// Side of a tile. Chosen between asking the hierarchy too often and casting at too many triangles. In
/// the office a 640 × 480 frame takes 44 ms of one core so, against 90 ms ray by ray (November 2026, level 2).
const TILE_PIXELS: u32 = 16;
const SKY_RGB: [u8; 3] = [120, 140, 165];
const FLOOR_RGB: [u8; 3] = [176, 160, 136];
const WALL_RGB: [u8; 3] = [214, 210, 200];

/// A scene, ready to be seen.
pub struct RayCaster {
    surface: TriMesh,
    instance_of_triangle: Vec<u16>,
    rgb_of_instance: Vec<[u8; 3]>,
    floor_areas: Vec<FloorArea>,
    /// Rays work near the origin, where `f32` is finest; this is where it lies in `map`.
    origin_map: Point3,
}

struct FloorArea {
    instance: u16,
    low: Point2,
    high: Point2,
    footprint: Footprint,
}

/// One image, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Red, green, blue of each pixel.
    pub rgb: Vec<u8>,
    /// Depth along the optical axis, millimetres; 0 for none.
    pub depth_mm: Vec<u16>,
    /// What each pixel shows.
    pub seen: InstanceImage,
}

/// Which instance each pixel shows, row-major.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InstanceImage {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Instance of each pixel; [`INSTANCE_NONE`] where nothing is seen.
    pub instances: Vec<u16>,
}

/// What can go wrong when a scene is made ready to be seen.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the scene's surfaces make no mesh: {0}")]
pub struct SurfaceError(String);

#[derive(Clone, Copy, Default)]
struct Pixel {
    rgb: [u8; 3],
    depth_mm: u16,
    instance: u16,
}

/// Where an image is taken from, and how.
struct View {
    map_from_camera: Pose3,
    camera: CameraIntrinsics,
    depth_m_max: f64,
}

impl View {
    fn eye_map(&self) -> Point3 {
        self.map_from_camera.translation.vector.into()
    }

    /// Direction of the ray through an image point, of length 1 m along the optical axis.
    fn direction_map(&self, u: f64, v: f64) -> nalgebra::Vector3<f64> {
        self.map_from_camera.rotation * self.camera.unproject(u, v, 1.0).coords
    }
}

impl RayCaster {
    /// The scene's surfaces with a hierarchy over them.
    ///
    /// # Errors
    /// [`SurfaceError`] when the mesh library refuses the surfaces.
    pub fn new(scene: &Scene) -> Result<Self, SurfaceError> {
        let centre = scene.floor.corners().iter().fold(nalgebra::Vector2::zeros(), |sum, c| sum + c.coords)
            / scene.floor.corners().len() as f64;
        let origin_map = Point3::new(centre.x, centre.y, 0.0);
        let mut vertices: Vec<Vector> = Vec::new();
        let mut instance_of_triangle = Vec::new();
        let mut add = |triangles: Vec<[Point3; 3]>, instance: u16| {
            instance_of_triangle.extend(std::iter::repeat_n(instance, triangles.len()));
            vertices.extend(triangles.iter().flatten().map(|p| vector(p - origin_map)));
        };
        add(border_of(scene), INSTANCE_WALL);
        scene.walls.iter().for_each(|wall| add(wall.surface(), INSTANCE_WALL));
        let mut rgb_of_instance = vec![[0; 3], FLOOR_RGB, WALL_RGB];
        let mut floor_areas = Vec::new();
        for (object, instance) in scene.objects.iter().zip(INSTANCE_OBJECTS..) {
            rgb_of_instance.push(object.rgb.unwrap_or_else(|| colour_of(&object.label, instance)));
            match object.kind {
                Kind::Thing => object.solids.iter().for_each(|s| add(s.surface(), instance)),
                Kind::FloorArea => floor_areas.extend(floor_area(object, instance)),
            }
        }
        let indices = (0..vertices.len() as u32 / 3).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
        let surface = TriMesh::new(vertices, indices).map_err(|e| SurfaceError(e.to_string()))?;
        Ok(RayCaster { surface, instance_of_triangle, rgb_of_instance, floor_areas, origin_map })
    }

    /// Number of triangles that rays can hit.
    #[must_use]
    pub fn n_triangles(&self) -> usize {
        self.instance_of_triangle.len()
    }

    /// What a camera sees, one ray through the centre of each pixel, tiles shared out over all threads.
    ///
    /// `depth_m_max` is the reach of its depth, at most 65 m; beyond it colour and instance are still
    /// seen.
    #[must_use]
    pub fn image(&self, map_from_camera: &Pose3, camera: &CameraIntrinsics, depth_m_max: f64) -> Image {
        let view = View { map_from_camera: *map_from_camera, camera: *camera, depth_m_max };
        let bands: Vec<Vec<Pixel>> = (0..camera.height.div_ceil(TILE_PIXELS))
            .into_par_iter()
            .map(|band| self.band(&view, band * TILE_PIXELS))
            .collect();
        let pixels = || bands.iter().flatten();
        let instances = pixels().map(|p| p.instance).collect();
        Image {
            rgb: pixels().flat_map(|p| p.rgb).collect(),
            depth_mm: pixels().map(|p| p.depth_mm).collect(),
            seen: InstanceImage { width: camera.width, height: camera.height, instances },
        }
    }

    /// The rows of one row of tiles, the first of them `top`.
    fn band(&self, view: &View, top: u32) -> Vec<Pixel> {
        let (width, bottom) = (view.camera.width, (top + TILE_PIXELS).min(view.camera.height));
        let mut pixels = vec![Pixel::default(); (width * (bottom - top)) as usize];
        for left in (0..width).step_by(TILE_PIXELS as usize) {
            let right = (left + TILE_PIXELS).min(width);
            // Pixel centres are at whole numbers; the tile reaches half a pixel beyond them.
            let edge = |u: u32, v: u32| vector(view.direction_map(f64::from(u) - 0.5, f64::from(v) - 0.5));
            let corners = [edge(left, top), edge(right, top), edge(right, bottom), edge(left, bottom)];
            let tile = Tile::new(&self.surface, vector(view.eye_map() - self.origin_map), corners);
            for v in top..bottom {
                for u in left..right {
                    let direction_map = view.direction_map(f64::from(u), f64::from(v));
                    pixels[((v - top) * width + u) as usize] = self.pixel(view, &tile, direction_map);
                }
            }
        }
        pixels
    }

    /// The pixel in a direction of length 1 m along the optical axis, so that hits are told as depths.
    fn pixel(&self, view: &View, tile: &Tile, direction_map: nalgebra::Vector3<f64>) -> Pixel {
        let eye_map = view.eye_map();
        let on_floor = floor_hit(eye_map, direction_map).filter(|depth_m| *depth_m <= SIGHT_M);
        let reach = on_floor.unwrap_or(SIGHT_M) as f32;
        let (depth_m, instance, brightness) = match (tile.nearest(vector(direction_map), reach), on_floor) {
            (Some(hit), _) => {
                let instance = self.instance_of_triangle.get(hit.triangle as usize);
                let normal = nalgebra::Vector3::new(hit.normal.x, hit.normal.y, hit.normal.z).cast::<f64>();
                let shade = shade(normal.normalize(), direction_map);
                (f64::from(hit.depth), instance.copied().unwrap_or(INSTANCE_NONE), shade)
            }
            (None, Some(depth_m)) => {
                let at = eye_map + direction_map * depth_m;
                let shade = shade(nalgebra::Vector3::z(), direction_map) * planks(at);
                (depth_m, self.floor_instance(at.xy()), shade)
            }
            (None, None) => return Pixel { rgb: SKY_RGB, depth_mm: 0, instance: INSTANCE_NONE },
        };
        let rgb = self.rgb_of_instance.get(usize::from(instance)).copied().unwrap_or(SKY_RGB);
        let within_reach = depth_m <= view.depth_m_max;
        let depth_mm = if within_reach { (depth_m * 1000.0).round().min(65535.0) as u16 } else { 0 };
        Pixel { rgb: rgb.map(|part| (f64::from(part) * brightness).min(255.0) as u8), depth_mm, instance }
    }

    /// What a single ray meets: the instance, and how often `direction_map` fits in between. Floor areas
    /// are not told from the floor.
    #[must_use]
    pub fn first_hit(&self, from_map: Point3, direction_map: nalgebra::Vector3<f64>) -> Option<(u16, f64)> {
        let ray = Ray::new(vector(from_map - self.origin_map), vector(direction_map));
        let hit = self.surface.cast_local_ray_and_get_normal(&ray, SIGHT_M as f32, false).and_then(|hit| {
            let instance = self.instance_of_triangle.get(hit.subshape as usize)?;
            Some((*instance, f64::from(hit.time_of_impact)))
        });
        let floor = floor_hit(from_map, direction_map).map(|depth| (INSTANCE_FLOOR, depth));
        [hit, floor].into_iter().flatten().min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// The floor area at a point of the floor, or the floor; the last of the file lies on top.
    fn floor_instance(&self, at: Point2) -> u16 {
        let lies_on = |area: &&FloorArea| {
            (area.low.x..=area.high.x).contains(&at.x)
                && (area.low.y..=area.high.y).contains(&at.y)
                && area.footprint.distance_m(at) <= 0.0
        };
        self.floor_areas.iter().rev().find(lies_on).map_or(INSTANCE_FLOOR, |area| area.instance)
    }

    /// One turn of a level LiDAR: the range along each of `n_beams` directions, the first along the
    /// LiDAR's x axis, counter-clockwise, metres; `+∞` where nothing is within `range_m_max`.
    #[must_use]
    pub fn scan(&self, map_from_lidar: Pose2, z_m: f64, n_beams: u32, range_m_max: f64) -> Vec<f32> {
        let origin = Point3::new(map_from_lidar.x_m, map_from_lidar.y_m, z_m) - self.origin_map;
        let beam = |idx: u32| {
            let yaw_rad =
                map_from_lidar.yaw_rad + f64::from(idx) / f64::from(n_beams) * std::f64::consts::TAU;
            let direction = nalgebra::Vector3::new(yaw_rad.cos(), yaw_rad.sin(), 0.0);
            let ray = Ray::new(vector(origin), vector(direction));
            self.surface.cast_local_ray(&ray, range_m_max as f32, false).unwrap_or(f32::INFINITY)
        };
        (0..n_beams).map(beam).collect()
    }
}

fn vector(v: nalgebra::Vector3<f64>) -> Vector {
    Vector::new(v.x as f32, v.y as f32, v.z as f32)
}

/// Depth at which a ray from above meets the plane z = 0.
fn floor_hit(eye: Point3, direction: nalgebra::Vector3<f64>) -> Option<f64> {
    (direction.z < -1e-9 && eye.z > 0.0).then(|| -eye.z / direction.z)
}

/// Upright faces along the border of the floor: behind them all is solid.
fn border_of(scene: &Scene) -> Vec<[Point3; 3]> {
    let lift = |p: Point2, z: f64| Point3::new(p.x, p.y, z);
    let face = |(a, b): (Point2, Point2)| {
        let top_m = OUTSIDE_HEIGHT_M;
        [[lift(a, 0.0), lift(b, 0.0), lift(b, top_m)], [lift(a, 0.0), lift(b, top_m), lift(a, top_m)]]
    };
    scene.floor.edges().flat_map(face).collect()
}

fn floor_area(object: &Object, instance: u16) -> Option<FloorArea> {
    let areas: Vec<_> = object.solids.iter().flat_map(|s| s.slice(Band::ALL)).collect();
    let (low, high) = areas.iter().map(crate::solid::Area::bounds).reduce(|(low, high), (l, h)| {
        (low.coords.inf(&l.coords).into(), high.coords.sup(&h.coords).into())
    })?;
    Some(FloorArea { instance, low, high, footprint: Footprint::of(&object.solids, Band::ALL) })
}

/// Brightness of a face: a lamp above and to one side, one at the eye, and light from everywhere.
fn shade(normal: nalgebra::Vector3<f64>, direction: nalgebra::Vector3<f64>) -> f64 {
    let facing = -normal.dot(&direction) / direction.norm();
    let towards_eye = if facing < 0.0 { -normal } else { normal };
    let lamp = nalgebra::Vector3::new(0.4, 0.25, 0.88);
    0.5 + 0.3 * towards_eye.dot(&lamp).max(0.0) + 0.25 * facing.abs()
}

/// A faint pattern of planks, so that the floor's perspective can be seen.
fn planks(at: Point3) -> f64 {
    let row = (at.y / 0.2).floor();
    let plank = ((at.x + 0.37 * row) / 1.1).floor();
    let odd = (row * 12.9898 + plank * 78.233).sin() * 43758.5453;
    0.96 + 0.06 * (odd - odd.floor())
}

/// A colour for an object that has none: by its label, and a little by its instance.
fn colour_of(label: &str, instance: u16) -> [u8; 3] {
    // FNV-1a: the same on every machine and in every run.
    let hash = label.bytes().fold(0x811c_9dc5_u32, |h, b| (h ^ u32::from(b)).wrapping_mul(0x0100_0193));
    let shift = (instance % 4) as u8 * 7;
    let part = |bits: u32| 60 + (bits & 0x7f) as u8 + shift;
    [part(hash), part(hash >> 9), part(hash >> 18)]
}
