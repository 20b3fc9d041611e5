//! The most that sampled motions can keep: bounds for many at once, so that few have to be followed exactly.
//!
//! A bound heeds only a part of what a motion must: the nearest layers, some hits of the scan, the limits
//! everywhere, the first steps. Leaving something out never lowers it, so whoever's bound is too low is no better
//! than what is known already. Time outside, motions inside: each loop over lanes is one that the compiler
//! turns into vectors. Deliberately not here: which layers are looked at, what is done with a bound (`score`).

use super::isa::{Work, fused};
use super::sweep::{least, most, padded};

/// Lanes of one pass.
const N: usize = 64;
/// So few motions left are followed exactly in less time than it takes to bound them further.
const N_FEW: u32 = 4;
/// Most steps that are bounded: f32 is exact enough for so many.
pub(crate) const N_STEPS_MAX: usize = 40;
/// What f32 may take from a bound, metres: measured below 1e-5, taken tenfold.
pub(crate) const ROUNDING_M: f64 = 1e-4;
/// Points looked at together.
const N_VECTOR: usize = 16;
/// Adding and subtracting it rounds a number of at most 2²² to the nearest whole one.
const ROUNDER: f32 = 12_582_912.0;

/// What a robot can do in a step, and what is lost on the way.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Motion {
    pub step_s: f32,
    pub speed_m_s_max: f32,
    /// Largest turn (radians) and gain (m/s) of a step.
    pub limit: [f32; 2],
    /// The speed and the turn of a step that no rule allows more than, anywhere.
    pub speed_m_s_cap: f32,
    pub turn_rad_cap: f32,
    pub radius_m: f32,
    /// What the tube grows by in a step of motion, and in a metre.
    pub tube_per_step_m: f32,
    pub tube_per_metre: f32,
}

/// Where all motions start; places are counted from there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct From {
    pub sin: f32,
    pub cos: f32,
    pub speed_m_s: f32,
    /// What is kept already, the margin at the start, and the tube there.
    pub kept_m: f32,
    pub here_m: f32,
    pub tube_m: f32,
}

/// A distance field around the start.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ground<'a> {
    /// Row-major; at least two a side.
    pub values_m: &'a [f32],
    pub n_cols: i32,
    pub cells_per_m: f32,
    /// The start's cell, and where in it the start is.
    pub first_idx: i32,
    pub share: [f32; 2],
    /// Places are held within these, in cells from the start's.
    pub low: [f32; 2],
    pub high: [f32; 2],
    /// What the distance must exceed, metres.
    pub keep_m: f32,
    /// Steps in which it is not looked at, being far.
    pub n_far: usize,
}

impl Ground<'_> {
    /// No field at all.
    pub(crate) const NONE: Ground<'static> = Ground {
        values_m: &[],
        n_cols: 0,
        cells_per_m: 0.0,
        first_idx: 0,
        share: [0.0; 2],
        low: [0.0; 2],
        high: [0.0; 2],
        keep_m: 0.0,
        n_far: 0,
    };
}

/// Points to keep clear of.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hits<'a> {
    /// Metres from the start.
    pub points: &'a [[f32; 2]],
    /// What the distance must exceed, metres.
    pub keep_m: f32,
    /// Steps in which they are not looked at, being far.
    pub n_far: usize,
}

/// The sequences: clamp(incumbent + scale · draw), a step each.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Drawn<'a> {
    /// Turn (radians) and gain (m/s) of each step.
    pub held: &'a [[f32; 2]],
    /// Draws of turns and of gains; `n_lanes` for each step, lane by lane.
    pub draws: [&'a [f32]; 2],
    pub n_lanes: usize,
    pub scale: [f32; 2],
}

/// Bounds what each of `n` motions keeps, into `kept_m`, to [`ROUNDING_M`]; those that cannot keep more than
/// `floor_m` are bounded no further.
pub(crate) struct Rollouts<'a> {
    pub motion: Motion,
    pub from: From,
    pub grounds: &'a [Ground<'a>],
    pub hits: Hits<'a>,
    pub drawn: Drawn<'a>,
    pub n: usize,
    pub floor_m: f32,
    pub kept_m: &'a mut [f32],
}

impl Work for Rollouts<'_> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Rollouts { motion, from, grounds, hits, drawn, n: n_all, floor_m, kept_m } = self;
        let Drawn { held, draws: [turn_draws, gain_draws], n_lanes, scale } = drawn;
        for first in (0..n_all).step_by(N) {
            let n = (n_all - first).min(N);
            let mut pass = Pass::at(from);
            for (step, held) in held.iter().take(N_STEPS_MAX).enumerate() {
                let at = step * n_lanes + first;
                let n = padded(n).min(N);
                let draws = [&turn_draws[at..at + n], &gain_draws[at..at + n]];
                pass.advance::<FUSED>(n, &motion, draws, *held, scale);
                for ground in grounds.iter().filter(|ground| ground.n_far <= step) {
                    pass.look::<FUSED>(n, ground);
                }
                if hits.n_far <= step {
                    pass.look_at_points::<FUSED>(n, hits.points, hits.keep_m);
                }
                if judge_lanes(
                    n,
                    &mut pass.kept_m,
                    &mut pass.before_m,
                    &mut pass.here_m,
                    &pass.lost_m,
                    floor_m,
                ) <= N_FEW
                {
                    break;
                }
            }
            kept_m[first..first + n].copy_from_slice(&pass.kept_m[..n]);
        }
    }
}

/// The lanes of one pass.
struct Pass {
    x_m: [f32; N],
    y_m: [f32; N],
    sin: [f32; N],
    cos: [f32; N],
    speed_m_s: [f32; N],
    tube_m: [f32; N],
    kept_m: [f32; N],
    /// What is lost on the segment.
    lost_m: [f32; N],
    /// The margin at its start and at its end.
    before_m: [f32; N],
    here_m: [f32; N],
    share_x: [f32; N],
    share_y: [f32; N],
    cell_idx: [i32; N],
    corners_m: [[f32; N]; 4],
}

impl Pass {
    #[inline(always)]
    fn at(from: From) -> Pass {
        Pass {
            x_m: [0.0; N],
            y_m: [0.0; N],
            sin: [from.sin; N],
            cos: [from.cos; N],
            speed_m_s: [from.speed_m_s; N],
            tube_m: [from.tube_m; N],
            kept_m: [from.kept_m; N],
            lost_m: [0.0; N],
            before_m: [from.here_m; N],
            here_m: [f32::INFINITY; N],
            share_x: [0.0; N],
            share_y: [0.0; N],
            cell_idx: [0; N],
            corners_m: [[0.0; N]; 4],
        }
    }

    /// One step of every lane.
    #[inline(always)]
    fn advance<const FUSED: bool>(
        &mut self,
        n: usize,
        motion: &Motion,
        draws: [&[f32]; 2],
        held: [f32; 2],
        scale: [f32; 2],
    ) {
        step_lanes::<FUSED>(
            n,
            motion,
            (draws, held, scale),
            &mut self.x_m,
            &mut self.y_m,
            &mut self.sin,
            &mut self.cos,
            &mut self.speed_m_s,
            &mut self.tube_m,
            &mut self.lost_m,
            &mut self.kept_m,
        );
    }

    /// Lowers the margins of all lanes to those of a field.
    #[inline(always)]
    fn look<const FUSED: bool>(&mut self, n: usize, ground: &Ground<'_>) {
        let Pass { x_m, y_m, share_x, share_y, cell_idx, corners_m, here_m, .. } = self;
        place_lanes::<FUSED>(n, ground, share_x, share_y, cell_idx, x_m, y_m);
        let [a, b, c, d] = corners_m;
        let n_cols = ground.n_cols as usize;
        for lane in 0..n.min(N) {
            let at = cell_idx[lane] as usize;
            // Beyond the field nothing is known, and nothing is lowered.
            let pair = |at: usize| ground.values_m.get(at..at + 2).unwrap_or(&[f32::INFINITY; 2]);
            let (lower, upper) = (pair(at), pair(at.wrapping_add(n_cols)));
            (a[lane], b[lane], c[lane], d[lane]) = (lower[0], lower[1], upper[0], upper[1]);
        }
        lower_lanes::<FUSED>(n, here_m, (a, b), (c, d), share_x, share_y, ground.keep_m);
    }

    /// Lowers the margins of all lanes to those of the nearest of some points.
    #[inline(always)]
    fn look_at_points<const FUSED: bool>(&mut self, n: usize, points: &[[f32; 2]], keep_m: f32) {
        let Pass { x_m, y_m, here_m, .. } = self;
        for first in (0..n.min(N)).step_by(N_VECTOR) {
            let (mut x, mut y, mut square) = ([0.0; N_VECTOR], [0.0; N_VECTOR], [f32::INFINITY; N_VECTOR]);
            x.copy_from_slice(&x_m[first..first + N_VECTOR]);
            y.copy_from_slice(&y_m[first..first + N_VECTOR]);
            for [point_x, point_y] in points {
                for k in 0..N_VECTOR {
                    let (dx, dy) = (x[k] - point_x, y[k] - point_y);
                    square[k] = least(fused::<FUSED>(dx, dx, dy * dy), square[k]);
                }
            }
            for k in 0..N_VECTOR {
                here_m[first + k] = least(square[k].sqrt() - keep_m, here_m[first + k]);
            }
        }
    }
}

// Each loop reads and writes arrays that are arguments of their own: only then does the compiler know that
// they do not overlap, and makes vectors of them.

#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "arrays in a struct would not be known to be apart")]
fn step_lanes<const FUSED: bool>(
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
fn place_lanes<const FUSED: bool>(
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
fn lower_lanes<const FUSED: bool>(
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

/// Lowers what lanes keep by what the segment leaves, and begins the next; how many keep more than the floor.
#[inline(always)]
fn judge_lanes(
    n: usize,
    kept_m: &mut [f32; N],
    before_m: &mut [f32; N],
    here_m: &mut [f32; N],
    lost_m: &[f32; N],
    floor_m: f32,
) -> u32 {
    let mut n_alive = 0_u32;
    for lane in 0..n.min(N) {
        let here = here_m[lane];
        let kept = least(least(before_m[lane], here) - lost_m[lane], kept_m[lane]);
        kept_m[lane] = kept;
        before_m[lane] = here;
        here_m[lane] = f32::INFINITY;
        n_alive = n_alive.wrapping_add(if kept > floor_m { 1 } else { 0 });
    }
    n_alive
}
