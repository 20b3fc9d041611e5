//! The loops of a sweep over its lanes.
//!
//! Each is a plain loop over arrays of one length. Not here: in which order they run, and when they may be left
//! out (`sweep`).

use super::isa::fused;
use super::sweep::{ALIVE, Ground, MOVING, Model, N, N_VECTOR, READS, least, most};

/// Adding and subtracting it rounds a number of at most 2²² to the nearest whole one.
const ROUNDER: f32 = 12_582_912.0;

// Each loop reads and writes arrays that are arguments of their own: only then does the compiler know that
// they do not overlap, and makes vectors of them.

#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "arrays in a struct would not be known to be apart")]
pub(super) fn step_lanes<M: Model, const FUSED: bool>(
    n: usize,
    model: M,
    ([turn_draws, gain_draws], held, scale, limit): ([&[f32]; 2], [f32; 2], [f32; 2], [f32; 2]),
    x: &mut [f32; N],
    y: &mut [f32; N],
    sin: &mut [f32; N],
    cos: &mut [f32; N],
    speed_m_s: &mut [f32; N],
    bound_m: &mut [f32; N],
    lost_m: &mut [f32; N],
    tube_m: &mut [f32; N],
    moved: &mut [f32; N],
) {
    let (turn_draws, gain_draws) = (&turn_draws[..n], &gain_draws[..n]);
    let sampled =
        |draw: f32, k: usize| most(least(fused::<FUSED>(draw, scale[k], held[k]), limit[k]), -limit[k]);
    for lane in 0..n {
        let (turn, gain) = (sampled(turn_draws[lane], 0), sampled(gain_draws[lane], 1));
        let step = model.step::<FUSED>(speed_m_s[lane], turn, gain);
        let (s, c) = (sin[lane], cos[lane]);
        let (ahead_x, ahead_y) =
            (fused::<FUSED>(step.along, c, x[lane]), fused::<FUSED>(step.along, s, y[lane]));
        x[lane] = if M::LOSES { fused::<FUSED>(-step.aside, s, ahead_x) } else { ahead_x };
        y[lane] = if M::LOSES { fused::<FUSED>(step.aside, c, ahead_y) } else { ahead_y };
        sin[lane] = fused::<FUSED>(s, step.turn_cos, c * step.turn_sin);
        cos[lane] = fused::<FUSED>(c, step.turn_cos, -s * step.turn_sin);
        speed_m_s[lane] = step.speed_m_s;
        bound_m[lane] = step.bound_m;
        moved[lane] = step.length;
        if M::LOSES {
            let tube = tube_m[lane] + step.growth_m;
            tube_m[lane] = tube;
            lost_m[lane] = step.loss_m + tube;
        }
    }
}

#[inline(always)]
pub(super) fn place_lanes<M: Model>(
    n: usize,
    ground: &Ground<'_>,
    share_x: &mut [f32; N],
    share_y: &mut [f32; N],
    cell_idx: &mut [i32; N],
    x: &[f32; N],
    y: &[f32; N],
) {
    let ([low_x, low_y], [high_x, high_y]) = (ground.low, ground.high);
    let ([first_col, first_row], n_cols) = (ground.first, ground.n_cols);
    let first_idx = first_row.wrapping_mul(n_cols).wrapping_add(first_col);
    let whole = |rounded: f32| (rounded.to_bits() as i32).wrapping_sub(ROUNDER.to_bits() as i32);
    for lane in 0..n {
        let inside_x = most(least(x[lane], high_x), low_x);
        let inside_y = most(least(y[lane], high_y), low_y);
        let (col, row) = ((inside_x - 0.5) + ROUNDER, (inside_y - 0.5) + ROUNDER);
        share_x[lane] = inside_x - (col - ROUNDER);
        share_y[lane] = inside_y - (row - ROUNDER);
        cell_idx[lane] = if M::WRAPS {
            let (col, row) = (whole(col).wrapping_add(first_col), whole(row).wrapping_add(first_row));
            ((row & 0xFF) << 8) | (col & 0xFF)
        } else {
            whole(row).wrapping_mul(n_cols).wrapping_add(whole(col)).wrapping_add(first_idx)
        };
    }
}

#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "arrays in a struct would not be known to be apart")]
pub(super) fn room_lanes<M: Model>(
    n: usize,
    room_m: &mut [f32; N],
    kept_m: &mut [f32; N],
    moved: &[f32; N],
    bound_m: &[f32; N],
    lost_m: &[f32; N],
    slope_m: f32,
    floor_m: f32,
) -> u32 {
    let mut state = 0;
    for lane in 0..n {
        let room = room_m[lane] - slope_m * moved[lane] - 1e-6;
        room_m[lane] = room;
        let kept = least(kept_m[lane], bound_m[lane]);
        kept_m[lane] = kept;
        let left = if M::LOSES { room - lost_m[lane] } else { room };
        let is_alive = kept > floor_m;
        state |= if is_alive { ALIVE } else { 0 };
        state |= if is_alive & (left < kept) { READS } else { 0 };
        state |= if is_alive & (moved[lane] > 0.0) { MOVING } else { 0 };
    }
    state
}

/// The margin to the nearest of the points.
#[inline(always)]
pub(super) fn near_lanes<const FUSED: bool>(
    n: usize,
    ground: &Ground<'_>,
    near_m: &mut [f32; N],
    x: &[f32; N],
    y: &[f32; N],
) {
    for first in (0..n).step_by(N_VECTOR) {
        let (mut here, mut px, mut py) = ([f32::INFINITY; N_VECTOR], [0.0; N_VECTOR], [0.0; N_VECTOR]);
        px.copy_from_slice(&x[first..first + N_VECTOR]);
        py.copy_from_slice(&y[first..first + N_VECTOR]);
        for [point_x, point_y] in ground.points {
            for k in 0..N_VECTOR {
                let (dx, dy) = (px[k] - point_x, py[k] - point_y);
                here[k] = least(here[k], fused::<FUSED>(dx, dx, dy * dy));
            }
        }
        for k in 0..N_VECTOR {
            near_m[first + k] = here[k].sqrt() * ground.cell_m - ground.points_keep_m;
        }
    }
}

#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "arrays in a struct would not be known to be apart")]
pub(super) fn judge_lanes<M: Model, const FUSED: bool>(
    n: usize,
    model: M,
    kept_m: &mut [f32; N],
    here_m: &mut [f32; N],
    room_m: &mut [f32; N],
    ridge: &mut [u32; N],
    bound_m: &[f32; N],
    lost_m: &[f32; N],
    near_m: &[f32; N],
    (clear, slow): (&[u32; N], &[u32; N]),
    share_x: &[f32; N],
    share_y: &[f32; N],
    speed_m_s: &[f32; N],
    quantum_m: [f32; 2],
) -> u32 {
    let mut ridges = 0;
    for lane in 0..n {
        let (x, y, clear, slow) = (share_x[lane], share_y[lane], clear[lane], slow[lane]);
        let (clear_m, slow_m) = model.margins_m::<FUSED>((clear, slow), (x, y), quantum_m);
        let worth_m = model.worth_m(clear_m, slow_m, speed_m_s[lane]);
        // Not the loaded value itself is chosen from: that would make a masked store, which the next load waits for.
        let kept = least(kept_m[lane], bound_m[lane]);
        room_m[lane] = least(clear_m, slow_m);
        if M::LOSES {
            // What such robots read is never a ridge: their words are bounds already.
            let worth_m = least(worth_m, near_m[lane]);
            kept_m[lane] = least(kept, least(here_m[lane], worth_m) - lost_m[lane]);
            here_m[lane] = worth_m;
            room_m[lane] = least(clear_m, near_m[lane]);
        } else {
            let lowers = if worth_m < kept { 1 } else { 0 };
            let is_ridge = (clear >> 31) & lowers;
            ridge[lane] = is_ridge;
            ridges |= is_ridge;
            kept_m[lane] = if is_ridge != 0 { kept } else { least(kept, worth_m) };
        }
    }
    ridges
}
