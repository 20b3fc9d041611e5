//! Ground truth agrees with brute force, and says what the words mean.

use geometry::Point2;
use heedway_simulator::scene::Hull;
use heedway_simulator::truth::{GroundTruth, ObjectGap};
use proptest::prelude::*;
use serde_json::json;

use crate::bodies::{HULL, parse, room, room_with, shipped};

/// A table 1.0 × 0.6 m, its top from 0.70 to 0.74 m, on four legs, with a rug under it.
fn table() -> heedway_simulator::scene::Scene {
    let leg = |x: f64, y: f64| json!({"shape": "box", "pose": [x, y, 0, 0], "size": [0.04, 0.04, 0.7]});
    room_with(json!([
        {"id": "table", "label": "table", "pose": [3, 2.5, 0, 0], "parts": [
            {"shape": "box", "pose": [0, 0, 0.7, 0], "size": [1.0, 0.6, 0.04]},
            leg(0.48, 0.28), leg(0.48, -0.28), leg(-0.48, 0.28), leg(-0.48, -0.28)]},
        {"id": "rug", "label": "rug", "kind": "floor_area", "pose": [3, 2.5, 0, 0], "size": [2, 2, 0]}
    ]))
}

fn gap(truth: &GroundTruth, id: &str, x: f64, y: f64) -> ObjectGap {
    truth.objects(Point2::new(x, y)).into_iter().find(|gap| gap.id == id).unwrap()
}

#[test]
fn beneath_is_the_whole_top_while_the_way_between_the_legs_is_free() {
    let truth = GroundTruth::new(&table(), HULL);
    let middle = Point2::new(3.0, 2.5);
    assert!((truth.clearance_m(middle) - (0.46_f64.hypot(0.26) - 0.25)).abs() < 1e-9);
    let under = gap(&truth, "table", 3.0, 2.5).overhead_m.unwrap();
    assert!((under - (-0.3 - 0.25)).abs() < 1e-9, "{under}");
    let beside = gap(&truth, "table", 3.0, 3.2).overhead_m.unwrap();
    assert!((beside - 0.15).abs() < 1e-9, "{beside}");
    assert!((gap(&truth, "table", 3.0, 3.2).any_height_m - 0.15).abs() < 1e-9);
}

#[test]
fn a_rug_is_no_obstacle_and_has_nothing_overhead() {
    let truth = GroundTruth::new(&table(), HULL);
    let on = gap(&truth, "rug", 3.0, 2.5);
    assert_eq!((on.any_height_m, on.overhead_m), (-1.25, None));
}

#[test]
fn a_taller_robot_hits_what_a_lower_one_passes_under() {
    let tall = Hull { radius_m: 0.25, height_m: 0.8 };
    let truth = GroundTruth::new(&table(), tall);
    assert!(truth.clearance_m(Point2::new(3.0, 2.5)) < 0.0);
    assert_eq!(gap(&truth, "table", 3.0, 2.5).overhead_m, None);
}

#[test]
fn what_is_no_higher_than_two_centimetres_is_driven_over() {
    let slab = |height_m: f64| {
        let scene = room_with(json!([
            {"id": "s", "label": "slab", "pose": [3, 2.5, 0, 0], "size": [1, 1, height_m]}
        ]));
        GroundTruth::new(&scene, HULL).clearance_m(Point2::new(3.0, 2.5))
    };
    assert!(slab(0.02) > 1.0);
    assert!(slab(0.021) < 0.0);
}

#[test]
fn the_outside_of_a_floor_that_is_not_convex_is_solid() {
    let mut value = room();
    value["floor"]["polygon"] = json!([[0, 0], [6, 0], [6, 2], [2, 2], [2, 5], [0, 5]]);
    value["goal"] = json!([1, 4]);
    let truth = GroundTruth::new(&parse(&value).unwrap(), HULL);
    // Near the inner corner, which sticks into the room at (2, 2).
    let clearance_m = truth.clearance_m(Point2::new(1.7, 1.6));
    assert!((clearance_m - (0.3_f64.hypot(0.4) - 0.25)).abs() < 1e-9, "{clearance_m}");
    assert!((truth.clearance_m(Point2::new(4.0, 4.0)) - (-2.0 - 0.25)).abs() < 1e-9);
}

#[test]
fn walls_are_boxes_around_their_centre_lines() {
    let mut value = room();
    value["walls"] = json!([{"x0": 3, "y0": 1, "x1": 3, "y1": 4, "height": 2.5, "thickness": 0.2}]);
    let truth = GroundTruth::new(&parse(&value).unwrap(), HULL);
    let clearance_m = |x, y| truth.clearance_m(Point2::new(x, y));
    assert!((clearance_m(2.0, 2.5) - (0.9 - 0.25)).abs() < 1e-9);
    assert!((clearance_m(3.0, 4.5) - (0.5 - 0.25)).abs() < 1e-9);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    /// Samples the surface of everything in the band densely and takes the nearest sample.
    #[test]
    fn clearances_agree_with_a_cloud_of_points(x in 0.3..4.7_f64, y in 0.3..3.7_f64) {
        let scene = shipped("tiny.json");
        let truth = GroundTruth::new(&scene, HULL);
        let at = Point2::new(x, y);
        let step_m = 0.02;
        let mut nearest_m = x.min(5.0 - x).min(y).min(4.0 - y);
        for object in scene.objects.iter().filter(|o| o.id != "rug") {
            for [a, b, c] in object.solids.iter().flat_map(|s| s.surface()) {
                let n = (((b - a).norm().max((c - a).norm()) / step_m).ceil() as i32).max(1);
                for i in 0..=n {
                    for j in 0..=n - i {
                        let p = a + (b - a) * (f64::from(i) / f64::from(n)) + (c - a) * (f64::from(j) / f64::from(n));
                        if p.z > 0.02 && p.z < HULL.height_m {
                            nearest_m = nearest_m.min((p.xy() - at).norm());
                        }
                    }
                }
            }
        }
        let told_m = truth.clearance_m(at) + HULL.radius_m;
        // Samples lie on the surface: never nearer than the truth, and at most one step farther.
        if told_m > 0.0 {
            prop_assert!(nearest_m >= told_m - 1e-9, "{} {}", nearest_m, told_m);
            prop_assert!(nearest_m <= told_m + step_m, "{} {}", nearest_m, told_m);
        } else {
            prop_assert!(nearest_m <= 0.3);
        }
    }
}
