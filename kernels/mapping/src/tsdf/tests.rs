use geometry::{CameraIntrinsics, Pose3};
use proptest::prelude::*;

use geometry::Point3;

use super::*;
use crate::image::DepthImage;

const WIDTH: usize = 160;
const HEIGHT: usize = 120;
const CAMERA: CameraIntrinsics =
    CameraIntrinsics { width: WIDTH as u32, height: HEIGHT as u32, fx: 140.0, fy: 140.0, cx: 79.5, cy: 59.5 };

/// A picture taken at the origin of `map`, looking along z.
struct Picture {
    depth_mm: Vec<u16>,
    mask: Mask,
}

impl Picture {
    /// `see` gives each pixel's depth, metres, and whether it is in the mask.
    fn new(see: impl Fn(usize, usize) -> (f64, bool)) -> Self {
        let pixels: Vec<_> = (0..WIDTH * HEIGHT).map(|idx| see(idx % WIDTH, idx / WIDTH)).collect();
        let depth_mm = pixels.iter().map(|(z, _)| (z * 1000.0).round() as u16).collect();
        let bits = pixels.iter().map(|(_, masked)| *masked).collect();
        Picture { depth_mm, mask: Mask::new(CAMERA.width, CAMERA.height, bits).unwrap() }
    }

    fn frame(&self) -> DepthFrame<'_> {
        let depth = DepthImage::new(CAMERA.width, CAMERA.height, &self.depth_mm).unwrap();
        DepthFrame::new(depth, CAMERA, Pose3::identity()).unwrap()
    }
}

fn in_middle(col: usize, row: usize) -> bool {
    (50..110).contains(&col) && (40..80).contains(&row)
}

/// A box at 1.5 m before a wall at 3 m.
fn with_box() -> Picture {
    Picture::new(|col, row| if in_middle(col, row) { (1.5, true) } else { (3.0, false) })
}

/// The box carried off.
fn without_box() -> Picture {
    Picture::new(|_, _| (3.0, false))
}

fn seen(picture: &Picture, times: usize, tsdf: &mut Tsdf) -> Integrated {
    let mut done = Integrated::default();
    for _ in 0..times {
        done = tsdf.integrate(&picture.frame(), Some(&picture.mask)).unwrap();
    }
    done
}

fn empty() -> Tsdf {
    Tsdf::new(TsdfConfig::default()).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn the_surface_of_a_plane_lies_on_it_at_any_angle_and_has_no_holes(
        slope_x in -1.5..1.5_f64, slope_y in -1.5..1.5_f64, distance_m in 1.0..2.5_f64,
    ) {
        // n·P = distance with n = (slope_x, slope_y, 1).
        let depth = |col: usize, row: usize| {
            let ray = CAMERA.unproject(col as f64, row as f64, 1.0);
            distance_m / (1.0 + slope_x * ray.x + slope_y * ray.y)
        };
        let picture = Picture::new(|col, row| {
            let z = depth(col, row);
            if z > 0.4 && z < 4.0 { (z, true) } else { (0.0, false) }
        });
        let mut tsdf = empty();
        seen(&picture, 3, &mut tsdf);
        let points = tsdf.surface_points();
        let norm = (1.0 + slope_x * slope_x + slope_y * slope_y).sqrt();
        let off_m = |p: &Point3| ((slope_x * p.x + slope_y * p.y + p.z - distance_m) / norm).abs();
        let mean_m = points.iter().map(off_m).sum::<f64>() / points.len().max(1) as f64;
        prop_assert!(mean_m < 0.006, "{mean_m} m off the plane on average");
        let worst_m = points.iter().map(off_m).fold(0.0, f64::max);
        // A voxel, and what half a pixel of this coarse camera is at the far end of a steep plane.
        prop_assert!(worst_m < 0.055, "{worst_m} m off the plane at worst");
        // Around each well-seen pixel's point there is surface.
        for row in (20..100).step_by(20) {
            for col in (20..140).step_by(20) {
                let (z, ray) = (depth(col, row), CAMERA.unproject(col as f64, row as f64, 1.0));
                let cosine = (distance_m / z / norm / ray.coords.norm()).abs();
                if z > 0.5 && z < 3.5 && cosine > 0.25 {
                    let at = ray * z;
                    let nearest = points.iter().map(|p| (p - at).norm()).fold(f64::INFINITY, f64::min);
                    prop_assert!(nearest < 0.06, "no surface within {nearest} m of {at}");
                }
            }
        }
    }
}

/// The surface of a scene that is seen from five places on an arc around a point 2 m ahead of the origin.
fn surface_from_around(depth_along: impl Fn(&Point3, &nalgebra::Vector3<f64>) -> f64) -> Vec<Point3> {
    let mut tsdf =
        Tsdf::new(TsdfConfig { voxel_m: 0.05, truncation_m: 0.15, ..TsdfConfig::default() }).unwrap();
    for step in -2..=2 {
        let turn = nalgebra::Vector3::y() * (0.2 * f64::from(step));
        let pivot = Pose3::translation(0.0, 0.0, 2.0);
        let map_from_camera = pivot * Pose3::rotation(turn) * pivot.inverse();
        let eye = Point3::from(map_from_camera.translation.vector);
        let depth_mm: Vec<u16> = (0..WIDTH * HEIGHT)
            .map(|idx| {
                let ray_camera = CAMERA.unproject((idx % WIDTH) as f64, (idx / WIDTH) as f64, 1.0).coords;
                let depth_m = depth_along(&eye, &(map_from_camera.rotation * ray_camera));
                if depth_m.is_finite() && depth_m > 0.0 {
                    (depth_m * 1000.0).round().min(9000.0) as u16
                } else {
                    0
                }
            })
            .collect();
        let depth = DepthImage::new(CAMERA.width, CAMERA.height, &depth_mm).unwrap();
        let frame = DepthFrame::new(depth, CAMERA, map_from_camera).unwrap();
        for _ in 0..2 {
            tsdf.integrate(&frame, None).unwrap();
        }
    }
    tsdf.surface_points()
}

#[track_caller]
fn check_no_bias(off_m: &[f64]) {
    assert!(off_m.len() > 300, "{} points", off_m.len());
    let mean_m = off_m.iter().sum::<f64>() / off_m.len() as f64;
    assert!(mean_m.abs() < 0.003, "{mean_m} m off on average");
    let n_close = off_m.iter().filter(|m| m.abs() < 0.008).count();
    assert!(n_close * 100 >= off_m.len() * 95, "{n_close} of {} within 8 mm", off_m.len());
    let worst_m = off_m.iter().fold(0.0_f64, |worst, m| worst.max(m.abs()));
    assert!(worst_m < 0.025, "{worst_m} m off at worst: half a voxel");
}

#[test]
fn the_surface_of_a_tilted_plane_seen_from_several_places_has_no_bias() {
    let normal = nalgebra::Vector3::new(0.25, -0.35, 1.0).normalize();
    let points = surface_from_around(|eye, ray| (2.0 * normal.z - normal.dot(&eye.coords)) / normal.dot(ray));
    check_no_bias(&points.iter().map(|p| normal.dot(&p.coords) - 2.0 * normal.z).collect::<Vec<_>>());
}

#[test]
fn the_surface_of_a_ball_seen_from_several_places_has_no_bias() {
    let (middle, radius_m) = (Point3::new(0.0, 0.0, 2.3), 0.7);
    let points = surface_from_around(|eye, ray| {
        let (to, squared) = (middle - eye, ray.norm_squared());
        let half = ray.dot(&to);
        let root = half * half - squared * (to.norm_squared() - radius_m * radius_m);
        (half - root.sqrt()) / squared
    });
    // Its rim is seen at a grazing angle.
    let near = points.iter().filter(|p| (*p - middle).normalize().z < -0.5);
    check_no_bias(&near.map(|p| (p - middle).norm() - radius_m).collect::<Vec<_>>());
}

#[test]
fn an_object_that_was_carried_off_is_forgotten_within_six_frames() {
    let mut tsdf = empty();
    seen(&with_box(), 40, &mut tsdf);
    assert!(tsdf.surface_points().len() > 100);
    seen(&without_box(), 6, &mut tsdf);
    assert_eq!(tsdf.surface_points(), vec![]);
    assert_eq!(tsdf.n_blocks(), 0);
}

#[test]
fn without_carving_nothing_is_forgotten() {
    let mut tsdf =
        Tsdf::new(TsdfConfig { carve_step: 0.0, absent_step: 0.0, ..TsdfConfig::default() }).unwrap();
    seen(&with_box(), 3, &mut tsdf);
    let before = tsdf.surface_points().len();
    seen(&without_box(), 20, &mut tsdf);
    assert_eq!(tsdf.surface_points().len(), before);
}

#[test]
fn one_wrong_mask_in_twenty_leaves_nothing() {
    // The wall is taken for the object, now and then at the same place.
    let wrong = Picture::new(|col, row| (3.0, in_middle(col, row)));
    let right = Picture::new(|_, _| (3.0, false));
    let mut tsdf = empty();
    for idx in 0..100 {
        seen(if idx % 20 == 0 { &wrong } else { &right }, 1, &mut tsdf);
        assert_eq!(tsdf.surface_points(), vec![], "after frame {idx}");
    }
}

#[test]
fn one_missed_mask_in_ten_loses_nothing() {
    let (found, missed) = (with_box(), Picture { mask: without_box().mask, ..with_box() });
    let mut tsdf = empty();
    seen(&with_box(), 5, &mut tsdf);
    let before = tsdf.surface_points().len();
    for idx in 0..50 {
        seen(if idx % 10 == 0 { &missed } else { &found }, 1, &mut tsdf);
        assert!(tsdf.surface_points().len() * 100 >= before * 95, "after frame {idx}");
    }
}

#[test]
fn what_is_hidden_or_out_of_view_or_without_depth_is_kept() {
    let mut tsdf = empty();
    seen(&with_box(), 3, &mut tsdf);
    let before = tsdf.surface_points();
    let hidden = Picture::new(|_, _| (0.8, false));
    let blind = Picture::new(|_, _| (0.0, false));
    for picture in [hidden, blind] {
        seen(&picture, 20, &mut tsdf);
        assert_eq!(tsdf.surface_points(), before);
    }
    // Turned around.
    let back = Pose3::rotation(nalgebra::Vector3::y() * std::f64::consts::PI);
    let picture = without_box();
    let depth = DepthImage::new(CAMERA.width, CAMERA.height, &picture.depth_mm).unwrap();
    let frame = DepthFrame::new(depth, CAMERA, back).unwrap();
    for _ in 0..20 {
        tsdf.observe_absent(&frame).unwrap();
    }
    assert_eq!(tsdf.surface_points(), before);
}

#[test]
fn a_surface_that_is_seen_and_not_masked_loses_its_claim() {
    let mut tsdf = empty();
    seen(&with_box(), 20, &mut tsdf);
    for _ in 0..6 {
        tsdf.observe_absent(&with_box().frame()).unwrap();
    }
    assert_eq!(tsdf.surface_points(), vec![]);
}

#[test]
fn memory_is_bounded_and_what_is_refused_is_counted() {
    let mut tsdf = Tsdf::new(TsdfConfig { n_blocks_max: 5, ..TsdfConfig::default() }).unwrap();
    let wall = Picture::new(|_, _| (3.0, true));
    let done = seen(&wall, 2, &mut tsdf);
    assert!(tsdf.n_blocks() <= 5 && done.n_blocks_refused > 0);
    // What is forgotten makes room.
    seen(&Picture::new(|_, _| (5.0, false)), 6, &mut tsdf);
    assert_eq!(tsdf.n_blocks(), 0);
}

#[test]
fn what_is_not_renewed_fades() {
    let mut tsdf = empty();
    seen(&with_box(), 12, &mut tsdf);
    for _ in 0..4 {
        tsdf.decay(0.5);
    }
    assert_eq!(tsdf.surface_points(), vec![]);
    tsdf.decay(f32::NAN);
    assert_eq!(tsdf.n_blocks(), 0);
}

#[test]
fn far_from_the_origin_and_at_negative_places_it_is_the_same() {
    let picture = with_box();
    let surface = |at: Pose3| {
        let depth = DepthImage::new(CAMERA.width, CAMERA.height, &picture.depth_mm).unwrap();
        let frame = DepthFrame::new(depth, CAMERA, at).unwrap();
        let mut tsdf = empty();
        for _ in 0..2 {
            tsdf.integrate(&frame, Some(&picture.mask)).unwrap();
        }
        tsdf.surface_points().iter().map(|p| at.inverse() * p).collect::<Vec<_>>()
    };
    let (here, there) = (surface(Pose3::identity()), surface(Pose3::translation(-800.0, -400.0, -8.0)));
    // Rounding may put a column of voxels that sees the border of the object on its other side: one in twenty.
    let n_same = here.iter().filter(|a| there.iter().any(|b| (*a - b).norm() < 1e-3)).count();
    assert!(n_same * 100 >= here.len() * 95, "{n_same} of {} and {}", here.len(), there.len());
}

#[test]
fn a_configuration_or_mask_that_cannot_be_is_refused() {
    let refused = |config| Tsdf::new(config).err().unwrap().to_string();
    let default = TsdfConfig::default();
    assert_eq!(refused(TsdfConfig { voxel_m: 0.0, ..default }), "voxel_m is 0, must be 0.005 to 0.5");
    assert!(refused(TsdfConfig { truncation_m: f64::NAN, ..default }).starts_with("truncation_m is NaN"));
    assert!(refused(TsdfConfig { weight_min: 0.0, ..default }).starts_with("weight_min"));
    assert!(refused(TsdfConfig { n_blocks_max: 0, ..default }).starts_with("n_blocks_max"));
    let small = Mask::new(2, 2, vec![true; 4]).unwrap();
    assert!(empty().integrate(&with_box().frame(), Some(&small)).is_err());
}
