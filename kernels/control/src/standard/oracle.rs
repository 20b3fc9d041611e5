//! The standard problem, slowly and obviously: f64, every layer, every sample to its end.

use super::*;

/// The noise of one step: for each round, step and sample a pair of standard normal draws.
///
/// Shared by all scores of the step. Sample 0 of each round is the incumbent: its noise is zero.
pub type Noise<'a> = dyn Fn(usize, usize, usize) -> (f64, f64) + 'a;

/// The state of the robot: x, y (m), heading (rad), speed (m/s).
pub(crate) type Pose = [f64; 4];

/// One Euler step.
pub(crate) fn after([x, y, yaw, v]: Pose, [rate, accel]: [f64; 2]) -> Pose {
    [
        x + v * yaw.cos() * STEP_S,
        y + v * yaw.sin() * STEP_S,
        yaw + rate * STEP_S,
        (v + accel * STEP_S).clamp(0.0, SPEED_M_S_MAX),
    ]
}

/// Bilinear between points, clamped at the border.
fn distance_m(layer_m: &[f32], n_side: usize, x_m: f64, y_m: f64) -> f64 {
    let inside = |place_m: f64| (place_m / CELL_M).clamp(0.0, n_side as f64 - 1.001);
    let (x, y) = (inside(x_m), inside(y_m));
    let (col, row) = (x as usize, y as usize);
    let (x, y) = (x - col as f64, y - row as f64);
    let value = |col: usize, row: usize| f64::from(layer_m[row * n_side + col]);
    (1.0 - y) * ((1.0 - x) * value(col, row) + x * value(col + 1, row))
        + y * ((1.0 - x) * value(col, row + 1) + x * value(col + 1, row + 1))
}

/// The margin l(x, ω): the smallest of all layers' and of the limits everywhere.
pub(crate) fn margin(scene: &Scene, [x, y, _, v]: Pose, rate: f64) -> f64 {
    let mut least = (SPEED_M_S_LIMIT - v).min(YAW_RATE_RAD_S_LIMIT - rate.abs());
    for (idx, layer_m) in scene.layers_m.iter().enumerate() {
        let distance = distance_m(layer_m, scene.n_side, x, y);
        least = least.min(match idx {
            0 => distance - RADIUS_M,
            SLOW_LAYER => (distance - SLOW_BUFFER_M).max(SLOW_SPEED_M_S - v),
            _ => distance - BUFFER_M,
        });
    }
    least
}

/// The score of a state: the largest margin that a sampled sequence keeps.
#[must_use]
pub fn score(scene: &Scene, sampling: &Sampling, start: [f64; 4], noise: &Noise<'_>) -> f64 {
    let mut incumbent = vec![[0.0, -ACCEL_M_S2_MAX]; sampling.n_steps];
    let mut score = f64::NEG_INFINITY;
    for round in 0..sampling.n_rounds {
        let mut best: Option<(f64, Vec<[f64; 2]>)> = None;
        for sample in 0..sampling.n_samples {
            let controls: Vec<[f64; 2]> = (0..sampling.n_steps)
                .map(|step| {
                    let (rate, accel) = if sample == 0 { (0.0, 0.0) } else { noise(round, step, sample) };
                    let [held_rate, held_accel] = incumbent[step];
                    let rate = held_rate + SIGMA_YAW_RATE_RAD_S * rate;
                    let accel = held_accel + SIGMA_ACCEL_M_S2 * accel;
                    [
                        rate.clamp(-YAW_RATE_RAD_S_MAX, YAW_RATE_RAD_S_MAX),
                        accel.clamp(-ACCEL_M_S2_MAX, ACCEL_M_S2_MAX),
                    ]
                })
                .collect();
            let mut state = start;
            let mut kept = margin(scene, state, 0.0);
            for control in &controls {
                state = after(state, *control);
                kept = kept.min(margin(scene, state, control[0]));
            }
            if best.as_ref().is_none_or(|(best, _)| kept > *best) {
                best = Some((kept, controls));
            }
        }
        if let Some((kept, controls)) = best {
            (score, incumbent) = (kept, controls);
        }
    }
    score
}

/// The scores of the present state and of the states one step on, and the primitive chosen.
#[must_use]
pub fn step(
    scene: &Scene,
    sampling: &Sampling,
    state: [f64; 6],
    noise: &Noise<'_>,
) -> (f64, Vec<f64>, usize) {
    let [x, y, yaw, v, rate, accel] = state;
    let start = [x, y, yaw, v];
    let here = score(scene, sampling, start, noise);
    let next: Vec<f64> =
        scene.primitives.iter().map(|p| score(scene, sampling, after(start, *p), noise)).collect();
    let choice = chosen(&next, here, &scene.primitives, [rate, accel]);
    (here, next, choice)
}

/// The primitive nearest to the nominal control among those that keep enough; none: the one that keeps most.
pub(crate) fn chosen(next: &[f64], here: f64, primitives: &[[f64; 2]], nominal: [f64; 2]) -> usize {
    let mut nearest: Option<(f64, usize)> = None;
    for (idx, primitive) in primitives.iter().enumerate() {
        let off = off(*primitive, nominal);
        if is_enough(next[idx], here) && nearest.is_none_or(|(least, _)| off < least) {
            nearest = Some((off, idx));
        }
    }
    let mut most = 0;
    for (idx, value) in next.iter().enumerate() {
        if *value > next[most] {
            most = idx;
        }
    }
    nearest.map_or(most, |(_, idx)| idx)
}

/// How far a control is from the nominal one, squared, each part scaled by its limit.
pub(crate) fn off(a: [f64; 2], b: [f64; 2]) -> f64 {
    ((a[0] - b[0]) / YAW_RATE_RAD_S_MAX).powi(2) + ((a[1] - b[1]) / ACCEL_M_S2_MAX).powi(2)
}

/// Whether the score after a primitive has not fallen too far.
pub(crate) fn is_enough(next: f64, here: f64) -> bool {
    next >= least_enough(here)
}

/// The smallest score after a primitive that has not fallen too far.
pub(crate) fn least_enough(here: f64) -> f64 {
    here - LOST_SHARE * here
}
