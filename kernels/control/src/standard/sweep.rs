//! Many rollouts of the standard problem at once: a lower bound of what each keeps.
//!
//! Time outside, lanes inside: each loop over lanes is one that the compiler turns into vectors. Places are
//! counted in cells from the cell of the start, so that f32 is exact enough on any map.

use super::field::Field;
use super::kinematics::{Lanes, kinematic_margin, least, most, speed_after};
use super::oracle::Pose;
use super::*;
use crate::fast::isa::{Work, fused};
use crate::fast::packed::{RIDGE, unpacked};

/// Lanes of one pass.
const N: usize = 64;
/// Adding and subtracting it rounds a number of at most 2²² to the nearest whole one.
const ROUNDER: f32 = 12_582_912.0;
/// Cells that a metre a second moves in a step.
const CELLS_PER_SPEED: f32 = (STEP_S / CELL_M) as f32;

/// What f32 may add to or take from a margin along a rollout, metres: measured below 2e-6, taken twentyfold.
pub(crate) const ROUNDING_M: f32 = 4e-5;

/// Rolls lanes out; what each keeps goes to `kept_m`, within [`ROUNDING_M`] at most the exact value and at least
/// that less the field's error. The margin at the start is not part of it.
///
/// `FULL` finishes every rollout and reads the field at every step. Otherwise steps are skipped where the
/// field cannot matter, and a pass ends as soon as no lane keeps more than `floor_m`; its values then are
/// bounds from above that lie at or below `floor_m`.
pub(crate) struct Sweep<'a, 's, const FULL: bool> {
    pub field: &'a Field<'s>,
    pub start: Pose,
    pub controls: &'a Lanes,
    pub n_lanes: usize,
    pub n_steps: usize,
    pub floor_m: f32,
    pub kept_m: &'a mut [f32],
}

impl<const FULL: bool> Work for Sweep<'_, '_, FULL> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Sweep { field, start, controls, n_lanes, n_steps, floor_m, kept_m } = self;
        let origin = Origin::of(field, start);
        for from in (0..n_lanes).step_by(N) {
            let n = (n_lanes - from).min(N);
            let mut pass = Pass::at(&origin, start, n.next_multiple_of(16).min(N));
            for step in 0..n_steps {
                let at = step * controls.n_lanes + from;
                let turns = &controls.turn_rad[at..at + pass.n];
                let gains = &controls.gain_m_s[at..at + pass.n];
                let reads = pass.advance::<FULL, FUSED>(&origin, turns, gains, floor_m);
                if !FULL && reads & ALIVE == 0 {
                    break;
                }
                if FULL || reads & READS != 0 {
                    pass.load(&origin, n);
                    if pass.judge::<FUSED>(&origin) != 0 {
                        pass.settle_ridges(&origin, n);
                    }
                }
            }
            kept_m[from..from + n].copy_from_slice(&pass.kept_m[..n]);
        }
    }
}

/// Some lane still keeps more than the floor.
const ALIVE: u32 = 1;
/// Some lane may be lowered by what the field says here.
const READS: u32 = 2;

/// What stays the same in a sweep: where lanes start and are counted from.
struct Origin<'a, 's> {
    field: &'a Field<'s>,
    cell_idx: i32,
    stride: i32,
    x: f32,
    y: f32,
    low: [f32; 2],
    high: [f32; 2],
    slope_m: f32,
    quantum_m: [f32; 2],
}

impl<'a, 's> Origin<'a, 's> {
    #[inline(always)]
    fn of(field: &'a Field<'s>, [x_m, y_m, ..]: Pose) -> Self {
        let last = (field.n_side - 2) as f64;
        let (x, y) = (x_m / CELL_M, y_m / CELL_M);
        let (col, row) = (x.floor().clamp(0.0, last), y.floor().clamp(0.0, last));
        let high = field.n_side as f64 - 1.001;
        Origin {
            field,
            cell_idx: (row as usize * field.n_side + col as usize) as i32,
            stride: field.n_side as i32,
            x: (x - col) as f32,
            y: (y - row) as f32,
            low: [-col as f32, -row as f32],
            high: [(high - col) as f32, (high - row) as f32],
            slope_m: field.slope_m(),
            quantum_m: [field.clear.quantum_m, field.slow.quantum_m],
        }
    }
}

/// The lanes of one pass.
struct Pass {
    n: usize,
    x: [f32; N],
    y: [f32; N],
    sin: [f32; N],
    cos: [f32; N],
    speed_m_s: [f32; N],
    kept_m: [f32; N],
    /// The margin to the limits everywhere in this step.
    bound_m: [f32; N],
    /// Cells moved in this step.
    moved: [f32; N],
    /// Neither margin can be below this, metres.
    room_m: [f32; N],
    share_x: [f32; N],
    share_y: [f32; N],
    cell_idx: [i32; N],
    clear: [u32; N],
    slow: [u32; N],
    ridge: [u32; N],
}

impl Pass {
    #[inline(always)]
    fn at(origin: &Origin<'_, '_>, [_, _, yaw, speed]: Pose, n: usize) -> Pass {
        let (sin, cos) = yaw.sin_cos();
        Pass {
            n,
            x: [origin.x; N],
            y: [origin.y; N],
            sin: [sin as f32; N],
            cos: [cos as f32; N],
            speed_m_s: [speed as f32; N],
            kept_m: [f32::INFINITY; N],
            bound_m: [f32::INFINITY; N],
            moved: [0.0; N],
            room_m: [f32::NEG_INFINITY; N],
            share_x: [0.0; N],
            share_y: [0.0; N],
            cell_idx: [0; N],
            clear: [0; N],
            slow: [0; N],
            ridge: [0; N],
        }
    }

    /// One step of every lane; where each is then, and what is to be done about it.
    #[inline(always)]
    fn advance<const FULL: bool, const FUSED: bool>(
        &mut self,
        origin: &Origin<'_, '_>,
        turns: &[f32],
        gains: &[f32],
        floor_m: f32,
    ) -> u32 {
        let n = self.n.min(N);
        move_lanes::<FUSED>(
            n,
            &mut self.x,
            &mut self.y,
            &mut self.moved,
            &mut self.sin,
            &mut self.cos,
            &self.speed_m_s,
            turns,
        );
        limit_lanes(n, &mut self.speed_m_s, &mut self.bound_m, turns, gains);
        place_lanes(n, origin, &mut self.share_x, &mut self.share_y, &mut self.cell_idx, &self.x, &self.y);
        if FULL {
            READS
        } else {
            room_lanes(
                n,
                &mut self.room_m,
                &mut self.kept_m,
                &self.moved,
                &self.bound_m,
                origin.slope_m,
                floor_m,
            )
        }
    }

    /// Loads the words of every lane's cell.
    #[inline(always)]
    fn load(&mut self, origin: &Origin<'_, '_>, n: usize) {
        let words = &origin.field.words[..];
        for lane in 0..n.min(N) {
            // What is not a number ends anywhere; nothing is read beyond the grid.
            let [clear, slow] = words.get(self.cell_idx[lane] as usize).copied().unwrap_or([RIDGE; 2]);
            self.clear[lane] = clear;
            self.slow[lane] = slow;
        }
    }

    /// Lowers what lanes keep by the margins at their places; not 0 when some lie on a ridge that matters.
    #[inline(always)]
    fn judge<const FUSED: bool>(&mut self, origin: &Origin<'_, '_>) -> u32 {
        let n = self.n.min(N);
        judge_lanes::<FUSED>(
            n,
            &mut self.kept_m,
            &self.bound_m,
            &mut self.room_m,
            &mut self.ridge,
            (&self.clear, &self.slow),
            &self.share_x,
            &self.share_y,
            &self.speed_m_s,
            origin.quantum_m,
        )
    }

    /// Where layers cross, the word is a lower bound only: those lanes ask the layers.
    #[inline(never)]
    fn settle_ridges(&mut self, origin: &Origin<'_, '_>, n: usize) {
        for lane in (0..n.min(N)).filter(|lane| self.ridge[*lane] != 0) {
            let place = (f64::from(self.share_x[lane]), f64::from(self.share_y[lane]));
            let cell_idx = self.cell_idx[lane] as usize;
            if cell_idx >= origin.field.words.len() {
                self.kept_m[lane] = f32::NEG_INFINITY;
                continue;
            }
            let clear_m = origin.field.clear_m(cell_idx, place) as f32;
            let slow_m = origin.field.slow_m(cell_idx, place) as f32;
            let eased_m = most(slow_m, SLOW_SPEED_M_S as f32 - self.speed_m_s[lane]);
            self.kept_m[lane] = least(self.kept_m[lane], least(clear_m, eased_m));
        }
    }
}

// Each loop reads and writes arrays that are arguments of their own: only then does the compiler know that
// they do not overlap, and makes vectors of them.

#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "arrays in a struct would not be known to be apart")]
fn move_lanes<const FUSED: bool>(
    n: usize,
    x: &mut [f32; N],
    y: &mut [f32; N],
    moved: &mut [f32; N],
    sin: &mut [f32; N],
    cos: &mut [f32; N],
    speed_m_s: &[f32; N],
    turns: &[f32],
) {
    let turns = &turns[..n];
    for lane in 0..n {
        let cells = speed_m_s[lane] * CELLS_PER_SPEED;
        let (s, c) = (sin[lane], cos[lane]);
        moved[lane] = cells;
        x[lane] = fused::<FUSED>(cells, c, x[lane]);
        y[lane] = fused::<FUSED>(cells, s, y[lane]);
        let turn = turns[lane];
        let square = turn * turn;
        // Taylor; a step turns by 0.05 rad at most: error below 1e-10.
        let by_cos = fused::<FUSED>(square, fused::<FUSED>(square, 1.0 / 24.0, -0.5), 1.0);
        let by_sin = turn * fused::<FUSED>(square, fused::<FUSED>(square, 1.0 / 120.0, -1.0 / 6.0), 1.0);
        sin[lane] = fused::<FUSED>(s, by_cos, c * by_sin);
        cos[lane] = fused::<FUSED>(c, by_cos, -s * by_sin);
    }
}

#[inline(always)]
fn limit_lanes(n: usize, speed_m_s: &mut [f32; N], bound_m: &mut [f32; N], turns: &[f32], gains: &[f32]) {
    let (turns, gains) = (&turns[..n], &gains[..n]);
    for lane in 0..n {
        let speed = speed_after(speed_m_s[lane], gains[lane]);
        speed_m_s[lane] = speed;
        bound_m[lane] = kinematic_margin(speed, turns[lane]);
    }
}

#[inline(always)]
fn place_lanes(
    n: usize,
    origin: &Origin<'_, '_>,
    share_x: &mut [f32; N],
    share_y: &mut [f32; N],
    cell_idx: &mut [i32; N],
    x: &[f32; N],
    y: &[f32; N],
) {
    let ([low_x, low_y], [high_x, high_y]) = (origin.low, origin.high);
    let (stride, first) = (origin.stride, origin.cell_idx);
    let whole = |rounded: f32| (rounded.to_bits() as i32).wrapping_sub(ROUNDER.to_bits() as i32);
    for lane in 0..n {
        let inside_x = most(least(x[lane], high_x), low_x);
        let inside_y = most(least(y[lane], high_y), low_y);
        let (col, row) = ((inside_x - 0.5) + ROUNDER, (inside_y - 0.5) + ROUNDER);
        share_x[lane] = inside_x - (col - ROUNDER);
        share_y[lane] = inside_y - (row - ROUNDER);
        cell_idx[lane] = whole(row).wrapping_mul(stride).wrapping_add(whole(col)).wrapping_add(first);
    }
}

#[inline(always)]
fn room_lanes(
    n: usize,
    room_m: &mut [f32; N],
    kept_m: &mut [f32; N],
    moved: &[f32; N],
    bound_m: &[f32; N],
    slope_m: f32,
    floor_m: f32,
) -> u32 {
    let mut reads = 0;
    for lane in 0..n {
        let room = room_m[lane] - slope_m * moved[lane] - 1e-6;
        room_m[lane] = room;
        let kept = least(kept_m[lane], bound_m[lane]);
        kept_m[lane] = kept;
        let is_alive = kept > floor_m;
        reads |= if is_alive { ALIVE } else { 0 };
        reads |= if is_alive & (room < kept) { READS } else { 0 };
    }
    reads
}

#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "arrays in a struct would not be known to be apart")]
fn judge_lanes<const FUSED: bool>(
    n: usize,
    kept_m: &mut [f32; N],
    bound_m: &[f32; N],
    room_m: &mut [f32; N],
    ridge: &mut [u32; N],
    (clear, slow): (&[u32; N], &[u32; N]),
    share_x: &[f32; N],
    share_y: &[f32; N],
    speed_m_s: &[f32; N],
    [clear_quantum_m, slow_quantum_m]: [f32; 2],
) -> u32 {
    let mut ridges = 0;
    for lane in 0..n {
        let (x, y) = (share_x[lane], share_y[lane]);
        let clear_m = clear_quantum_m * unpacked::<FUSED>(clear[lane], x, y);
        let slow_m = slow_quantum_m * unpacked::<FUSED>(slow[lane], x, y);
        let eased_m = most(slow_m, SLOW_SPEED_M_S as f32 - speed_m_s[lane]);
        let here_m = least(clear_m, eased_m);
        // Not the loaded value itself is chosen from: that would make a masked store, which the next load waits for.
        let kept = least(kept_m[lane], bound_m[lane]);
        let lowers = if here_m < kept { 1 } else { 0 };
        let is_ridge = ((clear[lane] | slow[lane]) >> 31) & lowers;
        ridge[lane] = is_ridge;
        ridges |= is_ridge;
        kept_m[lane] = if is_ridge != 0 { kept } else { least(kept, here_m) };
        room_m[lane] = least(clear_m, slow_m);
    }
    ridges
}
