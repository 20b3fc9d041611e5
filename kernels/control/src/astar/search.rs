//! The search itself: A* in arrays, a row of neighbours at a time.
//!
//! Costs are counted in buckets, of which a cell of plain floor is [`BUCKETS_PER_CELL`]. Deliberately not here: which
//! steps are allowed (`costmap`), in which order cells are looked at (`buckets`), and metres (`astar`).

use std::f32::consts::SQRT_2;

use wide::f32x4;

use super::buckets::{BUCKETS_PER_CELL, Buckets};
use super::place::{N_LANES, Place};
use crate::costmap::{STEPS, Weights};

/// Lengths of a step to the side and along a diagonal, buckets.
const STRAIGHT: f32 = BUCKETS_PER_CELL;
const DIAGONAL: f32 = SQRT_2 * BUCKETS_PER_CELL;
/// Lengths of the steps to the rows below and above, and to the cells beside.
const AT_SIDES: f32x4 = f32x4::new([DIAGONAL, STRAIGHT, DIAGONAL, 0.0]);
const BESIDE: f32x4 = f32x4::new([STRAIGHT, 0.0, STRAIGHT, 0.0]);
/// Where the columns of a row lie, beside the cell's own.
const COLUMNS: f32x4 = f32x4::new([-STRAIGHT, 0.0, STRAIGHT, 2.0 * STRAIGHT]);

/// What a search knows of each cell. It looks at the cells around one row by row, each row at once.
pub(super) struct Search<'a> {
    weights: &'a Weights,
    /// Cost of the cheapest way known, buckets; below zero once the ways on from there are known.
    costs: Vec<f32>,
    /// By lane, from a cell to those around it.
    ways: [usize; N_LANES],
}

/// The lane that each step leads to.
const LANES: [usize; STEPS.len()] = [0, 1, 2, 4, 6, 8, 9, 10];
/// By steps as bits, their lanes as bits.
static LANES_OF_STEPS: [u16; 256] = lanes_of_steps();

const fn lanes_of_steps() -> [u16; 256] {
    let mut table = [0; 256];
    let mut steps = 0;
    while steps < table.len() {
        table[steps] =
            (steps & 0x07 | (steps & 0x08) << 1 | (steps & 0x10) << 2 | (steps & 0xE0) << 3) as u16;
        steps += 1;
    }
    table
}

impl<'a> Search<'a> {
    pub(super) fn new(weights: &'a Weights) -> Self {
        let mut ways = [0; N_LANES];
        for (lane, way) in ways.iter_mut().enumerate() {
            *way = (lane / 4 * weights.stride + lane % 4).wrapping_sub(weights.stride + 1);
        }
        Search { weights, costs: vec![f32::INFINITY; weights.values.len()], ways }
    }

    /// Finds the cheapest way to the goal, if there is one.
    pub(super) fn run(&mut self, start: Place, goal: Place) {
        let stride = self.weights.stride;
        let goal_position = goal.position(stride);
        let [off_cols, off_rows] = start.off(goal).map(|off| (off * STRAIGHT).abs());
        let ahead = off_cols.max(off_rows) + off_cols.min(off_rows) * (SQRT_2 - 1.0);
        // What is further ahead than the ring is long would be looked at too early: the ring begins at the start.
        let mut open = Buckets::starting_at(ahead as i32);
        self.costs[start.position(stride)] = 0.0;
        open.push(ahead as i32, start);
        while let Some(mut chain) = open.take() {
            // No way over a cell in a later bucket could be cheaper.
            if chain.least() >= self.costs[goal_position].abs() {
                return;
            }
            while let Some(place) = open.pop(&mut chain) {
                self.look_around(place, goal, &mut open);
            }
        }
    }

    /// Takes note of the steps from a place that lead cheaper to a cell around than what is known.
    #[inline(always)]
    fn look_around(&mut self, place: Place, goal: Place, open: &mut Buckets) {
        let here = place.position(self.weights.stride);
        // One length for all, so that a place is held against it once.
        let n = self.costs.len();
        let (Some(weights), Some(steps)) = (self.weights.values.get(..n), self.weights.steps.get(..n)) else {
            return;
        };
        let costs = &mut self.costs[..n];
        let cost = costs[here];
        if cost.is_sign_negative() {
            return;
        }
        costs[here] = -cost;
        let [off_col, off_row] = place.off(goal).map(|off| off * STRAIGHT);
        let off_cols = (f32x4::splat(off_col) + COLUMNS).abs();
        let mut found = 0;
        let (mut reached, mut buckets) = ([0.0; N_LANES], [0; N_LANES]);
        let rows = [(-STRAIGHT, AT_SIDES), (0.0, BESIDE), (STRAIGHT, AT_SIDES)];
        for (nth, (row, lengths)) in rows.into_iter().enumerate() {
            let first = here.wrapping_add(self.ways[4 * nth]);
            let (Some(weights), Some(known)) = (four(weights, first), four(costs, first)) else { return };
            let by_here = f32x4::splat(cost) + lengths * weights;
            // The shortest way on over eight neighbours.
            let off_rows = f32x4::splat((off_row + row).abs());
            let (long, short) = (off_cols.fast_max(off_rows), off_cols.fast_min(off_rows));
            let whole = by_here + long + short * (SQRT_2 - 1.0);
            found |= by_here.simd_lt(known.abs()).to_bitmask() << (4 * nth);
            reached[4 * nth..4 * nth + 4].copy_from_slice(&by_here.to_array());
            buckets[4 * nth..4 * nth + 4].copy_from_slice(&whole.fast_trunc_int().to_array());
        }
        found &= u32::from(LANES_OF_STEPS[usize::from(steps[here])]);
        while found != 0 {
            let lane = found.trailing_zeros() as usize % N_LANES;
            found &= found - 1;
            costs[here.wrapping_add(self.ways[lane])] = reached[lane];
            open.push(buckets[lane], place.after(lane));
        }
    }

    /// The cell before one on the cheapest way to it, and the step from there; `None` when no way leads there. Of
    /// ways that cost the same it is the one that goes straight on by `step`.
    pub(super) fn before(&self, place: Place, step: usize) -> Option<(Place, usize)> {
        let here = place.position(self.weights.stride);
        let (cost, weight) = (self.costs[here].abs(), self.weights.values[here]);
        if cost == f32::INFINITY {
            return None;
        }
        let leads_here = |step: usize| {
            let from = here.wrapping_sub(self.ways[LANES[step]]);
            let (dx, dy) = STEPS[step];
            let length = if dx != 0 && dy != 0 { DIAGONAL } else { STRAIGHT };
            self.costs[from].abs() + length * weight <= cost && self.weights.steps[from] >> step & 1 == 1
        };
        let step = if leads_here(step) { step } else { (0..STEPS.len()).find(|step| leads_here(*step))? };
        Some((place.before(LANES[step]), step))
    }
}

/// Four values in a row.
#[inline(always)]
fn four(values: &[f32], first: usize) -> Option<f32x4> {
    values.get(first..)?.first_chunk::<4>().map(|values| f32x4::new(*values))
}
