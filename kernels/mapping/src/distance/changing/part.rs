//! Distances within columns for a part of a grid, for one kind of cells.

use std::ops::Range;

use super::super::NONE;
use crate::grid::Grid;
use crate::isa::{Isa, Work};

/// Columns at a time.
const N_CHUNK: usize = 32;

/// How far cells are from the nearest one of a kind in their column; kept to be used again.
#[derive(Clone, Debug, Default)]
pub(super) struct PartColumns {
    cols: Range<usize>,
    rows: Range<usize>,
    /// By row and column of the part.
    distances: Vec<u16>,
}

impl PartColumns {
    /// Measures cells in these columns and rows to the nearest one of `kind` that lies in the rows `sources`.
    pub(super) fn measure(
        &mut self,
        isa: Isa,
        occupied: &Grid<bool>,
        kind: bool,
        (cols, rows, sources): (Range<usize>, Range<usize>, Range<usize>),
    ) {
        let n_cols = occupied.layout().shape.n_cols;
        // In whole chunks, where the grid is as wide.
        let n = cols.len().next_multiple_of(N_CHUNK).min(n_cols);
        let start = cols.start.min(n_cols - n);
        (self.cols, self.rows) = (start..start + n, rows);
        self.distances.resize(n * self.rows.len(), NONE);
        isa.run(Measure {
            kinds: (occupied.values(), n_cols, kind),
            part: (self.cols.clone(), self.rows.clone()),
            sources,
            distances: &mut self.distances,
        });
    }

    /// The distances of cells in a row.
    pub(super) fn row(&self, row: usize, cols: Range<usize>) -> &[u16] {
        let begin = (row - self.rows.start) * self.cols.len();
        &self.distances[begin + cols.start - self.cols.start..begin + cols.end - self.cols.start]
    }
}

struct Measure<'a> {
    /// What is occupied, in how many columns, and which kind is measured to.
    kinds: (&'a [bool], usize, bool),
    /// Columns and rows.
    part: (Range<usize>, Range<usize>),
    sources: Range<usize>,
    distances: &'a mut [u16],
}

impl Measure<'_> {
    /// Measures `N` columns: their distances stay in registers on the way.
    #[inline(always)]
    fn columns<const N: usize>(&mut self, col: usize) {
        let ((cols, rows), sources) = (self.part.clone(), self.sources.clone());
        let mut carried = [NONE; N];
        for row in sources.start.min(rows.start)..rows.end {
            carried = self.carried(carried, row, col);
            if row >= rows.start
                && let Some(distances) =
                    self.distances[(row - rows.start) * cols.len() + col..].first_chunk_mut()
            {
                *distances = carried;
            }
        }
        let mut carried = [NONE; N];
        for row in (rows.start..sources.end.max(rows.end)).rev() {
            carried = self.carried(carried, row, col);
            if row < rows.end
                && let Some(distances) =
                    self.distances[(row - rows.start) * cols.len() + col..].first_chunk_mut::<N>()
            {
                for (distance, other) in distances.iter_mut().zip(carried) {
                    *distance = other.min(*distance);
                }
            }
        }
    }

    /// The distances of a row, by those of the row before.
    #[inline(always)]
    fn carried<const N: usize>(&self, mut before: [u16; N], row: usize, col: usize) -> [u16; N] {
        let (all, n_cols, kind) = self.kinds;
        before.iter_mut().for_each(|distance| *distance = distance.saturating_add(1));
        if self.sources.contains(&row)
            && let Some(kinds) = all[row * n_cols + self.part.0.start + col..].first_chunk::<N>()
        {
            for (distance, other) in before.iter_mut().zip(kinds) {
                *distance = if *other == kind { 0 } else { *distance };
            }
        }
        before
    }
}

impl Work for Measure<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(mut self) {
        let n = self.part.0.len();
        let in_chunks = n - n % N_CHUNK;
        for col in (0..in_chunks).step_by(N_CHUNK) {
            self.columns::<N_CHUNK>(col);
        }
        for col in in_chunks..n {
            self.columns::<1>(col);
        }
    }
}
