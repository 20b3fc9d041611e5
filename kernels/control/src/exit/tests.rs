//! Ways out of zones: in the open, around walls, and where there is none.

use std::sync::Arc;

use geometry::Profile;
use mapping::{DistanceField, Layout, Shape};

use super::*;
use crate::config::Disturbance;
use crate::dynamics::{Limits, State};
use crate::margin::{BaseLayer, Demand, RuleLayer, World};
use crate::scene::Assumptions;

fn field(distance_m: impl Fn(Point2) -> f64) -> Arc<DistanceField> {
    let layout = Layout::new(Point2::new(-5.0, -5.0), 0.05, Shape { n_cols: 200, n_rows: 200 }).unwrap();
    let values = layout.cells().map(|cell| distance_m(layout.centre(cell)) as f32).collect();
    Arc::new(DistanceField::from_values(layout, values).unwrap())
}

/// Distance to the box around (x, y) with half sides (hx, hy).
fn to_box(place: Point2, (x, y): (f64, f64), (hx, hy): (f64, f64)) -> f64 {
    let (dx, dy) = ((place.x - x).abs() - hx, (place.y - y).abs() - hy);
    dx.max(0.0).hypot(dy.max(0.0)) + dx.max(dy).min(0.0)
}

fn around(world: &World) -> Option<ExitMap> {
    let disturbance = Disturbance { position_m: 0.0, yaw_rad: 0.0, speed_m_s: 0.0, delay_s: 0.0 };
    let limits = Limits::of(&Profile::sim());
    let assumptions = Assumptions {
        limits,
        radius_m: 0.25,
        step_s: 0.05,
        disturbance,
        closing_speed_m_s: 0.0,
        braking_tail: true,
    };
    let mut map = ExitMap::default();
    map.find(&Scene::of(world, State::default(), assumptions, &|_| false)).then_some(map)
}

fn world(walls: impl Fn(Point2) -> f64, zones: &[(f64, f64, f64)]) -> World {
    let rules = zones.iter().map(|&(x, y, half)| RuleLayer {
        id: "s1".into(),
        label: "it".into(),
        demand: Demand::Exclusion { zone: field(move |p| to_box(p, (x, y), (half, half))), buffer_m: 0.0 },
    });
    let base = vec![BaseLayer { name: "the map".into(), field: field(walls) }];
    World { base, points: vec![], rules: rules.collect() }
}

#[test]
fn in_the_open_the_exit_is_straight_ahead() {
    let map = around(&world(|_| 9.0, &[(0.3, 0.0, 0.8)])).unwrap();
    // From 0 to the border at -0.5, and the hull beyond it.
    assert!((map.distance_m(Point2::origin()) - 0.77).abs() < 0.08);
    let ahead = map.along_way_out(Point2::origin(), 0.4).unwrap();
    assert!((ahead.x + 0.4).abs() < 0.1 && ahead.y.abs() < 0.1, "{ahead:?}");
}

#[test]
fn between_walls_the_way_out_goes_around_them() {
    // A wall beside the nearest border: the way leads over its end.
    let walls = |p: Point2| to_box(p, (-0.5, 0.0), (0.1, 0.8));
    let map = around(&world(walls, &[(0.0, 0.0, 1.0)])).unwrap();
    assert!(map.distance_m(Point2::origin()) > 1.2);
    let at_the_end = Point2::new(-0.5, 1.3);
    assert!(map.distance_m(at_the_end) < 0.1, "outside the zone is the exit");
}

#[test]
fn who_is_walled_in_has_no_exit() {
    let walls = |p: Point2| -to_box(p, (0.0, 0.0), (0.6, 0.6));
    assert!(around(&world(walls, &[(0.0, 0.0, 1.0)])).is_none());
}

#[test]
fn a_zone_that_the_robot_is_not_in_is_no_way_out() {
    // The second zone begins where the hull's margin to it is still positive.
    let both = world(|_| 9.0, &[(0.0, 0.0, 0.5), (-1.1, 0.0, 0.8)]);
    let open = world(|_| 9.0, &[(0.0, 0.0, 0.5)]);
    let west = Point2::new(-0.75, 0.0);
    assert!(around(&open).unwrap().distance_m(west) < 0.1);
    assert!(around(&both).unwrap().distance_m(west) > 0.3);
}
