use geometry::Point2;
use proptest::prelude::*;

use super::*;
use crate::grid::{Layout, Shape};

fn floor(n_cols: usize, n_rows: usize) -> Grid<bool> {
    let layout = Layout::new(Point2::new(-0.4, 0.3), 0.05, Shape { n_cols, n_rows }).unwrap();
    Grid::filled(layout, false)
}

/// Cells of a box, cut at the border of the grid or not.
fn cells_of(low: (usize, usize), size: (usize, usize)) -> impl Iterator<Item = Cell> {
    (low.1..low.1 + size.1).flat_map(move |row| (low.0..low.0 + size.0).map(move |col| Cell { col, row }))
}

/// Few cells on a wide floor: farther from each other than a sweep reaches.
fn any_wide_floor() -> impl Strategy<Value = Grid<bool>> {
    let cells = prop::collection::vec((0..1100_usize, 0..5_usize, 1..40_usize), 0..6);
    (1..1100_usize, 1..5_usize, cells).prop_map(|(n_cols, n_rows, cells)| {
        let mut grid = floor(n_cols, n_rows);
        for (col, row, width) in cells {
            let inside = (col..(col + width).min(n_cols)).map(|col| Cell { col, row });
            inside.filter(|_| row < n_rows).for_each(|cell| grid.set(cell, true));
        }
        grid
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn a_wide_floor_becomes_any_other(before in any_wide_floor(), now in any_wide_floor()) {
        let mut changing = ChangingField::new(before);
        // Cells of the other floor on this one's layout, then the other floor itself.
        let shape = changing.occupied().layout().shape;
        let (col, row) = (shape.n_cols / 2, shape.n_rows / 2);
        let own = changing.occupied().layout().cells().map(|cell| cell.col > col && cell.row >= row).collect();
        let mixed = Grid::from_values(*changing.occupied().layout(), own).unwrap();
        for floor in [mixed, now] {
            changing.update(floor.clone());
            prop_assert_eq!(changing.occupied(), &floor);
            let anew = signed_distance(&floor);
            prop_assert_eq!(changing.field().values_m(), anew.values_m());
        }
    }

    #[test]
    fn after_any_changes_it_is_the_field_of_what_is_occupied_now(
        (n_cols, n_rows) in (1..60_usize, 1..60_usize),
        boxes in prop::collection::vec(
            ((0..60_usize, 0..60_usize), (1..12_usize, 1..12_usize), prop::bool::weighted(0.7)), 1..12,
        ),
    ) {
        let mut changing = ChangingField::new(floor(n_cols, n_rows));
        for (low, size, is_occupied) in boxes {
            changing.change(cells_of(low, size).map(|cell| (cell, is_occupied)));
            let anew = signed_distance(changing.occupied());
            prop_assert_eq!(changing.field().values_m(), anew.values_m());
        }
    }

    #[test]
    fn things_that_come_and_go_in_a_room_change_it_as_far_as_they_matter(
        (n_cols, n_rows) in (90..420_usize, 90..420_usize),
        walls in prop::collection::vec((0..420_usize, any::<bool>()), 0..4),
        posts in prop::collection::vec((0..420_usize, 0..420_usize), 0..30),
        things in prop::collection::vec(((0..400_usize, 0..400_usize), (1..24_usize, 1..24_usize)), 1..4),
    ) {
        let mut before = floor(n_cols, n_rows);
        let of_wall = |(at, is_row): (usize, bool)| {
            let (low, size) = if is_row { ((0, at), (n_cols, 2)) } else { ((at, 0), (2, n_rows)) };
            cells_of(low, size)
        };
        let cells = walls.into_iter().flat_map(of_wall).chain(posts.into_iter().map(|(col, row)| Cell { col, row }));
        cells.filter(|cell| cell.col < n_cols && cell.row < n_rows).for_each(|cell| before.set(cell, true));
        let mut changing = ChangingField::new(before.clone());
        for (low, size) in &things {
            changing.change(cells_of(*low, *size).map(|cell| (cell, true)));
            let anew = signed_distance(changing.occupied());
            prop_assert_eq!(changing.field().values_m(), anew.values_m());
        }
        for (low, size) in &things {
            let cells = cells_of(*low, *size).filter(|cell| cell.col < n_cols && cell.row < n_rows);
            changing.change(cells.map(|cell| (cell, *before.get(cell))).collect::<Vec<_>>());
            let anew = signed_distance(changing.occupied());
            prop_assert_eq!(changing.field().values_m(), anew.values_m());
        }
        prop_assert_eq!(changing.occupied(), &before);
    }

    #[test]
    fn scattered_cells_change_it_as_well(
        crowd in prop::collection::vec(prop::bool::weighted(0.1), 40 * 30),
        flips in prop::collection::vec((0..40_usize, 0..30_usize, any::<bool>()), 1..40),
    ) {
        let layout = *floor(40, 30).layout();
        let mut changing = ChangingField::new(Grid::from_values(layout, crowd).unwrap());
        let n = changing.change(flips.iter().map(|(col, row, on)| (Cell { col: *col, row: *row }, *on)));
        prop_assert!(n <= flips.len());
        let anew = signed_distance(changing.occupied());
        prop_assert_eq!(changing.field().values_m(), anew.values_m());
    }
}

#[test]
fn what_does_not_change_costs_nothing_and_what_lies_outside_is_left_out() {
    let mut changing = ChangingField::new(floor(20, 20));
    assert_eq!(changing.change([(Cell { col: 3, row: 3 }, false), (Cell { col: 20, row: 0 }, true)]), 0);
    assert_eq!(changing.change([(Cell { col: 3, row: 3 }, true); 2]), 1);
}
