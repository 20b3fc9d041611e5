//! The search itself: A* in arrays, a row of neighbours at a time.
//!
//! Costs are in cells of plain floor. Deliberately not here: what is open and in which order (`buckets`), and
//! metres (`astar`).

use std::f32::consts::SQRT_2;

use wide::f32x4;

use super::buckets::{Buckets, Place};
use crate::costmap::Weights;

/// The eight steps, as columns and rows, by row and column.
pub(super) const STEPS: [(i32, i32); 8] =
    [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];
/// Their lengths, cells.
const LENGTHS: [f32; 8] = [SQRT_2, 1.0, SQRT_2, 1.0, 1.0, SQRT_2, 1.0, SQRT_2];
/// By which of the eight cells around may be stepped on, as bits: which steps do not cut a corner of the others.
static CLEAR_OF_CORNERS: [u8; 256] = clear_of_corners();

const fn clear_of_corners() -> [u8; 256] {
    let mut table = [0; 256];
    let mut open = 0;
    while open < table.len() {
        let (below, left, right, above) = (open >> 1 & 1, open >> 3 & 1, open >> 4 & 1, open >> 6 & 1);
        let diagonals = (below & left) | (below & right) << 2 | (above & left) << 5 | (above & right) << 7;
        table[open] = (open & (0b0101_1010 | diagonals)) as u8;
        open += 1;
    }
    table
}

/// What a search knows of each cell. It looks at the cells around one row by row, each row at once.
pub(super) struct Search<'a> {
    weights: &'a Weights,
    /// Cost of the cheapest way known, cells; below zero once the ways on from there are known.
    costs: Vec<f32>,
    /// From a cell to the eight around it.
    ways: [isize; 8],
}

impl<'a> Search<'a> {
    pub(super) fn new(weights: &'a Weights) -> Self {
        let stride = weights.stride as isize;
        let ways = STEPS.map(|(dx, dy)| dy as isize * stride + dx as isize);
        Search { weights, costs: vec![f32::INFINITY; weights.values.len()], ways }
    }

    /// Finds the cheapest way to the goal, if there is one.
    pub(super) fn run(&mut self, start: usize, goal: usize) {
        let stride = self.weights.stride;
        let place =
            |position: usize| Place { col: (position % stride) as u16, row: (position / stride) as u16 };
        let goal_place = place(goal);
        let mut open = Buckets::new();
        self.costs[start] = 0.0;
        open.push(0.0, place(start));
        while let Some(place) = open.pop(self.costs[goal].abs()) {
            let here = usize::from(place.row) * stride + usize::from(place.col);
            let cost = self.costs[here];
            if cost.is_sign_negative() {
                continue;
            }
            self.costs[here] = -cost;
            let mut found = self.look_around(here, cost);
            while found.steps != 0 {
                let step = found.steps.trailing_zeros() as usize;
                found.steps &= found.steps - 1;
                let (cost, next) = (found.costs[step], place.after(STEPS[step]));
                self.costs[here.wrapping_add_signed(self.ways[step])] = cost;
                open.push(cost + next.octile(goal_place), next);
            }
        }
    }

    /// Which steps lead cheaper to a cell around than what is known, and at what cost.
    #[inline(always)]
    fn look_around(&self, here: usize, cost: f32) -> Around {
        const AT_SIDES: f32x4 = f32x4::new([SQRT_2, 1.0, SQRT_2, 0.0]);
        const BESIDE: f32x4 = f32x4::new([1.0, 0.0, 1.0, 0.0]);
        let row = |first: usize, lengths: f32x4| {
            let costs = f32x4::splat(cost) + lengths * four(&self.weights.values, first).abs();
            (costs.simd_lt(four(&self.costs, first).abs()).to_bitmask(), costs.to_array())
        };
        let stride = self.weights.stride;
        let (below, [c0, c1, c2, _]) = row(here - stride - 1, AT_SIDES);
        let (beside, [c3, _, c4, _]) = row(here - 1, BESIDE);
        let (above, [c5, c6, c7, _]) = row(here + stride - 1, AT_SIDES);
        let steps = bits([below, beside, above]) & self.allowed(here);
        Around { steps, costs: [c0, c1, c2, c3, c4, c5, c6, c7] }
    }

    /// Which steps are allowed: out of an inflated area, never into one, and around corners.
    #[inline(always)]
    fn allowed(&self, here: usize) -> u8 {
        let stride = self.weights.stride;
        let is_free = self.weights.values[here] > 0.0;
        let rows = [here - stride - 1, here - 1, here + stride - 1].map(|first| {
            let weights = four(&self.weights.values, first);
            let there = if is_free { weights } else { weights.abs() };
            (there.simd_gt(f32x4::ZERO) & there.simd_lt(f32x4::splat(f32::INFINITY))).to_bitmask()
        });
        CLEAR_OF_CORNERS[usize::from(bits(rows))]
    }

    /// The cell before one on the cheapest way to it, and the step from there; `None` when no way leads there. Of
    /// ways that cost the same it is the one that goes straight on by `step`.
    pub(super) fn before(&self, here: usize, step: usize) -> Option<(usize, usize)> {
        let (cost, weight) = (self.costs[here].abs(), self.weights.values[here].abs());
        if cost == f32::INFINITY {
            return None;
        }
        let others = (0..STEPS.len()).filter(|other| *other != step);
        let mut befores = std::iter::once(step).chain(others).filter_map(|step| {
            let from = here.checked_add_signed(-self.ways[step])?;
            let is_before = self.costs[from].abs() + LENGTHS[step] * weight <= cost;
            (is_before && self.allowed(from) >> step & 1 == 1).then_some((from, step))
        });
        befores.next()
    }
}

/// Four values in a row; past the end nothing is cheap.
#[inline(always)]
fn four(values: &[f32], first: usize) -> f32x4 {
    f32x4::new(values[first..].first_chunk::<4>().copied().unwrap_or([f32::INFINITY; 4]))
}

/// Bits of the cells around one, by those of the three rows.
#[inline(always)]
fn bits([below, beside, above]: [u32; 3]) -> u8 {
    ((below & 7) | (beside & 1) << 3 | (beside & 4) << 2 | (above & 7) << 5) as u8
}

/// Steps that are worth it, as bits, and what each would cost.
struct Around {
    steps: u8,
    costs: [f32; 8],
}
