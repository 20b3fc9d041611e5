use geometry::{CameraIntrinsics, Pose3};

use super::*;
use crate::image::DepthImage;

const WIDTH: usize = 160;
const HEIGHT: usize = 120;
const CAMERA: CameraIntrinsics =
    CameraIntrinsics { width: WIDTH as u32, height: HEIGHT as u32, fx: 140.0, fy: 140.0, cx: 79.5, cy: 59.5 };

/// A camera half a metre above the origin that looks along +x, 0.3 rad down: `map` from the optical frame.
fn map_from_camera() -> Pose3 {
    let (sin, cos) = 0.3_f64.sin_cos();
    let axes = nalgebra::Matrix3::new(0.0, -sin, cos, -1.0, 0.0, 0.0, 0.0, -cos, -sin);
    let rotation = nalgebra::Rotation3::from_matrix_unchecked(axes);
    Pose3::from_parts(
        nalgebra::Translation3::new(0.0, 0.0, 0.5),
        nalgebra::UnitQuaternion::from_rotation_matrix(&rotation),
    )
}

/// Where each pixel's ray meets the floor, and its depth there, metres.
fn floor_at(idx: usize) -> Option<(Point2, f64)> {
    let ray =
        map_from_camera().rotation * CAMERA.unproject((idx % WIDTH) as f64, (idx / WIDTH) as f64, 1.0).coords;
    let depth_m = -0.5 / ray.z;
    (depth_m > 0.0).then(|| (Point2::from(ray.xy() * depth_m), depth_m))
}

fn on_rug(p: Point2) -> bool {
    (1.0..2.2).contains(&p.x) && (-0.5..0.5).contains(&p.y)
}

fn observe(area: &mut FloorArea, depth_mm: &[u16], bits: Vec<bool>) {
    let depth = DepthImage::new(CAMERA.width, CAMERA.height, depth_mm).unwrap();
    let frame = DepthFrame::new(depth, CAMERA, map_from_camera()).unwrap();
    area.observe(&frame, &Mask::new(CAMERA.width, CAMERA.height, bits).unwrap()).unwrap();
}

fn floor_mm() -> Vec<u16> {
    let depth = |idx| floor_at(idx).map_or(0.0, |(_, z)| z * 1000.0);
    (0..WIDTH * HEIGHT).map(|idx| depth(idx).min(65_535.0) as u16).collect()
}

fn rug_mask() -> Vec<bool> {
    (0..WIDTH * HEIGHT).map(|idx| floor_at(idx).is_some_and(|(p, _)| on_rug(p))).collect()
}

#[track_caller]
fn check_is_rug(area: &FloorArea) {
    let found = area.footprint().unwrap();
    for cell in found.layout().cells() {
        let c = found.layout().centre(cell);
        let inside = Point2::new((c.x - 1.6).abs() - 0.6, c.y.abs() - 0.5);
        let off_m = inside.x.max(inside.y);
        // Its edge is told to a pixel, which is longer than a cell here; what is not told counts as rug.
        if !(-0.05..=0.13).contains(&off_m) {
            assert_eq!(*found.get(cell), off_m < 0.0, "{c}");
        }
    }
}

#[test]
fn a_rug_is_where_it_lies_with_and_without_depth() {
    for depth_mm in [floor_mm(), vec![0; WIDTH * HEIGHT]] {
        let mut area = FloorArea::new(FloorConfig::default());
        for _ in 0..2 {
            observe(&mut area, &depth_mm, rug_mask());
        }
        check_is_rug(&area);
    }
}

#[test]
fn a_corner_that_was_never_seen_is_rug_and_a_notch_that_was_seen_is_not() {
    let is_corner = |p: Point2| p.x > 1.8 && p.y > 0.1;
    let check = |depth_mm: &[u16], mask: Vec<bool>, wanted: bool| {
        let mut area = FloorArea::new(FloorConfig::default());
        for _ in 0..2 {
            observe(&mut area, depth_mm, mask.clone());
        }
        let found = area.footprint().unwrap();
        let at = |x, y| *found.at(Point2::new(x, y)).unwrap();
        assert!(at(1.5, 0.0) && at(1.5, 0.4));
        assert_eq!(at(1.88, 0.18), wanted);
    };
    // Somebody stands before the corner: it is not in the mask, and not seen bare either.
    let hide = |idx: usize| floor_at(idx).is_some_and(|(p, _)| is_corner(p) || p.x > 2.2);
    let hidden: Vec<u16> =
        floor_mm().iter().enumerate().map(|(idx, mm)| if hide(idx) { 500 } else { *mm }).collect();
    let notched: Vec<bool> = rug_mask()
        .iter()
        .enumerate()
        .map(|(idx, on)| *on && !floor_at(idx).is_some_and(|(p, _)| is_corner(p)))
        .collect();
    check(&hidden, notched.clone(), true);
    check(&floor_mm(), notched, false);
}

#[test]
fn what_stands_in_front_of_the_floor_is_not_floor() {
    // Depth says that the mask shows something upright, a metre away.
    let mut area = FloorArea::new(FloorConfig::default());
    let upright: Vec<u16> = floor_mm().iter().map(|mm| (*mm).min(900)).collect();
    for _ in 0..5 {
        observe(&mut area, &upright, rug_mask());
    }
    assert!(matches!(area.footprint(), Err(OccupancyError::Nothing { .. })));
}

#[test]
fn a_rug_that_was_taken_away_is_forgotten_and_a_hidden_one_is_not() {
    let mut area = FloorArea::new(FloorConfig::default());
    for _ in 0..20 {
        observe(&mut area, &floor_mm(), rug_mask());
    }
    // Somebody stands before the camera.
    for _ in 0..20 {
        observe(&mut area, &vec![500; WIDTH * HEIGHT], vec![false; WIDTH * HEIGHT]);
    }
    check_is_rug(&area);
    for _ in 0..8 {
        observe(&mut area, &floor_mm(), vec![false; WIDTH * HEIGHT]);
    }
    assert_eq!(area.n_cells(), 0);
}

#[test]
fn one_wrong_mask_is_not_enough_and_cells_are_bounded() {
    let mut area = FloorArea::new(FloorConfig::default());
    observe(&mut area, &floor_mm(), rug_mask());
    assert!(area.footprint().is_err());
    let mut small = FloorArea::new(FloorConfig { n_cells_max: 10, ..FloorConfig::default() });
    observe(&mut small, &floor_mm(), rug_mask());
    assert!(small.n_cells() == 10 && small.n_refused() > 0);
}

#[test]
fn what_is_flat_lies_and_what_has_height_stands() {
    let flat: Vec<Point3> = (0..100).map(|i| Point3::new(f64::from(i) * 0.01, 0.0, 0.02)).collect();
    assert_eq!(object_kind(&flat), ObjectKind::FloorArea);
    let pool: Vec<Point3> = flat.iter().map(|p| Point3::new(p.x, p.y, -0.3)).collect();
    assert_eq!(object_kind(&pool), ObjectKind::FloorArea);
    let shoe: Vec<Point3> = flat.iter().map(|p| Point3::new(p.x, p.y, p.x * 0.1)).collect();
    assert_eq!(object_kind(&shoe), ObjectKind::Thing);
    assert_eq!(object_kind(&flat[..3]), ObjectKind::Unknown);
}
