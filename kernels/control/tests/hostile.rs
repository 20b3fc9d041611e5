//! Hostile nominal commands in generated worlds: no collision, no zone entered, no limit broken.
//!
//! `HEEDWAY_STEPS` sets the number of steps (a million for the full run), `HEEDWAY_SEED` the first seed.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a case that cannot be set up must fail")]
#![allow(clippy::print_stdout, reason = "the tally says how much was proven")]

mod arena;

use std::time::Duration;

use arena::{Arena, Base, Plant, TrueRule, chance, count, seed};
use control::{Certified, Filter, FilterConfig, Method, State};
use geometry::{Point2, Profile, Twist, angle::turn};
use rand::RngExt;
use rand_xoshiro::Xoshiro256PlusPlus;

const STEPS_PER_WORLD: usize = 300;

/// Ways to be hostile.
#[derive(Clone, Copy, Debug)]
enum Hostile {
    /// Full speed at the nearest obstacle or zone.
    AtNearest,
    /// Anything, anew at every step.
    Random,
    /// Full speed and full turn, either way, changing now and then.
    BangBang,
}

fn nearest_point(arena: &Arena, place: Point2) -> Point2 {
    let zones = arena.rules.iter().filter_map(|rule| match rule {
        TrueRule::Exclusion { zone, .. } | TrueRule::Limit { zone: Some(zone), .. } => Some(zone),
        TrueRule::Limit { .. } => None,
    });
    let foot = |a: Point2, b: Point2| {
        let along = b - a;
        a + along * ((place - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0)
    };
    let polygons = arena.obstacles.iter().chain(zones);
    let feet = polygons.flat_map(|p| p.edges().map(|(a, b)| foot(a, b)).collect::<Vec<_>>());
    feet.min_by(|a, b| (a - place).norm().total_cmp(&(b - place).norm())).unwrap()
}

fn nominal(
    kind: Hostile,
    arena: &Arena,
    state: State,
    held: &mut Twist,
    profile: &Profile,
    c: &mut Xoshiro256PlusPlus,
) -> Twist {
    let (v, w) = (profile.speed_m_s_max, profile.yaw_rate_rad_s_max);
    match kind {
        Hostile::AtNearest => {
            let to = nearest_point(arena, state.position()) - state.position();
            Twist::new(v, (4.0 * turn(state.yaw_rad, to.y.atan2(to.x))).clamp(-w, w))
        }
        Hostile::Random => Twist::new(c.random_range(-0.5 * v..1.5 * v), c.random_range(-1.5 * w..1.5 * w)),
        Hostile::BangBang => {
            if c.random_range(0..20) == 0 {
                *held = Twist::new(v, [-w, 0.0, w][c.random_range(0..3)]);
            }
            *held
        }
    }
}

#[derive(Default)]
struct Tally {
    steps: usize,
    uncertified: usize,
    metres: f64,
}

/// Drives one world; panics with its seed at the first thing broken.
///
/// `late` is the share of ticks in which no decision is made in time, and the rest of the plan is sent.
fn drive(
    world_seed: u64,
    config: &FilterConfig,
    profile: &Profile,
    (plant, late): (Plant, f64),
    tally: &mut Tally,
) {
    let mut c = chance(world_seed ^ 0xD1CE);
    let n_rules = c.random_range(0..5);
    let arena = Arena::generated(world_seed, n_rules, profile);
    let radius_m = profile.radius_m;
    let Some(place) = arena.free_place(&mut c, radius_m, 0.1) else { return };
    let mut base = Base::at(place, c.random_range(-3.0..3.0), profile, plant);
    let mut filter = Filter::new(config.clone(), profile).unwrap();
    let kind = [Hostile::AtNearest, Hostile::Random, Hostile::BangBang][c.random_range(0..3)];
    let mut held = Twist::new(profile.speed_m_s_max, 0.0);
    // Ticks as fast as the step, or faster.
    let tick_ms = [50, 50, 20, 10][c.random_range(0..4)];
    let moved_from = base.place();
    for step in 0..STEPS_PER_WORLD {
        let wanted = nominal(kind, &arena, base.state(), &mut held, profile, &mut c);
        let measured = base.measured(&mut c);
        let elapsed = Duration::from_millis(if step == 0 { 0 } else { tick_ms });
        let decision =
            (c.random_range(0.0..1.0) >= late).then(|| filter.step(elapsed, measured, wanted, &arena.world));
        let command = match &decision {
            Some(decision) => decision.command,
            None => filter.rest(elapsed),
        };
        let failing = || format!("seed {world_seed}, step {step}, {kind:?}, {plant:?}, {decision:?}");
        assert!(command.is_finite(), "{}", failing());
        tally.uncertified += usize::from(decision.as_ref().is_some_and(|d| d.certified != Certified::Yes));
        for _ in 0..tick_ms {
            base.millisecond(command);
            let clear = arena.clearance_m(base.place(), radius_m);
            assert!(clear >= 0.0, "hit by {} mm: {}", -1e3 * clear, failing());
            let outside = arena.exclusion_m(base.place(), radius_m);
            assert!(outside >= 0.0, "entered by {} mm: {}", -1e3 * outside, failing());
            let over = arena.over_limit(base.place(), radius_m, base.v, base.rate);
            assert!(over <= 0.0101 + plant.speed_m_s, "over a limit by {over}: {}", failing());
        }
        tally.steps += 1;
    }
    tally.metres += (base.place() - moved_from).norm();
}

fn run(
    config: impl Fn(&Profile) -> FilterConfig,
    (plant, late): (impl Fn(&FilterConfig) -> Plant, f64),
    share: f64,
) {
    let n_steps = (count("HEEDWAY_STEPS", 40_000) as f64 * share) as usize;
    let first = seed(1);
    let mut tally = Tally::default();
    let mut world_seed = first;
    while tally.steps < n_steps {
        let profile = if world_seed.is_multiple_of(2) { Profile::sim() } else { Profile::turtlebot2() };
        let config = config(&profile);
        drive(world_seed, &config, &profile, (plant(&config), late), &mut tally);
        world_seed += 1;
    }
    let worlds = world_seed - first;
    println!(
        "{} steps in {worlds} worlds, {} not certified, {:.1} m moved",
        tally.steps, tally.uncertified, tally.metres
    );
    assert!(tally.metres > 0.05 * worlds as f64, "a filter that never moves proves nothing");
}

fn ideal(_: &FilterConfig) -> Plant {
    Plant::default()
}

fn without_latency(profile: &Profile) -> FilterConfig {
    FilterConfig { latency_s: 0.0, ..FilterConfig::for_profile(profile) }
}

#[test]
fn smooth_blending_never_hits_nor_enters_whatever_it_is_told() {
    run(without_latency, (ideal, 0.0), 0.3);
}

#[test]
fn least_restrictive_never_hits_nor_enters_whatever_it_is_told() {
    let config =
        |profile: &Profile| FilterConfig { method: Method::LeastRestrictive, ..without_latency(profile) };
    run(config, (ideal, 0.0), 0.2);
}

#[test]
fn nothing_is_hit_with_disturbances_within_the_configured_radii() {
    // Measured latency is compensated; what is left of the delay is within the radius.
    let plant = |config: &FilterConfig| Plant {
        lag_s: 0.0,
        delay_ms: (config.latency_s * 1e3) as usize + 10,
        position_m: config.disturbance.position_m,
        yaw_rad: config.disturbance.yaw_rad,
        speed_m_s: config.disturbance.speed_m_s,
    };
    run(FilterConfig::for_profile, (plant, 0.0), 0.3);
}

#[test]
fn ticks_that_run_late_send_what_is_left_of_the_plan_and_nothing_is_hit() {
    run(without_latency, (ideal, 0.4), 0.2);
}
