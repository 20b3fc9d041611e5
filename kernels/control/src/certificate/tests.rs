//! Each term of the certificate at its border, against figures worked out by hand.
//!
//! Walls and zones are half-planes: their field is linear, so that bilinear samples are exact.

use std::sync::Arc;

use geometry::{Point2, Profile};
use mapping::{DistanceField, Layout, Shape};
use proptest::prelude::*;

use super::*;
use crate::config::Disturbance;
use crate::dynamics::{Control, Limits, State};
use crate::margin::{BaseLayer, Demand, RuleLayer, World};
use crate::scene::{Assumptions, LIMIT_TOLERANCE};

const EXACT: Disturbance = Disturbance { position_m: 0.0, yaw_rad: 0.0, speed_m_s: 0.0, delay_s: 0.0 };
/// Fields are in f32.
const ROUNDING_M: f64 = 1e-6;

fn assumptions(disturbance: Disturbance) -> Assumptions {
    Assumptions {
        limits: Limits::of(&Profile::sim()),
        radius_m: 0.25,
        step_s: 0.05,
        disturbance,
        closing_speed_m_s: 0.0,
        braking_tail: true,
    }
}

/// Everything at or beyond `x_m`.
fn beyond(x_m: f64) -> Arc<DistanceField> {
    let layout = Layout::new(Point2::new(-4.0, -4.0), 0.05, Shape { n_cols: 160, n_rows: 160 }).unwrap();
    let values = layout.cells().map(|cell| (x_m - layout.centre(cell).x) as f32).collect();
    Arc::new(DistanceField::from_values(layout, values).unwrap())
}

fn walled(x_m: f64) -> World {
    World { base: vec![BaseLayer { name: "the wall".into(), field: beyond(x_m) }], ..World::default() }
}

fn ruled(demand: Demand) -> World {
    World { rules: vec![RuleLayer { id: "s1".into(), label: "it".into(), demand }], ..World::default() }
}

fn limited(zone: Option<Arc<DistanceField>>, speed: Option<f64>, rate: Option<f64>) -> World {
    ruled(Demand::Limit { zone, buffer_m: 0.0, speed_m_s_max: speed, yaw_rate_rad_s_max: rate })
}

fn at_speed(speed_m_s: f64) -> State {
    State { speed_m_s, ..State::default() }
}

fn scene<'w>(world: &'w World, start: State, disturbance: Disturbance) -> Scene<'w> {
    Scene::of(world, start, assumptions(disturbance), &|_| false)
}

fn roll(start: State, controls: &[Control]) -> Plan {
    Plan::roll(start, controls, 0.05, &Limits::of(&Profile::sim()), true)
}

fn hold(yaw_rate_rad_s: f64, accel_m_s2: f64, n: usize) -> Vec<Control> {
    vec![Control { yaw_rate_rad_s, accel_m_s2 }; n]
}

/// The margin kept when braking straight from 1 m/s towards a wall 1 m ahead.
fn braking_margin(disturbance: Disturbance) -> f64 {
    let world = walled(1.0);
    let start = at_speed(1.0);
    certify(&scene(&world, start, disturbance), &roll(start, &[])).unwrap().0
}

/// Braking from 1 m/s passes 1, 0.85, … 0.1, 0 m/s: seven steps over 0.1675 m.
const BRAKING_M: f64 = 0.05 * (0.925 + 0.775 + 0.625 + 0.475 + 0.325 + 0.175 + 0.05);
const BRAKING_S: f64 = 0.35;

#[test]
fn a_braking_plan_keeps_what_is_left_at_its_end() {
    let last_length_m: f64 = 0.05 * 0.05;
    let lost_m = 0.25 - (0.25_f64.powi(2) - last_length_m.powi(2) / 4.0).sqrt();
    let wanted_m = 1.0 - BRAKING_M - 0.25 - lost_m;
    assert!((braking_margin(EXACT) - wanted_m).abs() < ROUNDING_M);
}

#[test]
fn each_disturbance_takes_its_share_of_the_margin() {
    let exact_m = braking_margin(EXACT);
    #[track_caller]
    fn check(disturbance: Disturbance, exact_m: f64, share_m: f64) {
        let lost_m = exact_m - braking_margin(disturbance);
        assert!((lost_m - share_m).abs() < ROUNDING_M, "{lost_m} {share_m}");
    }
    check(Disturbance { position_m: 0.02, ..EXACT }, exact_m, 0.02);
    check(Disturbance { yaw_rad: 0.1, ..EXACT }, exact_m, 0.1 * BRAKING_M);
    check(Disturbance { speed_m_s: 0.1, ..EXACT }, exact_m, 0.1 * BRAKING_S);
    // 1 m/s carried for 0.1 s, sped up at 3 m/s²; turned by 1 rad/s meanwhile.
    check(Disturbance { delay_s: 0.1, ..EXACT }, exact_m, 0.1 + 0.015 + 0.1 * BRAKING_M);
}

#[test]
fn at_rest_only_the_position_is_uncertain() {
    let world = walled(0.3);
    let all = Disturbance { position_m: 0.02, yaw_rad: 0.1, speed_m_s: 0.1, delay_s: 0.1 };
    let start = at_speed(0.0);
    let kept = certify(&scene(&world, start, all), &roll(start, &hold(1.0, 0.0, 5))).unwrap();
    assert!((kept.0 - 0.03).abs() < ROUNDING_M, "{kept:?}");
    assert_eq!(kept.1, Some(Source::Base(0)));
}

#[test]
fn a_plan_that_keeps_nothing_is_not_certified() {
    let start = at_speed(1.0);
    let just_m = 0.25 + BRAKING_M + 3.2e-6;
    let verdict = |x_m: f64| certify(&scene(&walled(x_m), start, EXACT), &roll(start, &[]));
    assert!(verdict(just_m + 2.0 * ROUNDING_M).is_ok());
    assert!(matches!(verdict(just_m - 2.0 * ROUNDING_M), Err(Breach::Near(Source::Base(0), _))));
}

#[test]
fn a_margin_of_exactly_zero_is_not_kept() {
    let layout = Layout::new(Point2::new(-1.0, -1.0), 0.05, Shape { n_cols: 40, n_rows: 40 }).unwrap();
    let at_rest = |distance_m: f32| {
        let field = Arc::new(DistanceField::from_values(layout, vec![distance_m; 1600]).unwrap());
        let world = World { base: vec![BaseLayer { name: "all round".into(), field }], ..World::default() };
        let start = at_speed(0.0);
        certify(&scene(&world, start, EXACT), &roll(start, &[]))
    };
    assert_eq!(at_rest(0.25), Err(Breach::Near(Source::Base(0), 0.0)));
    assert_eq!(at_rest(0.5), Ok((0.25, Some(Source::Base(0)))));
}

#[test]
fn what_a_plan_comes_too_near_to_is_named_and_a_plan_that_ends_moving_names_nothing() {
    let start = at_speed(1.0);
    let world = walled(0.3);
    let breach = certify(&scene(&world, start, EXACT), &roll(start, &[])).unwrap_err();
    assert_eq!(breach.source(), Some(Source::Base(0)));
    let world = limited(None, Some(0.2), Some(0.2));
    let source_of = |controls: &[Control], start| {
        certify(&scene(&world, start, EXACT), &roll(start, controls)).unwrap_err().source()
    };
    assert_eq!(source_of(&hold(0.0, 3.0, 4), at_speed(0.0)), Some(Source::Rule(0)));
    assert_eq!(source_of(&hold(1.0, 0.0, 4), at_speed(0.0)), Some(Source::Rule(0)));
    assert_eq!(Breach::Moving.source(), None);
}

#[test]
fn the_first_segment_is_checked_like_every_other() {
    // The robot drives away, but its first sample already touches the wall.
    let start = State { yaw_rad: std::f64::consts::PI, speed_m_s: 0.5, ..State::default() };
    let verdict = |x_m: f64| certify(&scene(&walled(x_m), start, EXACT), &roll(start, &[]));
    assert!(verdict(0.26).is_ok());
    assert!(matches!(verdict(0.2499), Err(Breach::Near(Source::Base(0), m)) if m < 0.0));
}

#[test]
fn a_plan_that_ends_moving_is_never_certified() {
    let world = World::default();
    let start = at_speed(0.5);
    let moving = Plan::roll(start, &[Control::default()], 0.05, &Limits::of(&Profile::sim()), false);
    assert_eq!(certify(&scene(&world, start, EXACT), &moving), Err(Breach::Moving));
    assert!(certify(&scene(&world, start, EXACT), &roll(start, &[])).is_ok());
}

#[test]
fn a_start_that_is_not_a_number_is_not_certified() {
    let start = State { x_m: f64::NAN, ..State::default() };
    let world = walled(1.0);
    assert!(certify(&scene(&world, start, EXACT), &roll(start, &[])).is_err());
}

#[test]
fn a_zone_is_kept_by_its_buffer_unless_the_robot_stands_in_it() {
    let exclusion = |x_m: f64| ruled(Demand::Exclusion { zone: beyond(x_m), buffer_m: 0.2 });
    let start = at_speed(0.0);
    let verdict = |x_m: f64| certify(&scene(&exclusion(x_m), start, EXACT), &roll(start, &[]));
    let (kept_m, source) = verdict(0.46).unwrap();
    assert!((kept_m - 0.01).abs() < ROUNDING_M);
    assert_eq!(source, Some(Source::Rule(0)));
    // In it: it does not bind, recovery sees to it.
    assert_eq!(verdict(0.44), Ok((f64::INFINITY, None)));
}

#[test]
fn what_is_past_counts_no_more_and_the_segment_under_way_still_does() {
    let start = at_speed(1.0);
    let mut plan = roll(start, &[]);
    // A new wall so near that only the plan's beginning is clear of it.
    let world = walled(0.25 + 0.1675 - 0.001);
    let now = |plan: &Plan| certify(&scene(&world, start, EXACT), plan);
    assert!(now(&plan).is_err());
    plan.advance(0.34);
    assert!(now(&plan).is_err(), "the last segment is under way");
    // The same plan, with the wall behind its start.
    let behind =
        World { base: vec![BaseLayer { name: "behind".into(), field: behind(-0.24) }], ..World::default() };
    let mut plan = roll(start, &[]);
    assert!(certify(&scene(&behind, start, EXACT), &plan).is_err());
    plan.advance(0.049);
    assert!(certify(&scene(&behind, start, EXACT), &plan).is_err());
    plan.advance(0.001);
    assert!(certify(&scene(&behind, start, EXACT), &plan).is_ok());
}

/// Everything at or before `x_m`.
fn behind(x_m: f64) -> Arc<DistanceField> {
    let layout = Layout::new(Point2::new(-4.0, -4.0), 0.05, Shape { n_cols: 160, n_rows: 160 }).unwrap();
    let values = layout.cells().map(|cell| (layout.centre(cell).x - x_m) as f32).collect();
    Arc::new(DistanceField::from_values(layout, values).unwrap())
}

#[test]
fn a_rest_that_is_over_is_held_to_the_place_of_rest() {
    let start = at_speed(1.0);
    let mut plan = roll(start, &[]);
    plan.advance(9.0);
    let verdict = |x_m: f64| certify(&scene(&walled(x_m), start, EXACT), &plan);
    assert!(verdict(0.25 + BRAKING_M + 0.001).is_ok());
    assert!(verdict(0.25 + BRAKING_M - 0.001).is_err());
    // What is uncertain of the way is still uncertain of its end.
    let late = Disturbance { position_m: 0.01, ..EXACT };
    assert!(certify(&scene(&walled(0.25 + BRAKING_M + 0.009), start, late), &plan).is_err());
    assert!(certify(&scene(&walled(0.25 + BRAKING_M + 0.011), start, late), &plan).is_ok());
}

#[test]
fn driving_exactly_at_a_limit_complies_and_beyond_its_tolerance_does_not() {
    let verdict = |speed_m_s: f64, rate_rad_s: f64| {
        let start = at_speed(0.3);
        let accel = (speed_m_s - 0.3) / 0.05;
        let controls = [hold(rate_rad_s, accel, 1), hold(rate_rad_s, 0.0, 2)].concat();
        certify(&scene(&limited(None, Some(0.4), Some(0.6)), start, EXACT), &roll(start, &controls))
    };
    assert!(verdict(0.4, 0.6).is_ok());
    assert!(verdict(0.41 - 1e-9, 0.61).is_ok());
    assert!(verdict(0.3, -0.61).is_ok());
    assert!(matches!(verdict(0.41 + 1e-6, 0.0), Err(Breach::Fast(Source::Rule(0), over)) if over < 2e-6));
    assert!(matches!(verdict(0.3, 0.61 + 1e-6), Err(Breach::Turning(Source::Rule(0), over)) if over < 2e-6));
    assert!(matches!(verdict(0.3, -0.61 - 1e-6), Err(Breach::Turning(Source::Rule(0), _))));
}

#[test]
fn a_limit_of_zero_everywhere_lets_only_rest_pass() {
    let world = limited(None, Some(0.0), None);
    let start = at_speed(0.0);
    let verdict = |controls: &[Control]| certify(&scene(&world, start, EXACT), &roll(start, controls));
    assert!(verdict(&hold(1.0, 0.0, 3)).is_ok());
    assert!(matches!(verdict(&hold(0.0, 0.001, 1)), Err(Breach::Fast(..))));
}

#[test]
fn either_end_of_a_segment_in_a_zone_holds_it_to_the_limit() {
    let start = at_speed(0.5);
    let plan = roll(start, &hold(0.0, 0.0, 1));
    // The first segment is 25 mm long: from 0.25 m to 0.275 m of hull front.
    let entering =
        |x_m: f64| certify(&scene(&limited(Some(beyond(x_m)), Some(0.2), None), start, EXACT), &plan);
    let stop_m = 0.25 + 0.025 + 0.05 * (0.425 + 0.275 + 0.125 + 0.025);
    assert!(entering(stop_m + 0.05).is_ok(), "never in the zone");
    assert!(matches!(entering(0.25 + 0.02), Err(Breach::Fast(..))), "its end is in the zone");
    let leaving =
        |x_m: f64| certify(&scene(&limited(Some(behind(x_m)), Some(0.2), None), start, EXACT), &plan);
    // Moving away from what lies behind: the hull's back is at -0.25 m.
    assert!(leaving(-0.30).is_ok(), "never in the zone");
    // In it at the start and too fast: full braking is allowed, holding the speed is not.
    assert!(matches!(leaving(-0.24), Err(Breach::Fast(..))));
    let world = limited(Some(behind(-0.24)), Some(0.2), None);
    assert!(certify(&scene(&world, start, EXACT), &roll(start, &[])).is_ok());
    // Slow enough while in it, faster once out.
    let slow = at_speed(0.2);
    let later = [hold(0.0, 0.0, 4), hold(0.0, 3.0, 3)].concat();
    let at_once = hold(0.0, 3.0, 3);
    let world = limited(Some(behind(-0.249)), Some(0.2), None);
    assert!(certify(&scene(&world, slow, EXACT), &roll(slow, &later)).is_ok());
    assert!(matches!(certify(&scene(&world, slow, EXACT), &roll(slow, &at_once)), Err(Breach::Fast(..))));
}

#[test]
fn a_segment_that_ends_in_a_zone_is_held_to_the_limit_from_its_beginning() {
    // 0.3 to 0.15 m/s, the hull's front from 0.25 to 0.261 m: within the limit only once in the zone.
    let start = at_speed(0.3);
    let verdict = |x_m: f64| {
        certify(&scene(&limited(Some(beyond(x_m)), Some(0.2), None), start, EXACT), &roll(start, &[]))
    };
    assert!(matches!(verdict(0.26), Err(Breach::Fast(..))));
    assert!(verdict(0.28).is_ok());
}

#[test]
fn the_speed_of_a_later_segment_is_not_forgiven_an_error_of_measurement() {
    // Outside for one step at 0.25 m/s, then braking into the zone, where 0.21 m/s is the most.
    let noisy = Disturbance { speed_m_s: 0.05, ..EXACT };
    let start = at_speed(0.25);
    let world = limited(Some(beyond(0.277)), Some(0.2), None);
    let plan = roll(start, &hold(0.0, 0.0, 1));
    assert!(matches!(certify(&scene(&world, start, noisy), &plan), Err(Breach::Fast(..))));
    let clear = limited(Some(beyond(0.31)), Some(0.2), None);
    assert!(certify(&scene(&clear, start, noisy), &plan).is_ok());
}

#[test]
fn only_the_measured_speed_is_forgiven_its_error() {
    let noisy = Disturbance { speed_m_s: 0.05, ..EXACT };
    let world = limited(None, Some(0.4), None);
    let start = at_speed(0.455);
    // At once down to the limit: the start may have been measured 5 cm/s too high.
    let down = hold(0.0, (0.4 - 0.455) / 0.05, 1);
    assert!(certify(&scene(&world, start, noisy), &roll(start, &down)).is_ok());
    let held = hold(0.0, 0.0, 2);
    assert!(matches!(certify(&scene(&world, start, noisy), &roll(start, &held)), Err(Breach::Fast(..))));
}

#[test]
fn too_fast_for_a_limit_is_who_is_beyond_it_by_more_than_the_error_of_measurement() {
    let noisy = Disturbance { speed_m_s: 0.05, ..EXACT };
    let world = limited(None, Some(0.4), None);
    // The tolerance of a limit is 0.01.
    let brakes_from = |speed_m_s| scene(&world, at_speed(speed_m_s), noisy).limits[0].braking_from_m_s;
    assert_eq!(brakes_from(0.455), None);
    assert_eq!(brakes_from(0.465), Some(0.465));
    let at_the_limit = scene(&world, at_speed(0.4 + LIMIT_TOLERANCE), EXACT);
    assert_eq!(at_the_limit.limits[0].braking_from_m_s, None);
}

#[test]
fn who_is_too_fast_when_told_may_brake_fully_and_no_less() {
    let world = limited(None, Some(0.3), None);
    let start = at_speed(1.0);
    let verdict = |accel: f64| certify(&scene(&world, start, EXACT), &roll(start, &hold(0.0, accel, 4)));
    assert!(verdict(-3.0).is_ok());
    assert!(matches!(verdict(-2.9), Err(Breach::Fast(Source::Rule(0), _))));
    // Half a step later the same plan still passes.
    let mut plan = roll(start, &[]);
    plan.advance(0.02);
    let now = plan.state_now();
    assert!(certify(&scene(&world, now, EXACT), &plan).is_ok());
}

#[test]
fn an_obstacle_that_may_move_comes_nearer_while_the_robot_moves() {
    let world = World { points: vec![Point2::new(1.0, 0.0)], ..World::default() };
    let start = at_speed(1.0);
    let kept = |closing_speed_m_s: f64| {
        let assumptions = Assumptions { closing_speed_m_s, ..assumptions(EXACT) };
        certify(&Scene::of(&world, start, assumptions, &|_| false), &roll(start, &[])).unwrap().0
    };
    assert!((kept(0.0) - kept(0.2) - 0.2 * BRAKING_S).abs() < 1e-9);
    // What is on the map does not move.
    let mapped = World { points: vec![Point2::new(0.9, 0.0)], ..walled(1.0) };
    let assumptions = Assumptions { closing_speed_m_s: 0.2, ..assumptions(EXACT) };
    let (kept_m, _) =
        certify(&Scene::of(&mapped, start, assumptions, &|_| false), &roll(start, &[])).unwrap();
    assert!((kept_m - (0.9 - 0.25 - BRAKING_M)).abs() < 1e-4);
}

#[test]
fn what_may_have_come_nearer_is_counted_from_now_and_not_from_the_plans_beginning() {
    let world = World { points: vec![Point2::new(1.0, 0.0)], ..World::default() };
    let mut plan = roll(at_speed(1.0), &[]);
    plan.advance(0.1);
    let kept = |closing_speed_m_s: f64| {
        let assumptions = Assumptions { closing_speed_m_s, ..assumptions(EXACT) };
        certify(&Scene::of(&world, plan.state_now(), assumptions, &|_| false), &plan).unwrap().0
    };
    assert!((kept(0.0) - kept(0.2) - 0.2 * (BRAKING_S - 0.1)).abs() < 1e-9);
}

proptest! {
    #[test]
    fn between_two_samples_no_more_is_lost_than_the_bound(
        v0 in 0.0..1.5_f64, v1 in 0.0..1.5_f64, rate in -1.0..1.0_f64,
        bearing in -3.2..3.2_f64, gap in 0.0..0.3_f64,
    ) {
        let start = at_speed(v0);
        let end = start.ramped(rate, v1, 0.05);
        // An obstacle point that the hull nearly touches somewhere on the way.
        let middle = start.ramped(rate, (v0 + v1) / 2.0, 0.025);
        let far = 0.25 + gap;
        let point = Point2::new(middle.x_m + far * bearing.cos(), middle.y_m + far * bearing.sin());
        let margin = |s: State| (s.position() - point).norm() - 0.25;
        let ends = margin(start).min(margin(end));
        prop_assume!(ends >= 0.0);
        let world = World::default();
        let lost = scene(&world, start, EXACT).loss_m((v0 + v1) / 2.0 * 0.05, rate * 0.05);
        for k in 0..=200 {
            let share = f64::from(k) / 200.0;
            let between = start.ramped(rate, v0 + (v1 - v0) * share, 0.05 * share);
            prop_assert!(margin(between) >= ends - lost - 1e-12);
        }
    }
}

#[test]
fn the_loss_between_samples_is_the_bound_of_the_proof() {
    let world = World::default();
    let lost_m = scene(&world, at_speed(0.0), EXACT).loss_m(0.075, -0.05);
    let chord_m = 0.25 - (0.0625_f64 - 0.075_f64.powi(2) / 4.0).sqrt();
    assert!((lost_m - (chord_m + 0.075 * 0.05 / 4.0)).abs() < 1e-12);
}
