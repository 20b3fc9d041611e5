//! Ticks: exactly one command each, late ones, and what commands and reports carry.

use geometry::{Time, Twist};

use super::bench::{Bench, WALL_NS};
use crate::{Input, Output};

/// A tick that comes `late_ms` after it was due.
fn late_tick(bench: &mut Bench, late_ms: u64) {
    let due = Time::from_nanos((bench.now_ms - late_ms) * 1_000_000);
    let wall_ns = bench.wall_ns();
    bench.give(Input::Tick { due, wall_ns });
}

fn just_before_a_tick() -> Bench {
    let mut bench = Bench::driving();
    while bench.now_ms % 50 != 49 {
        bench.run(1);
    }
    bench
}

#[test]
fn a_tick_later_than_half_a_period_sends_the_rest_of_the_certified_plan() {
    let mut bench = just_before_a_tick();
    for _ in 0..26 {
        bench.now_ms += 1;
        bench.feed();
    }
    let mut in_time = just_before_a_tick();
    for _ in 0..26 {
        in_time.now_ms += 1;
        in_time.feed();
    }
    late_tick(&mut in_time, 25);
    assert_eq!((in_time.status().n_late, in_time.status().action.as_str()), (0, "passed"));

    bench.now_ms += 1;
    bench.feed();
    late_tick(&mut bench, 26);
    assert_eq!((bench.status().n_late, bench.status().action.as_str()), (1, "resting"));
    assert!(bench.status().certified);
}

#[test]
fn one_late_tick_after_another_brings_the_robot_to_rest() {
    let mut bench = Bench::driving();
    for _ in 0..50 {
        for _ in 0..50 {
            bench.now_ms += 1;
            bench.feed();
        }
        late_tick(&mut bench, 30);
    }
    assert_eq!((bench.speed_m_s, bench.sent), (0.0, Twist::ZERO));
    assert_eq!(bench.status().n_late, 50);
}

#[test]
fn skipped_ticks_are_counted_as_late() {
    let mut bench = Bench::driving();
    bench.run(50 - bench.now_ms % 50);
    let before = bench.status().n_late;
    for _ in 0..200 {
        bench.now_ms += 1;
        bench.feed();
    }
    bench.tick();
    assert_eq!(bench.status().n_late - before, 3);
}

#[test]
fn a_command_counts_ticks_carries_its_stamp_and_answers_the_newest_odometry() {
    let mut bench = Bench::driving();
    bench.run(7);
    let (now, wall_ns) = (bench.time(), bench.wall_ns());
    let outputs = bench.decider.step(now, Input::Tick { due: now, wall_ns });
    let Some(Output::Command(command)) = outputs.first() else { panic!("no command first: {outputs:?}") };
    assert_eq!(command.header.stamp_ns, WALL_NS + bench.now_ms * 1_000_000);
    assert_eq!(command.header.echo, bench.odometry_seq());
    assert_eq!(command.header.seq, bench.status().tick + 1);
    let n_commands = outputs.iter().filter(|output| matches!(output, Output::Command(_))).count();
    assert_eq!(n_commands, 1);
}

#[test]
fn rules_held_are_told_at_once_and_then_twice_a_second() {
    let mut bench = Bench::driving();
    bench.held.clear();
    bench.rules(2, vec![]);
    bench.run(50);
    assert_eq!(bench.held.len(), 1);
    assert_eq!((bench.held[0].version, bench.held[0].service.as_str()), (2, "filter"));
    bench.run(2000);
    assert_eq!(bench.held.len(), 5);
}

#[test]
fn a_field_that_is_late_does_not_hold_up_a_single_command() {
    let mut bench = Bench::driving();
    bench.keep_fields_back = true;
    bench.base_map();
    bench.run(100);
    bench.base_map();
    bench.run(2000);
    assert_eq!(bench.kept_back.len(), 1, "one in flight, the newest waits");
    assert!(bench.speed_m_s > 0.4);
    let job = bench.kept_back.remove(0);
    let ready = bench.fields.compute(job);
    bench.give(Input::FieldReady(ready));
    assert_eq!(bench.kept_back.len(), 1, "the one that waited");
}
