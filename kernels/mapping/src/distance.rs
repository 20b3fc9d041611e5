//! Exact distance transforms of occupancy, and the conservative signed field made of them.
//!
//! Both signs come from one pass: every cell gets its squared distance to the nearest cell of the *other*
//! kind, and its own kind gives the sign. In a row, a run of equal cells is closed off by its two
//! neighbours of the other kind, at distance zero, so that each run is solved on its own: the lower
//! envelope of parabolas of Felzenszwalb & Huttenlocher, Theory of Computing 8 (2012), over columns'
//! distances. Linear in the number of cells, exact up to the rounding of the final `f32`.

use crate::field::{CONSERVATIVE_CELLS, DistanceField};
use crate::grid::Grid;

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

/// Signed distance to the squares of the occupied cells, metres, and never above it.
///
/// Outside EDT − h/2, inside −(EDT − h/2) for cells of side h, less [`CONSERVATIVE_CELLS`]·h everywhere,
/// so that the *bilinear* field nowhere exceeds the true distance. The plain difference of two
/// transforms would jump by 2h across the border. Nothing occupied: +1000 everywhere; nothing free:
/// −1000.
#[must_use]
pub fn signed_distance(occupied: &Grid<bool>) -> DistanceField {
    let layout = *occupied.layout();
    let resolution_m = layout.resolution_m as f32;
    let less_m = (CONSERVATIVE_CELLS * layout.resolution_m) as f32;
    let half_m = resolution_m / 2.0;
    let mut values_m = vec![0.0_f32; layout.shape.n_cells()];
    transform(occupied, |row, squared| {
        let begin = row * layout.shape.n_cols;
        let kinds = &occupied.values()[begin..begin + squared.len()];
        let out = &mut values_m[begin..begin + squared.len()];
        for ((out, &squared), &is_occupied) in out.iter_mut().zip(squared).zip(kinds) {
            let beyond_border_m = squared.sqrt() * resolution_m - half_m;
            let signed_m = if is_occupied { -beyond_border_m } else { beyond_border_m };
            *out = (signed_m - less_m).clamp(-FAR_M, FAR_M);
        }
    });
    DistanceField::from_clamped(layout, values_m)
}

/// What a field says where there is nothing to be near to, metres.
const FAR_M: f32 = 1000.0;

/// Calls `emit(row, squared)` for each row, with each cell's squared distance to the other kind, cells².
fn transform(occupied: &Grid<bool>, mut emit: impl FnMut(usize, &[f32])) {
    let shape = occupied.layout().shape;
    let (n_cols, n_rows) = (shape.n_cols, shape.n_rows);
    let kinds = occupied.values();
    let downward = distances_from_below(kinds, n_cols, n_rows);
    let mut envelope = Envelope::new(n_cols);
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
        let mut first = 0;
        for run in here.chunk_by(|a, b| a == b) {
            envelope.solve_run(first, run.len(), &nearest, &mut squared);
            first += run.len();
        }
        emit(row, &squared);
    }
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

/// One parabola of an envelope.
#[derive(Clone, Copy)]
struct Parabola {
    /// Its column.
    col: i32,
    /// Its value there, cells².
    lift: i32,
    /// First column where it is the lowest.
    from: i32,
}

/// Scratch space for lower envelopes along rows.
struct Envelope {
    parabolas: Vec<Parabola>,
    /// 1 / 2n: a multiplication instead of a division for each intersection.
    half_inverse: Vec<f64>,
}

impl Envelope {
    fn new(n_cols: usize) -> Self {
        let half_inverse = (0..n_cols + 2).map(|n| 0.5 / n.max(1) as f64).collect();
        Envelope { parabolas: Vec::with_capacity(n_cols + 2), half_inverse }
    }

    /// Writes the squared distances of the run of equal cells that begins at `first`.
    fn solve_run(&mut self, first: usize, n: usize, nearest: &[u16], squared: &mut [f32]) {
        let end = first + n;
        let (is_closed_left, is_closed_right) = (first > 0, end < squared.len());
        if n <= 2 && is_closed_left && is_closed_right {
            // Every cell has the other kind beside it.
            squared[first..end].fill(1.0);
            return;
        }
        let run = (first as i32, end as i32);
        self.parabolas.clear();
        if is_closed_left {
            self.push(run.0 - 1, 0, run);
        }
        for (col, &rows) in (run.0..).zip(&nearest[first..end]) {
            if rows != NONE {
                self.push(col, i32::from(rows) * i32::from(rows), run);
            }
        }
        if is_closed_right {
            self.push(run.1, 0, run);
        }
        self.write(run, squared);
    }

    /// Adds a parabola to the right of all others, unless it is nowhere lowest in the run.
    #[inline]
    fn push(&mut self, col: i32, lift: i32, (first, end): (i32, i32)) {
        let mut from = first;
        while let Some(last) = self.parabolas.last() {
            let (off, last_off) = (last.from - col, last.from - last.col);
            if off * off + lift > last_off * last_off + last.lift {
                // The last one keeps its beginning. Exact: a crossing that is not a whole number is at
                // least 1/2n away from one, far more than f64 rounds; at a whole number both parabolas
                // are equal and either may have the column. It lies right of the beginning, so it is
                // positive and rounds down by truncation.
                let rise = (lift - last.lift) + (col + last.col) * (col - last.col);
                from = (f64::from(rise) * self.half_inverse[(col - last.col) as usize]) as i32 + 1;
                break;
            }
            self.parabolas.pop();
        }
        if from < end {
            self.parabolas.push(Parabola { col, lift, from });
        }
    }

    /// Evaluates the envelope over the run.
    fn write(&self, (first, end): (i32, i32), squared: &mut [f32]) {
        let mut rest = &mut squared[first as usize..end as usize];
        if self.parabolas.is_empty() {
            rest.fill(f32::INFINITY);
            return;
        }
        for (idx, parabola) in self.parabolas.iter().enumerate() {
            let until = self.parabolas.get(idx + 1).map_or(end, |next| next.from);
            let (own, after) = rest.split_at_mut((until - parabola.from) as usize);
            let off = parabola.from - parabola.col;
            // (off + 1)² = off² + (2·off + 1): no product, and none that a check could keep from the
            // inner loop. All stay below 2³¹ for the largest grid.
            let (mut value, mut rise) = (off * off + parabola.lift, 2 * off + 1);
            for out in own {
                *out = value as f32;
                value = value.wrapping_add(rise);
                rise += 2;
            }
            rest = after;
        }
    }
}

#[cfg(test)]
mod tests {
    use geometry::Point2;
    use proptest::prelude::*;

    use super::*;
    use crate::grid::{Layout, Shape};

    fn any_grid(density: f64) -> impl Strategy<Value = Grid<bool>> {
        (1..24_usize, 1..24_usize).prop_flat_map(move |(n_cols, n_rows)| {
            let layout = Layout::new(Point2::new(-0.4, 0.3), 0.1, Shape { n_cols, n_rows }).unwrap();
            prop::collection::vec(prop::bool::weighted(density), n_cols * n_rows)
                .prop_map(move |values| Grid::from_values(layout, values).unwrap())
        })
    }

    /// The slow, obvious version.
    fn squared_distance_by_search(occupied: &Grid<bool>) -> Vec<f32> {
        let sites: Vec<_> = occupied.layout().cells().filter(|&c| *occupied.get(c)).collect();
        let squared = |a: usize, b: usize| (a as f32 - b as f32).powi(2);
        let nearest = |cell: crate::grid::Cell| {
            let all = sites.iter().map(|s| squared(s.col, cell.col) + squared(s.row, cell.row));
            all.fold(f32::INFINITY, f32::min)
        };
        occupied.layout().cells().map(nearest).collect()
    }

    /// Distance from a point to the nearest square of a given kind, metres.
    fn distance_to_squares_m(grid: &Grid<bool>, kind: bool, p: Point2) -> f64 {
        let half = grid.layout().resolution_m / 2.0;
        let cells = grid.layout().cells().filter(|&c| *grid.get(c) == kind);
        cells
            .map(|cell| {
                let c = grid.layout().centre(cell);
                ((p.x - c.x).abs() - half).max(0.0).hypot(((p.y - c.y).abs() - half).max(0.0))
            })
            .fold(f64::INFINITY, f64::min)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]

        #[test]
        fn it_agrees_with_brute_force(grid in any_grid(0.04)) {
            let found = squared_distance_cells(&grid);
            prop_assert_eq!(found.values(), &squared_distance_by_search(&grid)[..]);
        }

        #[test]
        fn it_agrees_with_brute_force_in_a_crowd(grid in any_grid(0.7)) {
            let found = squared_distance_cells(&grid);
            prop_assert_eq!(found.values(), &squared_distance_by_search(&grid)[..]);
        }

        #[test]
        fn the_field_is_never_above_the_true_distance(
            grid in any_grid(0.1), x in -0.2..1.2_f64, y in -0.2..1.2_f64,
        ) {
            let (low, high) = (grid.layout().origin, grid.layout().far_corner());
            let p = Point2::new(low.x + x * (high.x - low.x), low.y + y * (high.y - low.y));
            let outside_m = distance_to_squares_m(&grid, true, p);
            let inside_m = distance_to_squares_m(&grid, false, p);
            let true_m = if outside_m > 0.0 || inside_m.is_infinite() { outside_m } else { -inside_m };
            let sampled_m = signed_distance(&grid).sample(p);
            prop_assert!(sampled_m <= true_m + 1e-6, "field {sampled_m} m, truth {true_m} m at {p}");
        }

        #[test]
        fn the_field_is_not_needlessly_low(grid in any_grid(0.1), x in 0.0..1.0_f64, y in 0.0..1.0_f64) {
            let (low, high) = (grid.layout().origin, grid.layout().far_corner());
            let p = Point2::new(low.x + x * (high.x - low.x), low.y + y * (high.y - low.y));
            let outside_m = distance_to_squares_m(&grid, true, p);
            if outside_m > 0.0 && outside_m.is_finite() {
                prop_assert!(signed_distance(&grid).sample(p) >= outside_m - 1.7 * 0.1);
            }
        }
    }

    #[test]
    fn nothing_occupied_is_far_and_nothing_free_is_deep() {
        let layout = Layout::new(Point2::origin(), 0.05, Shape { n_cols: 7, n_rows: 3 }).unwrap();
        let empty = Grid::filled(layout, false);
        assert!(squared_distance_cells(&empty).values().iter().all(|v| *v == f32::INFINITY));
        assert!(signed_distance(&empty).values_m().iter().all(|v| *v == 1000.0));
        let full = Grid::filled(layout, true);
        assert!(squared_distance_cells(&full).values().iter().all(|v| *v == 0.0));
        assert!(signed_distance(&full).values_m().iter().all(|v| *v == -1000.0));
    }

    #[test]
    fn the_border_between_two_kinds_does_not_jump() {
        let layout = Layout::new(Point2::origin(), 0.1, Shape { n_cols: 10, n_rows: 1 }).unwrap();
        let grid = Grid::from_values(layout, (0..10).map(|col| col < 5).collect()).unwrap();
        let field = signed_distance(&grid);
        for pair in field.values_m().windows(2) {
            assert!((pair[1] - pair[0] - 0.1).abs() < 1e-6, "{pair:?}");
        }
    }

    #[test]
    fn a_distance_across_the_largest_grid_is_right() {
        let shape = Shape { n_cols: crate::grid::N_CELLS_SIDE_MAX, n_rows: 2 };
        let layout = Layout::new(Point2::origin(), 0.05, shape).unwrap();
        let mut grid = Grid::filled(layout, false);
        grid.set(crate::grid::Cell { col: 0, row: 0 }, true);
        let far = *squared_distance_cells(&grid).values().last().unwrap();
        assert!((far.sqrt() - 8191.0).abs() < 0.001);
    }
}
