//! The certificate: a plan that ends at rest and stays clear, also between its samples.
//!
//! **Claim.** If a plan passes `certify`, then any base that follows it within the assumptions keeps its
//! hull clear of every obstacle and every exclusion, and heeds every limit, until it is at rest and after.
//!
//! **Assumptions.** (1) A field is never above the true distance to its obstacle (`mapping`). (2) The hull
//! lies in a disc of radius r. (3) Obstacles stand still, save scan hits, which come closer at no more than
//! the configured speed while the robot moves. (4) The base follows set-points with its acceleration limit,
//! off the model by no more than the configured disturbance: position and heading at the start, speed while
//! moving, commands late by δ. (5) Commands follow each other within Δ; what is later counts into δ.
//!
//! **Between samples.** Take a segment of path length L = (v₀ + v₁)Δ/2 that turns by φ ≤ ½ rad, and an
//! obstacle point O whose distance from both ends is at least D = r + m, with m the smaller margin. (i) Every
//! point P of the path is within Lφ/4 of the chord: the heading stays in a fan of width φ, and of all paths
//! of length L in that fan the triangle with two sides of L/2 bulges most, by L/2 · sin(φ/2) ≤ Lφ/4. Heading
//! and chord differ by less than a right angle, so P's foot Q lies on the chord. (ii) On a chord c ≤ L, a
//! point Q is nearest to an O that is at least D from both ends when O is over the middle: |OQ| ≥ √(D² − c²/4)
//! ≥ √(D² − L²/4). Hence |OP| ≥ √(D² − L²/4) − Lφ/4. As D − √(D² − L²/4) falls with D and D ≥ r, the margin
//! on the segment is at least m − [r − √(r² − L²/4)] − Lφ/4 (`Scene::loss_m`). This is about true
//! distances; no Lipschitz constant of the bilinear field is used. A margin by a buffer only enlarges D.
//!
//! **Tube.** Commands late by δ let the base run on for δ with what it did before, at most v₀ + aδ fast: a
//! rigid motion that shifts by at most v₀δ + aδ²/2 and turns by at most ω_max δ. After it the plan follows,
//! turned and shifted as a whole: off by no more than that shift plus (ω_max δ + heading error) times the
//! length driven, plus position error, plus speed error times the time of motion (`Scene::tube_m`). It grows
//! along the plan and is subtracted from every margin. The set-point is the speed that the model reaches a step
//! later: a base that gets there early is ahead of the model by at most (v₁ − v₀)Δ/2 in a step, Δ/2 in time, and
//! δ ≥ Δ/2 is to be configured for it (full braking, which ends every plan, cannot be outrun).
//!
//! **Limits.** Speed is linear and the turn rate constant on a segment. If either end may be in the zone, both
//! speeds and the turn rate must be within the limit; a segment with both ends outside by more than loss and
//! tube is outside all along, by the bound above.
//!
//! **Induction.** The plan ends at rest, where nothing moves and no limit is broken. Let a certified plan be
//! stored at one tick. At the next, its remaining segments are a subset of those certified: in an unchanged
//! world they pass again, so there is always a certified plan, and the filter sends nothing else. The *first*
//! segment is checked like every other: no control can change its beginning. Only a new obstacle, rule or
//! relocalisation can break a stored plan; that is reported, and the plan of least harm is sent. ∎
//!
//! Deliberately not here: choosing plans (`score`, `filter`). This module says yes or no.

use crate::plan::{Plan, Sample};
use crate::scene::{LimitLayer, Scene, Source};

/// Why a plan is not certified.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Breach {
    /// It ends moving.
    Moving,
    /// It comes too near: by this much, metres (at or below zero).
    Near(Source, f64),
    /// It is too fast in a zone, or anywhere: speed minus limit, m/s.
    Fast(Source, f64),
    /// It turns too fast in a zone, or anywhere: rate minus limit, rad/s.
    Turning(Source, f64),
}

impl Breach {
    /// What is broken, when it is a thing of the world.
    pub(crate) fn source(&self) -> Option<Source> {
        match *self {
            Breach::Moving => None,
            Breach::Near(source, _) | Breach::Fast(source, _) | Breach::Turning(source, _) => Some(source),
        }
    }
}

/// The smallest margin that what is left of a plan is sure to keep, metres, and whose it is.
///
/// Soft layers do not count. Infinite when nothing is near.
///
/// # Errors
/// The first [`Breach`], in order of time, when the plan is not certified.
pub(crate) fn certify(scene: &Scene<'_>, plan: &Plan) -> Result<Kept, Breach> {
    if !plan.ends_at_rest() {
        return Err(Breach::Moving);
    }
    let rest = plan.rest();
    let (start_m_s, passed_s) = (plan.samples()[0].state.speed_m_s, plan.moving_s_now());
    let mut worst: Kept = (f64::INFINITY, None);
    let mut note = |kept: Kept| {
        worst = least(worst, kept);
        match kept {
            // Written so that NaN fails.
            (margin_m, _) if margin_m > 0.0 => Ok(()),
            (margin_m, Some(source)) => Err(Breach::Near(source, margin_m)),
            (_, None) => Err(Breach::Moving),
        }
    };
    let spatial =
        |sample: &Sample| scene.nearest(sample.state.position(), (sample.moving_s - passed_s).max(0.0));
    let tube_m = |sample: &Sample| scene.tube_m(start_m_s, sample.moving_s, sample.path_m);

    let (mut from_margin, mut from_tube_m) = (spatial(&rest[0]), tube_m(&rest[0]));
    for (k, pair) in rest.windows(2).enumerate() {
        let (from, to) = (&pair[0], &pair[1]);
        let (to_margin, to_tube_m) = (spatial(to), tube_m(to));
        let turn_rad = from.yaw_rate_rad_s * plan.step_s();
        let lost_m = scene.loss_m(to.path_m - from.path_m, turn_rad) + to_tube_m;
        let (ends_m, source) = least(from_margin, to_margin);
        note((ends_m - lost_m, source))?;
        within_limits(scene, (from, to), (from_tube_m, to_tube_m), k == 0, passed_s)?;
        (from_margin, from_tube_m) = (to_margin, to_tube_m);
    }
    // The place of rest, for a plan that has come to its end.
    note((from_margin.0 - from_tube_m, from_margin.1))?;
    Ok(worst)
}

/// A margin that is kept, metres, and whose it is.
type Kept = (f64, Option<Source>);

/// The smaller of two margins; the first when they are the same.
fn least(a: Kept, b: Kept) -> Kept {
    std::cmp::min_by(a, b, |a, b| a.0.total_cmp(&b.0))
}

/// Whether one segment heeds every limit of the zones it may touch.
fn within_limits(
    scene: &Scene<'_>,
    (from, to): (&Sample, &Sample),
    (from_tube_m, to_tube_m): (f64, f64),
    is_first: bool,
    passed_s: f64,
) -> Result<(), Breach> {
    let accel_m_s2 = scene.assumptions.limits.accel_m_s2_max;
    // The speed at the start is measured, and may be measured too high.
    let measured_m_s = if is_first { scene.assumptions.disturbance.speed_m_s } else { 0.0 };
    let is_in = |layer: &LimitLayer<'_>, sample: &Sample, tube_m: f64| {
        layer.zone_margin_m(sample.state.position()) <= scene.zone_guard_m(tube_m)
    };
    for layer in &scene.limits {
        let from_over_m_s =
            from.state.speed_m_s - measured_m_s - layer.speed_at(from.moving_s - passed_s, accel_m_s2);
        let to_over_m_s = to.state.speed_m_s - layer.speed_at(to.moving_s - passed_s, accel_m_s2);
        let over_m_s = from_over_m_s.max(to_over_m_s);
        let over_rad_s = from.yaw_rate_rad_s.abs() - layer.yaw_rate_rad_s;
        let is_over = over_m_s > 0.0 || over_rad_s > 0.0;
        // Who heeds a limit may be anywhere: its zone is asked for only by who does not.
        if !is_over || !(is_in(layer, from, from_tube_m) || is_in(layer, to, to_tube_m)) {
            continue;
        }
        return Err(if over_m_s > 0.0 {
            Breach::Fast(layer.source, over_m_s)
        } else {
            Breach::Turning(layer.source, over_rad_s)
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests;
