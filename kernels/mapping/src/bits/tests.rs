//! Lines against what they pass, cell by cell.

use proptest::prelude::*;

use super::*;

const N_ROWS: usize = 150;

fn points() -> impl Strategy<Value = (Point2, Point2)> {
    let along = || prop_oneof![0.0..149.99_f64, (0..150_u8).prop_map(f64::from)];
    (along(), along(), along(), along()).prop_map(|(a, b, c, d)| (Point2::new(a, b), Point2::new(c, d)))
}

/// Length of a line inside a cell, cells.
fn inside(from: Point2, to: Point2, col: usize, row: usize) -> f64 {
    let (mut begin, mut end) = (0.0_f64, 1.0_f64);
    for (at, way, low) in [(from.x, to.x - from.x, col as f64), (from.y, to.y - from.y, row as f64)] {
        if way == 0.0 {
            if !(low..low + 1.0).contains(&at) {
                return -1.0;
            }
        } else {
            let (a, b) = ((low - at) / way, (low + 1.0 - at) / way);
            (begin, end) = (begin.max(a.min(b)), end.min(a.max(b)));
        }
    }
    (end - begin) * (to - from).norm()
}

proptest! {
    #[test]
    fn a_line_sets_what_it_passes_but_for_its_last_cell_and_nothing_else((from, to) in points()) {
        let mut bits = BitGrid::new(3, N_ROWS);
        bits.pass(from, to);
        for row in 0..N_ROWS {
            for col in 0..3 * N_WORD {
                let is_last = (col, row) == (to.x as usize, to.y as usize);
                let inside_cells = inside(from, to, col, row);
                if is_last || inside_cells < -1e-6 {
                    prop_assert!(!bits.is_set(col, row), "{col} {row} is not passed");
                } else if inside_cells > 1e-6 {
                    prop_assert!(bits.is_set(col, row), "{col} {row} is passed by {inside_cells}");
                }
            }
        }
    }

    #[test]
    fn of_what_a_line_passes_one_cell_is_set_in_each_row_or_column((from, to) in points()) {
        let mut bits = BitGrid::new(3, N_ROWS);
        bits.pass_middles(from, to);
        let (mut n_in_row, mut n_in_col) = ([0; N_ROWS], [0; 3 * N_WORD]);
        for (row, n_in_row) in n_in_row.iter_mut().enumerate() {
            for (col, n_in_col) in n_in_col.iter_mut().enumerate().filter(|(col, _)| bits.is_set(*col, row)) {
                *n_in_row += 1;
                *n_in_col += 1;
                prop_assert!(inside(from, to, col, row) > -1e-6, "{col} {row} is not passed");
            }
        }
        if (to.x - from.x).abs() <= (to.y - from.y).abs() {
            let rows = from.y.min(to.y) as usize..=from.y.max(to.y) as usize;
            prop_assert!((0..N_ROWS).all(|row| n_in_row[row] == i32::from(rows.contains(&row))));
        } else {
            // Without the columns of the ends, whose middles the line may not reach.
            let cols = from.x.min(to.x) as usize + 1..from.x.max(to.x) as usize;
            prop_assert!(cols.into_iter().all(|col| n_in_col[col] == 1));
        }
    }

    #[test]
    fn growing_moves_bits_with_their_grid((from, to) in points(), word in 0..3_usize, row in 0..9_usize) {
        let mut bits = BitGrid::new(3, N_ROWS);
        bits.pass(from, to);
        let before = bits.clone();
        bits.grow(6, N_ROWS + 9, [word, row]);
        for y in 0..N_ROWS {
            for x in 0..3 * N_WORD {
                prop_assert_eq!(before.is_set(x, y), bits.is_set(x + word * N_WORD, y + row));
            }
        }
        let n_set = |bits: &BitGrid| bits.rows().flatten().map(|w| w.count_ones()).sum::<u32>();
        prop_assert_eq!(n_set(&before), n_set(&bits));
    }
}

#[test]
fn lines_that_leave_the_grid_or_are_none_set_nothing() {
    let mut bits = BitGrid::new(1, 10);
    for to in [Point2::new(64.0, 3.0), Point2::new(3.0, -0.1), Point2::new(f64::NAN, 3.0)] {
        bits.pass(Point2::new(1.0, 1.0), to);
        bits.pass_middles(Point2::new(1.0, 1.0), to);
    }
    assert!(bits.rows().flatten().all(|word| *word == 0));
}

#[test]
fn a_cell_is_set_and_cleared() {
    let mut bits = BitGrid::new(2, 4);
    bits.set(100, 2);
    assert!(bits.is_set(100, 2) && !bits.is_set(100, 1) && !bits.is_set(200, 2));
    bits.clear(100, 2);
    assert!(!bits.is_set(100, 2));
}
