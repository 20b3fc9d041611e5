//! Exact distance transforms of occupancy, and the conservative signed field made of them.
//!
//! Both signs come from one pass: every cell gets its squared distance to the nearest cell of the *other*
//! kind, and its own kind gives the sign. In a row, a run of equal cells is closed off by its two
//! neighbours of the other kind, at distance zero, so that each run is solved on its own, over columns'
//! distances: by a sweep to both sides where the other kind is near ([`sweep`]), else by the lower envelope of
//! parabolas of Felzenszwalb & Huttenlocher, Theory of Computing 8 (2012) ([`envelope`]). Linear in the number of
//! cells, exact up to the rounding of the final `f32`.

use crate::field::{CONSERVATIVE_CELLS, DistanceField};
use crate::grid::{Grid, Layout, Shape};

mod changing;
mod envelope;
mod sweep;

pub use changing::ChangingField;
use envelope::Envelope;
use sweep::Sweep;

/// A column that holds no cell of the other kind. Sums with it saturate.
const NONE: u16 = u16::MAX;

/// Squared distance from each cell's centre to the nearest occupied cell's centre, in cells².
///
/// Same layout as `occupied`; zero in occupied cells; `f32::INFINITY` throughout when nothing is
/// occupied.
#[must_use]
pub fn squared_distance_cells(occupied: &Grid<bool>) -> Grid<f32> {
    let mut result = occupied.map(|_| 0.0_f32);
    transform(occupied, |row, squared| {
        let begin = row * occupied.layout().shape.n_cols;
        let kinds = &occupied.values()[begin..begin + squared.len()];
        let out = &mut result.values_mut()[begin..begin + squared.len()];
        for ((out, &squared), &is_occupied) in out.iter_mut().zip(squared).zip(kinds) {
            *out = if is_occupied { 0.0 } else { squared };
        }
    });
    result
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
    let scale = Scale::new(&layout);
    let mut values_m = vec![0.0_f32; layout.shape.n_cells()];
    transform(occupied, |row, squared| {
        let begin = row * layout.shape.n_cols;
        let kinds = &occupied.values()[begin..begin + squared.len()];
        let out = &mut values_m[begin..begin + squared.len()];
        for ((out, &squared), &is_occupied) in out.iter_mut().zip(squared).zip(kinds) {
            *out = scale.signed_m(squared, is_occupied);
        }
    });
    DistanceField::from_clamped(layout, values_m)
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

/// Calls `emit(row, squared)` for each row, with each cell's squared distance to the other kind, cells².
fn transform(occupied: &Grid<bool>, mut emit: impl FnMut(usize, &[f32])) {
    let shape = occupied.layout().shape;
    let (n_cols, n_rows) = (shape.n_cols, shape.n_rows);
    let kinds = occupied.values();
    let downward = distances_from_below(kinds, n_cols, n_rows);
    let (mut sweep, mut envelope) = (Sweep::new(n_cols), Envelope::new(n_cols));
    // The sweep from above goes along with the rows' envelopes: each row is touched while it is in cache.
    let mut from_above = vec![NONE; n_cols];
    let mut nearest = vec![NONE; n_cols];
    let mut squared = vec![f32::INFINITY; n_cols];
    for row in (0..n_rows).rev() {
        let begin = row * n_cols;
        let here = &kinds[begin..begin + n_cols];
        if row + 1 < n_rows {
            step(&mut from_above, here, &kinds[begin + n_cols..begin + 2 * n_cols]);
        }
        for ((nearest, &above), &below) in
            nearest.iter_mut().zip(&from_above).zip(&downward[begin..begin + n_cols])
        {
            *nearest = above.min(below);
        }
        sweep.load(here, &nearest);
        let mut first = 0;
        for run in here.chunk_by(|a, b| a == b) {
            let place = first..first + run.len();
            if !sweep.solve_run(place.clone(), run.first() == Some(&true), &mut squared) {
                envelope.solve_run(first, run.len(), &nearest, &mut squared);
            }
            first = place.end;
        }
        emit(row, &squared);
    }
}

/// For each cell, how many rows away the nearest cell of the other kind is in its column.
fn transform_columns(occupied: &Grid<bool>) -> Vec<u16> {
    let Shape { n_cols, n_rows } = occupied.layout().shape;
    let kinds = occupied.values();
    let mut distances = distances_from_below(kinds, n_cols, n_rows);
    let mut from_above = vec![NONE; n_cols];
    for row in (0..n_rows.saturating_sub(1)).rev() {
        let begin = row * n_cols;
        step(&mut from_above, &kinds[begin..begin + n_cols], &kinds[begin + n_cols..begin + 2 * n_cols]);
        for (distance, above) in distances[begin..begin + n_cols].iter_mut().zip(&from_above) {
            *distance = (*above).min(*distance);
        }
    }
    distances
}

/// For each cell, how many rows below it the nearest cell of the other kind is in its column.
fn distances_from_below(kinds: &[bool], n_cols: usize, n_rows: usize) -> Vec<u16> {
    let mut distances = vec![NONE; kinds.len()];
    for row in 1..n_rows {
        let (done, open) = distances.split_at_mut(row * n_cols);
        let (before, here) = kinds[(row - 1) * n_cols..].split_at(n_cols);
        let open = &mut open[..n_cols];
        open.copy_from_slice(&done[(row - 1) * n_cols..]);
        step(open, &here[..n_cols], before);
    }
    distances
}

/// Carries columns' distances one row on: one more within a kind, one across a border.
fn step(distances: &mut [u16], here: &[bool], before: &[bool]) {
    for ((distance, here), before) in distances.iter_mut().zip(here).zip(before) {
        *distance = if here == before { distance.saturating_add(1) } else { 1 };
    }
}

#[cfg(test)]
mod tests;
