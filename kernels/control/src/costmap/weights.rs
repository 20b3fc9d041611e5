//! What a search goes by: what each cell costs, and which steps are allowed from it.
//!
//! Deliberately not here: why a cell costs what it costs (`costmap`).

use mapping::{Cell, Shape};

/// The eight steps, as columns and rows, by row and column.
pub(crate) const STEPS: [(i32, i32); 8] =
    [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];
/// What may be done with a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ground {
    /// It may be entered.
    Free,
    /// It is only ever left, over others of its kind too.
    Leaving,
    /// It is never passed, not even to get out of what is left.
    Solid,
}

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
    /// Of what each cell of a map is and what a metre costs there, row by row.
    pub(crate) fn new(shape: Shape, cells: impl Iterator<Item = (Ground, f32)>) -> Weights {
        let stride = shape.n_cols + 2;
        // One more than there are, so that four can be read from any neighbour on.
        let n = stride * (shape.n_rows + 2) + 1;
        let mut values = vec![f32::INFINITY; n];
        let mut grounds = vec![0; n];
        for (idx, (ground, value)) in cells.enumerate() {
            let position = (idx / shape.n_cols + 1) * stride + idx % shape.n_cols + 1;
            let (ground, value) = match ground {
                Ground::Free => (IS_FREE | IS_OPEN, value),
                Ground::Leaving => (IS_OPEN, value),
                Ground::Solid => (0, f32::INFINITY),
            };
            (grounds[position], values[position]) = (ground, value);
        }
        Weights { stride, values, steps: steps(stride, grounds) }
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
fn steps(stride: usize, mut grounds: Vec<u8>) -> Vec<u8> {
    const ONES: u64 = 0x0101_0101_0101_0101;
    let n = grounds.len();
    // Words reach beyond the last row.
    grounds.resize(n + stride + 9, 0);
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
