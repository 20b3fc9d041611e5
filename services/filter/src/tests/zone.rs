//! The whole of it: a wish that leads through a zone, and a robot that does not go in.

use geometry::{Twist, angle::turn};
use proto::Grounding;
use rules::{Relation, Rule};

use super::bench::Bench;

/// Distance of the hull from the square that is the zone, metres.
fn hull_m(bench: &Bench, centre: [f64; 2], half_m: f64) -> f64 {
    let (x_m, y_m) = (bench.map_from_base.x_m, bench.map_from_base.y_m);
    let beyond = |offset: f64| (offset.abs() - half_m).max(0.0);
    beyond(x_m - centre[0]).hypot(beyond(y_m - centre[1])) - bench.profile.radius_m
}

/// Heads for a place at full speed, whatever lies between.
fn head_for(bench: &mut Bench, goal: [f64; 2]) {
    let pose = bench.map_from_base;
    let error_rad = turn(pose.yaw_rad, (goal[1] - pose.y_m).atan2(goal[0] - pose.x_m));
    let speed_m_s = if error_rad.abs() > 0.6 { 0.0 } else { 1.5 };
    bench.wish = Twist::new(speed_m_s, (3.0 * error_rad).clamp(-1.0, 1.0));
}

#[test]
fn a_wish_through_a_zone_never_brings_the_hull_within_the_buffer() {
    let (centre, half_m, buffer_m) = ([2.5, 0.0], 0.5, 0.4);
    let mut bench = Bench::driving();
    bench.rules(2, vec![Rule { id: "s1".into(), buffer_m, ..Rule::exclusion(Relation::Near, "crib") }]);
    bench.object("s1", Grounding::Grounded, centre, half_m);
    let mut nearest_m = f64::INFINITY;
    for k in 0..12_000 {
        if k % 50 == 0 {
            head_for(&mut bench, [4.5, 0.2]);
        }
        bench.run(1);
        nearest_m = nearest_m.min(hull_m(&bench, centre, half_m));
        assert!(nearest_m >= buffer_m, "hull {nearest_m} m from the zone at {} ms", bench.now_ms);
    }
    assert!(nearest_m < buffer_m + 0.5, "it did want through: {nearest_m}");
}

#[test]
fn a_limit_near_an_object_holds_there_and_only_there() {
    let (centre, half_m, buffer_m) = ([1.5, -1.2], 0.3, 0.8);
    let mut bench = Bench::driving();
    let slow =
        Rule { id: "s1".into(), buffer_m, vel_max: Some(0.3), ..Rule::kinematic(Relation::Near, "crib") };
    bench.rules(2, vec![slow]);
    bench.object("s1", Grounding::Grounded, centre, half_m);
    let (mut fastest_in_m_s, mut fastest_out_m_s) = (0.0_f64, 0.0_f64);
    for k in 0..7000 {
        if k % 50 == 0 {
            head_for(&mut bench, [5.0, 0.0]);
        }
        bench.run(1);
        if hull_m(&bench, centre, half_m) < buffer_m {
            fastest_in_m_s = fastest_in_m_s.max(bench.speed_m_s);
        } else {
            fastest_out_m_s = fastest_out_m_s.max(bench.speed_m_s);
        }
    }
    assert!((0.2..=0.311).contains(&fastest_in_m_s), "{fastest_in_m_s}");
    assert!(fastest_out_m_s > 0.5, "{fastest_out_m_s}");
}

#[test]
fn live_hits_that_are_on_no_map_are_not_run_into() {
    let mut bench = Bench::driving();
    bench.silence(super::bench::Feed::Scan);
    let post = geometry::Point2::new(bench.map_from_base.x_m + 1.5, 0.05);
    let mut nearest_m = f64::INFINITY;
    for k in 0..5000 {
        if k % 100 == 0 {
            let seen_base = bench.map_from_base.inverse().transform(post);
            let mut scan = bench.scan();
            scan.angle_min_rad = seen_base.y.atan2(seen_base.x);
            scan.ranges_m = vec![seen_base.coords.norm() as f32, f32::INFINITY];
            let input = crate::Input::Scan(bench.heard(scan));
            bench.give(input);
        }
        bench.wish = Twist::new(1.5, 0.0);
        bench.run(1);
        nearest_m = nearest_m.min((bench.map_from_base.position() - post).norm() - bench.profile.radius_m);
    }
    assert!((0.0..0.3).contains(&nearest_m), "{nearest_m}");
}
