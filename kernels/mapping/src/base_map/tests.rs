use std::f64::consts::TAU;

use proptest::prelude::*;

use super::*;

fn turn(ranges_m: &[f32]) -> Scan<'_> {
    Scan {
        ranges_m,
        angle_min_rad: 0.0,
        angle_increment_rad: TAU / ranges_m.len() as f64,
        range_min_m: 0.1,
        range_max_m: 8.0,
        no_return_is_free: false,
    }
}

/// What a LiDAR at `eye` sees in a room of 6 × 4 m around the origin.
fn room(eye: Point2, n: usize) -> Vec<f32> {
    let beam = |idx: usize| {
        let (sin, cos) = (idx as f64 * TAU / n as f64).sin_cos();
        let x_m = if cos > 0.0 { (3.0 - eye.x) / cos } else { (-3.0 - eye.x) / cos };
        let y_m = if sin > 0.0 { (2.0 - eye.y) / sin } else { (-2.0 - eye.y) / sin };
        x_m.min(y_m) as f32
    };
    (0..n).map(beam).collect()
}

fn mapper() -> BaseMapper {
    BaseMapper::new(BaseMapConfig::default(), Point2::origin()).unwrap()
}

fn state(map: &BaseMapper, x: f64, y: f64) -> Occupancy {
    map.occupancy().at(Point2::new(x, y)).copied().unwrap_or_default()
}

#[test]
fn a_room_is_free_inside_and_has_walls_and_nothing_is_known_behind_them() {
    let mut map = mapper();
    for step in 0..8 {
        let eye = Point2::new(-2.0 + 0.5 * f64::from(step), 0.3);
        map.integrate(&turn(&room(eye, 720)), Pose2::new(eye.x, eye.y, 0.0)).unwrap();
    }
    for y in [-1.9, -1.0, 0.0, 1.0, 1.9] {
        assert_eq!(state(&map, -2.9, y), Occupancy::Free, "{y}");
        assert_eq!(state(&map, 3.2, y), Occupancy::Unknown, "{y}");
        let wall = (0..3).any(|i| state(&map, 2.95 + 0.05 * f64::from(i), y) == Occupancy::Occupied);
        assert!(wall, "no wall at {y}");
    }
}

proptest! {
    #[test]
    fn no_beam_frees_the_cell_it_hits(
        x in -2.5..2.5_f64, y in -1.5..1.5_f64, yaw in -3.0..3.0_f64,
        ranges in prop::collection::vec(0.1..7.9_f32, 1..200),
    ) {
        let mut map = mapper();
        let pose = Pose2::new(x, y, yaw);
        map.integrate(&turn(&ranges), pose).unwrap();
        let occupancy = map.occupancy();
        for (idx, range_m) in ranges.iter().enumerate() {
            let angle = idx as f64 * TAU / ranges.len() as f64;
            let end = Point2::new(f64::from(*range_m) * angle.cos(), f64::from(*range_m) * angle.sin());
            prop_assert_eq!(occupancy.at(pose.transform(end)), Some(&Occupancy::Occupied));
        }
    }

    #[test]
    fn all_that_a_beam_passes_is_known(
        x in -2.5..2.5_f64, y in -1.5..1.5_f64, yaw in -3.0..3.0_f64, range in 0.2..7.9_f32, t in 0.0..1.0_f64,
    ) {
        let mut map = mapper();
        let pose = Pose2::new(x, y, yaw);
        map.integrate(&turn(&[range]), pose).unwrap();
        let on_way = pose.transform(Point2::new(f64::from(range) * t, 0.0));
        prop_assert_ne!(state(&map, on_way.x, on_way.y), Occupancy::Unknown);
    }

    #[test]
    fn growing_moves_no_cell(x in -40.0..40.0_f64, y in -40.0..40.0_f64) {
        let mut map = mapper();
        map.integrate(&turn(&[2.0; 4]), Pose2::IDENTITY).unwrap();
        let before = map.occupancy();
        map.integrate(&turn(&[0.5; 4]), Pose2::new(x, y, 0.0)).unwrap();
        let after = map.occupancy();
        for cell in before.layout().cells() {
            let c = before.layout().centre(cell);
            if (c - Point2::new(x, y)).norm() > 1.0 {
                prop_assert_eq!(after.at(c), Some(before.get(cell)));
            }
        }
    }
}

#[test]
fn a_beam_without_return_frees_only_where_that_means_nothing_there() {
    for no_return in [0.0, 9.0, f32::INFINITY] {
        let (mut map, ranges_m) = (mapper(), [no_return]);
        map.integrate(&turn(&ranges_m), Pose2::IDENTITY).unwrap();
        assert_eq!(state(&map, 1.0, 0.0), Occupancy::Unknown);
        let scan = Scan { no_return_is_free: true, ..turn(&ranges_m) };
        map.integrate(&scan, Pose2::IDENTITY).unwrap();
        assert_eq!(state(&map, 1.0, 0.0), Occupancy::Free);
        assert_eq!(state(&map, 7.9, 0.0), Occupancy::Free);
        assert!(!map.occupancy().values().contains(&Occupancy::Occupied));
    }
}

#[test]
fn nan_and_what_is_too_near_says_nothing() {
    let mut map = mapper();
    let scan = Scan { no_return_is_free: true, ..turn(&[f32::NAN, 0.05, -1.0]) };
    map.integrate(&scan, Pose2::IDENTITY).unwrap();
    assert!(map.occupancy().values().iter().all(|o| *o == Occupancy::Unknown));
}

#[test]
fn what_went_away_is_freed() {
    let mut map = mapper();
    for _ in 0..50 {
        map.integrate(&turn(&[1.0]), Pose2::IDENTITY).unwrap();
    }
    for _ in 0..10 {
        map.integrate(&turn(&[4.0]), Pose2::IDENTITY).unwrap();
    }
    assert_eq!(state(&map, 1.0, 0.0), Occupancy::Free);
}

#[test]
fn the_robot_does_not_start_in_the_unknown() {
    let mut map = mapper();
    map.integrate(&turn(&[0.22]), Pose2::IDENTITY).unwrap();
    map.free_disc(Point2::origin(), 0.25).unwrap();
    assert_eq!(state(&map, 0.0, -0.24), Occupancy::Free);
    assert_eq!(state(&map, 0.0, 0.4), Occupancy::Unknown);
    // What was seen to stand there stays.
    assert_eq!(state(&map, 0.22, 0.0), Occupancy::Occupied);
}

#[test]
fn a_scan_or_pose_that_cannot_be_leaves_the_map_as_it_was() {
    let mut map = mapper();
    let before = map.occupancy();
    let lost = Pose2 { x_m: f64::NAN, ..Pose2::IDENTITY };
    assert_eq!(map.integrate(&turn(&[1.0]), lost), Err(BaseMapError::Pose));
    let scan = Scan { range_max_m: 0.0, ..turn(&[1.0]) };
    assert!(matches!(map.integrate(&scan, Pose2::IDENTITY), Err(BaseMapError::Scan { .. })));
    let far = Pose2::new(1e4, 0.0, 0.0);
    assert!(matches!(map.integrate(&turn(&[1.0]), far), Err(BaseMapError::Grid(_))));
    assert!(map.free_disc(Point2::origin(), f64::INFINITY).is_err());
    assert_eq!(map.occupancy(), before);
}
