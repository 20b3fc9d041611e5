//! Out of what is broken already: told to slow while fast, to leave what it stands in, to stand still.
//!
//! `HEEDWAY_STARTS` sets the number of generated starts (500 for the full run), `HEEDWAY_SEED` the first seed.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a case that cannot be set up must fail")]
#![allow(clippy::print_stdout, reason = "`HEEDWAY_TRACE=1` replays a failing seed step by step")]

mod arena;

use std::time::Duration;

use arena::{Arena, Base, Plant, TrueRule, chance, count, rectangle, seed};
use control::{Action, Filter, FilterConfig, State};
use geometry::{Point2, Profile, Twist};
use rand::RngExt;

const TICK: Duration = Duration::from_millis(50);

fn filter(profile: &Profile) -> Filter {
    let config = FilterConfig { latency_s: 0.0, ..FilterConfig::for_profile(profile) };
    Filter::new(config, profile).unwrap()
}

fn tick(filter: &mut Filter, base: &mut Base, nominal: Twist, arena: &Arena) -> control::Decision {
    let decision = filter.step(TICK, base.state(), nominal, &arena.world);
    for _ in 0..50 {
        base.millisecond(decision.command);
    }
    decision
}

/// Clearance of a way out that a map of 5 cm cells is sure to show, metres: a cell counts as occupied when the
/// obstacle may touch it, and a distance as the least that its cells allow, each half a diagonal, and the error of
/// the position on top.
const SHOWN_M: f64 = 2.0 * 0.5 * std::f64::consts::SQRT_2 * arena::CELL_M + 0.01;
/// Clearance of a way out that there may be all the same, metres: nobody is kept from taking it, nobody must.
const TIGHT_M: f64 = 0.05;

/// Shortest way with this clearance to a place clear of every zone, by a flood over the true polygons on a 4 cm
/// grid, metres.
fn true_exit_m(arena: &Arena, from: Point2, radius_m: f64, clearance_m: f64) -> Option<f64> {
    let cell = 0.04;
    let (cols, rows) =
        (((arena.high.x - arena.low.x) / cell) as i64 + 1, ((arena.high.y - arena.low.y) / cell) as i64 + 1);
    let place = |c: i64, r: i64| Point2::new(arena.low.x + c as f64 * cell, arena.low.y + r as f64 * cell);
    let start =
        (((from.x - arena.low.x) / cell).round() as i64, ((from.y - arena.low.y) / cell).round() as i64);
    let mut cost = std::collections::HashMap::from([(start, 0.0_f64)]);
    let mut queue = std::collections::BTreeSet::from([(0_u64, start)]);
    while let Some((_, (c, r))) = queue.pop_first() {
        let here = cost[&(c, r)];
        // Planner's clearance: what an exit must leave room for.
        if arena.exclusion_m(place(c, r), radius_m) > 0.03 {
            return Some(here);
        }
        for (dc, dr) in [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)] {
            let (nc, nr) = (c + dc, r + dr);
            if nc < 0 || nr < 0 || nc >= cols || nr >= rows {
                continue;
            }
            if arena.clearance_m(place(nc, nr), radius_m) < clearance_m {
                continue;
            }
            let there = here + cell * f64::from(((dc * dc + dr * dr) as f32).sqrt());
            if there < *cost.get(&(nc, nr)).unwrap_or(&f64::INFINITY) - 1e-9 {
                cost.insert((nc, nr), there);
                queue.insert(((there * 1e6) as u64, (nc, nr)));
            }
        }
    }
    None
}

struct Left {
    seconds: f64,
    shortest_s: f64,
    /// Whether the map shows the way out ([`SHOWN_M`]).
    shown: bool,
}

/// Puts the robot into zones of up to 3 m and waits for it to leave; `None` when there is no exit.
fn leave(world_seed: u64) -> Option<Result<Left, String>> {
    let profile = if world_seed.is_multiple_of(2) { Profile::sim() } else { Profile::turtlebot2() };
    let radius_m = profile.radius_m;
    let mut c = chance(world_seed ^ 0xE417);
    let mut arena = Arena::generated(world_seed, 0, &profile);
    let place = arena.free_place(&mut c, radius_m, 0.06)?;
    for _ in 0..c.random_range(1..3) {
        let off = Point2::new(place.x + c.random_range(-0.5..0.5), place.y + c.random_range(-0.5..0.5));
        let half = (c.random_range(0.4..1.5), c.random_range(0.4..1.5));
        let zone = rectangle(off, half, c.random_range(-3.0..3.0));
        arena.add(TrueRule::Exclusion { zone, buffer_m: c.random_range(0.0..0.3) });
    }
    let shown_m = true_exit_m(&arena, place, radius_m, SHOWN_M);
    let exit_m = shown_m.or_else(|| true_exit_m(&arena, place, radius_m, TIGHT_M))?;
    let shown = shown_m.is_some();
    let mut base = Base::at(place, c.random_range(-3.0..3.0), &profile, Plant::default());
    let mut filter = filter(&profile);
    // Half a turn, then the way at full speed with its start and end: the longest of the shortest.
    let ramp_s = profile.speed_m_s_max / profile.accel_m_s2_max;
    let shortest_s =
        std::f64::consts::PI / profile.yaw_rate_rad_s_max + exit_m / profile.speed_m_s_max + ramp_s;
    let limit_s = 3.0 * shortest_s + 5.0;
    let mut seconds = 0.0;
    let mut said = String::new();
    while arena.exclusion_m(base.place(), radius_m) <= 0.0 {
        if seconds > limit_s {
            if !shown && said.contains("no way out") {
                return Some(Ok(Left { seconds, shortest_s, shown }));
            }
            let left = arena.exclusion_m(base.place(), radius_m);
            return Some(Err(format!(
                "seed {world_seed}: still {left:.2} m in after {limit_s:.0} s, exit {exit_m:.2} m: {said}"
            )));
        }
        let decision = tick(&mut filter, &mut base, Twist::ZERO, &arena);
        if std::env::var("HEEDWAY_TRACE").is_ok() {
            println!(
                "({:.3}, {:.3}, {:.3}) v {:.3} sent {:?} clear {:.3} zone {:.3} {:?}",
                base.x,
                base.y,
                base.yaw,
                base.v,
                decision.command,
                arena.clearance_m(base.place(), radius_m),
                arena.exclusion_m(base.place(), radius_m),
                decision.certified,
            );
        }
        said = format!("{:?} {} {:?}", decision.action, decision.words, decision.certified);
        let clear = arena.clearance_m(base.place(), radius_m);
        if clear < 0.0 {
            return Some(Err(format!("seed {world_seed}: hit while leaving: {decision:?}")));
        }
        seconds += TICK.as_secs_f64();
    }
    Some(Ok(Left { seconds, shortest_s, shown }))
}

#[test]
fn who_stands_in_a_zone_leaves_it_without_hitting_anything() {
    let n_starts = count("HEEDWAY_STARTS", 25);
    let (mut n, mut slow, mut tight, mut failed, mut world_seed) = (0, 0, 0, vec![], seed(1));
    while n < n_starts {
        match leave(world_seed) {
            None => {}
            Some(Ok(left)) if !left.shown => tight += 1,
            Some(Ok(left)) => {
                n += 1;
                slow += usize::from(left.seconds > 1.5 * left.shortest_s);
            }
            Some(Err(why)) => {
                n += 1;
                failed.push(why);
            }
        }
        world_seed += 1;
    }
    println!("{n} starts, {} still in, {slow} slower than 1.5 times the shortest", failed.len());
    println!("beside them {tight} whose only way out is narrower than the map can show: left, or said so");
    for why in &failed {
        println!("{why}");
    }
    assert!(failed.is_empty());
    assert!(slow * 20 <= n, "{slow} of {n} slow");
}

fn open_room() -> Arena {
    Arena::new((8.0, 6.0), vec![], vec![])
}

fn fast(speed_m_s: f64) -> Base {
    let mut base = Base::at(Point2::new(2.0, 3.0), 0.0, &Profile::sim(), Plant::default());
    base.v = speed_m_s;
    base
}

#[test]
fn told_to_slow_while_fast_it_brakes_fully_and_says_why() {
    let mut arena = open_room();
    let (mut base, mut filter) = (fast(1.5), filter(&Profile::sim()));
    let full = Twist::new(1.5, 0.0);
    tick(&mut filter, &mut base, full, &arena);
    arena.add(TrueRule::Limit {
        zone: None,
        buffer_m: 0.0,
        speed_m_s_max: 0.3,
        rate_rad_s_max: f64::INFINITY,
    });
    for k in 1..=8 {
        let decision = tick(&mut filter, &mut base, full, &arena);
        let wanted = (1.5 - 0.15 * f64::from(k)).max(0.3);
        assert!(base.v <= wanted + 0.011, "tick {k}: {} m/s, {decision:?}", base.v);
        assert_eq!(decision.action, Action::Recovering { rule: Some("s1".to_owned()) }, "tick {k}");
    }
    let decision = tick(&mut filter, &mut base, full, &arena);
    assert!(base.v > 0.2 && base.v <= 0.31, "it drives on within the limit: {} {decision:?}", base.v);
    assert_eq!(decision.binding.map(|b| b.id), Some("s1".to_owned()));
}

#[test]
fn a_zone_that_appears_too_near_to_stop_is_entered_as_little_as_braking_allows_and_left_again() {
    let mut arena = open_room();
    let (mut base, mut filter) = (fast(1.5), filter(&Profile::sim()));
    tick(&mut filter, &mut base, Twist::new(1.5, 0.0), &arena);
    let ahead = Point2::new(base.x + 0.25 + 0.1 + 0.3, 3.0);
    arena.add(TrueRule::Exclusion { zone: rectangle(ahead, (0.3, 0.3), 0.0), buffer_m: 0.0 });
    let first = tick(&mut filter, &mut base, Twist::new(1.5, 0.0), &arena);
    assert_eq!(first.action, Action::LeastHarm, "{first:?}");
    assert!(base.v < 1.5);
    let mut deepest = 0.0_f64;
    for _ in 0..200 {
        tick(&mut filter, &mut base, Twist::ZERO, &arena);
        deepest = deepest.min(arena.exclusion_m(base.place(), 0.25));
    }
    assert!(deepest > -0.4, "{deepest}");
    assert!(arena.exclusion_m(base.place(), 0.25) > 0.0);
}

#[test]
fn told_not_to_move_near_something_one_who_is_in_stands_still_and_one_outside_stays_out() {
    let still = |centre: Point2| TrueRule::Limit {
        zone: Some(rectangle(centre, (0.4, 0.4), 0.0)),
        buffer_m: 0.2,
        speed_m_s_max: 0.0,
        rate_rad_s_max: f64::INFINITY,
    };
    let full = Twist::new(1.5, 0.0);
    let mut inside = open_room();
    inside.add(still(Point2::new(2.0, 3.0)));
    let (mut base, mut f) = (fast(0.0), filter(&Profile::sim()));
    for _ in 0..100 {
        let decision = tick(&mut f, &mut base, full, &inside);
        assert_eq!(decision.command.speed_m_s, 0.0, "{decision:?}");
        assert_eq!(decision.binding.map(|b| b.id), Some("s1".to_owned()));
    }
    let mut ahead = open_room();
    ahead.add(still(Point2::new(5.0, 3.0)));
    let (mut base, mut f) = (fast(0.0), filter(&Profile::sim()));
    for _ in 0..100 {
        tick(&mut f, &mut base, full, &ahead);
        assert!(ahead.exclusion_m(base.place(), 0.25) >= 0.0);
    }
    assert!(base.x > 3.0, "it comes near, {}", base.x);
}

#[test]
fn an_obstacle_already_too_near_does_not_hold_the_robot() {
    // 1 mm of clearance: inside the tube, so nothing is certified; driving off is still allowed.
    let profile = Profile::sim();
    let post = rectangle(Point2::new(3.0, 3.0), (0.2, 0.2), 0.0);
    let arena = Arena::new((8.0, 6.0), vec![post], vec![]);
    let place = Point2::new(3.0 - 0.2 - profile.radius_m - 0.001, 3.0);
    let mut base = Base::at(place, 0.0, &profile, Plant::default());
    let mut f = filter(&profile);
    let away = Twist::new(0.5, 0.0);
    for _ in 0..120 {
        let decision = tick(&mut f, &mut base, away, &arena);
        assert!(arena.clearance_m(base.place(), profile.radius_m) >= 0.0, "{decision:?}");
    }
    assert!(arena.clearance_m(base.place(), profile.radius_m) > 0.005);
}

#[test]
fn a_state_that_is_not_finite_brakes_to_rest() {
    let arena = open_room();
    let (mut base, mut f) = (fast(1.0), filter(&Profile::sim()));
    let before = tick(&mut f, &mut base, Twist::new(1.0, 0.2), &arena).command;
    for (k, bad) in
        [f64::NAN, f64::INFINITY, f64::NAN, f64::NAN, f64::NAN, f64::NAN, f64::NAN].iter().enumerate()
    {
        let state = State { x_m: *bad, ..base.state() };
        let decision = f.step(TICK, state, Twist::new(1.0, 0.0), &arena.world);
        assert_eq!(decision.action, Action::Braking);
        let wanted = (before.speed_m_s - 0.15 * (k + 1) as f64).max(0.0);
        assert!((decision.command.speed_m_s - wanted).abs() < 1e-9, "{decision:?}");
    }
    let decision = f.step(TICK, base.state(), Twist::new(f64::NAN, 0.0), &arena.world);
    assert_eq!((decision.action, decision.command), (Action::Braking, Twist::ZERO));
}
