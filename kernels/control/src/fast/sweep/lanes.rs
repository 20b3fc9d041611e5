//! The loops of the sweep over its lanes.
//!
//! Not here: in which order they run (`sweep`).

use super::super::isa::fused;
use super::{Ground, Model, N, least, most};

/// Adding and subtracting it rounds a number of at most 2²² to the nearest whole one.
const ROUNDER: f32 = 12_582_912.0;

/// One step of the sequences: draws of turns and gains, what is held, scale and limit of both.
type Drawn<'a> = ([&'a [f32]; 2], [f32; 2], [f32; 2], [f32; 2]);

// Each loop reads and writes arrays that are arguments of their own: only then does the compiler know that
// they do not overlap, and makes vectors of them.

#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "arrays in a struct would not be known to be apart")]
pub(super) fn step_lanes<M: Model, const FUSED: bool>(
    n: usize,
    model: M,
    ([turn_draws, gain_draws], held, scale, limit): Drawn<'_>,
    x: &mut [f32; N],
    y: &mut [f32; N],
    sin: &mut [f32; N],
    cos: &mut [f32; N],
    speed_m_s: &mut [f32; N],
    bound_m: &mut [f32; N],
    moved: &mut [f32; N],
) {
    let (turn_draws, gain_draws) = (&turn_draws[..n], &gain_draws[..n]);
    let sampled =
        |draw: f32, k: usize| most(least(fused::<FUSED>(draw, scale[k], held[k]), limit[k]), -limit[k]);
    for lane in 0..n {
        let (turn, gain) = (sampled(turn_draws[lane], 0), sampled(gain_draws[lane], 1));
        let step = model.step::<FUSED>(speed_m_s[lane], turn, gain);
        let (s, c) = (sin[lane], cos[lane]);
        x[lane] = fused::<FUSED>(step.along, c, x[lane]);
        y[lane] = fused::<FUSED>(step.along, s, y[lane]);
        sin[lane] = fused::<FUSED>(s, step.turn_cos, c * step.turn_sin);
        cos[lane] = fused::<FUSED>(c, step.turn_cos, -s * step.turn_sin);
        speed_m_s[lane] = step.speed_m_s;
        bound_m[lane] = step.bound_m;
        moved[lane] = step.along;
    }
}

#[inline(always)]
pub(super) fn begin_lanes<M: Model>(
    n: usize,
    model: M,
    kept_m: &mut [f32; N],
    room_m: &mut [f32; N],
    bound_m: &[f32; N],
    speed_m_s: &[f32; N],
    [clear_m, slow_m]: [f32; 2],
) {
    let room = least(clear_m, slow_m) - 1e-6;
    for lane in 0..n {
        let worth_m = model.worth_m(f32::INFINITY, slow_m, speed_m_s[lane]);
        kept_m[lane] = least(least(kept_m[lane], bound_m[lane]), worth_m);
        room_m[lane] = room;
    }
}

#[inline(always)]
pub(super) fn place_lanes(
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
        cell_idx[lane] = whole(row).wrapping_mul(n_cols).wrapping_add(whole(col)).wrapping_add(first_idx);
    }
}

#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "arrays in a struct would not be known to be apart")]
pub(super) fn room_lanes(
    n: usize,
    room_m: &mut [f32; N],
    kept_m: &mut [f32; N],
    moved: &[f32; N],
    bound_m: &[f32; N],
    slope_m: f32,
    floor_m: f32,
) -> (u32, u32) {
    let (mut n_alive, mut reads) = (0_u32, 0);
    for lane in 0..n {
        let room = room_m[lane] - slope_m * moved[lane] - 1e-6;
        room_m[lane] = room;
        let kept = least(kept_m[lane], bound_m[lane]);
        kept_m[lane] = kept;
        let is_alive = kept > floor_m;
        n_alive = n_alive.wrapping_add(if is_alive { 1 } else { 0 });
        reads |= if is_alive & (room < kept) { 1 } else { 0 };
    }
    (n_alive, reads)
}

#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "arrays in a struct would not be known to be apart")]
pub(super) fn judge_lanes<M: Model, const FUSED: bool, const FULL: bool>(
    n: usize,
    model: M,
    kept_m: &mut [f32; N],
    room_m: &mut [f32; N],
    ridge: &mut [u32; N],
    (bound_m, moved): (&[f32; N], &[f32; N]),
    (clear, slow): (&[u32; N], &[u32; N]),
    share_x: &[f32; N],
    share_y: &[f32; N],
    speed_m_s: &[f32; N],
    ground: &Ground<'_>,
    floor_m: f32,
) -> u32 {
    let mut ridges = 0;
    for lane in 0..n {
        let (x, y, clear, slow) = (share_x[lane], share_y[lane], clear[lane], slow[lane]);
        let clear_m = ground.clear_m::<FUSED>(clear, x, y);
        let slow_m = ground.slow_m::<FUSED>(slow, x, y);
        let worth_m = model.worth_m(clear_m, slow_m, speed_m_s[lane]);
        // Not the loaded value itself is chosen from: that would make a masked store, which the next load waits for.
        let kept = least(kept_m[lane], bound_m[lane]);
        let word_m = least(clear_m, slow_m);
        let room = if FULL { word_m } else { most(word_m, room_m[lane]) };
        room_m[lane] = room;
        let lowers = if worth_m < kept { 1 } else { 0 };
        let is_ridge = clear >> 31;
        // Who has not moved was judged here before: at the first place exactly, above what words say.
        let has_moved = moved[lane] > 0.0;
        let mut asks = is_ridge & lowers & if has_moved { 1 } else { 0 };
        if !FULL {
            asks &= if (kept > floor_m) & (room < kept) { 1 } else { 0 };
        }
        ridge[lane] = asks;
        ridges |= asks;
        let settled_m = if (is_ridge == 0) & has_moved { clear_m } else { f32::INFINITY };
        kept_m[lane] = least(kept, model.worth_m(settled_m, slow_m, speed_m_s[lane]));
    }
    ridges
}

#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "arrays in a struct would not be known to be apart")]
pub(super) fn settle_lanes<M: Model, const FUSED: bool>(
    n: usize,
    model: M,
    kept_m: &mut [f32; N],
    room_m: &mut [f32; N],
    ridge: &[u32; N],
    ([first, second], others_m, slow): ([&[u32; N]; 2], &[f32; N], &[u32; N]),
    share_x: &[f32; N],
    share_y: &[f32; N],
    speed_m_s: &[f32; N],
    ground: &Ground<'_>,
) {
    for lane in 0..n {
        let (x, y) = (share_x[lane], share_y[lane]);
        let first_m = ground.clear_m::<FUSED>(first[lane], x, y);
        let second_m = ground.clear_m::<FUSED>(second[lane], x, y);
        let clear_m = least(least(first_m, second_m), others_m[lane]);
        let slow_m = ground.slow_m::<FUSED>(slow[lane], x, y);
        let (kept, room, asks) = (kept_m[lane], room_m[lane], ridge[lane] != 0);
        let settled = least(kept, model.worth_m(clear_m, slow_m, speed_m_s[lane]));
        let raised = most(room, least(clear_m, slow_m));
        kept_m[lane] = if asks { settled } else { kept };
        room_m[lane] = if asks { raised } else { room };
    }
}
