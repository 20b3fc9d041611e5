//! A signed distance field that is kept up as cells change: an object was moved, a few cells are new.
//!
//! Exact, like the whole transform, by what that is made of: each cell's distance to the other kind within its
//! column is kept. A change touches the columns' runs that it lies in, and the cells that are no nearer to
//! the other kind than to the change; distances cannot grow faster than the way, so these hang together around it.
//! The cost goes with their number, not with the grid's.

use super::columns::{Remeasure, rows_to_other_kind};
use super::sweep::{Side, Sweep};
use super::{DistanceField, NONE, Scale, Signed, signed_distance};
use crate::grid::{Cell, Grid};
use crate::isa::Isa;

/// Cells by which a distance that was read back from a field may be off, and by which ways over cells are
/// longer than straight ones.
const SLACK_CELLS: f32 = 1.5;
/// When more than one cell in so many is touched, the whole field is computed anew.
const SHARE_ANEW: usize = 4;
/// Cells that are searched one by one before the sweep is tried again.
const N_FAR: usize = 32;

/// Occupancy and its conservative signed distance, as [`signed_distance`] computes it.
#[derive(Clone, Debug)]
pub struct ChangingField {
    occupied: Grid<bool>,
    isa: Isa,
    /// Rows to the nearest cell of the other kind in the column.
    rows: Vec<u16>,
    columns: Remeasure,
    field: DistanceField,
    scale: Scale,
    sweep: Sweep,
    /// Squared distances of some cells of a row, for now.
    squared: Vec<f32>,
}

/// Cells from a first to a last, both included.
#[derive(Clone, Copy, Debug)]
struct Span {
    first: usize,
    last: usize,
}

impl Span {
    fn holding(self, at: usize) -> Span {
        Span { first: self.first.min(at), last: self.last.max(at) }
    }

    /// How far a place is from it.
    fn off(self, at: usize) -> f32 {
        self.first.saturating_sub(at).max(at.saturating_sub(self.last)) as f32
    }
}

impl ChangingField {
    /// The field of an occupancy. Costs as much as [`signed_distance`] and a half.
    #[must_use]
    pub fn new(occupied: Grid<bool>) -> Self {
        let n_cols = occupied.layout().shape.n_cols;
        ChangingField {
            isa: Isa::detect(),
            rows: rows_to_other_kind(&occupied),
            columns: Remeasure::default(),
            field: signed_distance(&occupied),
            scale: Scale::new(occupied.layout()),
            sweep: Sweep::new(n_cols),
            squared: vec![0.0; n_cols],
            occupied,
        }
    }

    /// What is occupied.
    #[must_use]
    pub fn occupied(&self) -> &Grid<bool> {
        &self.occupied
    }

    /// Its signed distance field.
    #[must_use]
    pub fn field(&self) -> &DistanceField {
        &self.field
    }

    /// Takes over what all cells are now; on another layout it begins anew.
    pub fn update(&mut self, occupied: Grid<bool>) {
        if occupied.layout() != self.occupied.layout() {
            *self = ChangingField::new(occupied);
            return;
        }
        let n_cols = occupied.layout().shape.n_cols;
        let rows = occupied.values().chunks(n_cols).zip(self.occupied.values().chunks(n_cols)).enumerate();
        let changed: Vec<_> = rows
            .filter(|(_, (now, before))| now != before)
            .flat_map(|(row, (now, _))| now.iter().enumerate().map(move |(col, is)| (Cell { col, row }, *is)))
            .collect();
        self.change(changed);
    }

    /// Takes over what cells are now (`true` is occupied); those that are so already, and those outside, change
    /// nothing. Returns how many were changed.
    pub fn change(&mut self, cells: impl IntoIterator<Item = (Cell, bool)>) -> usize {
        let shape = self.occupied.layout().shape;
        let mut changed: Option<(Span, Span)> = None;
        let mut n_changed = 0;
        for (cell, is_occupied) in cells {
            let is_inside = cell.col < shape.n_cols && cell.row < shape.n_rows;
            if !is_inside || *self.occupied.get(cell) == is_occupied {
                continue;
            }
            self.occupied.set(cell, is_occupied);
            n_changed += 1;
            let at = |at| Span { first: at, last: at };
            let (cols, rows) = changed.unwrap_or((at(cell.col), at(cell.row)));
            changed = Some((cols.holding(cell.col), rows.holding(cell.row)));
        }
        let Some((cols, rows)) = changed else { return 0 };
        let measured = (self.occupied.values(), &mut self.rows[..]);
        self.columns.run(self.isa, measured, shape.n_cols, cols.first..=cols.last, rows.first..=rows.last);
        self.measure_around(cols, rows);
        n_changed
    }

    /// Measures the cells anew that may have been nearest to a changed one, or are now.
    fn measure_around(&mut self, cols: Span, rows: Span) {
        let n_cells_max = self.occupied.values().len() / SHARE_ANEW;
        let n_rows = self.occupied.layout().shape.n_rows;
        let mut n_cells = 0;
        // Row by row away from the change, each no wider than the one before and what goes on from there.
        let above: Box<dyn Iterator<Item = usize>> = Box::new(rows.last + 1..n_rows);
        let below: Box<dyn Iterator<Item = usize>> = Box::new((0..rows.first).rev());
        let within: Box<dyn Iterator<Item = usize>> = Box::new(rows.first..=rows.last);
        for (side, is_within) in [(within, true), (above, false), (below, false)] {
            let mut span = cols;
            for row in side {
                let off_rows = rows.off(row);
                let begin = if is_within { cols } else { span };
                let Some(touched) = self.touched(row, begin, cols, off_rows) else { break };
                span = touched;
                n_cells += span.last - span.first + 1;
                if n_cells > n_cells_max {
                    self.field = signed_distance(&self.occupied);
                    return;
                }
                self.measure_row(row, span);
            }
        }
    }

    /// The cells of a row that are no nearer to the other kind than to the change; `None` without any.
    fn touched(&self, row: usize, begin: Span, cols: Span, off_rows: f32) -> Option<Span> {
        let n_cols = self.occupied.layout().shape.n_cols;
        let values_m = &self.field.values_m()[row * n_cols..(row + 1) * n_cols];
        let is_touched = |col: usize| {
            let off_cols = cols.off(col);
            let cells = self.scale.cells_of(values_m[col]) + SLACK_CELLS;
            cells * cells >= off_cols * off_cols + off_rows * off_rows
        };
        let (mut first, mut last) = (begin.first.saturating_sub(1), (begin.last + 1).min(n_cols - 1));
        if off_rows > 0.0 {
            while first <= last && !is_touched(first) {
                first += 1;
            }
            while last > first && !is_touched(last) {
                last -= 1;
            }
            if first > last {
                return None;
            }
        }
        while first > 0 && is_touched(first - 1) {
            first -= 1;
        }
        while last + 1 < n_cols && is_touched(last + 1) {
            last += 1;
        }
        Some(Span { first, last })
    }

    /// Measures cells of a row anew.
    fn measure_row(&mut self, row: usize, span: Span) {
        let n_cols = self.occupied.layout().shape.n_cols;
        let begin = row * n_cols;
        let kinds = &self.occupied.values()[begin..begin + n_cols];
        let rows = &self.rows[begin..begin + n_cols];
        let end = span.last + 1;
        self.sweep.load_around(span.first..end, kinds, rows);
        let mut col = span.first;
        while col < end {
            col = self.sweep.solve(col..end, kinds, Side::Both, &mut self.squared);
            if col < end {
                // Far from all: one by one, as many as stand together.
                let place = col..(col + N_FAR).min(end);
                search(kinds, rows, place.clone(), &mut self.squared[place.clone()]);
                col = place.end;
            }
        }
        let values = &mut self.field.values_m_mut()[begin + span.first..begin + end];
        values.copy_from_slice(&self.squared[span.first..end]);
        self.isa.run(Signed { scale: self.scale, occupied: &kinds[span.first..end], values });
    }
}

/// The squared distances of cells of a row, one by one: the nearest of the other kind lies in some column, not
/// past one that has it in this very row, nor past the best that was found.
fn search(kinds: &[bool], rows: &[u16], place: std::ops::Range<usize>, out: &mut [f32]) {
    let squared = |distance: u16| if distance == NONE { i32::MAX } else { i32::from(distance).pow(2) };
    for (col, out) in place.zip(out) {
        let own = kinds[col];
        let mut best = squared(rows[col]);
        let mut look = |others: &mut dyn Iterator<Item = (bool, u16)>| {
            for (off, (kind, distance)) in (1_i32..).zip(others) {
                let across = off * off;
                if across >= best {
                    break;
                }
                if kind != own {
                    best = across;
                    break;
                }
                best = best.min(squared(distance).saturating_add(across));
            }
        };
        look(&mut kinds[..col].iter().copied().zip(rows[..col].iter().copied()).rev());
        look(&mut kinds[col + 1..].iter().copied().zip(rows[col + 1..].iter().copied()));
        *out = if best == i32::MAX { f32::INFINITY } else { best as f32 };
    }
}

#[cfg(test)]
mod tests {
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
}
