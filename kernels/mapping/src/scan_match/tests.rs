//! Scans of a room with a corner in it, found again.

use std::f64::consts::{PI, TAU};

use geometry::Point2;
use proptest::prelude::*;

use super::*;
use crate::base_map::Scan;

/// Walls, from point to point, metres: no two views of this room are alike.
const WALLS: [[f64; 4]; 6] = [
    [-3.0, -2.0, 4.0, -2.0],
    [4.0, -2.0, 4.0, 3.0],
    [4.0, 3.0, 0.5, 3.0],
    [0.5, 3.0, 0.5, 1.5],
    [0.5, 1.5, -3.0, 1.5],
    [-3.0, 1.5, -3.0, -2.0],
];
const N_BEAMS: usize = 360;

/// What a LiDAR sees from a pose inside.
fn seen_from(room_from_lidar: Pose2) -> Cloud {
    seen_among(&WALLS, room_from_lidar)
}

fn seen_among(walls: &[[f64; 4]], room_from_lidar: Pose2) -> Cloud {
    let range = |idx: usize| {
        let angle_rad = room_from_lidar.yaw_rad + idx as f64 * TAU / N_BEAMS as f64;
        let (ray, eye) = (Point2::new(angle_rad.cos(), angle_rad.sin()), room_from_lidar.position());
        let hit = |[ax, ay, bx, by]: [f64; 4]| {
            let (wx, wy) = (bx - ax, by - ay);
            let across = ray.x * wy - ray.y * wx;
            let along = ((ax - eye.x) * wy - (ay - eye.y) * wx) / across;
            let share = ((ax - eye.x) * ray.y - (ay - eye.y) * ray.x) / across;
            if along > 0.0 && (-1e-9..=1.0 + 1e-9).contains(&share) { along } else { f64::INFINITY }
        };
        walls.iter().copied().map(hit).fold(f64::INFINITY, f64::min) as f32
    };
    let ranges_m: Vec<f32> = (0..N_BEAMS).map(range).collect();
    let scan = Scan {
        ranges_m: &ranges_m,
        angle_min_rad: 0.0,
        angle_increment_rad: TAU / N_BEAMS as f64,
        range_min_m: 0.05,
        range_max_m: 20.0,
        no_return_is_free: false,
    };
    Cloud::of_scan(&scan, Pose2::IDENTITY, 20.0)
}

fn room() -> MatchMap {
    let mut map = MatchMap::new(0.05);
    for pose in [Pose2::IDENTITY, Pose2::new(1.0, 0.2, 0.3), Pose2::new(2.0, 1.5, -1.0)] {
        map.insert(&seen_from(pose), pose);
    }
    map
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn a_scan_is_found_where_it_was_taken_however_far_off_the_guess(
        x in -1.5..2.5_f64, y in -1.2..0.8_f64, yaw in -PI..PI,
        off_x in -0.8..0.8_f64, off_y in -0.8..0.8_f64, off_yaw in -0.6..0.6_f64,
    ) {
        let truth = Pose2::new(x, y, yaw);
        let guess = Pose2::new(x + off_x, y + off_y, yaw + off_yaw);
        let prior = Prior { map_from_scan: guess, shift_m: 1.0, turn_rad: 0.7 };
        let window = Window { shift_m: 1.0, turn_rad: 0.7 };
        let found = find(&room(), &seen_from(truth), &prior, window).unwrap();
        let off = truth.inverse() * found.map_from_scan;
        prop_assert!(off.position().coords.norm() < 0.015 && off.yaw_rad.abs() < 0.006, "{off:?} off");
        prop_assert!(found.inlier_share > 0.9);
    }

    #[test]
    fn what_is_clear_at_a_glance_is_where_the_scan_was_taken_however_the_robot_turned(
        x in -1.5..2.5_f64, y in -1.2..0.8_f64, yaw in -PI..PI,
        off_x in -0.9..0.9_f64, off_y in -0.9..0.9_f64, off_yaw in -1.6..1.6_f64,
    ) {
        let truth = Pose2::new(x, y, yaw);
        let guess = Pose2::new(x + off_x, y + off_y, yaw + off_yaw);
        let prior = Prior { map_from_scan: guess, shift_m: 0.5, turn_rad: 0.6 };
        let window = Window { shift_m: 1.0, turn_rad: 1.8 };
        let is_clear = |c: &Candidate| c.found.inlier_share >= 0.7 && c.evidence.share() >= 0.85;
        if let Some(clear) = at_a_glance(&room(), &seen_from(truth), &prior, window, is_clear) {
            let off = truth.inverse() * clear.found.map_from_scan;
            prop_assert!(off.position().coords.norm() < 0.015 && off.yaw_rad.abs() < 0.006, "{off:?} off");
        }
    }
}

#[test]
fn a_room_is_clear_at_a_glance_and_nothing_is_along_a_corridor_or_when_it_does_not_satisfy() {
    let window = Window { shift_m: 1.0, turn_rad: 1.0 };
    let prior = Prior { map_from_scan: Pose2::new(0.4, -0.3, 0.5), shift_m: 0.5, turn_rad: 0.5 };
    let scan = seen_from(Pose2::new(0.5, 0.1, 0.0));
    let clear = at_a_glance(&room(), &scan, &prior, window, |_| true).unwrap();
    let full = candidates(&room(), &scan, &prior, window, 1);
    let off = full[0].found.map_from_scan.inverse() * clear.found.map_from_scan;
    assert!(off.position().coords.norm() < 0.005 && off.yaw_rad.abs() < 0.002, "{off:?} off");
    assert_eq!(at_a_glance(&room(), &scan, &prior, window, |_| false), None);
    let corridor = [[-30.0, -1.0, 30.0, -1.0], [-30.0, 1.0, 30.0, 1.0]];
    let mut map = MatchMap::new(0.05);
    for x_m in [-2.0, 0.0, 2.0] {
        let pose = Pose2::new(x_m, 0.0, 0.0);
        map.insert(&seen_among(&corridor, pose), pose);
    }
    let scan = seen_among(&corridor, Pose2::new(0.5, 0.1, 0.0));
    let prior = Prior { shift_m: 4.0, ..prior };
    let window = Window { shift_m: 3.0, ..window };
    assert_eq!(at_a_glance(&map, &scan, &prior, window, |_| true), None);
}

#[test]
fn nothing_is_found_in_an_empty_map_or_for_an_empty_scan() {
    let prior = Prior { map_from_scan: Pose2::IDENTITY, shift_m: 1.0, turn_rad: 1.0 };
    let window = Window { shift_m: 1.0, turn_rad: 1.0 };
    assert_eq!(find(&MatchMap::new(0.05), &seen_from(Pose2::IDENTITY), &prior, window), None);
    assert_eq!(find(&room(), &Cloud::default(), &prior, window), None);
    let nowhere = Prior { map_from_scan: Pose2 { x_m: f64::NAN, ..Pose2::IDENTITY }, ..prior };
    assert_eq!(find(&room(), &seen_from(Pose2::IDENTITY), &nowhere, window), None);
}
