//! Marking every cell that a shape *touches*.
//!
//! Sampling cells at their centres loses walls thinner than a cell; here a cell counts as soon as its closed
//! square meets the shape, up to a nanometre on the safe side. Parts outside the grid are left out. A
//! shape that is not finite could be anywhere, and marks everything.

use geometry::{Point2, Polygon};

use crate::grid::Grid;

/// Slack, cells, that makes rounding err towards touching.
const SLACK_CELLS: f64 = 1e-8;

/// Marks every cell that the segment from `from` to `to` touches. Same frame as the grid.
pub fn mark_segment(grid: &mut Grid<bool>, from: Point2, to: Point2) {
    let (Some(a), Some(b)) = (in_cells(grid, from), in_cells(grid, to)) else {
        grid.values_mut().fill(true);
        return;
    };
    let (low, high) = if a.y <= b.y { (a, b) } else { (b, a) };
    for row in touched(low.y, high.y, grid.layout().shape.n_rows) {
        // The part of the segment inside this row's band, as shares of its length.
        let rise = high.y - low.y;
        let share = |y: f64| if rise > 0.0 { ((y - low.y) / rise).clamp(0.0, 1.0) } else { 0.0 };
        let (begin, end) = if rise > 0.0 {
            (share(row as f64 - SLACK_CELLS), share((row + 1) as f64 + SLACK_CELLS))
        } else {
            (0.0, 1.0)
        };
        let (x1, x2) = (low.x + begin * (high.x - low.x), low.x + end * (high.x - low.x));
        fill_row(grid, row, x1.min(x2), x1.max(x2));
    }
}

/// Marks every cell that the polygon, its inside included, touches. Same frame as the grid.
pub fn mark_polygon(grid: &mut Grid<bool>, polygon: &Polygon) {
    for (from, to) in polygon.edges() {
        mark_segment(grid, from, to);
    }
    // What no edge touches lies inside or outside as a whole: its centre decides.
    let layout = *grid.layout();
    let mut crossings = Vec::new();
    for row in 0..layout.shape.n_rows {
        let y = layout.origin.y + (row as f64 + 0.5) * layout.resolution_m;
        crossings.clear();
        for (a, b) in polygon.edges() {
            if (a.y > y) != (b.y > y) {
                let x = a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x);
                crossings.push((x - layout.origin.x) / layout.resolution_m);
            }
        }
        crossings.sort_by(f64::total_cmp);
        for pair in crossings.chunks_exact(2) {
            fill_row(grid, row, pair[0], pair[1]);
        }
    }
}

/// Marks every cell that the disc touches. Same frame as the grid; a negative radius is no disc.
pub fn mark_disc(grid: &mut Grid<bool>, centre: Point2, radius_m: f64) {
    let Some(c) = in_cells(grid, centre).filter(|_| radius_m.is_finite()) else {
        grid.values_mut().fill(true);
        return;
    };
    if radius_m < 0.0 {
        return;
    }
    let radius = radius_m / grid.layout().resolution_m + SLACK_CELLS;
    for row in touched(c.y - radius, c.y + radius, grid.layout().shape.n_rows) {
        let nearest_y = c.y.clamp(row as f64, (row + 1) as f64);
        let half = (radius * radius - (c.y - nearest_y).powi(2)).max(0.0).sqrt();
        fill_row(grid, row, c.x - half, c.x + half);
    }
}

/// Marks every cell that the axis-aligned box from `low` to `high` touches. Same frame as the grid.
pub fn mark_box(grid: &mut Grid<bool>, low: Point2, high: Point2) {
    let (Some(low), Some(high)) = (in_cells(grid, low), in_cells(grid, high)) else {
        grid.values_mut().fill(true);
        return;
    };
    if low.x > high.x {
        return;
    }
    for row in touched(low.y, high.y, grid.layout().shape.n_rows) {
        fill_row(grid, row, low.x, high.x);
    }
}

/// A point in units of cells from the grid's lower left corner; `None` when it is not finite.
fn in_cells(grid: &Grid<bool>, point: Point2) -> Option<Point2> {
    let cells = (point - grid.layout().origin) / grid.layout().resolution_m;
    (cells.x.is_finite() && cells.y.is_finite()).then_some(Point2::from(cells))
}

/// The cells of a line of `n` that the interval from `low` to `high` touches.
fn touched(low: f64, high: f64, n: usize) -> std::ops::Range<usize> {
    // A float cast saturates: negative is 0.
    let begin = ((low - SLACK_CELLS).floor().max(0.0) as usize).min(n);
    let end = if high < -SLACK_CELLS { 0 } else { ((high + SLACK_CELLS).floor() as usize).min(n - 1) + 1 };
    begin..end.max(begin)
}

fn fill_row(grid: &mut Grid<bool>, row: usize, low: f64, high: f64) {
    let n_cols = grid.layout().shape.n_cols;
    let cols = touched(low, high, n_cols);
    grid.values_mut()[row * n_cols..(row + 1) * n_cols][cols].fill(true);
}

#[cfg(test)]
mod tests {
    use geometry::polygon::segment_distance_m;
    use proptest::prelude::*;

    use super::*;
    use crate::grid::{Layout, Shape};

    const RESOLUTION_M: f64 = 0.1;

    fn empty() -> Grid<bool> {
        let shape = Shape { n_cols: 30, n_rows: 20 };
        Grid::filled(Layout::new(Point2::new(-1.0, 0.5), RESOLUTION_M, shape).unwrap(), false)
    }

    fn any_point() -> impl Strategy<Value = Point2> {
        (-1.5..2.5_f64, 0.0..3.0_f64).prop_map(|(x, y)| Point2::new(x, y))
    }

    proptest! {
        #[test]
        fn every_point_of_a_segment_lies_in_a_marked_cell(a in any_point(), b in any_point(), t in 0.0..1.0) {
            let mut grid = empty();
            mark_segment(&mut grid, a, b);
            prop_assert_ne!(grid.at(a + (b - a) * t), Some(&false));
        }

        #[test]
        fn no_cell_that_a_segment_misses_is_marked(a in any_point(), b in any_point()) {
            let mut grid = empty();
            mark_segment(&mut grid, a, b);
            for cell in grid.layout().cells().filter(|&c| *grid.get(c)) {
                let off_m = segment_distance_m(grid.layout().centre(cell), a, b);
                prop_assert!(off_m <= RESOLUTION_M * 0.5_f64.sqrt() + 1e-6);
            }
        }

        #[test]
        fn every_point_of_a_polygon_lies_in_a_marked_cell(
            a in any_point(), b in any_point(), c in any_point(), d in any_point(), p in any_point(),
        ) {
            let Ok(polygon) = Polygon::new(vec![a, b, c, d]) else { return Ok(()) };
            let mut grid = empty();
            mark_polygon(&mut grid, &polygon);
            if polygon.contains(p) {
                prop_assert_ne!(grid.at(p), Some(&false));
            }
            for cell in grid.layout().cells().filter(|&c| *grid.get(c)) {
                let off_m = polygon.signed_distance_m(grid.layout().centre(cell));
                prop_assert!(off_m <= RESOLUTION_M * 0.5_f64.sqrt() + 1e-6);
            }
        }

        #[test]
        fn a_disc_marks_exactly_the_squares_it_touches(c in any_point(), radius_m in 0.0..0.8) {
            let mut grid = empty();
            mark_disc(&mut grid, c, radius_m);
            for cell in grid.layout().cells() {
                let centre = grid.layout().centre(cell);
                let beyond = |d: f64| (d.abs() - RESOLUTION_M / 2.0).max(0.0);
                let off_m = beyond(c.x - centre.x).hypot(beyond(c.y - centre.y));
                if (off_m - radius_m).abs() > 1e-6 {
                    prop_assert_eq!(*grid.get(cell), off_m < radius_m);
                }
            }
        }
    }

    #[test]
    fn a_wall_on_the_line_between_two_rows_marks_both() {
        let mut grid = empty();
        mark_segment(&mut grid, Point2::new(0.0, 1.5), Point2::new(0.5, 1.5));
        assert_eq!(grid.at(Point2::new(0.25, 1.45)), Some(&true));
        assert_eq!(grid.at(Point2::new(0.25, 1.55)), Some(&true));
    }

    #[test]
    fn a_shape_that_is_not_finite_marks_everything() {
        let nan = Point2::new(f64::NAN, 0.0);
        let mut grid = empty();
        mark_segment(&mut grid, nan, Point2::origin());
        assert!(grid.values().iter().all(|v| *v));
        let mut grid = empty();
        mark_disc(&mut grid, Point2::origin(), f64::INFINITY);
        assert!(grid.values().iter().all(|v| *v));
    }
}
