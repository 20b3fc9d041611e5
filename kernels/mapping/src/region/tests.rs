use proptest::prelude::*;

use super::*;
use crate::raster::{mark_box, mark_polygon};
use geometry::Polygon;

fn layout() -> Layout {
    Layout::covering(Point2::new(-6.0, -6.0), Point2::new(6.0, 6.0), 0.05).unwrap()
}

fn block(low: (f64, f64), high: (f64, f64)) -> Grid<bool> {
    let mut grid = Grid::filled(layout(), false);
    mark_box(&mut grid, Point2::new(low.0 + 0.01, low.1 + 0.01), Point2::new(high.0 - 0.01, high.1 - 0.01));
    grid
}

fn seen_from(x: f64, y: f64) -> Option<Pose2> {
    Some(Pose2::new(x, y, 0.0))
}

/// Whether a point is in the region of a block of 1 × 0.6 m around the origin, seen from (−3, 0).
#[track_caller]
fn check(relation: Relation, point: (f64, f64), is_in: bool) {
    let object = block((-0.3, -0.5), (0.3, 0.5));
    let found = region(relation, &object, None, seen_from(-3.0, 0.0), layout()).unwrap();
    assert_eq!(found.at(Point2::new(point.0, point.1)), Some(&is_in), "{relation:?} {point:?}");
}

#[test]
fn sides_are_as_the_robot_saw_them() {
    check(Relation::LeftOf, (0.0, 1.0), true);
    check(Relation::LeftOf, (0.0, -1.0), false);
    check(Relation::LeftOf, (0.0, 0.0), false);
    check(Relation::RightOf, (0.0, -1.0), true);
    check(Relation::RightOf, (0.0, 1.0), false);
    check(Relation::FrontOf, (-1.0, 0.0), true);
    check(Relation::FrontOf, (1.0, 0.0), false);
    check(Relation::Behind, (1.0, 0.0), true);
    check(Relation::Behind, (-1.0, 0.0), false);
}

#[test]
fn a_side_reaches_a_metre_and_a_half_or_the_width_of_the_object() {
    check(Relation::Behind, (0.3 + 1.45, 0.0), true);
    check(Relation::Behind, (0.3 + 1.60, 0.0), false);
    let wide = block((-0.3, -1.5), (0.3, 1.5));
    let found = region(Relation::LeftOf, &wide, None, seen_from(-3.0, 0.0), layout()).unwrap();
    assert_eq!(found.at(Point2::new(0.0, 1.5 + 2.9)), Some(&true));
    assert_eq!(found.at(Point2::new(0.0, 1.5 + 3.2)), Some(&false));
}

#[test]
fn beyond_is_everything_past_the_object() {
    check(Relation::Beyond, (1.0, 5.0), true);
    check(Relation::Beyond, (0.5, -5.0), true);
    check(Relation::Beyond, (-0.5, 5.0), false);
    check(Relation::Beyond, (-2.0, 0.0), false);
}

#[test]
fn past_a_tape_is_past_its_own_line_however_it_is_looked_at() {
    let tape = block((0.0, -2.0), (0.1, 2.0));
    let found = region(Relation::Beyond, &tape, None, seen_from(-2.0, -2.0), layout()).unwrap();
    assert_eq!(found.at(Point2::new(0.5, -4.0)), Some(&true));
    assert_eq!(found.at(Point2::new(-0.5, 4.0)), Some(&false));
}

#[test]
fn between_two_objects_is_the_gap_and_not_the_objects() {
    let (a, b) = (block((-2.0, -0.5), (-1.0, 0.5)), block((1.0, -0.5), (2.0, 0.5)));
    let found = region(Relation::Between, &a, Some(&b), None, layout()).unwrap();
    assert_eq!(found.at(Point2::new(0.0, 0.0)), Some(&true));
    assert_eq!(found.at(Point2::new(-0.96, 0.46)), Some(&true));
    assert_eq!(found.at(Point2::new(-1.5, 0.0)), Some(&false));
    assert_eq!(found.at(Point2::new(0.0, 0.8)), Some(&false));
    assert_eq!(found.at(Point2::new(2.5, 0.0)), Some(&false));
}

#[test]
fn between_several_things_is_beside_each_and_not_the_hull_of_all() {
    let table = block((1.0, -0.5), (2.0, 0.5));
    let (near, far) = (((-1.0, -0.5), (-0.6, 0.5)), ((1.2, 4.0), (1.8, 4.4)));
    let mut chairs = block(near.0, near.1);
    merge_into(&mut chairs, &block(far.0, far.1));
    let found = region(Relation::Between, &chairs, Some(&table), None, layout()).unwrap();
    let is_in = |x: f64, y: f64| found.at(Point2::new(x, y)) == Some(&true);
    assert!(is_in(0.2, 0.0) && is_in(1.5, 2.0), "the gap of each chair");
    assert!(!is_in(0.0, 2.0), "the hull of both chairs");
    // Two halves of one sofa are one thing.
    let mut sofa = block((-1.0, -1.0), (-0.6, -0.1));
    merge_into(&mut sofa, &block((-1.0, 0.1), (-0.6, 1.0)));
    let whole = block((-1.0, -1.0), (-0.6, 1.0));
    let of_halves = region(Relation::Between, &sofa, Some(&table), None, layout()).unwrap();
    let of_whole = region(Relation::Between, &whole, Some(&table), None, layout()).unwrap();
    let is_sofa = |idx: usize| whole.values()[idx];
    for (idx, (one, other)) in of_halves.values().iter().zip(of_whole.values()).enumerate() {
        assert!(one == other || is_sofa(idx), "cell {idx}");
    }
}

#[test]
fn what_is_missing_is_an_error_and_not_a_guess() {
    let object = block((-0.3, -0.5), (0.3, 0.5));
    let empty = Grid::filled(layout(), false);
    for relation in
        [Relation::Beyond, Relation::LeftOf, Relation::RightOf, Relation::FrontOf, Relation::Behind]
    {
        assert_eq!(region(relation, &object, None, None, layout()), Err(RegionError::Anchor(relation)));
        let lost = seen_from(f64::NAN, 0.0);
        assert_eq!(region(relation, &object, None, lost, layout()), Err(RegionError::Anchor(relation)));
    }
    assert_eq!(region(Relation::Between, &object, None, None, layout()), Err(RegionError::Second));
    let with_nothing = region(Relation::Between, &object, Some(&empty), None, layout());
    assert_eq!(with_nothing, Err(RegionError::Empty));
    assert_eq!(region(Relation::Near, &empty, None, None, layout()), Err(RegionError::Empty));
    assert_eq!(region(Relation::Near, &object, None, None, layout()).unwrap(), object);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn sides_turn_with_the_scene(angle_rad in -3.1..3.1_f64, askew_rad in -0.5..0.5_f64) {
        // A block that stands askew, seen from two metres away, the whole turned around the origin.
        let turned = |p: Point2| Pose2::new(0.0, 0.0, angle_rad).transform(p);
        let corners = [(-0.5, -0.3), (0.5, -0.3), (0.5, 0.3), (-0.5, 0.3)]
            .map(|(x, y)| turned(Pose2::new(0.0, 0.0, askew_rad).transform(Point2::new(x, y))));
        let mut object = Grid::filled(layout(), false);
        mark_polygon(&mut object, &Polygon::new(corners.to_vec()).unwrap());
        let eye = turned(Point2::new(-2.0, 0.0));
        let anchor = Some(Pose2::new(eye.x, eye.y, 0.0));
        for (relation, x, y) in [
            (Relation::LeftOf, 0.0, 1.0), (Relation::RightOf, 0.0, -1.0),
            (Relation::FrontOf, -1.0, 0.0), (Relation::Behind, 1.0, 0.0),
        ] {
            let found = region(relation, &object, None, anchor, layout()).unwrap();
            prop_assert_eq!(found.at(turned(Point2::new(x, y))), Some(&true));
            prop_assert_eq!(found.at(turned(Point2::new(-x, -y))), Some(&false));
            // The object's middle is never of its own side.
            prop_assert_eq!(found.at(Point2::origin()), Some(&false));
        }
    }

    #[test]
    fn the_hull_holds_all_points(points in prop::collection::vec((-5.0..5.0_f64, -5.0..5.0_f64), 3..60)) {
        let points: Vec<Point2> = points.into_iter().map(|(x, y)| Point2::new(x, y)).collect();
        let hull = convex_hull(points.clone());
        let polygon = Polygon::new(hull).unwrap();
        for point in points {
            prop_assert!(polygon.signed_distance_m(point) < 1e-9);
        }
    }
}
