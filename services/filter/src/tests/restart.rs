//! Who starts over: perception, localisation, the robot, language, and the filter itself.

use geometry::Twist;
use proto::{BaseMap, CellSet, DepthObstacles, Grounding};
use rules::{Relation, Rule};

use super::bench::{Bench, Feed, square};
use crate::Input;

fn crib(buffer_m: f64) -> Rule {
    Rule { id: "s1".into(), buffer_m, ..Rule::exclusion(Relation::Near, "crib") }
}

/// A crib two metres ahead, found, and a robot that wants through it.
fn before_a_crib() -> Bench {
    let mut bench = Bench::driving();
    bench.wish = Twist::ZERO;
    bench.run(500);
    let ahead_m = bench.map_from_base.x_m + 1.5;
    bench.rules(2, vec![crib(0.3)]);
    bench.object("s1", Grounding::Grounded, [ahead_m, 0.0], 0.4);
    bench.run(300);
    bench
}

#[track_caller]
fn grounding(bench: &Bench) -> Grounding {
    bench.status().rules[0].grounding
}

/// Drives at the crib, and says how near the hull came to it.
fn nearest_m(mut bench: Bench, crib_x_m: f64) -> f64 {
    bench.wish = Twist::new(1.0, 0.0);
    let mut nearest_m = f64::INFINITY;
    for _ in 0..4000 {
        bench.run(1);
        let pose = bench.map_from_base;
        let aside = |offset: f64| (offset.abs() - 0.4).max(0.0);
        let away_m = aside(pose.x_m - crib_x_m).hypot(aside(pose.y_m)) - bench.profile.radius_m;
        nearest_m = nearest_m.min(away_m);
    }
    nearest_m
}

#[test]
fn an_empty_map_of_a_restarted_perception_does_not_replace_a_grounded_one() {
    for said in [Grounding::Searching, Grounding::Grounded] {
        let mut bench = before_a_crib();
        let crib_x_m = bench.map_from_base.x_m + 1.5;
        bench.restart("object");
        bench.object("s1", said, [0.0, 0.0], if said == Grounding::Grounded { 0.0 } else { -1.0 });
        bench.run(100);
        assert_eq!(grounding(&bench), Grounding::Grounded);
        let near_m = nearest_m(bench, crib_x_m);
        assert!((0.3..0.6).contains(&near_m), "{near_m}");
    }
}

#[test]
fn the_first_voxels_of_a_restarted_perception_do_not_replace_a_whole_crib() {
    let mut bench = before_a_crib();
    let crib_x_m = bench.map_from_base.x_m + 1.5;
    bench.restart("object");
    bench.object("s1", Grounding::Grounded, [crib_x_m + 0.3, 0.3], 0.1);
    bench.run(100);
    assert!(nearest_m(bench, crib_x_m) >= 0.3);
}

#[test]
fn the_same_run_may_shrink_a_region_and_a_new_run_may_once_it_has_seen_as_much() {
    let mut bench = before_a_crib();
    let crib_x_m = bench.map_from_base.x_m + 1.5;
    bench.object("s1", Grounding::Grounded, [crib_x_m, 2.5], 0.1);
    bench.run(100);
    assert!(nearest_m(bench, crib_x_m) < 0.0, "moved away by the same run");

    let mut bench = before_a_crib();
    bench.restart("object");
    bench.object("s1", Grounding::Grounded, [crib_x_m, 2.5], 0.1);
    bench.object("s1", Grounding::Grounded, [crib_x_m, 2.5], 0.4);
    bench.run(100);
    assert!(nearest_m(bench, crib_x_m) < 0.0, "moved away, and all of it seen there");
}

#[test]
fn a_lost_object_keeps_its_last_place_and_the_robot_goes_slowly() {
    let mut bench = before_a_crib();
    let crib_x_m = bench.map_from_base.x_m + 1.5;
    bench.object("s1", Grounding::Lost, [0.0, 0.0], -1.0);
    bench.wish = Twist::new(1.0, 0.0);
    bench.run(1000);
    assert_eq!(grounding(&bench), Grounding::Lost);
    assert!(bench.status().words.contains("looking for the crib"), "{}", bench.status().words);
    assert!(bench.speed_m_s <= bench.profile.ungrounded_speed_m_s + 0.011);
    assert!(nearest_m(bench, crib_x_m) >= 0.3);
}

#[test]
fn a_rule_whose_object_is_not_found_yet_slows_and_says_for_what() {
    let mut bench = Bench::driving();
    bench.rules(2, vec![crib(0.3)]);
    bench.run(1000);
    assert_eq!(grounding(&bench), Grounding::Searching);
    assert!(bench.status().words.contains("looking for the crib, going slowly"), "{}", bench.status().words);
    assert!((0.2..=0.311).contains(&bench.speed_m_s), "{}", bench.speed_m_s);
    assert_eq!(bench.status().binding.as_ref().map(|b| b.id.as_str()), Some("s1"));
}

#[test]
fn object_maps_of_another_epoch_count_as_not_grounded() {
    let mut bench = before_a_crib();
    bench.map_epoch = 2;
    bench.base_map();
    bench.wish = Twist::new(1.0, 1.0);
    bench.run(1000);
    assert_eq!(grounding(&bench), Grounding::Lost);
    assert!(bench.status().words.contains("looking for the crib"), "{}", bench.status().words);
    assert!(bench.speed_m_s > 0.1 && bench.speed_m_s <= bench.profile.ungrounded_speed_m_s + 0.011);
    bench.object("s1", Grounding::Grounded, [0.0, 4.0], 0.4);
    bench.run(600);
    assert_eq!(grounding(&bench), Grounding::Grounded);
    assert!(bench.speed_m_s > 0.4, "{}", bench.speed_m_s);
}

#[test]
fn a_base_map_of_another_epoch_than_the_pose_stops() {
    let mut bench = Bench::driving();
    bench.map_epoch = 2;
    bench.run(1000);
    assert_eq!(bench.sent, Twist::ZERO);
    assert_eq!(bench.status().stop_reason, "base map of epoch 1, pose of epoch 2");
}

#[test]
fn the_emptier_base_map_of_a_restarted_localisation_only_closes_room() {
    let mut bench = Bench::driving();
    bench.wish = Twist::ZERO;
    bench.run(600);
    bench.restart("base_map");
    // Only half a metre around the robot is known to be free.
    let (x_m, y_m) = (bench.map_from_base.x_m, bench.map_from_base.y_m);
    let centre = |i: usize| (-5.95 + 0.1 * (i % 120) as f64, -5.95 + 0.1 * (i / 120) as f64);
    let is_seen = |i: usize| (centre(i).0 - x_m).hypot(centre(i).1 - y_m) < 0.8;
    bench.base_map_of((0..120 * 120).map(|i| u8::from(is_seen(i))).collect());
    bench.wish = Twist::new(1.0, 0.0);
    bench.run(4000);
    let driven_m = (bench.map_from_base.x_m - x_m).hypot(bench.map_from_base.y_m - y_m);
    assert!(driven_m + bench.profile.radius_m <= 0.8, "{driven_m}");
}

fn seen_in_depth(bench: &mut Bench, cells: Option<CellSet>) {
    let header = bench.header("depth", 0);
    let message = DepthObstacles { header, map_epoch: bench.map_epoch, cells };
    let input = Input::DepthObstacles(bench.heard(message));
    bench.give(input);
}

/// A table top 1.5 m ahead, which only the camera sees.
fn before_a_table() -> (Bench, f64) {
    let mut bench = Bench::driving();
    bench.wish = Twist::ZERO;
    bench.run(600);
    let table_x_m = bench.map_from_base.x_m + 1.5;
    seen_in_depth(&mut bench, Some(square([table_x_m, 0.0], 0.4)));
    bench.run(50);
    (bench, table_x_m)
}

#[test]
fn what_the_camera_saw_is_not_run_into() {
    let (bench, table_x_m) = before_a_table();
    let near_m = nearest_m(bench, table_x_m);
    assert!((0.0..0.3).contains(&near_m), "{near_m}");
}

#[test]
fn what_the_camera_saw_is_kept_over_a_restart_of_perception_and_cleared_by_its_own_run() {
    for restarts in [true, false] {
        let (mut bench, table_x_m) = before_a_table();
        if restarts {
            bench.restart("depth");
        }
        seen_in_depth(&mut bench, None);
        bench.run(50);
        let near_m = nearest_m(bench, table_x_m);
        assert_eq!(near_m > 0.0, restarts, "{near_m}");
    }
}

#[test]
fn what_the_camera_saw_in_another_map_frame_is_nowhere() {
    let (mut bench, table_x_m) = before_a_table();
    bench.map_epoch = 2;
    bench.base_map();
    bench.run(100);
    assert!(nearest_m(bench, table_x_m) < 0.0);
}

#[test]
fn a_robot_that_starts_over_needs_a_new_pose_and_a_new_scan() {
    let mut bench = Bench::driving();
    bench.silence(Feed::Pose);
    bench.silence(Feed::Scan);
    bench.restart("odometry");
    bench.run(150);
    assert_eq!(bench.status().stop_reason, "no scan yet");
    bench.unsilence(Feed::Scan);
    bench.run(150);
    assert_eq!(bench.status().stop_reason, "no pose yet");
    bench.unsilence(Feed::Pose);
    bench.run(1000);
    assert!(bench.speed_m_s > 0.4, "{:?}", bench.status());
}

#[test]
fn the_version_of_the_rules_never_goes_back() {
    let mut bench = before_a_crib();
    bench.rules(1, vec![]);
    bench.run(50);
    assert_eq!(bench.status().rules_version, Some(2));
    assert_eq!(bench.rejected.last().map(|(key, _)| *key), Some("rules"));
    bench.rules(3, vec![]);
    bench.run(50);
    assert_eq!((bench.status().rules_version, bench.status().rules.len()), (Some(3), 0));
}

#[test]
fn a_revoked_rule_lets_go_of_its_region() {
    let mut bench = before_a_crib();
    let crib_x_m = bench.map_from_base.x_m + 1.5;
    bench.rules(3, vec![]);
    assert!(nearest_m(bench, crib_x_m) < 0.0);
}

#[test]
fn an_object_map_may_come_before_its_rule() {
    let mut bench = Bench::driving();
    bench.object("s1", Grounding::Grounded, [0.0, -4.0], 0.4);
    bench.rules(2, vec![crib(0.3)]);
    bench.run(100);
    assert_eq!(grounding(&bench), Grounding::Grounded);
}

#[test]
fn an_old_map_that_is_heard_again_changes_nothing() {
    let mut bench = before_a_crib();
    let crib_x_m = bench.map_from_base.x_m + 1.5;
    let old = bench.header("object", 0);
    bench.object("s1", Grounding::Grounded, [crib_x_m, 0.0], 0.4);
    let again = proto::ObjectMap {
        header: old,
        map_epoch: 1,
        rule_id: "s1".into(),
        grounding: Grounding::Grounded,
        region: Some(square([4.0, 4.0], 0.2)),
        remark: String::new(),
    };
    bench.run(5000);
    let input = Input::ObjectMap(bench.heard(again));
    bench.give(input);
    assert!(nearest_m(bench, crib_x_m) >= 0.3);
}

#[test]
fn a_rule_that_cannot_be_kept_while_moving_is_kept_by_standing_still() {
    let mut bench = Bench::driving();
    let everywhere = Rule { id: "s1".into(), ..Rule::exclusion(Relation::Global, "") };
    bench.rules(2, vec![everywhere]);
    bench.run(1500);
    assert_eq!(bench.speed_m_s, 0.0);
    assert!(bench.status().words.contains("standing still"), "{}", bench.status().words);
}

#[test]
fn a_base_map_of_impossible_size_is_refused_and_the_old_one_stays() {
    let mut bench = Bench::driving();
    let header = bench.header("base_map", 0);
    let layout = proto::GridLayout {
        origin_map: geometry::Point2::new(99_999.99, 0.0),
        resolution_m: 0.1,
        n_cols: 8192,
        n_rows: 1,
    };
    let map = BaseMap { header, map_epoch: 1, layout, cells: vec![1; 8192] };
    let input = Input::BaseMap(bench.heard(map));
    bench.give(input);
    bench.run(300);
    assert_eq!(bench.rejected.len(), 1, "{:?}", bench.rejected);
    assert!(bench.speed_m_s > 0.4);
}

#[test]
fn a_filter_that_starts_over_waits_for_everything_and_does_not_take_old_echoes_for_its_own() {
    let mut bench = before_a_crib();
    bench.wish = Twist::new(1.0, 0.0);
    bench.start_the_filter_over();
    bench.run(1000);
    assert_eq!(bench.status().stop_reason, "no rule set since the start");
    bench.rules(2, vec![crib(0.3)]);
    bench.run(1000);
    assert_eq!(bench.status().stop_reason, "no base map since the start");
    bench.base_map();
    bench.run(1000);
    assert_eq!(grounding(&bench), Grounding::Searching);
    assert!(bench.speed_m_s <= bench.profile.ungrounded_speed_m_s + 0.011);

    // The base still names commands of the filter before: none of them is this one's.
    let mut bench = before_a_crib();
    bench.start_the_filter_over();
    bench.silence(Feed::Uptake);
    bench.rules(2, vec![]);
    bench.base_map();
    bench.run(400);
    assert!(
        bench.status().stop_reason.starts_with("the base has not taken up"),
        "{:?}",
        bench.status().words
    );
}
