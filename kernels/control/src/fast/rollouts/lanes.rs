//! The loops of the rollouts over their lanes.
//!
//! Not here: in which order they run (`rollouts`).

use super::super::isa::fused;
use super::super::sweep::{least, most};
use super::{Ground, Motion, N};

/// Adding and subtracting it rounds a number of at most 2²² to the nearest whole one.
const ROUNDER: f32 = 12_582_912.0;

// Each loop reads and writes arrays that are arguments of their own: only then does the compiler know that
// they do not overlap, and makes vectors of them.

#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "arrays in a struct would not be known to be apart")]
pub(super) fn step_lanes<const FUSED: bool>(
    n: usize,
    motion: &Motion,
    ([turn_draws, gain_draws], held, scale): ([&[f32]; 2], [f32; 2], [f32; 2]),
    x_m: &mut [f32; N],
    y_m: &mut [f32; N],
    sin: &mut [f32; N],
    cos: &mut [f32; N],
    speed_m_s: &mut [f32; N],
    tube_m: &mut [f32; N],
    lost_m: &mut [f32; N],
    kept_m: &mut [f32; N],
) {
    let n = n.min(N);
    let (turn_draws, gain_draws) = (&turn_draws[..n], &gain_draws[..n]);
    let Motion { step_s, speed_m_s_max, limit, radius_m, .. } = *motion;
    let sampled =
        |draw: f32, k: usize| most(least(fused::<FUSED>(draw, scale[k], held[k]), limit[k]), -limit[k]);
    for lane in 0..n {
        let (turn, gain) = (sampled(turn_draws[lane], 0), sampled(gain_draws[lane], 1));
        let start_m_s = speed_m_s[lane];
        let ceiling_m_s = most(speed_m_s_max, start_m_s - limit[1]);
        let end_m_s = most(least(start_m_s + gain, ceiling_m_s), 0.0);
        let gained_m_s = end_m_s - start_m_s;
        // As in `dynamics`, with fewer terms; a step turns by half a radian at most: error below 1e-6.
        let square = turn * turn;
        let c0 = fused::<FUSED>(square, fused::<FUSED>(square, 1.0 / 120.0, -1.0 / 6.0), 1.0);
        let s0 = turn * fused::<FUSED>(square, fused::<FUSED>(square, 1.0 / 720.0, -1.0 / 24.0), 0.5);
        let c1 = fused::<FUSED>(square, fused::<FUSED>(square, 1.0 / 144.0, -1.0 / 8.0), 0.5);
        let s1 = turn * fused::<FUSED>(square, fused::<FUSED>(square, 1.0 / 840.0, -1.0 / 30.0), 1.0 / 3.0);
        let turn_cos = fused::<FUSED>(
            square,
            fused::<FUSED>(square, fused::<FUSED>(square, -1.0 / 720.0, 1.0 / 24.0), -0.5),
            1.0,
        );
        let turn_sin = turn
            * fused::<FUSED>(
                square,
                fused::<FUSED>(square, fused::<FUSED>(square, -1.0 / 5040.0, 1.0 / 120.0), -1.0 / 6.0),
                1.0,
            );
        let along_m = step_s * fused::<FUSED>(start_m_s, c0, gained_m_s * c1);
        let aside_m = step_s * fused::<FUSED>(start_m_s, s0, gained_m_s * s1);
        let (s, c) = (sin[lane], cos[lane]);
        x_m[lane] += fused::<FUSED>(along_m, c, -aside_m * s);
        y_m[lane] += fused::<FUSED>(along_m, s, aside_m * c);
        sin[lane] = fused::<FUSED>(s, turn_cos, c * turn_sin);
        cos[lane] = fused::<FUSED>(c, turn_cos, -s * turn_sin);
        speed_m_s[lane] = end_m_s;

        let length_m = (start_m_s + end_m_s) * (0.5 * step_s);
        let half_m = 0.5 * length_m;
        let chord_m = radius_m - most(fused::<FUSED>(-half_m, half_m, radius_m * radius_m), 0.0).sqrt();
        let standing_m = if length_m > 0.0 { motion.tube_per_step_m } else { 0.0 };
        let tube = tube_m[lane] + fused::<FUSED>(motion.tube_per_metre, length_m, standing_m);
        tube_m[lane] = tube;
        lost_m[lane] = fused::<FUSED>(0.25 * length_m, turn.abs(), chord_m + tube);
        let heeds = (end_m_s <= motion.speed_m_s_cap) & (turn.abs() <= motion.turn_rad_cap);
        let kept = kept_m[lane];
        kept_m[lane] = if heeds { kept } else { f32::NEG_INFINITY };
    }
}

#[inline(always)]
pub(super) fn place_lanes<const FUSED: bool>(
    n: usize,
    ground: &Ground<'_>,
    share_x: &mut [f32; N],
    share_y: &mut [f32; N],
    cell_idx: &mut [i32; N],
    x_m: &[f32; N],
    y_m: &[f32; N],
) {
    let Ground { n_cols, cells_per_m, first_idx, share, low, high, .. } = *ground;
    let whole = |rounded: f32| (rounded.to_bits() as i32).wrapping_sub(ROUNDER.to_bits() as i32);
    for lane in 0..n.min(N) {
        let x = most(least(fused::<FUSED>(x_m[lane], cells_per_m, share[0]), high[0]), low[0]);
        let y = most(least(fused::<FUSED>(y_m[lane], cells_per_m, share[1]), high[1]), low[1]);
        let (col, row) = ((x - 0.5) + ROUNDER, (y - 0.5) + ROUNDER);
        share_x[lane] = x - (col - ROUNDER);
        share_y[lane] = y - (row - ROUNDER);
        cell_idx[lane] = whole(row).wrapping_mul(n_cols).wrapping_add(whole(col)).wrapping_add(first_idx);
    }
}

#[inline(always)]
pub(super) fn lower_lanes<const FUSED: bool>(
    n: usize,
    here_m: &mut [f32; N],
    (a, b): (&[f32; N], &[f32; N]),
    (c, d): (&[f32; N], &[f32; N]),
    share_x: &[f32; N],
    share_y: &[f32; N],
    keep_m: f32,
) {
    for lane in 0..n.min(N) {
        let lower = fused::<FUSED>(share_x[lane], b[lane] - a[lane], a[lane]);
        let upper = fused::<FUSED>(share_x[lane], d[lane] - c[lane], c[lane]);
        let margin_m = fused::<FUSED>(share_y[lane], upper - lower, lower) - keep_m;
        let here = here_m[lane];
        here_m[lane] = least(margin_m, here);
    }
}

/// Lowers what lanes keep by what the segment leaves, and begins the next; how many keep more than `open_m`.
#[inline(always)]
pub(super) fn judge_lanes(
    n: usize,
    kept_m: &mut [f32; N],
    before_m: &mut [f32; N],
    here_m: &mut [f32; N],
    lost_m: &[f32; N],
    open_m: f32,
) -> u32 {
    let mut n_open = 0_u32;
    for lane in 0..n.min(N) {
        let here = here_m[lane];
        let kept = least(least(before_m[lane], here) - lost_m[lane], kept_m[lane]);
        kept_m[lane] = kept;
        before_m[lane] = here;
        here_m[lane] = f32::INFINITY;
        n_open = n_open.wrapping_add(if kept > open_m { 1 } else { 0 });
    }
    n_open
}
