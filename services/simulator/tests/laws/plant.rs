//! Laws of the plant.

use std::time::Duration;

use geometry::{Point2, Pose2, Time, Twist};
use heedway_simulator::base::{OdometryDrift, Plant, PlantLimits, Start};
use proptest::prelude::*;

const LIMITS: PlantLimits = PlantLimits {
    speed_m_s_max: 1.5,
    yaw_rate_rad_s_max: 1.0,
    accel_m_s2_max: 3.0,
    yaw_accel_rad_s2_max: 10.0,
    delay: Duration::ZERO,
    lag: Duration::ZERO,
    watchdog: Duration::from_millis(600),
    radius_m: 0.25,
};
/// Accelerations so large that a set-point holds from the first millisecond.
const AT_ONCE: PlantLimits = PlantLimits {
    accel_m_s2_max: 1e6,
    yaw_accel_rad_s2_max: 1e6,
    watchdog: Duration::from_secs(1000),
    ..LIMITS
};

fn plant(limits: PlantLimits) -> Plant {
    plant_with(limits, OdometryDrift::default())
}

fn plant_with(limits: PlantLimits, drift: OdometryDrift) -> Plant {
    let start = Start { map_from_start: Pose2::IDENTITY, odom_from_start: Pose2::IDENTITY };
    Plant::new(limits, drift, start, Time::ZERO)
}

fn ms(t: u64) -> Time {
    Time::ZERO + Duration::from_millis(t)
}

fn nothing(_: Point2) -> f64 {
    f64::INFINITY
}

/// Distance to a wall at x = `x_m`, which has no thickness and no end.
fn wall(x_m: f64) -> impl Fn(Point2) -> f64 {
    move |p| (x_m - p.x).abs()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_held_set_point_drives_the_exact_arc(v in -1.5..1.5_f64, w in -1.0..1.0_f64, t_ms in 1..8000_u64) {
        let mut plant = plant(AT_ONCE);
        plant.command(Time::ZERO, Twist::new(v, w));
        // One millisecond to take up the set-point, at half of it.
        plant.advance(ms(1), &nothing);
        let from = plant.map_from_base();
        plant.advance(ms(1 + t_ms), &nothing);
        let t = t_ms as f64 / 1000.0;
        let (yaw0, yaw1) = (from.yaw_rad, from.yaw_rad + w * t);
        // The closed form of a circle, where it has one.
        let (x, y) = if w.abs() > 1e-3 {
            (from.x_m + v / w * (yaw1.sin() - yaw0.sin()), from.y_m - v / w * (yaw1.cos() - yaw0.cos()))
        } else {
            (from.x_m + v * t * yaw0.cos(), from.y_m + v * t * yaw0.sin())
        };
        let at = plant.map_from_base();
        let tolerance_m = if w.abs() > 1e-3 { 1e-9 } else { v.abs() * w.abs() * t * t };
        prop_assert!((at.x_m - x).abs() <= tolerance_m + 1e-9, "{} {}", at.x_m, x);
        prop_assert!((at.y_m - y).abs() <= tolerance_m + 1e-9, "{} {}", at.y_m, y);
    }

    #[test]
    fn however_it_is_driven_it_never_tunnels_and_counts_each_contact_once(
        commands in prop::collection::vec((-1.5..1.5_f64, -1.0..1.0_f64), 1..40),
        x_m in 0.3..2.0_f64,
    ) {
        let mut plant = plant(LIMITS);
        let mut touched = false;
        let mut n_entered = 0;
        for (k, (v, w)) in (0_u64..).zip(commands) {
            plant.command(ms(k * 300), Twist::new(v, w));
            for t in 0..300 {
                plant.advance(ms(k * 300 + t + 1), &wall(x_m));
                let gap_m = x_m - plant.map_from_base().x_m - 0.25;
                prop_assert!(gap_m > -2e-4, "{} m deep", -gap_m);
                n_entered += u64::from(plant.in_contact() && !touched);
                touched = plant.in_contact();
            }
        }
        prop_assert_eq!(plant.n_collisions(), n_entered);
    }

    #[test]
    fn it_is_at_rest_after_the_delay_and_the_braking_time_and_not_before(
        v in 0.1..1.5_f64, delay_ms in 0..200_u64,
    ) {
        let patient = PlantLimits { watchdog: Duration::from_secs(10), ..LIMITS };
        let mut plant = plant(PlantLimits { delay: Duration::from_millis(delay_ms), ..patient });
        plant.command(Time::ZERO, Twist::new(v, 0.0));
        plant.advance(ms(550 + delay_ms), &nothing);
        prop_assert!((plant.twist().speed_m_s - v).abs() < 1e-12);
        let said_at = plant.now();
        plant.command(said_at, Twist::ZERO);
        let braking = Duration::from_secs_f64(v / 3.0);
        plant.advance(said_at + Duration::from_millis(delay_ms), &nothing);
        let x_m = plant.map_from_base().x_m;
        prop_assert!((plant.twist().speed_m_s - v).abs() < 1e-9, "nothing happens before the delay is over");
        plant.advance(said_at + Duration::from_millis(delay_ms + 2) + braking, &nothing);
        prop_assert_eq!(plant.twist(), Twist::ZERO);
        let braked_m = plant.map_from_base().x_m - x_m;
        prop_assert!((braked_m - v * v / 6.0).abs() < 0.001 * v + 1e-6, "{}", braked_m);
    }

    #[test]
    fn neither_limit_of_acceleration_is_ever_exceeded(
        commands in prop::collection::vec((-3.0..3.0_f64, -3.0..3.0_f64), 1..20), lag_ms in 0..100_u64,
    ) {
        let mut plant = plant(PlantLimits { lag: Duration::from_millis(lag_ms), ..LIMITS });
        for (k, (v, w)) in (0_u64..).zip(commands) {
            plant.command(ms(k * 100), Twist::new(v, w));
            for t in 0..100 {
                let before = plant.twist();
                plant.advance(ms(k * 100 + t + 1), &nothing);
                let after = plant.twist();
                prop_assert!((after.speed_m_s - before.speed_m_s).abs() <= 0.003 + 1e-5);
                prop_assert!((after.yaw_rate_rad_s - before.yaw_rate_rad_s).abs() <= 0.01 + 1e-5);
                prop_assert!(after.speed_m_s.abs() <= 1.5 && after.yaw_rate_rad_s.abs() <= 1.0);
            }
        }
    }

    #[test]
    fn how_the_time_is_cut_changes_nothing_but_rounding(v in 0.1..1.5_f64, w in -1.0..1.0_f64) {
        let (mut coarse, mut fine) = (plant(LIMITS), plant(LIMITS));
        coarse.command(Time::ZERO, Twist::new(v, w));
        fine.command(Time::ZERO, Twist::new(v, w));
        coarse.advance(ms(500), &nothing);
        (1..=500).for_each(|t| fine.advance(ms(t), &nothing));
        prop_assert_eq!(coarse.map_from_base(), fine.map_from_base());
    }
}

#[test]
fn after_a_contact_it_can_drive_away_and_bump_again() {
    let mut plant = plant(LIMITS);
    let mut at_ms = 0;
    let mut drive = |plant: &mut Plant, v: f64| {
        for _ in 0..20 {
            plant.command(ms(at_ms), Twist::new(v, 0.0));
            at_ms += 50;
            plant.advance(ms(at_ms), &wall(0.8));
        }
    };
    drive(&mut plant, 1.0);
    assert_eq!((plant.n_collisions(), plant.twist().speed_m_s), (1, 0.0));
    assert!(plant.in_contact());
    drive(&mut plant, -0.5);
    assert!(!plant.in_contact() && plant.map_from_base().x_m < 0.4);
    drive(&mut plant, 1.0);
    assert_eq!(plant.n_collisions(), 2);
}

#[test]
fn a_base_that_hears_nothing_stops_by_itself_and_a_long_pause_costs_nothing() {
    let mut plant = plant(LIMITS);
    plant.command(Time::ZERO, Twist::new(1.5, 0.5));
    plant.advance(ms(600), &nothing);
    assert!((plant.twist().speed_m_s - 1.5).abs() < 1e-9);
    plant.advance(ms(600 + 502), &nothing);
    assert_eq!(plant.twist(), Twist::ZERO);
    let at = plant.map_from_base();
    // A year: it must not be integrated in milliseconds.
    plant.advance(Time::ZERO + Duration::from_secs(31_536_000), &nothing);
    assert_eq!(plant.map_from_base(), at);
}

#[test]
fn numbers_that_are_none_are_taken_as_standing_still() {
    let mut plant = plant(LIMITS);
    plant.command(Time::ZERO, Twist::new(f64::NAN, f64::INFINITY));
    plant.advance(ms(100), &nothing);
    assert_eq!(plant.map_from_base(), Pose2::IDENTITY);
}

#[test]
fn wheels_without_drift_are_exact_and_with_drift_err_as_told() {
    let drive = |drift| {
        let mut plant = plant_with(AT_ONCE, drift);
        for k in 0..40 {
            plant.command(ms(50 * k), Twist::new(1.0, if k % 2 == 0 { 0.8 } else { -0.3 }));
            plant.advance(ms(50 * (k + 1)), &nothing);
        }
        (plant.map_from_base(), plant.odom_from_base())
    };
    let (truth, exact) = drive(OdometryDrift::default());
    assert_eq!(truth, exact);
    let (truth, drifted) = drive(OdometryDrift { scale: 0.0, yaw_rad_per_m: 0.1 });
    // Two metres were driven.
    assert!((drifted.yaw_rad - truth.yaw_rad - 0.2).abs() < 1e-3);

    let mut straight = plant_with(AT_ONCE, OdometryDrift { scale: 0.05, yaw_rad_per_m: 0.0 });
    straight.command(Time::ZERO, Twist::new(1.0, 0.0));
    straight.advance(ms(2000), &nothing);
    assert!((straight.odom_from_base().x_m / straight.map_from_base().x_m - 1.05).abs() < 1e-9);
}
