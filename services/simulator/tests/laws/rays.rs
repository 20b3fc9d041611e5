//! What sensors see agrees with geometry done by hand.

use geometry::{CameraIntrinsics, Point3, Pose2, Profile};
use heedway_simulator::footprint::Footprint;
use heedway_simulator::raycast::{INSTANCE_FLOOR, INSTANCE_OBJECTS, INSTANCE_WALL, Image, RayCaster};
use heedway_simulator::scene::Scene;
use heedway_simulator::solid::Band;
use proptest::prelude::*;
use serde_json::json;

use crate::bodies::{parse, room, room_with};

const SMALL: CameraIntrinsics =
    CameraIntrinsics { width: 80, height: 60, fx: 75.0, fy: 75.0, cx: 39.5, cy: 29.5 };

fn look(scene: &Scene, map_from_base: Pose2) -> Image {
    let map_from_camera = map_from_base.lifted(0.0) * Profile::sim().camera.base_from_camera();
    RayCaster::new(scene).unwrap().image(&map_from_camera, &SMALL, 6.0)
}

fn at(image: &Image, u: usize, v: usize) -> (u16, u16) {
    let idx = v * 80 + u;
    (image.depth_mm[idx], image.seen.instances[idx])
}

/// Distance along a ray to an upright box that is not turned, by slabs; infinite when it is missed.
fn slab_hit(from: Point3, direction: nalgebra::Vector3<f64>, low: [f64; 3], high: [f64; 3]) -> f64 {
    let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
    for axis in 0..3 {
        let (a, b) =
            ((low[axis] - from[axis]) / direction[axis], (high[axis] - from[axis]) / direction[axis]);
        enter = enter.max(a.min(b));
        leave = leave.min(a.max(b));
    }
    if enter <= leave { enter } else { f64::INFINITY }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn depths_of_boxes_floor_and_walls_are_the_analytic_ones(
        x in 2.5..4.0_f64, y in 1.5..3.5_f64, z in 0.0..0.5_f64, yaw in -0.3..0.3_f64,
        (sx, sy, sz) in (0.1..1.0_f64, 0.1..1.5_f64, 0.1..1.0_f64),
    ) {
        let scene = room_with(json!([{"id": "b", "label": "box", "pose": [x, y, z, 0], "size": [sx, sy, sz]}]));
        let map_from_base = Pose2::new(0.6, 2.5, yaw);
        let image = look(&scene, map_from_base);
        let map_from_camera = map_from_base.lifted(0.0) * Profile::sim().camera.base_from_camera();
        let eye = Point3::from(map_from_camera.translation.vector);
        // From within a body its faces can lie in another's: which of the two is seen is a tie.
        let here = Band { bottom_m: eye.z - 0.01, top_m: eye.z + 0.01 };
        prop_assume!(scene.objects.iter().all(|o| Footprint::of(&o.solids, here).distance_m(eye.xy()) > 0.01));
        let mut n_border = 0;
        for v in 0..60 {
            for u in 0..80 {
                let direction = map_from_camera.rotation * SMALL.unproject(u as f64, v as f64, 1.0).coords;
                let of_box = slab_hit(eye, direction, [x - sx / 2.0, y - sy / 2.0, z], [x + sx / 2.0, y + sy / 2.0, z + sz]);
                let of_floor = if direction.z < 0.0 { -eye.z / direction.z } else { f64::INFINITY };
                let of_walls = slab_hit(
                    eye + direction * 20.0, -direction, [0.0, 0.0, 0.0], [6.0, 5.0, 3.0],
                );
                let of_walls = if of_walls.is_finite() { 20.0 - of_walls } else { f64::INFINITY };
                let ceiling = eye.z + direction.z * of_walls > 3.0 - 1e-6;
                let nearest = of_box.min(of_floor).min(if ceiling { f64::INFINITY } else { of_walls });
                let wanted_mm = if nearest <= 6.0 { (nearest * 1000.0).round() } else { 0.0 };
                let (depth_mm, instance) = at(&image, u, v);
                // Rays along an edge may go either way, and the reach may fall within a rounding.
                if (f64::from(depth_mm) - wanted_mm).abs() > 1.0 {
                    n_border += 1;
                    continue;
                }
                if of_box < of_floor.min(of_walls) - 0.01 {
                    prop_assert_eq!(instance, INSTANCE_OBJECTS);
                }
            }
        }
        prop_assert!(n_border <= 8, "{} pixels differ", n_border);
    }

    #[test]
    fn each_pixel_shows_what_its_own_ray_meets(x in 0.5..7.5_f64, y in 0.5..5.5_f64, yaw in -3.0..3.0_f64) {
        let scene = crate::bodies::shipped("office.json");
        let rays = RayCaster::new(&scene).unwrap();
        let map_from_camera = Pose2::new(x, y, yaw).lifted(0.0) * Profile::sim().camera.base_from_camera();
        let image = rays.image(&map_from_camera, &SMALL, 65.0);
        let rug = INSTANCE_OBJECTS + scene.objects.iter().position(|o| o.id == "rug").unwrap() as u16;
        let eye = Point3::from(map_from_camera.translation.vector);
        // From within a body its faces can lie in another's: which of the two is seen is a tie.
        let here = Band { bottom_m: eye.z - 0.01, top_m: eye.z + 0.01 };
        prop_assume!(scene.objects.iter().all(|o| Footprint::of(&o.solids, here).distance_m(eye.xy()) > 0.01));
        let mut n_border = 0;
        for v in 0..60 {
            for u in 0..80 {
                let direction = map_from_camera.rotation * SMALL.unproject(u as f64, v as f64, 1.0).coords;
                let (instance, depth_m) = rays.first_hit(eye, direction).unwrap_or((0, 0.0));
                let (depth_mm, shown) = at(&image, u, v);
                let shown = if shown == rug { INSTANCE_FLOOR } else { shown };
                // Rays along an edge, or where two faces meet, may go either way.
                let differs = shown != instance || (f64::from(depth_mm) / 1000.0 - depth_m).abs() > 0.002;
                n_border += u32::from(differs);
            }
        }
        prop_assert!(n_border <= 5, "{} of 4800 pixels differ", n_border);
    }

    #[test]
    fn lidar_ranges_in_an_empty_room_are_those_of_its_walls(
        x in 0.5..5.5_f64, y in 0.5..4.5_f64, yaw in -3.0..3.0_f64,
    ) {
        let rays = RayCaster::new(&parse(&room()).unwrap()).unwrap();
        let ranges = rays.scan(Pose2::new(x, y, yaw), 0.18, 360, 12.0);
        prop_assert_eq!(ranges.len(), 360);
        for (k, range) in ranges.iter().enumerate() {
            let (sin, cos) = (yaw + (k as f64).to_radians()).sin_cos();
            let to_x = if cos > 0.0 { (6.0 - x) / cos } else { -x / cos };
            let to_y = if sin > 0.0 { (5.0 - y) / sin } else { -y / sin };
            prop_assert!((f64::from(*range) - to_x.min(to_y)).abs() < 1e-4);
        }
    }
}

#[test]
fn a_cylinder_is_as_far_away_as_its_radius_says_and_thin_parts_are_seen() {
    let scene = room_with(json!([
        {"id": "c", "label": "column", "pose": [3, 2.5, 0, 0], "parts": [{"shape": "cylinder", "size": [0.4, 1.0]}]}
    ]));
    let rays = RayCaster::new(&scene).unwrap();
    let ranges = rays.scan(Pose2::new(1.0, 2.5, 0.0), 0.18, 720, 12.0);
    assert!((ranges[0] - 1.6).abs() < 0.003, "{}", ranges[0]);
    // The tangent leaves at asin(0.4 / 2) = 11.54°.
    assert!(ranges[22] < 2.1 && ranges[24] > 2.5, "{:?}", &ranges[21..26]);
}

#[test]
fn what_is_below_or_above_the_lidar_is_not_in_its_turn() {
    let scene = room_with(json!([
        {"id": "low", "label": "base", "pose": [2.0, 2.5, 0, 0], "size": [0.4, 0.4, 0.1]},
        {"id": "high", "label": "top", "pose": [3.0, 2.5, 0.7, 0], "size": [0.4, 0.4, 0.1]}
    ]));
    let ranges = RayCaster::new(&scene).unwrap().scan(Pose2::new(1.0, 2.5, 0.0), 0.18, 360, 12.0);
    assert!((ranges[0] - 5.0).abs() < 1e-3);
    let short = RayCaster::new(&scene).unwrap().scan(Pose2::new(1.0, 2.5, 0.0), 0.18, 360, 4.0);
    assert_eq!(short[0], f32::INFINITY);
}

#[test]
fn rugs_lie_on_the_floor_and_the_floor_beside_them_is_floor() {
    let scene = room_with(json!([
        {"id": "r", "label": "rug", "kind": "floor_area", "pose": [2.5, 2.5, 0, 0], "size": [1.0, 4.0, 0.0]}
    ]));
    let image = look(&scene, Pose2::new(0.6, 2.5, 0.0));
    // The camera is 0.4 m high at x = 0.7. Row 50 looks down by 20.5 / 75: it meets the floor at a depth
    // of 1.463 m, on the rug, which reaches from x = 2 to 3. Row 58 meets it at x = 1.75, row 41 at 3.31.
    assert_eq!(at(&image, 40, 58), (1053, INSTANCE_FLOOR));
    assert_eq!(at(&image, 40, 50), (1463, INSTANCE_OBJECTS));
    assert_eq!(at(&image, 40, 41).1, INSTANCE_FLOOR);
    assert_eq!(at(&image, 40, 20).1, INSTANCE_WALL);
}

#[test]
fn a_floor_that_is_not_convex_has_walls_at_its_inner_corner() {
    let mut value = room();
    value["floor"]["polygon"] = json!([[0, 0], [6, 0], [6, 2], [2, 2], [2, 5], [0, 5]]);
    value["goal"] = json!([1, 4]);
    let rays = RayCaster::new(&parse(&value).unwrap()).unwrap();
    let ranges = rays.scan(Pose2::new(1.0, 1.0, 0.0), 0.18, 360, 12.0);
    assert!((ranges[0] - 5.0).abs() < 1e-3, "along the lower arm");
    assert!((f64::from(ranges[60]) - 2.0_f64.sqrt()).abs() > 0.1 && ranges[60] < 2.1, "inner wall");
    assert!((ranges[90] - 4.0).abs() < 1e-3, "along the upper arm");
    assert!((f64::from(ranges[30]) - 1.0 / 30.0_f64.to_radians().sin()).abs() < 1e-3, "inner wall");
}

#[test]
fn two_pictures_of_the_same_pose_are_the_same() {
    let scene = crate::bodies::shipped("tiny.json");
    assert_eq!(look(&scene, scene.map_from_start), look(&scene, scene.map_from_start));
}
