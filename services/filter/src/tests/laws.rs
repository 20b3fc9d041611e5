//! Laws: what holds whatever comes, in whatever order.

use geometry::{Time, Twist};
use proptest::prelude::*;
use proto::Grounding;
use rules::{Relation, Rule};

use super::bench::{Bench, Feed};
use crate::{Input, Output};

const FEEDS: [Feed; 5] = [Feed::Odometry, Feed::Scan, Feed::Pose, Feed::Nominal, Feed::Uptake];

#[derive(Clone, Debug)]
enum Event {
    Silence(usize),
    Speak(usize),
    Wish(f64, f64),
    Rules(u64, bool),
    Object(u8, f64, f64),
    Epoch(u64),
    BaseMap,
    Restart(usize),
    LateTick(u64),
    Run(u64),
}

fn any_event() -> impl Strategy<Value = Event> {
    prop_oneof![
        (0..5_usize).prop_map(Event::Silence),
        (0..5_usize).prop_map(Event::Speak),
        (-20.0..20.0_f64, -50.0..50.0_f64).prop_map(|(v, w)| Event::Wish(v, w)),
        (0..5_u64, any::<bool>()).prop_map(|(version, has_rule)| Event::Rules(version, has_rule)),
        (0..4_u8, -2.0..2.0_f64, -2.0..2.0_f64).prop_map(|(said, x, y)| Event::Object(said, x, y)),
        (1..3_u64).prop_map(Event::Epoch),
        Just(Event::BaseMap),
        (0..4_usize).prop_map(Event::Restart),
        (0..200_u64).prop_map(Event::LateTick),
        (1..400_u64).prop_map(Event::Run),
    ]
}

fn perform(bench: &mut Bench, event: Event) {
    match event {
        Event::Silence(idx) => bench.silence(FEEDS[idx]),
        Event::Speak(idx) => bench.unsilence(FEEDS[idx]),
        Event::Wish(speed_m_s, yaw_rate_rad_s) => bench.wish = Twist::new(speed_m_s, yaw_rate_rad_s),
        Event::Rules(version, has_rule) => {
            let crib = Rule { id: "s1".into(), buffer_m: 0.3, ..Rule::exclusion(Relation::Near, "crib") };
            bench.rules(version, if has_rule { vec![crib] } else { vec![] });
        }
        Event::Object(said, x_m, y_m) => {
            let said = [Grounding::Searching, Grounding::Grounded, Grounding::Lost, Grounding::Ambiguous]
                [usize::from(said)];
            let half_m = if said.is_usable() { 0.3 } else { -1.0 };
            bench.object("s1", said, [x_m, y_m], half_m);
        }
        Event::Epoch(map_epoch) => bench.map_epoch = map_epoch,
        Event::BaseMap => bench.base_map(),
        Event::Restart(idx) => bench.restart(["odometry", "scan", "object", "base_map"][idx]),
        Event::LateTick(late_ms) => {
            bench.run(late_ms);
            let due = Time::from_nanos((bench.now_ms - late_ms) * 1_000_000);
            let wall_ns = bench.wall_ns();
            bench.give(Input::Tick { due, wall_ns });
        }
        Event::Run(ms) => bench.run(ms),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn each_tick_sends_one_command_within_the_limits_and_it_is_zero_when_the_reason_is_an_input(
        events in prop::collection::vec(any_event(), 1..40),
    ) {
        let mut bench = Bench::driving();
        for event in events {
            perform(&mut bench, event.clone());
            let (now, wall_ns) = (bench.time(), bench.wall_ns());
            let outputs = bench.decider.step(now, Input::Tick { due: now, wall_ns });
            let commands: Vec<Twist> = outputs
                .iter()
                .filter_map(|output| match output {
                    Output::Command(command) => Some(command.twist),
                    _ => None,
                })
                .collect();
            prop_assert_eq!(commands.len(), 1);
            let Twist { speed_m_s, yaw_rate_rad_s } = commands[0];
            prop_assert!((0.0..=bench.profile.speed_m_s_max + 1e-9).contains(&speed_m_s), "{}", speed_m_s);
            prop_assert!(yaw_rate_rad_s.abs() <= bench.profile.yaw_rate_rad_s_max + 1e-9);
        }
        // Whatever state it was left in: silence brings it to rest.
        for feed in FEEDS.into_iter().filter(|feed| *feed != Feed::Odometry && *feed != Feed::Uptake) {
            bench.silence(feed);
        }
        bench.run(2500);
        prop_assert_eq!((bench.sent, bench.speed_m_s), (Twist::ZERO, 0.0));
    }

    #[test]
    fn a_hostile_wish_never_brings_the_hull_into_a_zone_that_was_found_in_time(
        wishes in prop::collection::vec((0.0..1.5_f64, -1.0..1.0_f64), 12),
        (x_m, y_m) in (1.6..2.6_f64, -1.5..1.5_f64),
    ) {
        let mut bench = Bench::driving();
        bench.wish = Twist::ZERO;
        bench.run(500);
        let centre = [bench.map_from_base.x_m + x_m, bench.map_from_base.y_m + y_m];
        bench.rules(2, vec![Rule { id: "s1".into(), buffer_m: 0.2, ..Rule::exclusion(Relation::Near, "crib") }]);
        bench.object("s1", Grounding::Grounded, centre, 0.4);
        for (speed_m_s, yaw_rate_rad_s) in wishes {
            bench.wish = Twist::new(speed_m_s, yaw_rate_rad_s);
            for _ in 0..400 {
                bench.run(1);
                let beyond = |at: f64, centre: f64| ((at - centre).abs() - 0.4).max(0.0);
                let pose = bench.map_from_base;
                let hull_m = beyond(pose.x_m, centre[0]).hypot(beyond(pose.y_m, centre[1])) - 0.25;
                prop_assert!(hull_m >= 0.2, "hull {} m from the zone", hull_m);
            }
        }
    }
}
