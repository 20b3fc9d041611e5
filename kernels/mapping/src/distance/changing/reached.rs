//! Which cells a change may touch: those that are no nearer to the other kind than to the change.
//!
//! Distances cannot grow faster than the way, so all cells on the straight way to it are such cells as well: they hang
//! together around it.

use std::ops::Range;

use super::super::Scale;
use super::Change;
use crate::field::DistanceField;

/// Cells by which a distance that was read back from a field may be off, and by which ways over cells are
/// longer than straight ones.
const SLACK_CELLS: f32 = 1.5;

/// Cells of a row that a change may touch.
#[derive(Clone, Debug)]
pub(super) struct Stretch {
    pub(super) row: usize,
    pub(super) cols: Range<usize>,
    /// Those among them that are to be measured anew, and others maybe.
    pub(super) anew: Range<usize>,
    /// Whether there are others.
    pub(super) has_nearing: bool,
}

/// Writes the stretches that a change may touch, by what the field was before it.
pub(super) fn reached(field: &DistanceField, scale: Scale, change: &Change, stretches: &mut Vec<Stretch>) {
    stretches.clear();
    let shape = field.layout().shape;
    let mut take = |row: usize, begin: &Range<usize>, off_rows: usize| {
        let values_m = &field.values_m()[row * shape.n_cols..(row + 1) * shape.n_cols];
        let reach =
            Reach { values_m, scale, change: &change.cols, off_rows_squared: (off_rows as f32).powi(2) };
        let cols = if off_rows == 0 { Some(reach.grown(begin)) } else { reach.shrunk(begin) }?;
        stretches.push(Stretch { row, cols: cols.clone(), anew: 0..0, has_nearing: false });
        Some(cols)
    };
    for row in change.rows.clone() {
        take(row, &change.cols, 0);
    }
    // Row by row away from the change, each no wider than the one before and what goes on from there.
    let mut cols = change.cols.clone();
    for (row, off) in (change.rows.end..shape.n_rows).zip(1..) {
        let Some(next) = take(row, &cols, off) else { break };
        cols = next;
    }
    let mut cols = change.cols.clone();
    for (row, off) in (0..change.rows.start).rev().zip(1..) {
        let Some(next) = take(row, &cols, off) else { break };
        cols = next;
    }
}

/// How far a change reaches in a row.
struct Reach<'a> {
    values_m: &'a [f32],
    scale: Scale,
    /// The columns that it lies in.
    change: &'a Range<usize>,
    /// Rows to it, squared.
    off_rows_squared: f32,
}

impl Reach<'_> {
    fn is_touched(&self, col: usize) -> bool {
        let off = self.change.start.saturating_sub(col).max((col + 1).saturating_sub(self.change.end)) as f32;
        let cells = self.scale.cells_of(self.values_m[col]) + SLACK_CELLS;
        cells * cells >= off * off + self.off_rows_squared
    }

    /// From cells that are touched as far to both sides as others are.
    fn grown(&self, cols: &Range<usize>) -> Range<usize> {
        self.start(cols.start)..self.end(cols.end)
    }

    /// Without the cells at both ends that are not touched, those beside them looked at as well.
    fn shrunk(&self, cols: &Range<usize>) -> Option<Range<usize>> {
        let (grown, mut cols) = (self.grown(cols), cols.clone());
        if grown.start == cols.start {
            while cols.start < grown.end && !self.is_touched(cols.start) {
                cols.start += 1;
            }
        } else {
            cols.start = grown.start;
        }
        if grown.end == cols.end {
            while cols.start < cols.end && !self.is_touched(cols.end - 1) {
                cols.end -= 1;
            }
        } else {
            cols.end = grown.end;
        }
        (cols.start < cols.end).then_some(cols)
    }

    /// The first of the cells before one that are touched all the way.
    fn start(&self, col: usize) -> usize {
        (0..col).rev().take_while(|col| self.is_touched(*col)).last().unwrap_or(col)
    }

    /// One past the last of the cells from one on that are touched all the way.
    fn end(&self, col: usize) -> usize {
        (col..self.values_m.len()).take_while(|col| self.is_touched(*col)).last().map_or(col, |last| last + 1)
    }
}
