//! A slow, obvious version of the score and of both filters, to hold the real ones against.
//!
//! Whole states instead of running sums, every layer at every sample, every candidate to its end: nothing is
//! skipped, cut short or shared. Only the dynamics, the noise and the library of primitives are the real ones.

use crate::config::FilterConfig;
use crate::dynamics::{Control, Limits, State};
use crate::margin::{Demand, World};
use crate::noise::Noise;
use crate::primitives::primitives;
use crate::scene::Assumptions;
use crate::score::Search;

/// The margin that a motion is sure to keep when it follows `controls` and then brakes; `None` when it is not
/// certified. Zones that the robot stands in at the start do not count.
pub(crate) fn value(world: &World, a: &Assumptions, start: State, controls: &[Control]) -> Option<f64> {
    let mut states = vec![start];
    let mut rates = vec![];
    let braking = Control { yaw_rate_rad_s: 0.0, accel_m_s2: -a.limits.accel_m_s2_max };
    let mut next = controls.iter().copied();
    loop {
        let now = states[states.len() - 1];
        let control = match next.next() {
            Some(control) => control,
            None if now.speed_m_s > 0.0 => braking,
            None => break,
        };
        rates.push(control.yaw_rate_rad_s);
        states.push(now.after(control, a.step_s, &a.limits));
    }
    let mut kept = margin(world, a, start, start) - a.disturbance.position_m;
    for k in 0..rates.len() {
        let loss = loss(a, states[k], states[k + 1], rates[k]);
        let ends = margin(world, a, start, states[k]).min(margin(world, a, start, states[k + 1]));
        kept = kept.min(ends - loss - tube(a, &states[..k + 2]));
        if !heeds_limits(world, a, &states[..k + 2], rates[k]) {
            return None;
        }
    }
    (kept > 0.0).then_some(kept)
}

fn margin(world: &World, a: &Assumptions, start: State, at: State) -> f64 {
    let place = at.position();
    let mut margins = vec![];
    for layer in &world.base {
        margins.push(layer.field.sample(place) - a.radius_m);
    }
    for point in &world.points {
        margins.push((point - place).norm() - a.radius_m);
    }
    for rule in &world.rules {
        let (zone, buffer) = match &rule.demand {
            Demand::Exclusion { zone, buffer_m } => (zone, buffer_m),
            Demand::Limit { zone: Some(zone), buffer_m, speed_m_s_max: Some(0.0), .. } => (zone, buffer_m),
            _ => continue,
        };
        let stood_in = zone.sample(start.position()) - a.radius_m - buffer <= 0.0;
        if !stood_in {
            margins.push(zone.sample(place) - a.radius_m - buffer);
        }
    }
    margins.into_iter().fold(f64::INFINITY, f64::min)
}

fn loss(a: &Assumptions, from: State, to: State, rate: f64) -> f64 {
    let length = (from.speed_m_s + to.speed_m_s) / 2.0 * a.step_s;
    let r = a.radius_m;
    r - (r * r - length * length / 4.0).sqrt() + length * (rate * a.step_s).abs() / 4.0
}

/// The tube at the last of some states, the first of which is the start.
fn tube(a: &Assumptions, states: &[State]) -> f64 {
    let (mut path, mut moving) = (0.0, 0.0);
    for pair in states.windows(2) {
        let length = (pair[0].speed_m_s + pair[1].speed_m_s) / 2.0 * a.step_s;
        path += length;
        moving += if length > 0.0 { a.step_s } else { 0.0 };
    }
    let d = a.disturbance;
    let start_speed = states[0].speed_m_s;
    let carried = if start_speed > 0.0 || path > 0.0 {
        start_speed * d.delay_s + a.limits.accel_m_s2_max * d.delay_s.powi(2) / 2.0
    } else {
        0.0
    };
    let turned = (d.yaw_rad + a.limits.yaw_rate_rad_s_max * d.delay_s) * path;
    d.position_m + d.speed_m_s * moving + carried + turned
}

/// Whether the last segment of some states heeds the limits of the zones that it may touch.
fn heeds_limits(world: &World, a: &Assumptions, states: &[State], rate: f64) -> bool {
    let n = states.len();
    let (from, to) = (states[n - 2], states[n - 1]);
    let d = a.disturbance;
    let longest = a.limits.speed_m_s_max.max(states[0].speed_m_s) * a.step_s;
    let r = a.radius_m;
    let longest_loss =
        r - (r * r - longest * longest / 4.0).sqrt() + longest * a.limits.yaw_rate_rad_s_max * a.step_s / 4.0;
    let growth = d.speed_m_s * a.step_s
        + (d.yaw_rad + a.limits.yaw_rate_rad_s_max * d.delay_s) * longest
        + a.limits.accel_m_s2_max * d.delay_s.powi(2) / 2.0;
    let measured = if n == 2 { d.speed_m_s } else { 0.0 };
    world.rules.iter().all(|rule| {
        let (zone, buffer, speed, turn) = match &rule.demand {
            Demand::Exclusion { .. } => return true,
            Demand::SpeedCap { speed_m_s_max } => (&None, 0.0, Some(*speed_m_s_max), None),
            Demand::Limit { zone: Some(_), speed_m_s_max: Some(0.0), .. } => return true,
            Demand::Limit { zone, buffer_m, speed_m_s_max, yaw_rate_rad_s_max } => {
                (zone, *buffer_m, *speed_m_s_max, *yaw_rate_rad_s_max)
            }
        };
        let inside = |states: &[State]| {
            let place = states[states.len() - 1].position();
            zone.as_ref()
                .is_none_or(|zone| zone.sample(place) - r - buffer <= tube(a, states) + growth + longest_loss)
        };
        let tolerant = |limit: Option<f64>| {
            limit.map_or(f64::INFINITY, |limit| if limit > 0.0 { limit + 0.01 } else { 0.0 })
        };
        let too_fast_at_start = inside(&states[..1]) && states[0].speed_m_s - d.speed_m_s > tolerant(speed);
        let allowed = |moving_steps: usize| {
            let braked = states[0].speed_m_s - a.limits.accel_m_s2_max * a.step_s * moving_steps as f64;
            if too_fast_at_start { tolerant(speed).max(braked + 1e-9) } else { tolerant(speed) }
        };
        let moving_steps =
            |states: &[State]| states.windows(2).filter(|w| w[0].speed_m_s + w[1].speed_m_s > 0.0).count();
        !(inside(&states[..n - 1]) || inside(states))
            || (from.speed_m_s - measured <= allowed(moving_steps(&states[..n - 1]))
                && to.speed_m_s <= allowed(moving_steps(states))
                && rate.abs() <= tolerant(turn))
    })
}

/// The best value over all candidates of Alg. 1 as we run it, after `prefix`; its controls without the prefix.
/// Values below `least` do not count.
pub(crate) fn score(
    world: &World,
    a: &Assumptions,
    (search, noise): (&Search, &Noise),
    start: State,
    (prefix, rate): (&[Control], f64),
    warm: &[&[Control]],
    least: f64,
) -> Option<(f64, Vec<Control>)> {
    let after = prefix.iter().fold(start, |s, c| s.after(*c, a.step_s, &a.limits));
    let mut best: Option<(f64, Vec<Control>)> = None;
    let consider = |controls: Vec<Control>, best: &mut Option<(f64, Vec<Control>)>| {
        let all: Vec<Control> = prefix.iter().chain(&controls).copied().collect();
        if let Some(value) = value(world, a, start, &all)
            && value >= least
            && best.as_ref().is_none_or(|(best, _)| value > *best)
        {
            *best = Some((value, controls));
        }
    };
    let n_braking = (after.speed_m_s / a.limits.accel_m_s2_max / a.step_s - 1e-9).ceil() as usize;
    let rate_max = a.limits.yaw_rate_rad_s_max;
    for yaw_rate_rad_s in [0.0, rate, rate_max, -rate_max] {
        let braking = Control { yaw_rate_rad_s, accel_m_s2: -a.limits.accel_m_s2_max };
        consider(vec![braking; n_braking], &mut best);
    }
    for sequence in warm {
        consider(sequence.to_vec(), &mut best);
    }
    for round in 0..search.n_rounds {
        let fallback = warm.first().map(|w| w.to_vec()).unwrap_or_default();
        let mut incumbent = best.as_ref().map_or(fallback, |(_, controls)| controls.clone());
        incumbent.truncate(search.n_steps);
        let braking = Control { yaw_rate_rad_s: 0.0, accel_m_s2: -a.limits.accel_m_s2_max };
        incumbent.resize(search.n_steps, braking);
        for sample in 0..search.n_samples {
            let draws = noise.sequence(round * search.n_samples + sample);
            let sampled = incumbent.iter().zip(draws).map(|(c, (rate, accel))| {
                a.limits.clamped(Control {
                    yaw_rate_rad_s: c.yaw_rate_rad_s + search.sigma.yaw_rate_rad_s * rate,
                    accel_m_s2: c.accel_m_s2 + search.sigma.accel_m_s2 * accel,
                })
            });
            consider(sampled.collect(), &mut best);
        }
    }
    best
}

/// The first control of the smooth-blending filter, or of the least-restrictive one; `None` when nothing is
/// certified. `capped` is the nominal control held to the limits in force.
pub(crate) fn first_control(
    world: &World,
    a: &Assumptions,
    (search, noise): (&Search, &Noise),
    start: State,
    (nominal, capped): (Control, Control),
    (config, is_blending): (&FilterConfig, bool),
) -> Option<Control> {
    let (v, safest) = score(world, a, (search, noise), start, (&[], nominal.yaw_rate_rad_s), &[], 0.0)?;
    let needed = if is_blending {
        (1.0 - config.gamma_per_s * config.step_s) * v.min(config.ample_m)
    } else {
        config.epsilon_m
    };
    let limits: Limits = a.limits;
    // The rules' limits are the library's range; told apart from the search, they are read off the scene.
    let in_force = crate::scene::Scene::of(world, start, *a, &|_| false).limits_in_force();
    let library = if is_blending {
        primitives(nominal, capped, &limits, &in_force, Vec::new())
    } else {
        vec![nominal, capped]
    };
    let tail = |n: usize| {
        let braking = Control { yaw_rate_rad_s: 0.0, accel_m_s2: -limits.accel_m_s2_max };
        safest.iter().copied().chain(std::iter::repeat_n(braking, n)).skip(1).collect::<Vec<_>>()
    };
    // The warm start of a primitive: the safest motion from its second step to rest.
    let end = safest.iter().fold(start, |s, c| s.after(*c, a.step_s, &limits));
    let n_tail = (end.speed_m_s / limits.accel_m_s2_max / a.step_s - 1e-9).ceil().max(0.0) as usize;
    let warm = tail(n_tail);
    let passing = library.into_iter().find(|&first| {
        let prefix = [first];
        let from = (&prefix[..], first.yaw_rate_rad_s);
        score(world, a, (search, noise), start, from, &[&warm], needed).is_some()
    });
    passing.or_else(|| {
        let braking = Control { yaw_rate_rad_s: 0.0, accel_m_s2: -limits.accel_m_s2_max };
        Some(safest.first().copied().unwrap_or(braking))
    })
}

#[cfg(test)]
mod tests;
