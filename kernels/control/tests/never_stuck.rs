//! Planner, tracker and filter together reach every goal that the rules allow.
//!
//! `HEEDWAY_WORLDS` sets the number of worlds (1000 for the full run), `HEEDWAY_SEED` the first seed.
//! `HEEDWAY_COMPARE=1` reports the other methods beside smooth blending.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a case that cannot be set up must fail")]
#![allow(clippy::print_stdout, reason = "`HEEDWAY_TRACE=1` replays a failing seed step by step")]

mod arena;

use std::time::Duration;

use arena::{Arena, Base, Plant, TrueRule, chance, count, seed};
use control::{
    Costmap, Filter, FilterConfig, Method, Tracker, TrackerGains, planner_clearance_m, shortest_path,
};
use control::{Demand, NoPath};
use geometry::{Point2, Profile, Twist};
use mapping::DistanceField;
use rand::RngExt;

const TICK: Duration = Duration::from_millis(50);

#[derive(Debug, PartialEq)]
enum End {
    Reached,
    /// Stopped short: what the filter said last, where, and how far from the goal.
    Short(String),
    Collided,
    Entered,
    Infeasible,
}

fn planned(arena: &Arena, profile: &Profile) -> Costmap {
    let zones: Vec<(&DistanceField, f64)> = arena
        .world
        .rules
        .iter()
        .filter_map(|rule| match &rule.demand {
            Demand::Exclusion { zone, buffer_m } => Some((&**zone, *buffer_m)),
            Demand::Limit { .. } | Demand::SpeedCap { .. } => None,
        })
        .collect();
    Costmap::new(&arena.map, &zones, planner_clearance_m(arena::CELL_M), profile)
}

/// The slowest that the rules may ask for, m/s.
fn slowest(arena: &Arena, profile: &Profile) -> f64 {
    let limit = |rule: &TrueRule| match rule {
        TrueRule::Limit { speed_m_s_max, .. } => *speed_m_s_max,
        TrueRule::Exclusion { .. } => profile.speed_m_s_max,
    };
    arena.rules.iter().map(limit).fold(profile.speed_m_s_max, f64::min)
}

fn drive(world_seed: u64, method: Method, plant: Plant) -> End {
    let profile = if world_seed.is_multiple_of(2) { Profile::sim() } else { Profile::turtlebot2() };
    let mut c = chance(world_seed ^ 0x60A1);
    let arena = Arena::generated(world_seed, (world_seed / 2 % 5) as usize, &profile);
    let map = planned(&arena, &profile);
    let free = |c: &mut _| arena.free_place(c, profile.radius_m, 0.06).filter(|p| map.is_free(*p));
    let (Some(start), Some(goal)) = (free(&mut c), free(&mut c)) else { return End::Infeasible };
    let Ok(path) = shortest_path(&map, start, goal) else { return End::Infeasible };
    let length_m: f64 = path.windows(2).map(|w| (w[1] - w[0]).norm()).sum();
    let seconds = 20.0 + 3.0 * length_m / slowest(&arena, &profile);

    let config = FilterConfig { method, latency_s: 0.0, ..FilterConfig::for_profile(&profile) };
    let mut filter = Filter::new(config, &profile).unwrap();
    let tracker = Tracker::new(&profile, TrackerGains::default());
    let mut base = Base::at(start, c.random_range(-3.0..3.0), &profile, plant);
    let (mut path, mut said) = (path, String::new());
    for tick in 0..(seconds / TICK.as_secs_f64()) as usize {
        if (goal - base.place()).norm() <= 0.15 {
            return End::Reached;
        }
        if tick % 10 == 0 {
            path = replanned(&map, base.place(), goal).unwrap_or(path);
        }
        let measured = base.measured(&mut c);
        let nominal = tracker.step(measured.pose(), measured.speed_m_s, &path, &map);
        let decision = filter.step(TICK, measured, nominal, &arena.world);
        for _ in 0..50 {
            base.millisecond(decision.command);
            if arena.clearance_m(base.place(), profile.radius_m) < 0.0 {
                return End::Collided;
            }
            if arena.exclusion_m(base.place(), profile.radius_m) < 0.0 {
                return End::Entered;
            }
        }
        if std::env::var("HEEDWAY_TRACE").is_ok() {
            println!(
                "{tick} ({:.3}, {:.3}, {:.3}) v {:.3} nominal ({:.2}, {:.2}) sent ({:.2}, {:.2}) V {:.4} {} clear {:.3} zone {:.3} path {:.2?}",
                base.x,
                base.y,
                base.yaw,
                base.v,
                nominal.speed_m_s,
                nominal.yaw_rate_rad_s,
                decision.command.speed_m_s,
                decision.command.yaw_rate_rad_s,
                decision.v_safe_m,
                decision.words,
                arena.clearance_m(base.place(), profile.radius_m),
                arena.exclusion_m(base.place(), profile.radius_m),
                path.iter().skip(1).step_by(5).take(3).map(|p| (p.x, p.y)).collect::<Vec<_>>(),
            );
        }
        if tick % 20 == 0 {
            said = format!(
                "{:.2} m left, nominal {:?}, V {:.3}, {}, {:?}",
                (goal - base.place()).norm(),
                (nominal.speed_m_s, nominal.yaw_rate_rad_s),
                decision.v_safe_m,
                decision.words,
                decision.action,
            );
        }
    }
    End::Short(said)
}

fn replanned(map: &Costmap, from: Point2, goal: Point2) -> Result<Vec<Point2>, NoPath> {
    shortest_path(map, from, goal)
}

fn run(method: Method, n_worlds: usize, plant: Plant) -> (usize, Vec<(u64, End)>) {
    let (mut n, mut failed, mut world_seed) = (0, vec![], seed(1));
    while n < n_worlds {
        match drive(world_seed, method, plant) {
            End::Infeasible => {}
            End::Reached => n += 1,
            end => {
                n += 1;
                failed.push((world_seed, end));
            }
        }
        world_seed += 1;
    }
    (n, failed)
}

#[test]
fn smooth_blending_reaches_the_goal_in_every_world_that_allows_it() {
    let (n, failed) = run(Method::SmoothBlending, count("HEEDWAY_WORLDS", 30), Plant::default());
    for (seed, end) in &failed {
        println!("seed {seed}: {end:?}");
    }
    println!("smooth blending: {} of {n} short", failed.len());
    assert!(failed.len() * 500 <= n, "{failed:?}");
    if std::env::var("HEEDWAY_COMPARE").is_ok() {
        for method in [Method::LeastRestrictive, Method::PaperLiteral, Method::PaperLiteralBlending] {
            let (n, failed) = run(method, n, Plant::default());
            let hit = failed.iter().filter(|(_, end)| *end == End::Collided).count();
            let entered = failed.iter().filter(|(_, end)| *end == End::Entered).count();
            let short = failed.len() - hit - entered;
            println!("{method:?}: {short} of {n} short, {hit} collided, {entered} entered a zone");
        }
    }
}

#[test]
fn a_base_told_to_go_nowhere_goes_nowhere() {
    let profile = Profile::sim();
    let arena = Arena::generated(3, 0, &profile);
    let mut filter = Filter::new(FilterConfig::for_profile(&profile), &profile).unwrap();
    let place = arena.free_place(&mut chance(3), profile.radius_m, 0.1).unwrap();
    let base = Base::at(place, 0.0, &profile, Plant::default());
    for _ in 0..40 {
        let decision = filter.step(TICK, base.state(), Twist::ZERO, &arena.world);
        assert_eq!(decision.command, Twist::ZERO, "{decision:?}");
    }
}
