//! A signed distance field that is kept up as cells change: an object was moved, a few cells are new.
//!
//! Exact, like the whole transform. Where cells became occupied, a free cell is either as far from all as it was or
//! as far as it is from them, whatever else there is ([`nearing`]). What lay nearest to something that is gone is
//! measured anew, from as much as can be nearest to it now ([`around`]). Either way only cells matter that are no nearer
//! to the other kind than to the change ([`reached`]). The cost goes with their number, not with the grid's.

use std::ops::Range;

use super::{DistanceField, RowSolver, Scale, Side, signed_distance};
use crate::grid::{Cell, Grid};
use crate::isa::{Isa, Work};

mod around;
mod nearing;
mod part;
mod reached;

use around::Around;
use nearing::Nearing;
use part::PartColumns;
use reached::{Stretch, reached};

/// Occupancy and its conservative signed distance, as [`signed_distance`] computes it.
#[derive(Clone, Debug)]
pub struct ChangingField {
    occupied: Grid<bool>,
    field: DistanceField,
    scale: Scale,
    isa: Isa,
    stretches: Vec<Stretch>,
    columns: PartColumns,
    solver: RowSolver,
    /// Squared distances of some cells of a row, for now.
    squared: Vec<f32>,
}

/// Some cells became one kind.
#[derive(Clone, Debug)]
struct Change {
    is_occupied: bool,
    /// They lie in here.
    cols: Range<usize>,
    rows: Range<usize>,
}

impl Change {
    fn at(cell: Cell, is_occupied: bool) -> Change {
        Change { is_occupied, cols: cell.col..cell.col + 1, rows: cell.row..cell.row + 1 }
    }

    fn take_in(&mut self, cell: Cell) {
        let Change { cols, rows, .. } = self;
        (cols.start, cols.end) = (cols.start.min(cell.col), cols.end.max(cell.col + 1));
        (rows.start, rows.end) = (rows.start.min(cell.row), rows.end.max(cell.row + 1));
    }
}

impl ChangingField {
    /// The field of an occupancy. Costs as much as [`signed_distance`].
    #[must_use]
    pub fn new(occupied: Grid<bool>) -> Self {
        let n_cols = occupied.layout().shape.n_cols;
        ChangingField {
            field: signed_distance(&occupied),
            scale: Scale::new(occupied.layout()),
            isa: Isa::detect(),
            stretches: Vec::new(),
            columns: PartColumns::default(),
            solver: RowSolver::new(n_cols),
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
        let mut changed: Vec<_> = rows
            .filter(|(_, (now, before))| now != before)
            .flat_map(|(row, (now, before))| {
                let cells = now.iter().zip(before).enumerate().filter(|(_, (now, before))| now != before);
                cells.map(move |(col, (is, _))| (Cell { col, row }, *is))
            })
            .collect();
        // What comes leaves less that was nearest to what goes.
        changed.sort_by_key(|(_, is_occupied)| !is_occupied);
        self.change(changed);
    }

    /// Takes over what cells are now (`true` is occupied); those that are so already, and those outside, change
    /// nothing. Returns how many were changed.
    ///
    /// Cheapest with all that comes before all that goes, or after it.
    pub fn change(&mut self, cells: impl IntoIterator<Item = (Cell, bool)>) -> usize {
        let shape = self.occupied.layout().shape;
        let mut changed: Option<Change> = None;
        let mut n_changed = 0;
        for (cell, is_occupied) in cells {
            let is_inside = cell.col < shape.n_cols && cell.row < shape.n_rows;
            if !is_inside || *self.occupied.get(cell) == is_occupied {
                continue;
            }
            if let Some(before) = changed.take_if(|before| before.is_occupied != is_occupied) {
                self.measure(&before);
            }
            self.occupied.set(cell, is_occupied);
            n_changed += 1;
            changed.get_or_insert(Change::at(cell, is_occupied)).take_in(cell);
        }
        if let Some(changed) = changed {
            self.measure(&changed);
        }
        n_changed
    }

    /// Brings the field up to date with a change that occupancy shows already.
    fn measure(&mut self, change: &Change) {
        reached(&self.field, self.scale, change, &mut self.stretches);
        let around = Around::new(&self.occupied, &self.field, self.scale, change, &mut self.stretches);
        if around.is_dearer_than_all {
            self.field = signed_distance(&self.occupied);
            return;
        }
        self.near(change, &around);
        self.measure_anew(change, &around);
    }

    /// Cells of the kind that there is less of now: no farther from the others than from those that changed.
    fn near(&mut self, change: &Change, around: &Around) {
        if !around.has_nearing {
            return;
        }
        let n_cols = self.occupied.layout().shape.n_cols;
        let (rows, sources) = (around.rows.clone(), change.rows.clone());
        let part = (change.cols.clone(), rows, sources);
        self.columns.measure(self.isa, &self.occupied, change.is_occupied, part);
        for stretch in self.stretches.iter().filter(|stretch| stretch.has_nearing) {
            // In whole chunks: what else there is in a row is as near as it can be.
            let n = stretch.cols.len().next_multiple_of(nearing::N_CHUNK).min(n_cols);
            let first = stretch.cols.start.min(n_cols - n);
            let cells = stretch.row * n_cols + first..stretch.row * n_cols + first + n;
            self.isa.run(Nearing {
                scale: self.scale,
                to_occupied: change.is_occupied,
                lifts: self.columns.row(stretch.row, change.cols.clone()),
                first_lift: change.cols.start,
                kinds: &self.occupied.values()[cells.clone()],
                first,
                values: &mut self.field.values_m_mut()[cells],
            });
        }
    }

    /// Cells of the kind that there is more of now: what was nearest to them may be gone.
    fn measure_anew(&mut self, change: &Change, around: &Around) {
        if around.cols.is_empty() {
            return;
        }
        let n_cols = self.occupied.layout().shape.n_cols;
        let (kind, part) =
            (change.is_occupied, (around.cols.clone(), around.rows.clone(), around.sources.clone()));
        self.columns.measure(self.isa, &self.occupied, !kind, part);
        self.solver.n_rows_far = 0;
        let (first, n) = (around.cols.start, around.cols.len());
        let squared = &mut self.squared[..n];
        for Stretch { row, anew, .. } in self.stretches.iter().filter(|stretch| !stretch.anew.is_empty()) {
            let begin = row * n_cols;
            let kinds = &self.occupied.values()[begin + first..begin + first + n];
            let nearest = self.columns.row(*row, around.cols.clone());
            let span = anew.start - first..anew.end - first;
            let side = if kind { Side::Occupied } else { Side::Free };
            self.solver.solve((kinds, nearest), span.clone(), side, squared);
            let values = &mut self.field.values_m_mut()[begin + anew.start..begin + anew.end];
            let (kinds, squared) = (&kinds[span.clone()], &squared[span]);
            self.isa.run(Anew { scale: self.scale, kind, kinds, squared, values });
        }
    }
}

/// Writes the values of the cells of a kind.
struct Anew<'a> {
    scale: Scale,
    kind: bool,
    kinds: &'a [bool],
    squared: &'a [f32],
    values: &'a mut [f32],
}

impl Work for Anew<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        for ((value, kind), squared) in self.values.iter_mut().zip(self.kinds).zip(self.squared) {
            let anew_m = self.scale.signed_m(*squared, self.kind);
            *value = if *kind == self.kind { anew_m } else { *value };
        }
    }
}

#[cfg(test)]
mod laws;
