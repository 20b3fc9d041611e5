//! One rollout of the standard problem, exactly: to settle what the fast bounds leave open.

use super::field::Field;
use super::oracle::Pose;
use super::*;

/// Sequences of controls as the oracle has them, in f64.
pub(crate) type Controls = Vec<[f64; 2]>;

/// The smallest margin along a rollout from `start`, at most `cap` (the margin there); `None` once it is known
/// to be below `floor`.
///
/// Fields are read only where they can lower it: margins cannot fall faster than their true Lipschitz
/// constant lets them.
pub(crate) fn kept(
    field: &Field<'_>,
    start: Pose,
    cap: f64,
    controls: impl Iterator<Item = [f64; 2]>,
    floor: f64,
) -> Option<f64> {
    let [mut x, mut y, yaw, mut v] = start;
    let (mut sin, mut cos) = yaw.sin_cos();
    let slope = f64::from(field.slope_m()) / CELL_M;
    let mut kept = cap;
    let (mut clear, mut slow) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
    for [rate, accel] in controls {
        x += v * cos * STEP_S;
        y += v * sin * STEP_S;
        let fallen = slope * v * STEP_S + 1e-9;
        (sin, cos) = turned((sin, cos), rate * STEP_S);
        v = (v + accel * STEP_S).clamp(0.0, SPEED_M_S_MAX);
        (clear, slow) = (clear - fallen, slow - fallen);
        kept = kept.min(SPEED_M_S_LIMIT - v).min(YAW_RATE_RAD_S_LIMIT - rate.abs());
        let (needs_clear, needs_slow) = (clear < kept, SLOW_SPEED_M_S - v < kept && slow < kept);
        if needs_clear || needs_slow {
            let (cell_idx, place) = field.cell(x, y);
            if needs_clear {
                clear = field.clear_m(cell_idx, place);
                kept = kept.min(clear);
            }
            if needs_slow {
                slow = field.slow_m(cell_idx, place);
                kept = kept.min(slow.max(SLOW_SPEED_M_S - v));
            }
        }
        if kept < floor {
            return None;
        }
    }
    Some(kept)
}

/// A heading's sine and cosine after a turn of at most 0.05 rad: Taylor, error below 1e-16.
#[inline]
fn turned((sin, cos): (f64, f64), turn: f64) -> (f64, f64) {
    let square = turn * turn;
    let by_cos = 1.0 - square / 2.0 * (1.0 - square / 12.0 * (1.0 - square / 30.0 * (1.0 - square / 56.0)));
    let by_sin =
        turn * (1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0 * (1.0 - square / 72.0))));
    (sin * by_cos + cos * by_sin, cos * by_cos - sin * by_sin)
}
