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
    fn it_agrees_with_brute_force_on_wide_floors(
        (n_cols, n_rows) in (1..1300_usize, 1..5_usize),
        sites in prop::collection::vec((0..1300_usize, 0..5_usize), 0..5),
    ) {
        let layout = Layout::new(Point2::origin(), 0.1, Shape { n_cols, n_rows }).unwrap();
        let is_site = |cell: crate::grid::Cell| sites.contains(&(cell.col, cell.row));
        let grid = Grid::from_values(layout, layout.cells().map(is_site).collect()).unwrap();
        let found = squared_distance_cells(&grid);
        prop_assert_eq!(found.values(), &squared_distance_by_search(&grid)[..]);
        // And to the free cells, where all is the other way round.
        let inverse = grid.map(|occupied| !occupied);
        let depth = signed_distance(&inverse);
        for (value_m, squared) in depth.values_m().iter().zip(found.values()) {
            let wanted_m = 0.05 - 0.1 * squared.sqrt() - 0.036;
            prop_assert!(*squared == 0.0 || (value_m - wanted_m.max(-1000.0)).abs() < 1e-4, "{value_m} {wanted_m}");
        }
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
        // Within obstacles it stays below zero, and on the ridge of a wall an even number of cells thick, where no
        // cell has its centre, it may be half a cell too shallow, less what is taken from it everywhere.
        let ridge_m = if true_m < 0.0 { (0.5 - CONSERVATIVE_CELLS) * grid.layout().resolution_m } else { 0.0 };
        let most_m = if true_m < 0.0 { (true_m + ridge_m).min(0.0) } else { true_m };
        prop_assert!(sampled_m <= most_m + 1e-6, "field {sampled_m} m, truth {true_m} m at {p}");
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
