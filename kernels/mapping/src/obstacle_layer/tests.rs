use geometry::{CameraIntrinsics, Pose3};
use rand::{RngExt, SeedableRng};

use super::*;
use crate::image::DepthImage;

const WIDTH: usize = 160;
const HEIGHT: usize = 120;
const CAMERA: CameraIntrinsics =
    CameraIntrinsics { width: WIDTH as u32, height: HEIGHT as u32, fx: 140.0, fy: 140.0, cx: 79.5, cy: 59.5 };
const EYE_M: f64 = 0.4;

/// A level camera above the origin that looks along +x.
fn map_from_camera() -> Pose3 {
    let axes = nalgebra::Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
    let rotation = nalgebra::Rotation3::from_matrix_unchecked(axes);
    Pose3::from_parts(
        nalgebra::Translation3::new(0.0, 0.0, EYE_M),
        nalgebra::UnitQuaternion::from_rotation_matrix(&rotation),
    )
}

/// Depth of floor and a wall at 6 m, and of a board across the way: at `x_m`, from `low_m` to `high_m`.
fn picture(board: Option<(f64, f64, f64)>) -> Vec<f64> {
    let depth = |idx: usize| {
        let ray = CAMERA.unproject((idx % WIDTH) as f64, (idx / WIDTH) as f64, 1.0);
        let floor_m = if ray.y > 0.0 { EYE_M / ray.y } else { f64::INFINITY };
        let far_m = floor_m.min(6.0);
        match board {
            Some((x_m, low_m, high_m)) if x_m < far_m => {
                let z = EYE_M - ray.y * x_m;
                if (low_m..high_m).contains(&z) { x_m } else { far_m }
            }
            _ => far_m,
        }
    };
    (0..WIDTH * HEIGHT).map(depth).collect()
}

fn see(layer: &mut ObstacleLayer, depth_m: &[f64], times: usize) {
    see_pitched(layer, depth_m, times, 0.0);
}

/// As if the camera looked `up_rad` higher than it did.
fn see_pitched(layer: &mut ObstacleLayer, depth_m: &[f64], times: usize, up_rad: f64) {
    let depth_mm: Vec<u16> = depth_m.iter().map(|z| (z * 1000.0).clamp(0.0, 65_535.0) as u16).collect();
    let depth = DepthImage::new(CAMERA.width, CAMERA.height, &depth_mm).unwrap();
    let believed = map_from_camera() * Pose3::rotation(nalgebra::Vector3::x() * up_rad);
    let frame = DepthFrame::new(depth, CAMERA, believed).unwrap();
    for _ in 0..times {
        layer.integrate(&frame);
    }
}

fn config() -> ObstacleConfig {
    let config = ObstacleConfig::for_height(0.45);
    // The camera here is coarse: every pixel counts.
    ObstacleConfig { limits: DepthLimits { stride_px: 1, ..config.limits }, ..config }
}

fn layer() -> ObstacleLayer {
    ObstacleLayer::new(config())
}

fn obstacles(layer: &ObstacleLayer) -> Vec<Point2> {
    let layout = Layout::covering(Point2::new(-1.0, -4.0), Point2::new(7.0, 4.0), 0.05).unwrap();
    let grid = layer.occupied(layout);
    layout.cells().filter(|&c| *grid.get(c)).map(|c| layout.centre(c)).collect()
}

#[test]
fn a_shelf_within_the_robots_height_is_an_obstacle_after_two_frames() {
    let mut layer = layer();
    see(&mut layer, &picture(Some((2.0, 0.30, 0.40))), 1);
    assert_eq!(obstacles(&layer), vec![]);
    see(&mut layer, &picture(Some((2.0, 0.30, 0.40))), 1);
    let found = obstacles(&layer);
    assert!(found.len() >= 40 && found.iter().all(|p| (p.x - 2.0).abs() <= 0.0501), "{found:?}");
}

#[test]
fn what_is_above_the_robot_is_none() {
    let mut layer = layer();
    see(&mut layer, &picture(Some((2.0, 0.55, 0.70))), 5);
    assert_eq!(obstacles(&layer), vec![]);
}

#[test]
fn the_floor_is_none_however_noisy() {
    let mut layer = layer();
    let mut random = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(7);
    for frame in 0..20 {
        let noisy: Vec<f64> = picture(None)
            .iter()
            .map(|z| {
                let normal = (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
                z + 0.002 * z * z * normal
            })
            .collect();
        see(&mut layer, &noisy, 1);
        assert_eq!(obstacles(&layer), vec![], "frame {frame}, seed 7");
    }
}

#[test]
fn the_floor_is_none_when_the_robot_nods() {
    // 0.6°, 4 cm at 4 m.
    let mut layer = layer();
    see_pitched(&mut layer, &picture(None), 5, 0.01);
    assert_eq!(obstacles(&layer), vec![]);
}

#[test]
fn what_went_away_is_cleared_and_what_is_hidden_is_not() {
    let mut layer = layer();
    see(&mut layer, &picture(Some((2.0, 0.30, 0.40))), 20);
    let before = obstacles(&layer).len();
    see(&mut layer, &picture(Some((1.0, 0.0, 0.5))), 2);
    assert!(obstacles(&layer).iter().filter(|p| p.x > 1.5).count() == before);
    see(&mut layer, &picture(None), 3);
    // A cell on the border of the view is seen by less than its middle, and stays.
    let left = obstacles(&layer);
    assert!(left.iter().all(|p| p.y.abs() / p.x > 0.5), "{left:?}");
}

#[test]
fn cells_are_bounded_and_refusals_counted() {
    let mut layer = ObstacleLayer::new(ObstacleConfig { n_cells_max: 4, ..config() });
    see(&mut layer, &picture(Some((2.0, 0.30, 0.40))), 3);
    assert!(layer.n_cells() == 4 && layer.n_refused() > 0);
}
