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
        for row in self.between(first_row, last_row) {
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
        let (first_row, last_row) = (low.y as usize, high.y as usize);
        let (along, rise) = (high.x - low.x, high.y - low.y);
        let slope = if rise > 0.0 { along / rise } else { 0.0 };
        let at = |y: f64| low.x + (y.clamp(low.y, high.y) - low.y) * slope;
        let (least, most, step) = (fixed(low.x.min(high.x)), fixed(low.x.max(high.x)), fixed(slope));
        if along.abs() <= rise {
            self.set(at(first_row as f64 + 0.5) as usize, first_row);
            self.set(at(last_row as f64 + 0.5) as usize, last_row);
            let mut here = fixed(at(first_row as f64 + 1.5));
            for row in self.between(first_row, last_row) {
                let col = whole(here.clamp(least, most));
                set_bits(row, col, col);
                here = here.wrapping_add(step);
            }
            return;
        }
        // Columns whose middle lies between where the line enters a row and where it leaves it.
        let set_middles = |row: &mut [u64], enters: i64, leaves: i64| {
            let [first, end] = [enters.min(leaves), enters.max(leaves)].map(|x| whole(x + HALF));
            if first < end {
                set_bits(row, first, end - 1);
            }
        };
        let leaves_first = if first_row == last_row { high.x } else { at((first_row + 1) as f64) };
        let mut here = fixed(leaves_first).clamp(least, most);
        set_middles(self.row_mut(first_row), fixed(low.x), here);
        for row in self.between(first_row, last_row) {
            let leaves = here.wrapping_add(step).clamp(least, most);
            set_middles(row, here, leaves);
            here = leaves;
        }
        set_middles(self.row_mut(last_row), here, fixed(high.x));
    }

    fn row_mut(&mut self, row: usize) -> &mut [u64] {
        self.words.get_mut(row * self.n_words..(row + 1) * self.n_words).unwrap_or_default()
    }

    /// The rows between two, without them.
    fn between(&mut self, first: usize, last: usize) -> impl Iterator<Item = &mut [u64]> {
        let rows = self.words.get_mut((first + 1) * self.n_words..last * self.n_words);
        rows.unwrap_or_default().chunks_exact_mut(self.n_words.max(1))
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
        if first < end {
            set_bits(self.row_mut(row), first, end - 1);
        }
    }
}

/// Half a cell with 32 bits behind the point.
const HALF: i64 = 1 << 31;

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
mod tests;
