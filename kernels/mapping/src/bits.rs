//! Grids of bits, a word of cells at a time: which cells straight lines pass.
//!
//! A beam passes hundreds of cells, but one run of them in each row. Whole runs are set at once, and a cell that
//! many beams pass is still one bit: whoever counts it counts it once.
//!
//! Deliberately not here: where a grid lies, and what a bit means.

use geometry::Point2;

/// Cells of a word.
pub(crate) const N_WORD: usize = u64::BITS as usize;

/// One bit for each cell, in rows of whole words.
#[derive(Clone, Debug, Default)]
pub(crate) struct BitGrid {
    n_words: usize,
    n_rows: usize,
    words: Vec<u64>,
}

impl BitGrid {
    /// Of so many words and rows, nothing set.
    pub(crate) fn new(n_words: usize, n_rows: usize) -> Self {
        BitGrid { n_words, n_rows, words: vec![0; n_words * n_rows] }
    }

    /// The same in the room of this one.
    pub(crate) fn reset(&mut self, n_words: usize, n_rows: usize) {
        self.words.clear();
        self.words.resize(n_words * n_rows, 0);
        (self.n_words, self.n_rows) = (n_words, n_rows);
    }

    /// Follows its owner into a larger grid, so many words to the right and rows up.
    pub(crate) fn grow(&mut self, n_words: usize, n_rows: usize, [word, row]: [usize; 2]) {
        let mut grown = BitGrid::new(n_words, n_rows);
        let rows = grown.words.chunks_exact_mut(n_words.max(1)).skip(row);
        for (new, old) in rows.zip(self.words.chunks_exact(self.n_words.max(1))) {
            if let Some(new) = new.get_mut(word..word + old.len()) {
                new.copy_from_slice(old);
            }
        }
        *self = grown;
    }

    /// Rows of words, from the lowest.
    pub(crate) fn rows(&self) -> impl Iterator<Item = &[u64]> {
        self.words.chunks_exact(self.n_words.max(1))
    }

    /// Whether a cell is set; none outside is.
    #[inline]
    pub(crate) fn is_set(&self, col: usize, row: usize) -> bool {
        col / N_WORD < self.n_words
            && self
                .words
                .get(row.wrapping_mul(self.n_words).wrapping_add(col / N_WORD))
                .is_some_and(|word| word >> (col % N_WORD) & 1 == 1)
    }

    /// Sets a cell.
    pub(crate) fn set(&mut self, col: usize, row: usize) {
        self.set_run(row, col, col, [0, 0]);
    }

    /// Clears a cell.
    pub(crate) fn clear(&mut self, col: usize, row: usize) {
        if col / N_WORD < self.n_words
            && let Some(word) = self.words.get_mut(row * self.n_words + col / N_WORD)
        {
            *word &= !(1 << (col % N_WORD));
        }
    }

    /// Sets every cell that the line between two points (in cells, from the low corner) passes by more than a
    /// millionth of a cell, without the one that `to` lies in. Lines that leave the grid set nothing.
    pub(crate) fn pass(&mut self, from: Point2, to: Point2) {
        let Some([low, high]) = self.upwards(from, to) else { return };
        let is_upwards = from.y <= to.y;
        let (first_row, last_row) = (low.y as usize, high.y as usize);
        // The last cell is at that end of its run that the line comes to.
        let but_last = if to.x > from.x { [0, 1] } else { [1, 0] };
        if first_row == last_row {
            self.set_run(first_row, low.x as usize, high.x as usize, but_last);
            return;
        }
        let slope = (high.x - low.x) / (high.y - low.y);
        // Rounding must not carry the line beyond its ends.
        let (least, most) = (fixed(from.x.min(to.x)), fixed(from.x.max(to.x)));
        let mut enters = fixed(low.x + ((first_row + 1) as f64 - low.y) * slope).clamp(least, most);
        let at_low = if is_upwards { [0, 0] } else { but_last };
        self.set_run(first_row, low.x as usize, whole(enters), at_low);
        // Asked for only where the line is longer than a row is high: it is less than the grid is wide.
        let step = fixed(slope);
        let rows = self.words.get_mut((first_row + 1) * self.n_words..last_row * self.n_words);
        for row in rows.unwrap_or_default().chunks_exact_mut(self.n_words) {
            let leaves = enters.wrapping_add(step).clamp(least, most);
            let (a, b) = (whole(enters), whole(leaves));
            set_bits(row, a.min(b), a.max(b));
            enters = leaves;
        }
        let at_high = if is_upwards { but_last } else { [0, 0] };
        self.set_run(last_row, whole(enters), high.x as usize, at_high);
    }

    /// Sets those cells that the line between two points passes through the middle of, not those that it cuts the
    /// corners of: one in each row or in each column, whichever it crosses more of. Lines that leave the grid set
    /// nothing.
    pub(crate) fn pass_middles(&mut self, from: Point2, to: Point2) {
        let Some([low, high]) = self.upwards(from, to) else { return };
        let (along, rise) = (high.x - low.x, high.y - low.y);
        let slope = if rise > 0.0 { along / rise } else { 0.0 };
        let at = |y: f64| low.x + (y.clamp(low.y, high.y) - low.y) * slope;
        let is_steep = along.abs() <= rise;
        for row in low.y as usize..=high.y as usize {
            if is_steep {
                self.set(at(row as f64 + 0.5) as usize, row);
                continue;
            }
            let enters = if row == low.y as usize { low.x } else { at(row as f64) };
            let leaves = if row == high.y as usize { high.x } else { at((row + 1) as f64) };
            // Columns whose middle lies between.
            let [first, end] = [enters.min(leaves), enters.max(leaves)].map(|x| (x + 0.5) as usize);
            if first < end {
                self.set_run(row, first, end - 1, [0, 0]);
            }
        }
    }

    /// The ends of a line, the lower one first; `None` unless both lie in the grid.
    fn upwards(&self, from: Point2, to: Point2) -> Option<[Point2; 2]> {
        let (width, height) = ((self.n_words * N_WORD) as f64, self.n_rows as f64);
        let is_inside = |p: &Point2| p.x >= 0.0 && p.y >= 0.0 && p.x < width && p.y < height;
        let is_upwards = from.y <= to.y;
        (is_inside(&from) && is_inside(&to)).then_some(if is_upwards { [from, to] } else { [to, from] })
    }

    /// Sets the cells of a row between two, in whichever order, both included, but for so many at the lower end and
    /// at the upper one.
    fn set_run(&mut self, row: usize, a: usize, b: usize, but: [usize; 2]) {
        let (first, end) = (a.min(b) + but[0], a.max(b) + 1 - but[1]);
        if let Some(row) = self.words.get_mut(row * self.n_words..(row + 1) * self.n_words)
            && first < end
        {
            set_bits(row, first, end - 1);
        }
    }
}

/// A number of cells with 32 bits behind the point.
fn fixed(cells: f64) -> i64 {
    (cells * (1_i64 << 32) as f64) as i64
}

/// The whole cells of such a number, which is not negative.
#[inline]
fn whole(fixed: i64) -> usize {
    (fixed >> 32) as usize
}

/// Sets the bits of a row from one to another, both included.
#[inline]
fn set_bits(row: &mut [u64], first: usize, last: usize) {
    let (low, high) = (first / N_WORD, last / N_WORD);
    let from_first = !0 << (first % N_WORD);
    let to_last = !0 >> (N_WORD - 1 - last % N_WORD);
    if low == high {
        if let Some(word) = row.get_mut(low) {
            *word |= from_first & to_last;
        }
    } else if let Some([low, between @ .., high]) = row.get_mut(low..=high) {
        *low |= from_first;
        between.fill(!0);
        *high |= to_last;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const N_ROWS: usize = 150;

    fn points() -> impl Strategy<Value = (Point2, Point2)> {
        let along = || prop_oneof![0.0..149.99_f64, (0..150_u8).prop_map(f64::from)];
        (along(), along(), along(), along()).prop_map(|(a, b, c, d)| (Point2::new(a, b), Point2::new(c, d)))
    }

    /// Length of a line inside a cell, cells.
    fn inside(from: Point2, to: Point2, col: usize, row: usize) -> f64 {
        let (mut begin, mut end) = (0.0_f64, 1.0_f64);
        for (at, way, low) in [(from.x, to.x - from.x, col as f64), (from.y, to.y - from.y, row as f64)] {
            if way == 0.0 {
                if !(low..low + 1.0).contains(&at) {
                    return -1.0;
                }
            } else {
                let (a, b) = ((low - at) / way, (low + 1.0 - at) / way);
                (begin, end) = (begin.max(a.min(b)), end.min(a.max(b)));
            }
        }
        (end - begin) * (to - from).norm()
    }

    proptest! {
        #[test]
        fn a_line_sets_what_it_passes_but_for_its_last_cell_and_nothing_else((from, to) in points()) {
            let mut bits = BitGrid::new(3, N_ROWS);
            bits.pass(from, to);
            for row in 0..N_ROWS {
                for col in 0..3 * N_WORD {
                    let is_last = (col, row) == (to.x as usize, to.y as usize);
                    let inside_cells = inside(from, to, col, row);
                    if is_last || inside_cells < -1e-6 {
                        prop_assert!(!bits.is_set(col, row), "{col} {row} is not passed");
                    } else if inside_cells > 1e-6 {
                        prop_assert!(bits.is_set(col, row), "{col} {row} is passed by {inside_cells}");
                    }
                }
            }
        }

        #[test]
        fn of_what_a_line_passes_one_cell_is_set_in_each_row_or_column((from, to) in points()) {
            let mut bits = BitGrid::new(3, N_ROWS);
            bits.pass_middles(from, to);
            let (mut n_in_row, mut n_in_col) = ([0; N_ROWS], [0; 3 * N_WORD]);
            for (row, n_in_row) in n_in_row.iter_mut().enumerate() {
                for (col, n_in_col) in n_in_col.iter_mut().enumerate().filter(|(col, _)| bits.is_set(*col, row)) {
                    *n_in_row += 1;
                    *n_in_col += 1;
                    prop_assert!(inside(from, to, col, row) > -1e-6, "{col} {row} is not passed");
                }
            }
            if (to.x - from.x).abs() <= (to.y - from.y).abs() {
                let rows = from.y.min(to.y) as usize..=from.y.max(to.y) as usize;
                prop_assert!((0..N_ROWS).all(|row| n_in_row[row] == i32::from(rows.contains(&row))));
            } else {
                // Without the columns of the ends, whose middles the line may not reach.
                let cols = from.x.min(to.x) as usize + 1..from.x.max(to.x) as usize;
                prop_assert!(cols.into_iter().all(|col| n_in_col[col] == 1));
            }
        }

        #[test]
        fn growing_moves_bits_with_their_grid((from, to) in points(), word in 0..3_usize, row in 0..9_usize) {
            let mut bits = BitGrid::new(3, N_ROWS);
            bits.pass(from, to);
            let before = bits.clone();
            bits.grow(6, N_ROWS + 9, [word, row]);
            for y in 0..N_ROWS {
                for x in 0..3 * N_WORD {
                    prop_assert_eq!(before.is_set(x, y), bits.is_set(x + word * N_WORD, y + row));
                }
            }
            let n_set = |bits: &BitGrid| bits.rows().flatten().map(|w| w.count_ones()).sum::<u32>();
            prop_assert_eq!(n_set(&before), n_set(&bits));
        }
    }

    #[test]
    fn lines_that_leave_the_grid_or_are_none_set_nothing() {
        let mut bits = BitGrid::new(1, 10);
        for to in [Point2::new(64.0, 3.0), Point2::new(3.0, -0.1), Point2::new(f64::NAN, 3.0)] {
            bits.pass(Point2::new(1.0, 1.0), to);
            bits.pass_middles(Point2::new(1.0, 1.0), to);
        }
        assert!(bits.rows().flatten().all(|word| *word == 0));
    }

    #[test]
    fn a_cell_is_set_and_cleared() {
        let mut bits = BitGrid::new(2, 4);
        bits.set(100, 2);
        assert!(bits.is_set(100, 2) && !bits.is_set(100, 1) && !bits.is_set(200, 2));
        bits.clear(100, 2);
        assert!(!bits.is_set(100, 2));
    }
}
