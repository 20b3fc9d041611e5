//! Where beams have passed and nothing stood: one bit for each square of a tenth of a metre.
//!
//! A scan that puts points there contradicts the map; points where nobody looked yet tell nothing. Kept for as
//! long as a sub-map is, therefore small.

use geometry::Point2 as Point2D;
use nalgebra::Point2;

use super::placement::floor;
use crate::bits::{BitGrid, N_WORD};

/// Side of a square, metres.
const SIDE_M: f32 = 0.1;
/// The grid grows by this many squares at a time: one word.
const CHUNK: i32 = N_WORD as i32;
/// A beam frees nothing this near to its end, metres: pose and range are not exact.
const SHORT_OF_END_M: f32 = 0.2;
/// Beams are followed this far, metres.
const LENGTH_MAX_M: f32 = 20.0;
/// Most squares along a side: 800 m.
const N_SIDE_MAX: i32 = 8192;

/// The squares that are known to be free.
#[derive(Clone, Debug, Default)]
pub struct FreeGrid {
    /// Square (column, row) of the low corner, multiples of [`CHUNK`].
    origin: [i32; 2],
    /// Columns and rows, multiples of [`CHUNK`].
    n_side: [i32; 2],
    bits: BitGrid,
}

impl FreeGrid {
    /// Whether a point lies where a beam has passed.
    #[must_use]
    pub fn is_free(&self, at: Point2<f32>) -> bool {
        let (col, row) = self.place(square_of(at));
        self.bits.is_set(col, row)
    }

    /// Frees what a beam passed.
    pub fn pass(&mut self, from: Point2<f32>, to: Point2<f32>) {
        let way = to - from;
        let length_m = way.norm();
        let free_m = (length_m - SHORT_OF_END_M).min(LENGTH_MAX_M);
        // What is not finite lies nowhere in the grid.
        if free_m <= 0.0 {
            return;
        }
        let corner = nalgebra::Vector2::from(self.origin).cast::<f64>();
        let in_squares =
            |at: Point2<f32>| Point2D::from(at.coords.cast::<f64>() / f64::from(SIDE_M) - corner);
        self.bits.pass_middles(in_squares(from), in_squares(from + way * (free_m / length_m)));
    }

    /// Makes room for points between two corners, so that beams between them can be marked.
    pub fn make_room(&mut self, low: Point2<f32>, high: Point2<f32>) {
        let (low, high) = (square_of(low), square_of(high));
        let is_empty = self.n_side[0] == 0;
        let (mut origin, mut n_side) = (self.origin, self.n_side);
        for axis in 0..2 {
            let (mut first, mut end) = (low[axis] - 1, high[axis] + 2);
            if !is_empty {
                first = first.min(self.origin[axis]);
                end = end.max(self.origin[axis] + self.n_side[axis]);
            }
            origin[axis] = first.div_euclid(CHUNK) * CHUNK;
            n_side[axis] = (end - origin[axis] + CHUNK - 1).div_euclid(CHUNK) * CHUNK;
        }
        let is_same = (origin, n_side) == (self.origin, self.n_side);
        if is_same || n_side.iter().any(|n| *n > N_SIDE_MAX) {
            return;
        }
        let off_word = ((self.origin[0] - origin[0]) / CHUNK) as usize;
        let off_row = (self.origin[1] - origin[1]) as usize;
        self.bits.grow((n_side[0] / CHUNK) as usize, n_side[1] as usize, [off_word, off_row]);
        (self.origin, self.n_side) = (origin, n_side);
    }

    /// Frees the square of a point; room must have been made.
    pub fn free(&mut self, at: Point2D) {
        let (col, row) = self.place(square_of(at.cast()));
        self.bits.set(col, row);
    }

    /// A square counted from the low corner. What lies below becomes huge, and is nowhere.
    #[inline]
    fn place(&self, square: [i32; 2]) -> (usize, usize) {
        let from_corner = |axis: usize| square[axis].wrapping_sub(self.origin[axis]) as u32 as usize;
        (from_corner(0), from_corner(1))
    }
}

#[inline]
fn square_of(at: Point2<f32>) -> [i32; 2] {
    [floor(at.x * (1.0 / SIDE_M)), floor(at.y * (1.0 / SIDE_M))]
}
