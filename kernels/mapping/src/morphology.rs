//! Shapes of occupied cells: grown, shrunk, closed, filled, told apart.
//!
//! All by the exact distance transform, with round elements measured between cells' centres, so that a
//! radius is a radius in every direction. What lies outside a grid is free.

use geometry::Point2;

use crate::distance::squared_distance_cells;
use crate::grid::{Cell, Grid, GridError, Layout, Shape};

/// Every cell whose centre lies within `radius_m` of an occupied cell's centre.
#[must_use]
pub fn dilated(occupied: &Grid<bool>, radius_m: f64) -> Grid<bool> {
    let limit = squared_cells(occupied, radius_m);
    squared_distance_cells(occupied).map(|squared| *squared <= limit)
}

/// Every cell whose centre lies farther than `radius_m` from each free cell's centre inside the grid.
#[must_use]
pub fn eroded(occupied: &Grid<bool>, radius_m: f64) -> Grid<bool> {
    let limit = squared_cells(occupied, radius_m);
    squared_distance_cells(&occupied.map(|o| !o)).map(|squared| *squared > limit)
}

/// Dilated, then eroded: gaps and bays narrower than twice the radius are filled, and nothing is lost.
///
/// # Errors
/// [`GridError`] when the border that closing needs makes the grid too large.
pub fn closed(occupied: &Grid<bool>, radius_m: f64) -> Result<Grid<bool>, GridError> {
    let layout = *occupied.layout();
    let n_border = (radius_m.max(0.0) / layout.resolution_m).ceil() as usize + 2;
    let wide = padded(occupied, n_border)?;
    let closed = eroded(&dilated(&wide, radius_m), radius_m);
    let cut = |cell: Cell| *closed.get(Cell { col: cell.col + n_border, row: cell.row + n_border });
    Grid::from_values(layout, layout.cells().map(cut).collect())
}

/// The same with `n_border` free cells more on each side.
///
/// # Errors
/// [`GridError`] when the grid becomes too large.
pub fn padded(occupied: &Grid<bool>, n_border: usize) -> Result<Grid<bool>, GridError> {
    let layout = occupied.layout();
    let off_m = n_border as f64 * layout.resolution_m;
    let shape =
        Shape { n_cols: layout.shape.n_cols + 2 * n_border, n_rows: layout.shape.n_rows + 2 * n_border };
    let origin = Point2::new(layout.origin.x - off_m, layout.origin.y - off_m);
    let mut wide = Grid::filled(Layout::new(origin, layout.resolution_m, shape)?, false);
    for cell in layout.cells().filter(|&c| *occupied.get(c)) {
        wide.set(Cell { col: cell.col + n_border, row: cell.row + n_border }, true);
    }
    Ok(wide)
}

/// The same with every free cell filled from which no path of free cells, side by side, leads to the border.
#[must_use]
pub fn without_holes(occupied: &Grid<bool>) -> Grid<bool> {
    let layout = *occupied.layout();
    let Shape { n_cols, n_rows } = layout.shape;
    let mut filled = Grid::filled(layout, true);
    let mut open: Vec<Cell> = layout
        .cells()
        .filter(|c| c.col == 0 || c.row == 0 || c.col + 1 == n_cols || c.row + 1 == n_rows)
        .filter(|&c| !*occupied.get(c))
        .collect();
    for &cell in &open {
        filled.set(cell, false);
    }
    while let Some(cell) = open.pop() {
        for next in beside(layout.shape, cell) {
            if *filled.get(next) && !*occupied.get(next) {
                filled.set(next, false);
                open.push(next);
            }
        }
    }
    filled
}

/// Occupied cells in groups: two cells are of one group when a chain of occupied cells joins them whose
/// gaps, between squares, are at most `gap_m`. Groups in order of their first cell; the cost grows with
/// the occupied cells times the square of the gap.
#[must_use]
pub fn groups(occupied: &Grid<bool>, gap_m: f64) -> Vec<Vec<Cell>> {
    let layout = *occupied.layout();
    // Between the centres of two facing cells lies one cell more than the gap; corners that touch join too.
    let reach = (gap_m.max(0.0) / layout.resolution_m + 1.0).max(std::f64::consts::SQRT_2) + 1e-6;
    let n_reach = reach as i64;
    let offsets: Vec<(i64, i64)> = (-n_reach..=n_reach)
        .flat_map(|row| (-n_reach..=n_reach).map(move |col| (col, row)))
        .filter(|&(col, row)| (col as f64).hypot(row as f64) <= reach)
        .collect();
    let (n_cols, n_rows) = (layout.shape.n_cols as i64, layout.shape.n_rows as i64);
    let mut left = occupied.clone();
    let mut groups = Vec::new();
    for start in layout.cells() {
        if !*left.get(start) {
            continue;
        }
        left.set(start, false);
        let mut group = vec![start];
        let mut next = 0;
        while let Some(&cell) = group.get(next) {
            next += 1;
            for (col, row) in &offsets {
                let (col, row) = (cell.col as i64 + col, cell.row as i64 + row);
                if col < 0 || row < 0 || col >= n_cols || row >= n_rows {
                    continue;
                }
                let other = Cell { col: col as usize, row: row as usize };
                if *left.get(other) {
                    left.set(other, false);
                    group.push(other);
                }
            }
        }
        groups.push(group);
    }
    groups
}

fn squared_cells(grid: &Grid<bool>, radius_m: f64) -> f32 {
    let radius = radius_m.max(0.0) / grid.layout().resolution_m;
    // A hair more, so that a radius of whole cells holds the cells at exactly that distance.
    (radius * radius + 1e-6) as f32
}

/// The cells inside that share a side.
fn beside(shape: Shape, Cell { col, row }: Cell) -> impl Iterator<Item = Cell> {
    let all = [
        (col > 0).then(|| Cell { col: col - 1, row }),
        (col + 1 < shape.n_cols).then(|| Cell { col: col + 1, row }),
        (row > 0).then(|| Cell { col, row: row - 1 }),
        (row + 1 < shape.n_rows).then(|| Cell { col, row: row + 1 }),
    ];
    all.into_iter().flatten()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const RESOLUTION_M: f64 = 0.1;

    fn any_grid() -> impl Strategy<Value = Grid<bool>> {
        (2..20_usize, 2..20_usize).prop_flat_map(|(n_cols, n_rows)| {
            let layout = Layout::new(Point2::origin(), RESOLUTION_M, Shape { n_cols, n_rows }).unwrap();
            prop::collection::vec(prop::bool::weighted(0.15), n_cols * n_rows)
                .prop_map(move |values| Grid::from_values(layout, values).unwrap())
        })
    }

    fn holds(outer: &Grid<bool>, inner: &Grid<bool>) -> bool {
        outer.values().iter().zip(inner.values()).all(|(outer, inner)| *outer || !*inner)
    }

    fn picture(rows: &[&str]) -> Grid<bool> {
        let shape = Shape { n_cols: rows[0].len(), n_rows: rows.len() };
        let layout = Layout::new(Point2::origin(), RESOLUTION_M, shape).unwrap();
        Grid::from_values(layout, rows.concat().chars().map(|c| c == '#').collect()).unwrap()
    }

    proptest! {
        #[test]
        fn closing_loses_nothing_and_does_nothing_twice(grid in any_grid(), radius_m in 0.0..0.5) {
            let once = closed(&grid, radius_m).unwrap();
            prop_assert!(holds(&once, &grid));
            prop_assert_eq!(closed(&once, radius_m).unwrap(), once);
        }

        #[test]
        fn a_wider_closing_that_is_the_double_holds_the_narrower(grid in any_grid()) {
            // Digital discs are not sums of smaller ones; a factor of two and a cell is ample.
            let (narrow, wide) = (closed(&grid, 0.1).unwrap(), closed(&grid, 0.4).unwrap());
            prop_assert!(holds(&wide, &narrow));
        }

        #[test]
        fn dilation_agrees_with_brute_force(grid in any_grid(), radius_m in 0.0..0.5) {
            let grown = dilated(&grid, radius_m);
            for cell in grid.layout().cells() {
                let near = grid.layout().cells().any(|other| {
                    *grid.get(other)
                        && (grid.layout().centre(other) - grid.layout().centre(cell)).norm() <= radius_m + 1e-7
                });
                prop_assert_eq!(*grown.get(cell), near);
            }
        }

        #[test]
        fn groups_are_a_partition(grid in any_grid(), gap_m in 0.0..0.4) {
            let groups = groups(&grid, gap_m);
            let n: usize = groups.iter().map(Vec::len).sum();
            prop_assert_eq!(n, grid.values().iter().filter(|o| **o).count());
            let all: std::collections::HashSet<_> = groups.iter().flatten().collect();
            prop_assert_eq!(all.len(), n);
        }
    }

    #[test]
    fn holes_are_filled_and_bays_are_not() {
        let found = without_holes(&picture(&["#####", "#.#..", "#.#..", "#####"]));
        assert_eq!(found, picture(&["#####", "###..", "###..", "#####"]));
        // A hole that is open only across a corner is a hole.
        let found = without_holes(&picture(&["...#.", ".#.#.", "#.#..", ".#..."]));
        assert_eq!(found, picture(&["...#.", ".#.#.", "###..", ".#..."]));
    }

    #[test]
    fn what_is_farther_apart_than_the_gap_is_two() {
        let grid = picture(&["##...##", "##...##"]);
        assert_eq!(groups(&grid, 0.15).len(), 2);
        assert_eq!(groups(&grid, 0.35).len(), 1);
    }
}
