//! The office is what the demo needs: a short way under the standing desk, and a way around.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use geometry::Point2;
use heedway_simulator::scene::{Hull, Scene};
use heedway_simulator::truth::GroundTruth;

use crate::bodies::{HULL, shipped};

const CELL_M: f64 = 0.05;
const N_COLUMNS: i32 = 160;
const N_ROWS: i32 = 120;

fn centre(cell: (i32, i32)) -> Point2 {
    Point2::new((f64::from(cell.0) + 0.5) * CELL_M, (f64::from(cell.1) + 0.5) * CELL_M)
}

/// The shortest way over cells that are free: its length in metres, and the cells (Dijkstra, 16 directions).
fn shortest(scene: &Scene, free: &dyn Fn(Point2) -> bool) -> Option<(f64, Vec<Point2>)> {
    let cell_of = |p: Point2| ((p.x / CELL_M) as i32, (p.y / CELL_M) as i32);
    let index = |(c, r): (i32, i32)| (r * N_COLUMNS + c) as usize;
    let goal = cell_of(scene.goal_map);
    let n_cells = (N_COLUMNS * N_ROWS) as usize;
    let is_free: Vec<bool> =
        (0..n_cells as i32).map(|k| free(centre((k % N_COLUMNS, k / N_COLUMNS)))).collect();
    let (mut best_um, mut from) = (vec![u64::MAX; n_cells], vec![(0, 0); n_cells]);
    let start = cell_of(scene.map_from_start.position());
    best_um[index(start)] = 0;
    let mut queue = BinaryHeap::from([Reverse((0_u64, start))]);
    while let Some(Reverse((um, cell))) = queue.pop() {
        if cell == goal {
            let mut way = vec![centre(cell)];
            let mut at = cell;
            while at != start {
                at = from[index(at)];
                way.push(centre(at));
            }
            return Some((um as f64 * 1e-6, way));
        }
        for (dc, dr) in (-2..=2).flat_map(|dc| (-2..=2).map(move |dr| (dc, dr))) {
            let next = (cell.0 + dc, cell.1 + dr);
            let inside = (0..N_COLUMNS).contains(&next.0) && (0..N_ROWS).contains(&next.1);
            if !inside || !is_free[index(next)] {
                continue;
            }
            let next_um = um + (f64::from(dc).hypot(f64::from(dr)) * CELL_M * 1e6) as u64;
            if next_um < best_um[index(next)] {
                best_um[index(next)] = next_um;
                from[index(next)] = cell;
                queue.push(Reverse((next_um, next)));
            }
        }
    }
    None
}

fn overhead_m(truth: &GroundTruth, at: Point2) -> f64 {
    let desk = truth.objects(at).into_iter().find(|gap| gap.id == "standing-desk").unwrap();
    desk.overhead_m.unwrap()
}

/// What a planner that keeps 5 cm sees of it.
const PLANNER_M: f64 = 0.05;

#[test]
fn the_shortest_way_leads_deep_under_the_desk_with_room_on_both_sides() {
    let scene = shipped("office.json");
    let truth = GroundTruth::new(&scene, HULL);
    let (length_m, way) = shortest(&scene, &|p| truth.clearance_m(p) > PLANNER_M).unwrap();
    assert!(length_m < 6.6, "{length_m}");
    // A disc of 0.25 m whose distance is −0.55 m stands 0.3 m inside.
    let deepest_m = way.iter().map(|p| overhead_m(&truth, *p)).fold(f64::INFINITY, f64::min);
    assert!(deepest_m < -0.6, "{deepest_m}");
    // With 15 cm to spare on each side there still is a way under it.
    let (roomy_m, _) = shortest(&scene, &|p| truth.clearance_m(p) > 0.15).unwrap();
    assert!((roomy_m - length_m).abs() < 0.1, "{roomy_m}");
}

#[test]
fn the_way_around_is_longer_not_too_long_and_as_wide_as_a_door() {
    let scene = shipped("office.json");
    let truth = GroundTruth::new(&scene, HULL);
    let way_around = |margin_m: f64| {
        shortest(&scene, &|p| truth.clearance_m(p) > margin_m && overhead_m(&truth, p) > margin_m)
    };
    let (around_m, _) = way_around(PLANNER_M).unwrap();
    let (under_m, _) = shortest(&scene, &|p| truth.clearance_m(p) > PLANNER_M).unwrap();
    assert!(around_m > under_m + 0.5 && around_m < 8.0, "{around_m} {under_m}");
    // Half of the tightest passage is radius + the largest margin that still lets it through.
    assert!(way_around(0.35 - 0.25).is_some(), "at least 0.7 m wide");
    assert!(way_around(0.5 - 0.25).is_none(), "at most 1.0 m wide");
}

#[test]
fn the_lower_robot_of_the_hardware_finds_both_ways_too() {
    let scene = shipped("office.json");
    let truth = GroundTruth::new(&scene, Hull { radius_m: 0.178, height_m: 0.42 });
    assert!(shortest(&scene, &|p| truth.clearance_m(p) > 0.05).is_some());
    assert!(shortest(&scene, &|p| truth.clearance_m(p) > 0.05 && overhead_m(&truth, p) > 0.05).is_some());
}

/// What stands below or above the LiDAR's plane but within the robot's height is invisible to it.
#[test]
fn what_the_lidar_cannot_see_keeps_away_from_both_ways() {
    let scene = shipped("office.json");
    let truth = GroundTruth::new(&scene, HULL);
    let plane = heedway_simulator::solid::Band { bottom_m: 0.179, top_m: 0.181 };
    let hull = heedway_simulator::solid::Band::of_hull(HULL.height_m);
    let ways = [
        shortest(&scene, &|p| truth.clearance_m(p) > PLANNER_M).unwrap().1,
        shortest(&scene, &|p| truth.clearance_m(p) > PLANNER_M && overhead_m(&truth, p) > PLANNER_M)
            .unwrap()
            .1,
    ];
    let mut n_unseen = 0;
    for object in scene.objects.iter().filter(|o| o.id != "rug") {
        for solid in &object.solids {
            let unseen = solid.slice(plane).is_empty() && !solid.slice(hull).is_empty();
            n_unseen += u32::from(unseen);
            for at in ways.iter().flatten().filter(|_| unseen) {
                let gap_m = solid.slice(hull).iter().map(|a| a.distance_m(*at)).fold(f64::INFINITY, f64::min);
                assert!(gap_m - HULL.radius_m > 0.4, "{} is {gap_m} m from {at}", object.id);
            }
        }
    }
    assert!(n_unseen > 10, "star bases and seats are there");
}
