//! When nothing may be sent, and what is said instead.

use geometry::Twist;
use proto::PoseQuality;

use super::bench::{Bench, WALL_NS};
use crate::Input;
use crate::config::Planner;

fn driving() -> Bench {
    let mut bench = Bench::new(Planner::Base);
    bench.room(&[]);
    bench.goal(3.0, 0.0);
    bench.run(1000, &[]);
    assert_eq!(bench.state(), "driving");
    bench
}

/// Commands sent at a tick that comes when the newest odometry, or pose, has exactly this age.
fn n_sent_at_age(mut bench: Bench, silence: fn(&mut Bench), age_ms: u64) -> u64 {
    // Both have just spoken.
    while !bench.now_ms.is_multiple_of(100) {
        bench.run(1, &[]);
    }
    silence(&mut bench);
    bench.run(age_ms, &[]);
    let before = bench.n_commands;
    let wall_ns = WALL_NS + bench.now_ms * 1_000_000;
    bench.give(Input::TrackTick { wall_ns });
    bench.n_commands - before
}

#[test]
fn with_stale_odometry_it_sends_nothing_and_says_that_it_waits() {
    let silence = |bench: &mut Bench| bench.odometry_speaks = false;
    assert_eq!(n_sent_at_age(driving(), silence, 100), 1);
    assert_eq!(n_sent_at_age(driving(), silence, 101), 0);
    let mut bench = driving();
    bench.odometry_speaks = false;
    bench.run(1000, &[]);
    assert_eq!(bench.state(), "waiting");
    assert!(bench.status.as_ref().unwrap().words.starts_with("odometry"));
}

#[test]
fn with_a_stale_pose_it_sends_nothing_and_says_that_it_waits() {
    let silence = |bench: &mut Bench| bench.pose_speaks = false;
    assert_eq!(n_sent_at_age(driving(), silence, 900), 1);
    assert_eq!(n_sent_at_age(driving(), silence, 901), 0);
}

#[test]
fn with_localisation_lost_it_sends_nothing() {
    let mut bench = driving();
    bench.quality = PoseQuality::Lost;
    bench.run(200, &[]);
    let before = bench.n_commands;
    bench.run(1000, &[]);
    assert_eq!((bench.n_commands, bench.state()), (before, "waiting"));
    assert_eq!(bench.status.as_ref().unwrap().words, "localisation is lost");
}

#[test]
fn with_localisation_in_doubt_it_goes_on_by_odometry_until_the_last_good_pose_is_stale() {
    let mut bench = driving();
    bench.quality = PoseQuality::Uncertain;
    bench.run(800, &[]);
    assert_ne!(bench.state(), "waiting");
    bench.run(2000, &[]);
    assert_eq!(bench.state(), "waiting");
    assert!(bench.status.as_ref().unwrap().words.contains("pose"), "{:?}", bench.status);
}

#[test]
fn without_a_goal_it_stands_and_says_so_twenty_times_a_second() {
    let mut bench = Bench::new(Planner::Base);
    bench.room(&[]);
    bench.run(1000, &[]);
    let before = bench.n_commands;
    bench.run(1000, &[]);
    assert_eq!((bench.n_commands - before, bench.state()), (20, "idle"));
    assert_eq!(bench.command.as_ref().unwrap().twist, Twist::ZERO);
}

#[test]
fn a_map_of_another_epoch_than_the_pose_is_not_planned_on() {
    let mut bench = driving();
    bench.map_epoch = 2;
    bench.run(1000, &[]);
    assert_eq!((bench.state(), bench.command.as_ref().unwrap().twist), ("waiting", Twist::ZERO));
    bench.room(&[]);
    bench.run(1000, &[]);
    assert_eq!(bench.state(), "driving");
}

#[test]
fn each_command_answers_the_odometry_it_was_made_from() {
    let mut bench = driving();
    bench.run(40, &[]);
    let first = bench.command.clone().unwrap().header;
    bench.run(50, &[]);
    let next = bench.command.clone().unwrap().header;
    assert_eq!(next.seq, first.seq + 1);
    assert!(next.echo > first.echo && first.echo > 0);
    assert_eq!(next.stamp_ns % 50_000_000, WALL_NS % 50_000_000);
}
