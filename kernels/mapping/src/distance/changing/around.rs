//! What cells that have to be measured anew can be nearest to: how much of the grid is to be looked at for them.
//!
//! Beside a stretch of them the distances are known, and what is nearest along a row never goes back: nothing beyond
//! what is nearest to its neighbours is nearest to any of them, and none is farther from all than from there.

use std::ops::Range;

use super::super::Scale;
use super::Change;
use super::reached::Stretch;
use crate::field::DistanceField;
use crate::grid::Grid;

/// Measuring a cell anew costs so many times what it costs among all.
const TIMES_ANEW: usize = 4;
/// Columns of a change that a cell that comes nearer is measured to at what it costs among all.
const N_COLS_AT_ONCE: usize = 64;

/// The part of a grid that a change asks for.
#[derive(Debug)]
pub(super) struct Around {
    /// Rows that it touches.
    pub(super) rows: Range<usize>,
    /// Where there is anything that touched cells to be measured anew can be nearest to; no columns without such.
    pub(super) cols: Range<usize>,
    pub(super) sources: Range<usize>,
    /// Whether there are any others.
    pub(super) has_nearing: bool,
    /// Whether the whole grid may as well be measured.
    pub(super) is_dearer_than_all: bool,
}

impl Around {
    /// Finds what in each stretch is to be measured anew, and what for.
    pub(super) fn new(
        occupied: &Grid<bool>,
        field: &DistanceField,
        scale: Scale,
        change: &Change,
        stretches: &mut [Stretch],
    ) -> Around {
        let shape = occupied.layout().shape;
        let mut around = Around {
            rows: shape.n_rows..0,
            cols: shape.n_cols..0,
            sources: shape.n_rows..0,
            has_nearing: false,
            is_dearer_than_all: false,
        };
        let (mut n_near, mut n_anew) = (0, 0);
        for stretch in stretches {
            let row = stretch.row;
            around.rows = hull(&around.rows, row..row + 1);
            let cells = row * shape.n_cols..(row + 1) * shape.n_cols;
            let known = Known {
                kinds: &occupied.values()[cells.clone()],
                values_m: &field.values_m()[cells],
                scale,
                kind: change.is_occupied,
            };
            stretch.anew = known.anew(&stretch.cols);
            stretch.has_nearing = known.has(!known.kind, &stretch.cols);
            around.has_nearing |= stretch.has_nearing;
            n_near += if stretch.has_nearing { stretch.cols.len() } else { 0 };
            n_anew += stretch.anew.len();
            if !stretch.anew.is_empty() {
                let (cols, off_rows) = known.nearest_within(&stretch.anew, shape.n_rows);
                around.cols = hull(&around.cols, cols);
                let sources = row.saturating_sub(off_rows)..(row + off_rows + 1).min(shape.n_rows);
                around.sources = hull(&around.sources, sources);
            }
        }
        let cost = TIMES_ANEW * n_anew + n_near * (1 + change.cols.len() / N_COLS_AT_ONCE);
        around.is_dearer_than_all = cost > shape.n_cells();
        around
    }
}

fn hull(a: &Range<usize>, b: Range<usize>) -> Range<usize> {
    a.start.min(b.start)..a.end.max(b.end)
}

/// A row of which cells outside a stretch are known.
struct Known<'a> {
    kinds: &'a [bool],
    values_m: &'a [f32],
    scale: Scale,
    /// The kind that is measured anew.
    kind: bool,
}

impl Known<'_> {
    /// Whether there are cells of a kind.
    fn has(&self, kind: bool, cols: &Range<usize>) -> bool {
        // Many at a time, until one is of it.
        let (chunks, rest) = self.kinds[cols.clone()].as_chunks::<32>();
        let any = |kinds: &[bool]| kinds.iter().fold(false, |any, own| any | (*own == kind));
        chunks.iter().any(|kinds| any(kinds)) || any(rest)
    }

    /// From the first to the last of the cells that are to be measured anew.
    fn anew(&self, cols: &Range<usize>) -> Range<usize> {
        let is_at_ends = self.kinds[cols.start] == self.kind && self.kinds[cols.end - 1] == self.kind;
        if is_at_ends {
            return cols.clone();
        }
        if !self.has(self.kind, cols) {
            return 0..0;
        }
        let kinds = &self.kinds[cols.clone()];
        let n_before = kinds.iter().take_while(|kind| **kind != self.kind).count();
        let n_after = kinds.iter().rev().take_while(|kind| **kind != self.kind).count();
        cols.start + n_before..cols.end - n_after
    }

    /// The columns that cells can be nearest to, and how many rows off at most.
    fn nearest_within(&self, anew: &Range<usize>, n_rows: usize) -> (Range<usize>, usize) {
        let n_cols = self.kinds.len();
        let left = anew.start.checked_sub(1).map(|col| (col, self.cells_to_others(col)));
        let right = (anew.end < n_cols).then(|| (anew.end, self.cells_to_others(anew.end)));
        let first = left.map_or(0, |(col, cells)| col.saturating_sub(cells));
        let end = right.map_or(n_cols, |(col, cells)| cells.saturating_add(col + 1).min(n_cols));
        let (n, left, right) = (anew.len(), left.map(|(_, cells)| cells), right.map(|(_, cells)| cells));
        let off_rows = match (left, right) {
            // None is farther than along the row from one of both, the nearer one.
            (Some(left), Some(right)) => left.saturating_add(right).saturating_add(n + 2) / 2,
            (Some(off), None) | (None, Some(off)) => off.saturating_add(n),
            (None, None) => n_rows,
        };
        (first..end, off_rows.min(n_rows))
    }

    /// How far the known cell at a column is from the other kind, cells, rounded up.
    fn cells_to_others(&self, col: usize) -> usize {
        if self.kinds[col] == self.kind {
            (self.scale.cells_of(self.values_m[col]) as usize).saturating_add(2)
        } else {
            0
        }
    }
}
