//! Semantics as it should behave: on a bench with a rendered world and a clock of its own.

mod bench;
mod scene;

use geometry::Pose2;
use proto::{Grounding, PoseQuality};
use rules::{Relation, Rule};

use bench::{Bench, Models, START_NS, fit, rule};
use scene::{cuboid, room, table};

use super::Settings;

/// A table ahead of the robot's start.
const TABLE: [f64; 4] = [2.2, -0.6, 2.8, 0.6];
const AHEAD: Pose2 = Pose2 { x_m: 0.8, y_m: 0.0, yaw_rad: 0.0 };

fn with_table() -> Bench {
    Bench::new(room(vec![table("table", 2.5, 0.0)]))
}

#[test]
fn a_rule_is_grounded_from_what_is_seen() {
    let mut bench = with_table();
    bench.wait(0.5);
    bench.tell_rules(1, &[rule("s1", Relation::Near, "table"), rule("s2", Relation::Beneath, "table")]);
    bench.drive(AHEAD, 2.0);
    for id in ["s1", "s2"] {
        assert_eq!(bench.grounding(id), Grounding::Grounded);
        let fit = bench.fit(id, &[TABLE]);
        assert!(fit.covered > 0.9 && fit.iou > 0.6, "{id} {fit:?}");
    }
    let map = &bench.object_maps["s1"];
    assert!(map.header.stamp_ns > START_NS + 2_000_000_000 && map.header.stamp_ns <= bench.stamp_ns());
    assert_eq!((map.map_epoch, map.remark.as_str()), (1, ""));
    let held = bench.held.as_ref().unwrap();
    assert_eq!((held.version, held.service.as_str()), (1, "semantics"));
    assert!(held.rules.iter().all(|r| r.grounding == Grounding::Grounded));
    assert_eq!(bench.trouble(), "");
}

#[test]
fn a_rule_is_grounded_on_what_was_seen_before_it_was_said() {
    let check = |n_keyframes_max: usize, wanted: Grounding| {
        let scene = room(vec![table("table", 2.5, 0.0)]);
        let mut bench = Bench::with(Settings { n_keyframes_max, ..Settings::default() }, scene);
        bench.drive(Pose2::new(1.0, 0.0, 0.0), 2.0);
        bench.drive(Pose2::new(1.0, 0.0, 3.0), 3.0);
        bench.wait(5.0);
        assert_eq!(bench.n_asked, 0);
        bench.tell_rules(1, &[rule("s1", Relation::Near, "table")]);
        bench.wait(2.0);
        assert_eq!(bench.grounding("s1"), wanted);
        if wanted == Grounding::Grounded {
            assert!(bench.fit("s1", &[TABLE]).iou > 0.5, "{:?}", bench.fit("s1", &[TABLE]));
        }
    };
    check(40, Grounding::Grounded);
    check(0, Grounding::Searching);
}

/// A rectangle in the map as a place.
fn place(name: &str, [low_x, low_y, high_x, high_y]: [f64; 4]) -> proto::Place {
    let polygon_map = vec![[low_x, low_y], [high_x, low_y], [high_x, high_y], [low_x, high_y]];
    proto::Place { name: name.into(), also: vec![], kind: "room".into(), polygon_map }
}

#[test]
fn a_rule_about_a_named_place_is_grounded_without_a_camera() {
    const KITCHEN: [f64; 4] = [3.0, -1.0, 5.0, 2.0];
    let mut bench = with_table();
    bench.models = Models::Vanish;
    let told = proto::Places { map_epoch: None, places: vec![place("kitchen", KITCHEN)] };
    let out = rule("s1", Relation::On, "kitchen");
    bench.tell_rules(1, &[out.clone(), rule("s2", Relation::Near, "table")]);
    bench.wait(0.3);
    assert_eq!(bench.grounding("s1"), Grounding::Searching);
    bench.tell_places(told);
    bench.wait(0.6);
    assert_eq!(bench.grounding("s1"), Grounding::Grounded);
    assert_eq!(bench.grounding("s2"), Grounding::Searching);
    assert!(bench.fit("s1", &[KITCHEN]).iou > 0.9, "{:?}", bench.fit("s1", &[KITCHEN]));
    // Only the table is searched for.
    bench.tell_rules(2, &[out]);
    let n_asked = bench.n_asked;
    bench.wait(3.0);
    assert_eq!((bench.n_asked, bench.grounding("s1")), (n_asked, Grounding::Grounded));
}

#[test]
fn models_that_do_not_answer_are_trouble_and_the_rule_waits() {
    let check = |models: Models, words: &str, seconds: f64| {
        let mut bench = with_table();
        bench.models = models;
        bench.tell_rules(1, &[rule("s1", Relation::Near, "table")]);
        bench.wait(seconds);
        assert_eq!(bench.grounding("s1"), Grounding::Searching, "{models:?}");
        assert!(bench.trouble().contains(words), "{models:?}: {}", bench.trouble());
        // Beats go on: semantics lives.
        assert!(bench.beats.len() as f64 >= 2.5 * seconds);
        bench.models = Models::Good;
        bench.wait(if models == Models::Vanish { 4.0 } else { 1.0 });
        assert_eq!((bench.grounding("s1"), bench.trouble()), (Grounding::Grounded, ""), "{models:?}");
    };
    check(Models::Refuse, "no answer within 2000 ms", 2.0);
    check(Models::Vanish, "a question was lost", 4.0);
    check(Models::WrongSize, "segments are 80×120 pixels, must be 160×120", 2.0);
    check(Models::WrongFrame, "must be of frame", 2.0);
    check(Models::TooFew, "0 heat maps, must be 1", 2.0);
}

#[test]
fn what_was_seen_before_is_not_spent_on_models_that_fail() {
    let mut bench = with_table();
    bench.drive(Pose2::new(1.0, 0.0, 0.0), 2.0);
    bench.drive(Pose2::new(1.0, 0.0, 3.0), 3.0);
    bench.models = Models::Refuse;
    bench.tell_rules(1, &[rule("s1", Relation::Near, "table")]);
    bench.wait(10.0);
    assert_eq!(bench.grounding("s1"), Grounding::Searching);
    bench.models = Models::Good;
    bench.wait(2.0);
    assert_eq!(bench.grounding("s1"), Grounding::Grounded);
}

#[test]
fn a_frame_in_a_gap_of_odometry_is_left_out() {
    let mut bench = with_table();
    bench.tell_rules(1, &[rule("s1", Relation::Near, "table")]);
    bench.drive(AHEAD, 1.0);
    let before = bench.beats.last().unwrap().n_frames_dropped;
    let stamp_ns = bench.object_maps["s1"].header.stamp_ns;
    bench.odometry_is_silent = true;
    bench.wait(1.5);
    assert_eq!(bench.object_maps["s1"].header.stamp_ns, stamp_ns);
    assert!(bench.trouble().contains("odometry"), "{}", bench.trouble());
    assert!(bench.beats.last().unwrap().n_frames_dropped > before);
    bench.odometry_is_silent = false;
    bench.wait(1.0);
    assert!(bench.object_maps["s1"].header.stamp_ns > stamp_ns);
    assert_eq!(bench.trouble(), "");
    // What was wrong with a frame long ago does not explain a camera that is silent now.
    bench.camera_is_silent = true;
    bench.wait(1.5);
    assert_eq!(bench.trouble(), "no camera frame for more than 1 s");
}

#[test]
fn without_a_good_pose_nothing_is_mapped() {
    let check = |unplace: fn(&mut Bench), words: &str| {
        let mut bench = with_table();
        unplace(&mut bench);
        bench.tell_rules(1, &[rule("s1", Relation::Near, "table")]);
        bench.wait(2.0);
        assert!(bench.object_maps.values().all(|map| map.region.is_none()));
        assert!(bench.obstacles.is_none());
        assert!(bench.trouble().contains(words), "{}", bench.trouble());
    };
    check(|bench| bench.pose_is_silent = true, "no pose from localisation");
    check(|bench| bench.quality = PoseQuality::Lost, "localisation is lost");
    check(|bench| bench.quality = PoseQuality::Uncertain, "localisation is uncertain");
}

#[test]
fn a_new_map_frame_clears_what_was_found_and_it_is_found_again_there() {
    let mut bench = with_table();
    bench.tell_rules(1, &[rule("s1", Relation::Near, "table")]);
    bench.drive(Pose2::new(1.0, 0.0, 0.0), 2.0);
    bench.drive(Pose2::new(1.0, 0.0, 3.0), 3.0);
    assert_eq!(bench.grounding("s1"), Grounding::Grounded);
    // The same world, told 2 m to the left: the table is behind the robot, only keyframes know it.
    bench.told.clear();
    bench.map_epoch = 2;
    bench.map_from_odom = Pose2::new(0.0, 2.0, 0.0);
    bench.tell_pose();
    assert_eq!(bench.told[0], (2, Grounding::Searching, false));
    bench.wait(2.0);
    assert_eq!((bench.grounding("s1"), bench.object_maps["s1"].map_epoch), (Grounding::Grounded, 2));
    let moved = [TABLE[0], TABLE[1] + 2.0, TABLE[2], TABLE[3] + 2.0];
    assert!(bench.fit("s1", &[moved]).iou > 0.5, "{:?}", bench.fit("s1", &[moved]));
}

#[test]
fn an_answer_from_before_the_map_changed_is_of_no_use() {
    let mut bench = with_table();
    bench.tell_rules(1, &[rule("s1", Relation::Near, "table")]);
    bench.wait(1.0);
    assert_eq!(bench.grounding("s1"), Grounding::Grounded);
    bench.models = Models::Late;
    bench.wait(1.0);
    assert_eq!(bench.late.len(), 1, "one question at a time");
    bench.models = Models::Vanish;
    bench.map_epoch = 2;
    bench.tell_pose();
    let n_asked = bench.n_asked;
    let late = bench.late.remove(0);
    bench.input(late);
    // It frees the way for the next question, and tells nothing.
    assert_eq!(bench.n_asked, n_asked + 1);
    bench.wait(1.0);
    assert_eq!((bench.grounding("s1"), bench.object_maps["s1"].header.stamp_ns), (Grounding::Searching, 0));
}

#[test]
fn a_pose_that_comes_no_more_places_nothing() {
    let mut bench = with_table();
    bench.tell_rules(1, &[rule("s1", Relation::Near, "table")]);
    bench.wait(1.0);
    bench.pose_is_silent = true;
    bench.wait(1.5);
    let stamp_ns = bench.object_maps["s1"].header.stamp_ns;
    bench.wait(2.0);
    assert_eq!(bench.object_maps["s1"].header.stamp_ns, stamp_ns);
    assert!(bench.trouble().contains("older than 1200 ms"), "{}", bench.trouble());
}

#[test]
fn a_rule_that_is_changed_under_its_id_gets_another_region() {
    let mut bench = with_table();
    let near = rule("s1", Relation::Near, "table");
    bench.tell_rules(1, std::slice::from_ref(&near));
    bench.drive(AHEAD, 2.0);
    let seq = bench.object_maps["s1"].header.seq;
    bench.tell_rules(2, &[Rule { relation: Relation::LeftOf, anchor: Some([0.0; 3]), ..near }]);
    assert_eq!(bench.grounding("s1"), Grounding::Grounded);
    assert!(bench.fit("s1", &[[2.3, 0.8, 2.7, 1.9]]).covered > 0.95);
    assert!(bench.fit("s1", &[[2.3, -0.5, 2.7, 0.4]]).covered < 0.05);
    assert!(bench.object_maps["s1"].header.seq > seq);
}

#[test]
fn a_base_that_begins_anew_makes_old_frames_useless() {
    let mut bench = with_table();
    bench.drive(Pose2::new(1.0, 0.0, 0.0), 2.0);
    bench.drive(Pose2::new(1.0, 0.0, 3.0), 3.0);
    bench.restart_base();
    bench.map_epoch = 2;
    bench.wait(0.5);
    bench.tell_rules(1, &[rule("s1", Relation::Near, "table")]);
    bench.wait(2.0);
    assert_eq!(bench.grounding("s1"), Grounding::Searching);
    bench.drive(Pose2::new(1.0, 0.0, 0.0), 3.0);
    bench.wait(1.0);
    assert_eq!(bench.grounding("s1"), Grounding::Grounded);
}

#[test]
fn restarted_semantics_begin_by_searching() {
    let mut bench = with_table();
    let rules = [rule("s1", Relation::Near, "table")];
    bench.tell_rules(1, &rules);
    bench.wait(1.0);
    assert_eq!(bench.grounding("s1"), Grounding::Grounded);
    bench.restart();
    bench.tell_pose();
    bench.tell_rules(1, &rules);
    let map = &bench.object_maps["s1"];
    assert_eq!((map.grounding, &map.region, map.header.seq), (Grounding::Searching, &None, 1));
    bench.wait(1.0);
    assert_eq!(bench.grounding("s1"), Grounding::Grounded);
}

#[test]
fn an_ended_rule_is_told_no_more_and_an_older_rule_set_changes_nothing() {
    let mut bench = with_table();
    let (first, second) = (rule("s1", Relation::Near, "table"), rule("s2", Relation::Beneath, "table"));
    bench.tell_rules(3, &[first.clone(), second.clone()]);
    bench.wait(1.0);
    bench.tell_rules(4, &[second]);
    assert_eq!(bench.ended, ["s1"]);
    let n_told = bench.n_object_maps["s1"];
    bench.wait(1.0);
    assert_eq!(bench.n_object_maps["s1"], n_told);
    assert_eq!(bench.grounding("s2"), Grounding::Grounded);
    bench.tell_rules(2, &[first]);
    bench.wait(0.5);
    assert_eq!(bench.n_object_maps["s1"], n_told);
    assert_eq!(bench.held.as_ref().unwrap().version, 4);
}

#[test]
fn an_object_that_was_carried_off_is_lost_and_one_that_is_hidden_is_not() {
    let mut bench = with_table();
    bench.tell_rules(1, &[rule("s1", Relation::Near, "table")]);
    bench.drive(AHEAD, 2.0);
    let turned = Pose2 { yaw_rad: 3.0, ..AHEAD };
    bench.drive(turned, 2.0);
    bench.wait(10.0);
    assert_eq!(bench.grounding("s1"), Grounding::Grounded);
    bench.scene = room(Vec::new());
    bench.wait(1.0);
    assert_eq!(bench.grounding("s1"), Grounding::Grounded);
    bench.drive(AHEAD, 2.0);
    bench.wait(3.0);
    assert_eq!((bench.grounding("s1"), &bench.object_maps["s1"].region), (Grounding::Lost, &None));
    // Brought back, it is found again.
    bench.scene = room(vec![table("table", 2.5, 0.0)]);
    bench.wait(2.0);
    assert_eq!(bench.grounding("s1"), Grounding::Grounded);
}

#[test]
fn a_qualifier_that_cannot_be_told_covers_all_and_says_so() {
    let tables = vec![table("table", 3.0, -1.0), table("table", 3.0, 1.0)];
    let check = |reference: &str, wanted: Grounding| {
        let mut bench = Bench::new(room(tables.clone()));
        let mut told = rule("s1", Relation::Near, "table");
        told.reference = reference.to_owned();
        bench.tell_rules(1, &[told]);
        bench.drive(AHEAD, 2.0);
        assert_eq!(bench.grounding("s1"), wanted, "{reference}");
        let both = [[2.7, -1.6, 3.3, -0.4], [2.7, 0.4, 3.3, 1.6]];
        assert!(bench.fit("s1", &both).covered > 0.8, "{reference} {:?}", bench.fit("s1", &both));
        assert_eq!(bench.object_maps["s1"].remark.contains("red table"), wanted == Grounding::Ambiguous);
    };
    check("red table", Grounding::Ambiguous);
    check("the table", Grounding::Grounded);
}

#[test]
fn a_side_without_an_anchor_is_not_guessed() {
    let mut bench = with_table();
    let left = rule("s1", Relation::LeftOf, "table");
    bench.tell_rules(1, &[left.clone(), Rule { id: "s2".into(), anchor: Some([0.0; 3]), ..left }]);
    bench.drive(AHEAD, 2.0);
    assert_eq!(bench.grounding("s1"), Grounding::Searching);
    let remark = &bench.object_maps["s1"].remark;
    assert!(remark.contains("pose at which the rule was accepted"), "{remark}");
    assert_eq!(bench.grounding("s2"), Grounding::Grounded);
    assert!(bench.fit("s2", &[[2.3, 0.7, 2.7, 2.0]]).covered > 0.95);
    assert!(bench.fit("s2", &[[2.3, -2.0, 2.7, 0.3]]).covered < 0.05);
}

#[test]
fn between_needs_both_objects() {
    let sofa = cuboid("sofa", [2.0, -1.5, 0.0], [2.5, -1.0, 0.6]);
    let crate_ = cuboid("crate", [2.0, 1.0, 0.0], [2.5, 1.5, 0.6]);
    let between = Rule { obj2: Some("crate".into()), ..rule("s1", Relation::Between, "sofa") };
    let mut bench = Bench::new(room(vec![sofa.clone()]));
    bench.tell_rules(1, std::slice::from_ref(&between));
    bench.wait(2.0);
    assert_eq!(bench.grounding("s1"), Grounding::Searching);
    assert!(bench.object_maps["s1"].remark.contains("crate"));
    bench.scene = room(vec![sofa, crate_]);
    bench.wait(2.0);
    assert_eq!(bench.grounding("s1"), Grounding::Grounded);
    assert!(bench.fit("s1", &[[2.1, -0.9, 2.2, 0.9]]).covered > 0.9);
}

#[test]
fn a_rug_and_a_pool_are_areas_of_floor() {
    let area = [2.0, -0.8, 3.4, 0.8];
    for name in ["rug", "pool"] {
        let flat = cuboid(name, [area[0], area[1], 0.0], [area[2], area[3], 0.005]);
        let mut bench = Bench::new(room(vec![flat]));
        bench.tell_rules(1, &[rule("s1", Relation::On, name), rule("s2", Relation::Beneath, name)]);
        bench.drive(AHEAD, 2.0);
        assert_eq!(bench.grounding("s1"), Grounding::Grounded, "{name}");
        let fit = bench.fit("s1", &[area]);
        assert!(fit.iou > 0.8, "{name} {fit:?}");
        // Nothing can be under what lies on the floor.
        assert_eq!(bench.grounding("s2"), Grounding::Searching, "{name}");
    }
}

#[test]
fn what_a_laser_does_not_see_is_an_obstacle_with_or_without_rules() {
    let step = [1.6, -0.4, 1.9, 0.4];
    let low = cuboid("step", [step[0], step[1], 0.0], [step[2], step[3], 0.12]);
    let mut bench = Bench::new(room(vec![low, table("table", 3.2, 2.0)]));
    bench.drive(Pose2::new(0.4, 0.0, 0.0), 1.5);
    let obstacles = bench.obstacles.clone().unwrap();
    assert_eq!(obstacles.map_epoch, 1);
    assert!(bench.n_asked == 0 && bench.object_maps.is_empty());
    let cells = obstacles.cells.unwrap();
    assert!(fit(&cells, &[[1.6, -0.35, 1.62, 0.35]]).covered > 0.9, "the face of the step");
    assert!(fit(&cells, &[[0.5, -0.4, 1.5, 0.4]]).covered < 0.01, "the floor before it");
    assert!(fit(&cells, &[[3.0, 1.6, 3.4, 2.4]]).covered < 0.05, "under the table top");
}

#[test]
fn a_robot_at_rest_looks_less_often_once_all_is_found() {
    let mut bench = with_table();
    bench.tell_rules(1, &[rule("s1", Relation::Near, "table")]);
    bench.wait(3.0);
    let before = (bench.n_asked, bench.beats.last().unwrap().n_frames);
    bench.wait(10.0);
    let asked = bench.n_asked - before.0;
    let looked = bench.beats.last().unwrap().n_frames - before.1;
    assert!((10..=21).contains(&asked), "{asked} questions in 10 s");
    assert!((10..=21).contains(&looked), "{looked} looks in 10 s");
}

#[test]
fn rules_beyond_what_can_be_looked_for_are_reported() {
    let scene = room(vec![table("table", 2.5, 0.0)]);
    let mut bench = Bench::with(Settings { n_phrases_max: 1, ..Settings::default() }, scene);
    let odd = rule("no key", Relation::Near, "table");
    bench.tell_rules(1, &[rule("s1", Relation::Near, "table"), rule("s2", Relation::Near, "sofa"), odd]);
    bench.wait(2.0);
    assert_eq!(bench.grounding("s1"), Grounding::Grounded);
    assert_eq!(bench.grounding("s2"), Grounding::Searching);
    assert!(bench.trouble().contains("2 rules are not looked for"), "{}", bench.trouble());
}
