//! What a search goes by: what each cell costs, and which steps are allowed from it.
//!
//! Deliberately not here: why a cell costs what it costs (`costmap`).

use mapping::{Cell, Shape};

/// The eight steps, as columns and rows, by row and column.
pub(crate) const STEPS: [(i32, i32); 8] =
    [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];

/// What a metre costs in each cell, where a metre of plain floor costs 1, and which steps are allowed.
///
/// With a border of solid cells around the map, so that every cell has eight neighbours.
#[derive(Clone, Debug)]
pub(crate) struct Weights {
    /// Cells of a row, the border's with it.
    pub(crate) stride: usize,
    /// By row and column; infinite where it is solid.
    pub(crate) values: Vec<f32>,
    /// By row and column, which of [`STEPS`] are allowed, as bits: into what is free, out of what is left, never around
    /// a corner of anything else.
    pub(crate) steps: Vec<u8>,
}

impl Weights {
    /// A map with something in every cell.
    pub(crate) fn solid(shape: Shape) -> Weights {
        let stride = shape.n_cols + 2;
        // One more than there are, so that four can be read from any neighbour on.
        let n = stride * (shape.n_rows + 2) + 1;
        Weights { stride, values: vec![f32::INFINITY; n], steps: Vec::new() }
    }

    /// Finds the steps, once each cell has its value: below 0 where it may only be left, which is then made positive.
    #[must_use]
    pub(crate) fn with_steps(mut self) -> Weights {
        let n = self.values.len();
        // Words of eight reach beyond the last row.
        let mut grounds = vec![0; n + self.stride + 9];
        for (ground, value) in grounds.iter_mut().zip(&mut self.values) {
            let is_free = *value > 0.0 && *value < f32::INFINITY;
            *value = value.abs();
            *ground = (u8::from(is_free) * IS_FREE) | (u8::from(*value < f32::INFINITY) * IS_OPEN);
        }
        self.steps = steps(self.stride, n, &grounds);
        self
    }

    /// Where a cell of the map lies among the values.
    pub(crate) fn position(&self, cell: Cell) -> usize {
        (cell.row + 1) * self.stride + cell.col + 1
    }
}

/// Bits of a cell's ground: whether it may be entered from a free one, and from one that is left.
const IS_FREE: u8 = 1;
const IS_OPEN: u8 = 2;

/// The steps that are allowed from each cell that has a neighbour on every side, by its ground; eight cells at a time,
/// one in each byte of a word.
fn steps(stride: usize, n: usize, grounds: &[u8]) -> Vec<u8> {
    const ONES: u64 = 0x0101_0101_0101_0101;
    let word = |first: usize| grounds[first..].first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes));
    let mut steps = vec![0; n];
    for (nth, out) in steps[stride + 1..].chunks_mut(8).enumerate() {
        // The corner below on the left of the first.
        let corner = 8 * nth;
        let from_free = word(corner + stride + 1) & ONES;
        let from_left = from_free ^ ONES;
        let open = |row: usize, col: usize| {
            let there = word(corner + row * stride + col);
            there & from_free | there >> 1 & from_left
        };
        let (below, left, right, above) = (open(0, 1), open(1, 0), open(1, 2), open(2, 1));
        let straight = below << 1 | left << 3 | right << 4 | above << 6;
        let to_below = open(0, 0) & below & left | (open(0, 2) & below & right) << 2;
        let to_above = (open(2, 0) & above & left) << 5 | (open(2, 2) & above & right) << 7;
        let bytes = (straight | to_below | to_above).to_le_bytes();
        out.copy_from_slice(&bytes[..out.len()]);
    }
    steps
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn steps_enter_what_is_free_or_leave_what_is_not_and_cut_no_corner(
            n_cols in 1..20_usize, cells in prop::collection::vec(prop::sample::select(vec![1.0, -51.0, f32::INFINITY]), 1..200),
        ) {
            let n_rows = cells.len().div_ceil(n_cols);
            let mut weights = Weights::solid(Shape { n_cols, n_rows });
            for (idx, value) in cells.iter().enumerate() {
                let position = weights.position(Cell { col: idx % n_cols, row: idx / n_cols });
                weights.values[position] = *value;
            }
            let signed = weights.values.clone();
            let weights = weights.with_steps();
            for idx in 0..cells.len() {
                let here = weights.position(Cell { col: idx % n_cols, row: idx / n_cols });
                let is_open = |dx: i32, dy: i32| {
                    let there = here.wrapping_add_signed(dy as isize * weights.stride as isize + dx as isize);
                    signed[there].is_finite() && (signed[there] > 0.0 || !(signed[here] > 0.0 && signed[here].is_finite()))
                };
                for (nth, (dx, dy)) in STEPS.into_iter().enumerate() {
                    let is_allowed = is_open(dx, dy) && (dx == 0 || dy == 0 || is_open(dx, 0) && is_open(0, dy));
                    prop_assert_eq!(weights.steps[here] >> nth & 1 == 1, is_allowed, "cell {}, step {}", idx, nth);
                }
            }
        }
    }
}
