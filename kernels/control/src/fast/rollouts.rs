//! The most that sampled motions can keep: bounds for many at once, so that few have to be followed exactly.
//!
//! A bound heeds only a part of what a motion must: the nearest layers, some hits of the scan, the limits
//! everywhere, the first steps. Leaving something out never lowers it, so whoever's bound is too low is no better
//! than what is known already. Time outside, motions inside: each loop over lanes is one that the compiler
//! turns into vectors. Deliberately not here: which layers are looked at, what is done with a bound (`score`).

use super::isa::{Work, fused};
use super::sweep::{least, padded};

mod lanes;

use lanes::{judge_lanes, lower_lanes, place_lanes, step_lanes};

/// Lanes of one pass.
const N: usize = 64;
/// So few motions left are followed exactly in less time than it takes to bound them further. Those that keep as
/// much as the floor to within the rounding do not count: bounds seldom tell them from it, the first exact steps do.
const N_FEW: u32 = 2;
/// Most steps that are bounded: f32 is exact enough for so many.
pub(crate) const N_STEPS_MAX: usize = 40;
/// What f32 may take from a bound, metres: measured below 1e-5, taken tenfold.
pub(crate) const ROUNDING_M: f64 = 1e-4;
/// Points looked at together.
const N_VECTOR: usize = 16;

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

/// Draws that are made when they are needed: most motions are ruled out by their first steps.
pub(crate) trait Draws {
    /// Draws of turns and of gains for a step, lane by lane, in whole vectors.
    fn of_step(&mut self, step: usize) -> [&[f32]; 2];
}

/// The sequences: clamp(incumbent + scale · draw), a step each.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Drawn<'a, D> {
    /// Turn (radians) and gain (m/s) of each step.
    pub held: &'a [[f32; 2]],
    pub draws: D,
    pub scale: [f32; 2],
}

/// Bounds what each of `n` motions keeps, into `kept_m`, to [`ROUNDING_M`]; those that cannot keep more than
/// `floor_m` are bounded no further.
pub(crate) struct Rollouts<'a, D> {
    pub motion: Motion,
    pub from: From,
    pub grounds: &'a [Ground<'a>],
    pub hits: Hits<'a>,
    pub drawn: Drawn<'a, D>,
    pub n: usize,
    pub floor_m: f32,
    pub kept_m: &'a mut [f32],
}

impl<D: Draws> Work for Rollouts<'_, D> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Rollouts { motion, from, grounds, hits, drawn, n: n_all, floor_m, kept_m } = self;
        let Drawn { held, mut draws, scale } = drawn;
        for first in (0..n_all).step_by(N) {
            let n_real = (n_all - first).min(N);
            let n = padded(n_real).min(N);
            let mut pass = Pass::at(from);
            // Lanes beyond the samples matter to nobody.
            pass.kept_m[n_real..].fill(f32::NEG_INFINITY);
            for (step, held) in held.iter().take(N_STEPS_MAX).enumerate() {
                let draws = draws.of_step(step).map(|draws| &draws[first..first + n]);
                pass.advance::<FUSED>(n, &motion, draws, *held, scale);
                for ground in grounds.iter().filter(|ground| ground.n_far <= step) {
                    pass.look::<FUSED>(n, n_real, ground);
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
                    floor_m + 2.0 * ROUNDING_M as f32,
                ) <= N_FEW
                {
                    break;
                }
            }
            kept_m[first..first + n_real].copy_from_slice(&pass.kept_m[..n_real]);
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

    /// Lowers the margins of all lanes to those of a field; those beyond `n_real` belong to no motion.
    #[inline(always)]
    fn look<const FUSED: bool>(&mut self, n: usize, n_real: usize, ground: &Ground<'_>) {
        let Pass { x_m, y_m, share_x, share_y, cell_idx, corners_m, here_m, .. } = self;
        place_lanes::<FUSED>(n, ground, share_x, share_y, cell_idx, x_m, y_m);
        let [a, b, c, d] = corners_m;
        let n_cols = ground.n_cols as usize;
        for lane in 0..n_real.min(N) {
            let at = cell_idx[lane] as usize;
            // Beyond the field nothing is known, and nothing is lowered.
            let pair = |at: usize| match ground.values_m.get(at..at.wrapping_add(2)) {
                Some([left, right]) => (*left, *right),
                _ => (f32::INFINITY, f32::INFINITY),
            };
            ((a[lane], b[lane]), (c[lane], d[lane])) = (pair(at), pair(at.wrapping_add(n_cols)));
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
