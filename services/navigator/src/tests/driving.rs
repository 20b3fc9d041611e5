//! To the goal: around boxes, around regions or through them, and why not.

use geometry::{Point2, Twist};
use proto::{DepthObstacles, Goal};
use rules::{Relation, Rule};

use super::bench::{Bench, Box2};
use crate::Input;
use crate::config::Planner;

const BOX: Box2 = ([-0.6, -1.0], [0.6, 1.2]);

fn distance_m(bench: &Bench, x_m: f64, y_m: f64) -> f64 {
    (bench.map_from_base.position() - Point2::new(x_m, y_m)).norm()
}

fn keep_out(buffer_m: f64) -> Rule {
    Rule { id: "s1".into(), buffer_m, ..Rule::exclusion(Relation::Near, "crib") }
}

#[test]
fn it_drives_around_a_box_to_the_goal_and_stands_there() {
    let mut bench = Bench::new(Planner::Base);
    bench.room(&[BOX]);
    bench.goal(3.0, 0.3);
    let nearest_m = bench.run(15_000, &[BOX]);
    assert_eq!(bench.state(), "arrived");
    assert!(distance_m(&bench, 3.0, 0.3) <= 0.2);
    assert_eq!((bench.speed_m_s, bench.command.as_ref().unwrap().twist), (0.0, Twist::ZERO));
    assert!(nearest_m[0] > 0.0, "hull {} m from the box", nearest_m[0]);
}

#[test]
fn regions_of_rules_are_walls_only_for_the_planner_that_sees_them() {
    for planner in [Planner::Base, Planner::BaseAndRules] {
        let mut bench = Bench::new(planner);
        bench.room(&[]);
        bench.rule(keep_out(0.3), &BOX);
        bench.goal(3.0, 0.3);
        let nearest_m = bench.run(15_000, &[BOX]);
        assert_eq!(bench.state(), "arrived");
        match planner {
            Planner::Base => assert!(nearest_m[0] < 0.0, "{nearest_m:?}"),
            Planner::BaseAndRules => assert!(nearest_m[0] >= 0.3, "{nearest_m:?}"),
        }
    }
}

#[test]
fn what_the_camera_saw_is_driven_around_too() {
    let mut bench = Bench::new(Planner::Base);
    bench.room(&[]);
    let header = bench.header();
    let cells = Some(Bench::cells(&BOX));
    bench.give(Input::DepthObstacles(DepthObstacles { header, map_epoch: 1, cells }));
    bench.goal(3.0, 0.3);
    let nearest_m = bench.run(15_000, &[BOX]);
    assert_eq!(bench.state(), "arrived");
    assert!(nearest_m[0] > 0.0);
}

#[test]
fn a_limit_near_an_object_is_no_wall_but_a_limit_of_zero_is() {
    for (vel_max, goes_in) in [(0.3, true), (0.0, false)] {
        let mut bench = Bench::new(Planner::BaseAndRules);
        bench.room(&[]);
        let rule = Rule { rule_type: rules::RuleType::Kinematic, vel_max: Some(vel_max), ..keep_out(0.2) };
        bench.rule(rule, &BOX);
        bench.goal(3.0, 0.3);
        let nearest_m = bench.run(15_000, &[BOX]);
        assert_eq!(nearest_m[0] < 0.2, goes_in, "{vel_max}: {nearest_m:?}");
    }
}

#[test]
fn a_goal_that_a_rule_forbids_is_not_driven_to_and_the_rule_is_named() {
    let mut bench = Bench::new(Planner::BaseAndRules);
    bench.room(&[]);
    bench.rule(keep_out(0.3), &BOX);
    bench.goal(0.0, 0.0);
    bench.run(2000, &[]);
    assert_eq!((bench.state(), bench.command.as_ref().unwrap().twist), ("no_path", Twist::ZERO));
    let words = &bench.status.as_ref().unwrap().words;
    assert!(words.contains("rule") && words.contains("crib"), "{words}");
}

#[test]
fn a_goal_behind_walls_is_not_driven_to_until_the_map_opens() {
    let wall: Box2 = ([-0.1, -4.0], [0.1, 4.0]);
    let mut bench = Bench::new(Planner::Base);
    bench.room(&[wall]);
    bench.goal(3.0, 0.0);
    bench.run(2000, &[]);
    assert_eq!((bench.state(), bench.command.as_ref().unwrap().twist), ("no_path", Twist::ZERO));
    assert!(!bench.status.as_ref().unwrap().words.is_empty());
    bench.room(&[]);
    bench.run(12_000, &[]);
    assert_eq!(bench.state(), "arrived");
}

#[test]
fn a_new_goal_replaces_the_old_one_and_a_cancelled_one_leaves_it_standing() {
    let mut bench = Bench::new(Planner::Base);
    bench.room(&[]);
    bench.goal(3.0, 0.0);
    bench.run(1500, &[]);
    assert!(bench.speed_m_s > 0.5);
    bench.goal(-3.0, 2.0);
    bench.run(15_000, &[]);
    assert!(distance_m(&bench, -3.0, 2.0) <= 0.2);

    bench.goal(3.0, 0.0);
    bench.run(4000, &[]);
    bench.give(Input::Goal(Goal { id: String::new(), x_m: 0.0, y_m: 0.0, tolerance_m: 0.2, cancel: true }));
    bench.run(1500, &[]);
    assert_eq!((bench.state(), bench.speed_m_s), ("idle", 0.0));
    assert!(distance_m(&bench, 3.0, 0.0) > 0.5);
}

#[test]
fn a_plan_for_a_goal_before_this_one_is_not_followed() {
    let mut bench = Bench::new(Planner::Base);
    bench.room(&[]);
    bench.run(200, &[]);
    bench.keep_plans_back = true;
    bench.goal(3.0, 0.0);
    bench.goal(-3.0, 3.0);
    bench.run(600, &[]);
    assert_eq!(bench.kept_back.len(), 1, "one in flight");
    let late = crate::plan::make(&bench.kept_back.remove(0), &bench.profile);
    bench.give(Input::PlanReady(late));
    bench.run(100, &[]);
    assert_eq!(bench.command.as_ref().unwrap().twist, Twist::ZERO);
}
