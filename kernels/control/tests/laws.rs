//! Laws of the filter that need no simulation: what passes, what never leaves, what is said.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a case that cannot be set up must fail")]

mod arena;

use std::sync::Arc;
use std::time::Duration;

use arena::{Arena, TrueRule, chance, field_of, rectangle, seed};
use control::{Action, Certified, Demand, Filter, FilterConfig, MarginUnit, Method, RuleLayer, State, World};
use geometry::{Point2, Profile, Twist};
use proptest::prelude::*;
use rand::RngExt;

const TICK: Duration = Duration::from_millis(50);

fn filter(profile: &Profile) -> Filter {
    let config = FilterConfig { latency_s: 0.0, ..FilterConfig::for_profile(profile) };
    Filter::new(config, profile).unwrap()
}

/// A state in the middle of a room.
fn at(x_m: f64, y_m: f64, speed_m_s: f64) -> State {
    State { x_m, y_m, yaw_rad: 0.0, speed_m_s }
}

#[test]
fn a_nominal_command_that_keeps_ample_margin_passes_bit_for_bit() {
    let post = rectangle(Point2::new(9.0, 7.0), (0.3, 0.3), 0.4);
    let arena = Arena::new((12.0, 10.0), vec![post], vec![]);
    let mut c = chance(seed(7));
    let mut n_passed = 0;
    for profile in [Profile::sim(), Profile::turtlebot2()] {
        let config = FilterConfig { latency_s: 0.0, ..FilterConfig::for_profile(&profile) };
        let (v, w, a) = (profile.speed_m_s_max, profile.yaw_rate_rad_s_max, profile.accel_m_s2_max);
        // What is lost until rest: a step, braking, and the tube around both, generously.
        let way_m = v * config.step_s + profile.braking_distance_m(v);
        let threshold_m = config.ample_m + way_m + 0.15;
        for _ in 0..200 {
            let Some(place) = arena.free_place(&mut c, profile.radius_m, threshold_m) else { continue };
            let speed_m_s = c.random_range(0.0..=v);
            let state = State { yaw_rad: c.random_range(-3.0..3.0), ..at(place.x, place.y, speed_m_s) };
            let reach = a * config.step_s;
            let low = (speed_m_s - reach).max(0.0);
            let high = (speed_m_s + reach).min(v);
            let nominal = Twist::new(c.random_range(low..=high), c.random_range(-w..=w));
            for method in [Method::SmoothBlending, Method::LeastRestrictive] {
                let mut filter = Filter::new(FilterConfig { method, ..config.clone() }, &profile).unwrap();
                let decision = filter.step(TICK, state, nominal, &arena.world);
                assert_eq!(decision.command, nominal, "{decision:?}");
                assert_eq!((decision.action, decision.deviation), (Action::Passed, 0.0));
                assert_eq!(decision.certified, Certified::Yes);
                n_passed += 1;
            }
        }
    }
    assert!(n_passed > 400, "{n_passed}");
}

#[test]
fn the_same_inputs_and_seed_give_the_same_commands() {
    let profile = Profile::sim();
    let arena = Arena::generated(seed(11), 4, &profile);
    let place = arena.free_place(&mut chance(1), profile.radius_m, 0.1).unwrap();
    let run = || {
        let mut filter = filter(&profile);
        let mut state = at(place.x, place.y, 0.0);
        (0..60)
            .map(|k| {
                let nominal = Twist::new(1.5, (f64::from(k) * 0.3).sin());
                let command = filter.step(TICK, state, nominal, &arena.world).command;
                state = state.ramped(command.yaw_rate_rad_s, command.speed_m_s, 0.05);
                command
            })
            .collect::<Vec<_>>()
    };
    assert_eq!(run(), run());
}

fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -20.0..20.0_f64,
        1 => any::<f64>(),
        1 => prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(f64::NEG_INFINITY), Just(-0.0)],
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn whatever_comes_in_what_leaves_is_finite_and_within_the_limits(
        inputs in prop::collection::vec(
            (any_number(), any_number(), any_number(), any_number(), any_number(), any_number(), 0..2000_u64),
            1..12,
        ),
        method in 0..4_usize,
    ) {
        let profile = Profile::sim();
        let arena = Arena::new((4.0, 4.0), vec![], vec![]);
        let mut world = arena.world.clone();
        world.points = inputs.iter().map(|i| Point2::new(i.0, i.5)).collect();
        let method = [
            Method::SmoothBlending,
            Method::LeastRestrictive,
            Method::PaperLiteral,
            Method::PaperLiteralBlending,
        ][method];
        let mut filter = Filter::new(FilterConfig { method, ..FilterConfig::for_profile(&profile) }, &profile).unwrap();
        for (x_m, y_m, yaw_rad, speed_m_s, v, w, ms) in inputs {
            let state = State { x_m, y_m, yaw_rad, speed_m_s };
            let command = filter.step(Duration::from_millis(ms), state, Twist::new(v, w), &world).command;
            let braked = filter.brake(Duration::from_millis(ms), Some(state));
            let rest = filter.rest(Duration::from_millis(ms));
            for sent in [command, braked, rest] {
                prop_assert!(sent.is_finite(), "{sent:?}");
                prop_assert!((0.0..=1.5).contains(&sent.speed_m_s) && sent.yaw_rate_rad_s.abs() <= 1.0, "{sent:?}");
            }
        }
    }
}

#[test]
fn a_late_tick_sends_the_rest_of_the_plan_until_it_stands_still() {
    let profile = Profile::sim();
    let arena = Arena::new((8.0, 6.0), vec![], vec![]);
    let mut filter = filter(&profile);
    let first = filter.step(TICK, at(2.0, 3.0, 1.0), Twist::new(1.0, 0.0), &arena.world);
    assert_eq!(first.command, Twist::new(1.0, 0.0));
    let plan = filter.plan().unwrap().clone();
    let mut last_m_s = 1.0;
    for k in 1..60 {
        let mut expected = plan.clone();
        expected.advance(0.05 * f64::from(k));
        let sent = filter.rest(TICK);
        assert_eq!(sent.speed_m_s, expected.command().speed_m_s);
        assert!(sent.speed_m_s >= last_m_s - 0.15 - 1e-9);
        last_m_s = sent.speed_m_s;
    }
    assert_eq!(filter.rest(TICK), Twist::ZERO);
}

#[test]
fn braking_ramps_to_zero_along_the_present_arc() {
    let profile = Profile::sim();
    let arena = Arena::new((8.0, 6.0), vec![], vec![]);
    let mut filter = filter(&profile);
    let full = Twist::new(1.5, 0.5);
    assert_eq!(filter.step(TICK, at(3.0, 3.0, 1.5), full, &arena.world).command, full);
    for k in 1..10 {
        let sent = filter.brake(TICK, None);
        assert!((sent.speed_m_s - (1.5 - 0.15 * f64::from(k))).abs() < 1e-9);
        assert!((sent.yaw_rate_rad_s / sent.speed_m_s - 1.0 / 3.0).abs() < 1e-9, "the same arc");
    }
    assert_eq!(filter.brake(TICK, None), Twist::ZERO);
    assert_eq!(filter.rest(TICK), Twist::ZERO, "no plan is left to go on with");
    // A base that is slower than its command is not sped up.
    filter.step(TICK, at(3.0, 3.0, 1.5), full, &arena.world);
    assert!(filter.brake(TICK, Some(at(3.0, 3.0, 0.2))).speed_m_s <= 0.2);
}

#[test]
fn a_hit_of_the_live_scan_acts_at_once() {
    let profile = Profile::sim();
    let arena = Arena::new((8.0, 6.0), vec![], vec![]);
    let mut filter = filter(&profile);
    let full = Twist::new(1.5, 0.0);
    let state = at(2.0, 3.0, 1.5);
    assert_eq!(filter.step(TICK, state, full, &arena.world).command, full);
    let seen = World { points: vec![Point2::new(2.9, 3.05)], ..arena.world.clone() };
    let decision = filter.step(Duration::ZERO, state, full, &seen);
    assert!(decision.command.speed_m_s < 1.5, "{decision:?}");
    assert_eq!(decision.binding.map(|b| b.id), Some("scan".to_owned()));
}

fn drive(filter: &mut Filter, world: &World, mut state: State, n: usize) -> (State, control::Decision) {
    let mut decision = filter.step(TICK, state, Twist::new(1.5, 0.0), world);
    for _ in 0..n {
        state = state.ramped(decision.command.yaw_rate_rad_s, decision.command.speed_m_s, 0.05);
        decision = filter.step(TICK, state, Twist::new(1.5, 0.0), world);
    }
    (state, decision)
}

#[test]
fn what_slows_the_robot_is_named_with_its_distance() {
    let profile = Profile::sim();
    let mut arena = Arena::new((8.0, 6.0), vec![], vec![]);
    let zone = rectangle(Point2::new(5.0, 3.0), (0.3, 0.3), 0.0);
    arena.add(TrueRule::Exclusion { zone, buffer_m: 0.5 });
    arena.world.rules[0].label = "the crib".into();
    let (state, decision) = drive(&mut filter(&profile), &arena.world, at(2.0, 3.0, 0.0), 30);
    let binding = decision.binding.clone().unwrap();
    assert_eq!((binding.id.as_str(), binding.unit, binding.is_rule), ("s1", MarginUnit::Metres, true));
    let true_m = 4.7 - state.x_m - profile.radius_m;
    assert!((binding.margin - true_m).abs() < 0.09, "{} {true_m}", binding.margin);
    assert_eq!(decision.words, format!("slowed: {:.1} m from the crib", binding.margin));
}

#[test]
fn a_rule_that_is_not_grounded_caps_the_speed_and_is_named() {
    let profile = Profile::sim();
    let mut arena = Arena::new((8.0, 6.0), vec![], vec![]);
    let demand = Demand::SpeedCap { speed_m_s_max: profile.ungrounded_speed_m_s };
    arena.world.rules.push(RuleLayer { id: "s4".into(), label: "the crib".into(), demand });
    let (state, decision) = drive(&mut filter(&profile), &arena.world, at(2.0, 3.0, 0.0), 20);
    assert!(state.speed_m_s > 0.28 && state.speed_m_s <= 0.311, "{state:?}");
    assert_eq!(decision.words, "looking for the crib, going slowly");
    assert!(decision.binding.unwrap().is_ungrounded);
}

#[test]
fn near_something_the_limit_holds_and_away_from_it_it_does_not() {
    let profile = Profile::sim();
    let arena = Arena::new((12.0, 6.0), vec![], vec![]);
    let zone = rectangle(Point2::new(6.0, 1.5), (0.3, 0.3), 0.0);
    let field = Arc::new(field_of(*arena.map.layout(), std::slice::from_ref(&zone)));
    let mut world = arena.world.clone();
    world.rules.push(RuleLayer {
        id: "s1".into(),
        label: "the bed".into(),
        demand: Demand::Limit {
            zone: Some(field),
            buffer_m: 1.0,
            speed_m_s_max: Some(0.4),
            yaw_rate_rad_s_max: None,
        },
    });
    let mut filter = filter(&profile);
    let (mut state, mut fastest, mut slowest) = (at(2.0, 3.0, 0.0), 0.0_f64, 2.0_f64);
    while state.x_m < 10.0 {
        let decision = filter.step(TICK, state, Twist::new(1.5, 0.0), &world);
        let next = state.ramped(decision.command.yaw_rate_rad_s, decision.command.speed_m_s, 0.05);
        let inside = zone.signed_distance_m(state.position()) - profile.radius_m < 1.0;
        if inside {
            assert!(state.speed_m_s <= 0.411, "{state:?} {decision:?}");
            slowest = slowest.min(state.speed_m_s);
        }
        fastest = fastest.max(state.speed_m_s);
        state = next;
    }
    assert!(fastest > 1.4 && slowest > 0.3, "{fastest} {slowest}");
}

#[test]
fn who_pushes_into_a_corner_is_turned_to_where_there_is_room() {
    let profile = Profile::sim();
    let arena = Arena::new((6.0, 6.0), vec![], vec![]);
    let mut filter = filter(&profile);
    let mut state = State { yaw_rad: -2.4, ..at(0.5, 0.5, 0.0) };
    let mut unfroze = None;
    for tick in 0..120 {
        let decision = filter.step(TICK, state, Twist::new(1.5, 0.0), &arena.world);
        if decision.action == Action::Unfreezing {
            unfroze = unfroze.or(Some(tick));
            assert_eq!(decision.certified, Certified::Yes, "{decision:?}");
        }
        state = state.ramped(decision.command.yaw_rate_rad_s, decision.command.speed_m_s, 0.05);
        assert!(arena.clearance_m(state.position(), profile.radius_m) > 0.0);
    }
    assert!(unfroze.is_some_and(|tick| tick >= 10), "{unfroze:?}");
    assert!(state.x_m + state.y_m > 1.1, "{state:?}");
}
