//! Exact distance transforms of occupancy, and the conservative signed field made of them.
//!
//! Both signs come from one pass: every cell gets its squared distance to the nearest cell of the *other*
//! kind, and its own kind gives the sign. In a row, a run of equal cells is closed off by its two
//! neighbours of the other kind, at distance zero, so that each run is solved on its own, over columns'
//! distances: by a sweep to both sides where the other kind is near ([`sweep`]), else by the lower envelope of
//! parabolas of Felzenszwalb & Huttenlocher, Theory of Computing 8 (2012) ([`envelope`]). Linear in the number of
//! cells, exact up to the rounding of the final `f32`.

use std::ops::Range;

use crate::field::{CONSERVATIVE_CELLS, DistanceField};
use crate::grid::{Grid, Layout};
use crate::isa::{Isa, Work};

mod changing;
mod columns;
mod envelope;
mod sweep;

pub use changing::ChangingField;
use columns::{Nearer, Step, distances_along};
use envelope::Envelope;
use sweep::{Side, Sweep};

/// A column that holds no cell of the other kind. Sums with it saturate.
const NONE: u16 = u16::MAX;

/// Squared distance from each cell's centre to the nearest occupied cell's centre, in cells².
///
/// Same layout as `occupied`; zero in occupied cells; `f32::INFINITY` throughout when nothing is
/// occupied.
#[must_use]
pub fn squared_distance_cells(occupied: &Grid<bool>) -> Grid<f32> {
    let mut values = Vec::with_capacity(occupied.values().len());
    transform(occupied, Side::Free, |_, squared| values.extend_from_slice(squared));
    occupied.with_values(values)
}

/// Signed distance to the squares of the occupied cells, metres, and outside them never above it.
///
/// Within them it is negative, and never above it either but on the ridge of a wall that is an even number of cells
/// thick, where it may be too shallow by a fraction of a cell.
///
/// Outside EDT − h/2, inside −(EDT − h/2) for cells of side h, less [`CONSERVATIVE_CELLS`]·h everywhere,
/// so that the *bilinear* field nowhere exceeds the true distance. The plain difference of two
/// transforms would jump by 2h across the border. Nothing occupied: +1000 everywhere; nothing free:
/// −1000.
#[must_use]
pub fn signed_distance(occupied: &Grid<bool>) -> DistanceField {
    let layout = *occupied.layout();
    let (scale, isa) = (Scale::new(&layout), Isa::detect());
    let mut values_m = Vec::with_capacity(layout.shape.n_cells());
    transform(occupied, Side::Both, |occupied, values| {
        isa.run(Signed { scale, occupied, values });
        values_m.extend_from_slice(values);
    });
    DistanceField::from_clamped(layout, values_m)
}

/// From squared distances, cells², to a conservative field's values, metres.
struct Signed<'a> {
    scale: Scale,
    occupied: &'a [bool],
    values: &'a mut [f32],
}

impl Work for Signed<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        for (value, is_occupied) in self.values.iter_mut().zip(self.occupied) {
            *value = self.scale.signed_m(*value, *is_occupied);
        }
    }
}

/// What a field says where there is nothing to be near to, metres.
const FAR_M: f32 = 1000.0;

/// From squared distances in cells to the values of a conservative field, and back.
#[derive(Clone, Copy, Debug)]
struct Scale {
    resolution_m: f32,
    half_m: f32,
    less_m: f32,
}

impl Scale {
    fn new(layout: &Layout) -> Self {
        let resolution_m = layout.resolution_m as f32;
        let less_m = (CONSERVATIVE_CELLS * layout.resolution_m) as f32;
        Scale { resolution_m, half_m: resolution_m / 2.0, less_m }
    }

    /// The field's value at a cell, by its squared distance to the other kind.
    #[inline]
    fn signed_m(&self, squared: f32, is_occupied: bool) -> f32 {
        let beyond_border_m = squared.sqrt() * self.resolution_m - self.half_m;
        let signed_m = if is_occupied { -beyond_border_m } else { beyond_border_m };
        (signed_m - self.less_m).clamp(-FAR_M, FAR_M)
    }

    /// The distance to the other kind that a value came from, in cells; huge where there is none.
    #[inline]
    fn cells_of(&self, signed_m: f32) -> f32 {
        if signed_m.abs() >= FAR_M {
            f32::MAX
        } else {
            ((signed_m + self.less_m).abs() + self.half_m) / self.resolution_m
        }
    }
}

/// Calls `emit(occupied, squared)` for each row from the first on, with each cell's squared distance to the other
/// kind, cells².
fn transform(occupied: &Grid<bool>, side: Side, mut emit: impl FnMut(&[bool], &mut [f32])) {
    let n_cols = occupied.layout().shape.n_cols;
    let isa = Isa::detect();
    let rows = occupied.values().chunks_exact(n_cols);
    let above = distances_along(isa, rows.clone().rev(), n_cols);
    let mut solver = RowSolver::new(n_cols);
    // The way from below goes along with the rows: each is touched while it is in cache.
    let mut nearest = vec![NONE; n_cols];
    let mut below = vec![NONE; n_cols];
    let mut squared = vec![f32::INFINITY; n_cols];
    let mut before: Option<&[bool]> = None;
    for (here, above) in rows.zip(above.chunks_exact(n_cols).rev()) {
        if let Some(before) = before.replace(here) {
            isa.run(Step { distances: &mut below, here, before });
        }
        nearest.copy_from_slice(above);
        isa.run(Nearer { distances: &mut nearest, others: &below });
        solver.solve((here, &nearest), 0..n_cols, side, &mut squared);
        emit(here, &mut squared);
    }
}

/// Rows that go to the envelope at once after one that had to.
const N_ROWS_FAR: u32 = 8;

/// From distances in the columns to distances, row by row.
#[derive(Clone, Debug)]
struct RowSolver {
    sweep: Sweep,
    envelope: Envelope,
    /// Rows that are still left to the envelope.
    n_rows_far: u32,
}

impl RowSolver {
    fn new(n_cols: usize) -> Self {
        RowSolver { sweep: Sweep::new(n_cols), envelope: Envelope::new(n_cols), n_rows_far: 0 }
    }

    /// Writes the squared distances of the cells in `span` of a row, and of others maybe. It may be a part of a row, when
    /// nothing beyond can matter.
    fn solve(
        &mut self,
        (occupied, nearest): (&[bool], &[u16]),
        span: Range<usize>,
        side: Side,
        squared: &mut [f32],
    ) {
        let is_far = self.n_rows_far > 0;
        self.n_rows_far = self.n_rows_far.saturating_sub(1);
        if !is_far {
            self.sweep.load(occupied, nearest);
        }
        let mut col = span.start;
        while col < span.end {
            if !is_far {
                col = self.sweep.solve(col..span.end, occupied, side, squared);
                if col == span.end {
                    return;
                }
                self.n_rows_far = N_ROWS_FAR;
            }
            let kind = occupied[col];
            let first = col - occupied[..col].iter().rev().take_while(|other| **other == kind).count();
            col += occupied[col..].iter().take_while(|other| **other == kind).count();
            if side.is_of(kind) {
                self.envelope.solve_run(first, col - first, nearest, squared);
            } else {
                squared[first..col].fill(0.0);
            }
        }
    }
}

#[cfg(test)]
mod tests;
