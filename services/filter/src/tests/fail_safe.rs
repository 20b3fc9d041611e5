//! The table of inputs that fail safe, row by row: what still holds at the limit, and what one past it does.

use geometry::Twist;
use proto::{BaseFault, FilterStatus, Grounding, Header, NominalCommand, PoseQuality};
use rules::{Relation, Rule};

use super::bench::{Bench, Feed};
use crate::{Input, Note};

/// A robot that drives; one input falls silent, and a tick comes when it is exactly this old.
#[track_caller]
fn silent_for(mut bench: Bench, feed: Feed, age_ms: u64) -> Bench {
    // Until this input has just spoken.
    while bench.last_ms.get(&feed) != Some(&bench.now_ms) {
        bench.run(1);
    }
    bench.silence(feed);
    bench.run(age_ms);
    bench.tick();
    bench
}

#[track_caller]
fn stops_past(make: fn() -> Bench, feed: Feed, limit_ms: u64, input: &str) {
    let at = silent_for(make(), feed, limit_ms);
    assert_eq!(at.status().stop_reason, "", "at the limit");
    assert!(at.sent.speed_m_s > 0.1, "at the limit");
    let past = silent_for(make(), feed, limit_ms + 1);
    let wanted = format!("{input} {} ms old, at most {limit_ms} ms", limit_ms + 1);
    assert_eq!(past.status().stop_reason, wanted);
    assert!(past.sent.speed_m_s < at.sent.speed_m_s, "past the limit");
    assert!(past.notes.iter().any(|note| matches!(note, Note::Stopped(reason) if reason.words == wanted)));
}

/// Runs on, and expects rest within the time that braking takes.
#[track_caller]
fn comes_to_rest(mut bench: Bench) -> FilterStatus {
    bench.run(1000);
    assert_eq!((bench.speed_m_s, bench.sent), (0.0, Twist::ZERO), "{:?}", bench.status());
    bench.status().clone()
}

/// A rule about a crib that stands far from the robot, found.
fn with_a_grounded_rule() -> Bench {
    let mut bench = Bench::driving();
    let crib = Rule { id: "s1".into(), buffer_m: 0.5, ..Rule::exclusion(Relation::Near, "crib") };
    bench.rules(2, vec![crib]);
    bench.object("s1", Grounding::Grounded, [0.0, -4.0], 0.5);
    bench.run(1000);
    bench.wish = Twist::new(0.5, 1.0);
    bench.run(1000);
    assert_eq!(bench.status().words, "as asked");
    bench
}

#[test]
fn a_nominal_command_older_than_a_quarter_second_ramps_to_zero() {
    stops_past(Bench::driving, Feed::Nominal, 250, "nominal command");
    let mut bench = silent_for(Bench::driving(), Feed::Nominal, 300);
    // 50 ms past the limit, at 3 m/s²: a ramp, not a jump.
    assert!((0.2..0.5).contains(&bench.sent.speed_m_s), "{:?}", bench.sent);
    let mut turning = Bench::driving();
    turning.wish = Twist::new(0.5, 0.8);
    turning.run(200);
    let turning = silent_for(turning, Feed::Nominal, 300);
    assert!((0.3..0.8).contains(&turning.sent.yaw_rate_rad_s), "along its arc: {:?}", turning.sent);
    bench.run(100);
    assert!(bench.sent.speed_m_s > 0.0);
    comes_to_rest(bench);
}

#[test]
fn base_feedback_older_than_a_tenth_of_a_second_sends_zero_at_once() {
    stops_past(Bench::driving, Feed::Odometry, 100, "odometry");
    let bench = silent_for(Bench::driving(), Feed::Odometry, 101);
    assert_eq!(bench.sent, Twist::ZERO);
    assert_eq!(bench.status().action, "stopped");
    comes_to_rest(bench);
}

#[test]
fn a_scan_older_than_three_tenths_of_a_second_stops() {
    stops_past(Bench::driving, Feed::Scan, 300, "scan");
    comes_to_rest(silent_for(Bench::driving(), Feed::Scan, 301));
}

#[test]
fn a_pose_matched_from_a_scan_older_than_three_scan_limits_stops() {
    stops_past(Bench::driving, Feed::Pose, 900, "pose");
    comes_to_rest(silent_for(Bench::driving(), Feed::Pose, 901));
}

#[test]
fn a_pose_that_is_lost_stops() {
    let mut bench = Bench::driving();
    let before = bench.status().map_from_base.unwrap();
    bench.quality = PoseQuality::Lost;
    bench.run(200);
    let after = bench.status().map_from_base.unwrap();
    assert!(
        (before.x_m - after.x_m).hypot(before.y_m - after.y_m) < 0.2,
        "it goes by the last good pose: {after:?}"
    );
    assert_eq!(comes_to_rest(bench).stop_reason, "localisation is lost");
}

#[test]
fn a_pose_in_doubt_carries_the_robot_as_far_as_none_does() {
    let in_doubt_for = |ms| {
        let mut bench = Bench::driving();
        bench.quality = PoseQuality::Uncertain;
        bench.run(ms);
        bench
    };
    assert_eq!(in_doubt_for(800).status().stop_reason, "");
    assert!(comes_to_rest(in_doubt_for(1000)).stop_reason.contains("pose"));
}

#[test]
fn silent_semantics_slow_and_then_stop_while_a_rule_has_an_object() {
    let at = silent_for(with_a_grounded_rule(), Feed::Beat, 1000);
    assert_eq!(at.status().words, "as asked");
    let past = silent_for(with_a_grounded_rule(), Feed::Beat, 1001);
    assert!(past.status().words.contains("going slowly: semantics 1001 ms old"), "{}", past.status().words);
    let cap_m_s = past.profile.ungrounded_speed_m_s;
    let slow = silent_for(with_a_grounded_rule(), Feed::Beat, 3000);
    assert_eq!(slow.status().stop_reason, "");
    assert!(slow.speed_m_s > 0.1 && slow.speed_m_s <= cap_m_s + 0.011, "{}", slow.speed_m_s);
    let stopped = silent_for(with_a_grounded_rule(), Feed::Beat, 3001);
    assert_eq!(stopped.status().stop_reason, "semantics 3001 ms old, at most 3000 ms");
    assert_eq!(stopped.status().rules[0].grounding, Grounding::Grounded, "grounded objects stay");
    comes_to_rest(stopped);
}

#[test]
fn semantics_that_beat_and_cannot_look_count_as_silent() {
    let mut bench = Bench::driving();
    bench.rules(2, vec![Rule { id: "s1".into(), ..Rule::exclusion(Relation::Near, "crib") }]);
    bench.object("s1", Grounding::Grounded, [40.0, 40.0], 0.2);
    bench.run(5000);
    assert_eq!(bench.status().stop_reason, "");
    bench.blind = true;
    bench.run(2000);
    assert!(bench.status().words.contains("going slowly: semantics"), "{}", bench.status().words);
    bench.run(2000);
    assert!(bench.status().stop_reason.starts_with("semantics"), "{}", bench.status().words);
    bench.blind = false;
    bench.run(1000);
    assert_eq!(bench.status().stop_reason, "");
}

#[test]
fn silent_semantics_do_not_matter_while_no_rule_has_an_object() {
    let mut bench = Bench::driving();
    bench.silence(Feed::Beat);
    bench.rules(
        2,
        vec![Rule { id: "s1".into(), vel_max: Some(0.4), ..Rule::kinematic(Relation::Global, "") }],
    );
    bench.run(3500);
    assert_eq!(bench.status().stop_reason, "");
    assert!((0.35..=0.411).contains(&bench.speed_m_s), "{}", bench.speed_m_s);
}

#[test]
fn a_language_service_that_is_gone_leaves_the_rules_in_force() {
    let mut bench = with_a_grounded_rule();
    bench.give(Input::Peer { service: "language".into(), alive: false });
    bench.run(20_000);
    assert_eq!((bench.status().rules_version, bench.status().stop_reason.as_str()), (Some(2), ""));
}

#[test]
fn without_a_rule_set_or_a_base_map_nothing_moves() {
    let mut bench = Bench::silent();
    bench.base_map();
    bench.run(1000);
    assert_eq!(bench.sent, Twist::ZERO);
    assert_eq!(bench.status().stop_reason, "no rule set since the start");

    let mut bench = Bench::silent();
    bench.rules(1, vec![]);
    bench.run(1000);
    assert_eq!(bench.sent, Twist::ZERO);
    assert_eq!(bench.status().stop_reason, "no base map since the start");
    bench.base_map();
    bench.run(500);
    assert!(bench.speed_m_s > 0.3);
}

#[test]
fn each_input_must_have_come_once_before_anything_moves() {
    for (feed, words) in [
        (Feed::Odometry, "no odometry yet"),
        (Feed::Scan, "no scan yet"),
        (Feed::Pose, "no pose yet"),
        (Feed::Nominal, "no nominal command yet"),
    ] {
        let mut bench = Bench::silent();
        bench.silence(feed);
        bench.rules(1, vec![]);
        bench.base_map();
        bench.run(1000);
        assert_eq!((bench.sent, bench.status().stop_reason.as_str()), (Twist::ZERO, words));
    }
}

#[test]
fn a_base_that_takes_up_no_command_for_a_quarter_second_stops() {
    let at = silent_for_uptake(Bench::driving(), 250);
    assert_eq!(at.status().stop_reason, "");
    let past = silent_for_uptake(Bench::driving(), 251);
    assert_eq!(past.status().stop_reason, "the base has not taken up a command 251 ms old, at most 250 ms");
}

/// The base answers at its usual rate, with echoes of commands sent long ago.
fn silent_for_uptake(mut bench: Bench, age_ms: u64) -> Bench {
    while !bench.now_ms.is_multiple_of(50) {
        bench.run(1);
    }
    // The command of the next tick is the first that is not taken up.
    bench.run(49);
    bench.silence(Feed::Uptake);
    bench.run(1 + age_ms);
    bench.tick();
    bench
}

#[test]
fn a_steadily_delayed_nominal_command_does_not_look_fresh() {
    #[track_caller]
    fn check(thought_ms: u64, wanted: &str) {
        let mut bench = Bench::driving();
        bench.silence(Feed::Nominal);
        while !bench.now_ms.is_multiple_of(20) {
            bench.run(1);
        }
        let echo = bench.odometry_seq();
        // Nothing but the delayed command speaks for the navigator.
        for _ in 0..thought_ms {
            bench.run(1);
            let header = bench.header("nominal", echo);
            let late = NominalCommand { header, twist: bench.wish };
            let input = Input::Nominal(bench.heard(late));
            bench.give(input);
        }
        bench.tick();
        assert_eq!(bench.status().stop_reason, wanted);
    }
    check(250, "");
    check(251, "nominal command 251 ms old, at most 250 ms");
}

#[test]
fn a_steadily_delayed_scan_or_pose_does_not_look_fresh() {
    for (is_scan, limit_ms) in [(true, 300), (false, 900)] {
        for delay_ms in [limit_ms - 20, limit_ms + 20] {
            let mut bench = Bench::driving();
            bench.silence(if is_scan { Feed::Scan } else { Feed::Pose });
            let mut waiting = std::collections::VecDeque::new();
            for _ in 0..1500 {
                bench.run(1);
                // One a tick, always `delay_ms` old when it comes, and just before the odometry.
                let input = if is_scan {
                    let scan = bench.scan();
                    waiting.push_back(scan.header);
                    let header: Header = *waiting.front().unwrap();
                    Input::Scan(bench.heard(proto::Scan { header, ..scan }))
                } else {
                    let pose = bench.pose();
                    waiting.push_back(pose.header);
                    let header: Header = *waiting.front().unwrap();
                    Input::Pose(bench.heard(proto::PoseEstimate { header, ..pose }))
                };
                if waiting.len() as u64 > delay_ms {
                    waiting.pop_front();
                    bench.give(input);
                }
            }
            let is_stopped = !bench.status().stop_reason.is_empty();
            assert_eq!(is_stopped, delay_ms > limit_ms, "{delay_ms} ms: {:?}", bench.status().words);
        }
    }
}

#[test]
fn a_beat_that_answers_old_odometry_does_not_look_fresh() {
    let mut bench = with_a_grounded_rule();
    bench.silence(Feed::Beat);
    let echo = bench.odometry_seq();
    for k in 0..3500 {
        if k % 100 == 0 {
            let header = bench.header("beat", echo);
            let trouble = String::new();
            let beat = proto::SemanticsBeat {
                header,
                rules_version: 2,
                n_frames: k,
                n_frames_dropped: 0,
                is_blind: false,
                trouble,
            };
            let input = Input::SemanticsBeat(bench.heard(beat));
            bench.give(input);
        }
        bench.run(1);
        if k == 2000 {
            assert!(bench.status().words.contains("going slowly: semantics"), "{}", bench.status().words);
        }
    }
    assert!(bench.status().stop_reason.starts_with("semantics"), "{}", bench.status().words);
}

#[test]
fn a_stamp_from_the_future_is_refused_and_counted() {
    #[track_caller]
    fn check(ahead_ms: u64, n_refused: usize) {
        let mut bench = Bench::driving();
        let mut odometry = bench.odometry();
        odometry.header.stamp_ns += ahead_ms * 1_000_000;
        let input = Input::Odometry(bench.heard(odometry));
        bench.give(input);
        assert_eq!(bench.rejected.len(), n_refused, "{:?}", bench.rejected);
    }
    check(50, 0);
    check(51, 1);
    // A robot whose clock runs ahead is refused altogether, and so stops.
    let mut bench = Bench::driving();
    bench.silence(Feed::Odometry);
    for _ in 0..200 {
        bench.run(1);
        let mut odometry = bench.odometry();
        odometry.header.stamp_ns += 60_000_000;
        let input = Input::Odometry(bench.heard(odometry));
        bench.give(input);
    }
    assert!(bench.status().stop_reason.starts_with("odometry"), "{}", bench.status().stop_reason);
    let n_refused = bench.rejected.iter().filter(|(key, _)| *key == "robot/odometry").count();
    assert_eq!(n_refused, 200);
}

#[test]
fn a_base_fault_sends_zero_and_names_it() {
    let mut bench = Bench::driving();
    bench.silence(Feed::Odometry);
    let mut odometry = bench.odometry();
    odometry.fault = Some(BaseFault::Bumper);
    let input = Input::Odometry(bench.heard(odometry));
    bench.give(input);
    bench.tick();
    assert_eq!((bench.sent, bench.status().stop_reason.as_str()), (Twist::ZERO, "base fault: bumper"));
}

#[test]
fn a_blind_scan_is_refused_and_does_not_keep_the_robot_going() {
    let mut bench = Bench::driving();
    bench.silence(Feed::Scan);
    for _ in 0..10 {
        bench.run(50);
        let mut scan = bench.scan();
        scan.ranges_m.fill(f32::NAN);
        let input = Input::Scan(bench.heard(scan));
        bench.give(input);
    }
    assert!(bench.status().stop_reason.starts_with("scan"), "{}", bench.status().stop_reason);
    assert_eq!(bench.rejected.len(), 10);
}

#[test]
fn the_words_name_the_service_that_is_gone() {
    let mut bench = silent_for(Bench::driving(), Feed::Nominal, 400);
    bench.give(Input::Peer { service: "navigator".into(), alive: false });
    bench.tick();
    assert!(bench.status().stop_reason.ends_with("(navigator is gone)"), "{}", bench.status().stop_reason);
    bench.give(Input::Peer { service: "navigator".into(), alive: true });
    bench.tick();
    assert!(!bench.status().stop_reason.contains("gone"));
}

#[test]
fn every_input_that_comes_back_lets_the_robot_go_on() {
    for feed in [Feed::Odometry, Feed::Scan, Feed::Pose, Feed::Nominal, Feed::Uptake] {
        let mut bench = Bench::driving();
        bench.wish = Twist::new(0.3, 0.5);
        bench.silence(feed);
        bench.run(1500);
        assert_eq!(bench.speed_m_s, 0.0, "{feed:?}");
        bench.unsilence(feed);
        bench.run(1000);
        assert!(bench.speed_m_s > 0.25, "{feed:?}: {:?}", bench.status());
    }
}
