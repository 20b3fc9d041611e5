//! Where beams have passed and nothing stood: one bit for each square of a tenth of a metre.
//!
//! A scan that puts points there contradicts the map; points where nobody looked yet tell nothing. Kept for as
//! long as a sub-map is, therefore small.

use geometry::Point2 as Point2D;
use nalgebra::Point2;

use super::placement::floor;

/// Side of a square, metres.
const SIDE_M: f32 = 0.1;
/// The grid grows by this many squares at a time: one word.
const CHUNK: i32 = 64;
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
    /// Row by row.
    words: Vec<u64>,
}

impl FreeGrid {
    /// Whether a point lies where a beam has passed.
    #[must_use]
    pub fn is_free(&self, at: Point2<f32>) -> bool {
        self.place(square_of(at))
            .is_some_and(|(word, bit)| self.words.get(word).is_some_and(|w| w >> bit & 1 == 1))
    }

    /// Frees what a beam passed.
    pub fn pass(&mut self, from: Point2<f32>, to: Point2<f32>) {
        let way = to - from;
        let length_m = way.norm();
        let free_m = (length_m - SHORT_OF_END_M).min(LENGTH_MAX_M);
        // NaN is no length.
        if !(free_m > 0.0 && from.coords.iter().all(|c| c.is_finite())) {
            return;
        }
        let step = way * (SIDE_M / length_m);
        let mut at = from;
        for _ in 0..=(free_m / SIDE_M) as usize {
            self.mark(square_of(at));
            at += step;
        }
    }

    /// Makes room for points between two corners, so that beams between them can be marked.
    pub fn make_room(&mut self, low: Point2<f32>, high: Point2<f32>) {
        let (low, high) = (square_of(low), square_of(high));
        let is_empty = self.words.is_empty();
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
        let mut words = vec![0; (n_side[0] / CHUNK * n_side[1]) as usize];
        let (old_words, new_words) = ((self.n_side[0] / CHUNK) as usize, (n_side[0] / CHUNK) as usize);
        let off_col = ((self.origin[0] - origin[0]) / CHUNK) as usize;
        let off_row = (self.origin[1] - origin[1]) as usize;
        for (row, old) in self.words.chunks_exact(old_words.max(1)).enumerate() {
            let begin = (row + off_row) * new_words + off_col;
            words[begin..begin + old_words].copy_from_slice(old);
        }
        (self.origin, self.n_side, self.words) = (origin, n_side, words);
    }

    /// Frees the square of a point; room must have been made.
    pub fn free(&mut self, at: Point2D) {
        self.mark(square_of(at.cast()));
    }

    fn mark(&mut self, square: [i32; 2]) {
        if let Some((word, bit)) = self.place(square)
            && let Some(word) = self.words.get_mut(word)
        {
            *word |= 1 << bit;
        }
    }

    #[inline]
    fn place(&self, square: [i32; 2]) -> Option<(usize, u32)> {
        let (col, row) = (square[0].wrapping_sub(self.origin[0]), square[1].wrapping_sub(self.origin[1]));
        let is_inside = col >= 0 && row >= 0 && col < self.n_side[0] && row < self.n_side[1];
        is_inside.then(|| ((row * (self.n_side[0] / CHUNK) + col / CHUNK) as usize, (col % CHUNK) as u32))
    }
}

#[inline]
fn square_of(at: Point2<f32>) -> [i32; 2] {
    [floor(at.x * (1.0 / SIDE_M)), floor(at.y * (1.0 / SIDE_M))]
}
