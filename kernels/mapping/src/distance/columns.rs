//! Distances within columns: for each cell, how many rows away the nearest cell of the other kind is.
//!
//! All is done row by row, many columns at a time: going along a column would touch a cache line for each cell.

use std::ops::RangeInclusive;

use super::NONE;
use crate::grid::Grid;
use crate::isa::{Isa, Work};

/// For each cell, how many rows away the nearest cell of the other kind is in its column.
pub(super) fn rows_to_other_kind(occupied: &Grid<bool>) -> Vec<u16> {
    let n_cols = occupied.layout().shape.n_cols;
    let isa = Isa::detect();
    let rows = occupied.values().chunks_exact(n_cols);
    let mut distances = distances_along(isa, rows.clone(), n_cols);
    let above = distances_along(isa, rows.rev(), n_cols);
    for (distances, above) in distances.chunks_exact_mut(n_cols).zip(above.chunks_exact(n_cols).rev()) {
        isa.run(Nearer { distances, others: above });
    }
    distances
}

/// For each cell of rows in this order, how many rows before it the nearest cell of the other kind is in its column.
pub(super) fn distances_along<'a>(
    isa: Isa,
    rows: impl ExactSizeIterator<Item = &'a [bool]>,
    n_cols: usize,
) -> Vec<u16> {
    let mut distances = Vec::with_capacity(rows.len() * n_cols);
    let mut before = None;
    for here in rows {
        if let Some(before) = before.replace(here) {
            let begin = distances.len();
            distances.extend_from_within(begin - n_cols..);
            isa.run(Step { distances: &mut distances[begin..], here, before });
        } else {
            distances.resize(n_cols, NONE);
        }
    }
    distances
}

/// Carries columns' distances one row on.
pub(super) struct Step<'a> {
    pub(super) distances: &'a mut [u16],
    pub(super) here: &'a [bool],
    pub(super) before: &'a [bool],
}

impl Work for Step<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        for ((distance, here), before) in self.distances.iter_mut().zip(self.here).zip(self.before) {
            *distance = one_on(*distance, here == before);
        }
    }
}

/// One more within a kind, one across a border.
#[inline(always)]
fn one_on(distance: u16, is_same: bool) -> u16 {
    if is_same { distance.saturating_add(1) } else { 1 }
}

/// Of each two distances the smaller one.
pub(super) struct Nearer<'a> {
    pub(super) distances: &'a mut [u16],
    pub(super) others: &'a [u16],
}

impl Work for Nearer<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let pairs = self.distances.iter_mut().zip(self.others);
        pairs.for_each(|(distance, other)| *distance = (*other).min(*distance));
    }
}

/// Measures columns anew after some of their cells changed; scratch space for it.
#[derive(Clone, Debug, Default)]
pub(super) struct Remeasure {
    /// For each column the first row that the change may have altered, and one past the last.
    first: Vec<u16>,
    end: Vec<u16>,
    /// The distances carried into these rows from below and from above.
    from_below: Vec<u16>,
    from_above: Vec<u16>,
}

impl Remeasure {
    /// Brings `distances` up to date with `kinds`, of which cells in these columns and rows have changed.
    pub(super) fn run(
        &mut self,
        isa: Isa,
        (kinds, distances): (&[bool], &mut [u16]),
        n_cols: usize,
        cols: RangeInclusive<usize>,
        rows: RangeInclusive<usize>,
    ) {
        let (first_col, n) = (*cols.start(), cols.count());
        let n_rows = (kinds.len() / n_cols) as u16;
        let part = |row: u16| {
            let begin = usize::from(row) * n_cols + first_col;
            begin..begin + n
        };
        for (values, value) in [
            (&mut self.first, 0),
            (&mut self.end, n_rows),
            (&mut self.from_below, NONE),
            (&mut self.from_above, NONE),
        ] {
            values.clear();
            values.resize(n, value);
        }
        let (first, last) = (*rows.start() as u16, *rows.end() as u16);
        let (ends, carried) = (&mut self.first, &mut self.from_below);
        for row in (0..first).rev() {
            let (ends, carried, distances) = (&mut ends[..], &mut carried[..], &distances[part(row)]);
            if isa.run(End { off: first - row, open: 0, end: row + 1, ends, carried, distances }) {
                break;
            }
        }
        let (ends, carried) = (&mut self.end, &mut self.from_above);
        for row in last + 1..n_rows {
            let (ends, carried, distances) = (&mut ends[..], &mut carried[..], &distances[part(row)]);
            if isa.run(End { off: row - last, open: n_rows, end: row, ends, carried, distances }) {
                break;
            }
        }
        let lowest = self.first.iter().copied().min().unwrap_or(0);
        let highest = self.end.iter().copied().max().unwrap_or(0);
        let spans = (&self.first[..], &self.end[..]);
        for row in (lowest..highest).rev() {
            let (here, before) = (&kinds[part(row)], &kinds[part((row + 1).min(n_rows - 1))]);
            let (carried, distances) = (&mut self.from_above[..], &mut distances[part(row)]);
            isa.run(Carry { row, is_anew: true, spans, carried, here, before, distances });
        }
        for row in lowest..highest {
            let (here, before) = (&kinds[part(row)], &kinds[part(row.saturating_sub(1))]);
            let (carried, distances) = (&mut self.from_below[..], &mut distances[part(row)]);
            isa.run(Carry { row, is_anew: false, spans, carried, here, before, distances });
        }
    }
}

/// One row away from the change: a cell that is nearer to the other kind than to the change is as it was, and so are
/// all behind it. Says whether all columns have come to such a cell.
struct End<'a> {
    /// Rows to the change.
    off: u16,
    /// What the ends are until they are found, and what they are then.
    open: u16,
    end: u16,
    ends: &'a mut [u16],
    /// The distances found there.
    carried: &'a mut [u16],
    distances: &'a [u16],
}

impl Work for End<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> bool {
        let mut n_open = 0_u16;
        for ((end, carried), distance) in self.ends.iter_mut().zip(self.carried).zip(self.distances) {
            let is_open = *end == self.open;
            let is_end = is_open & (*distance < self.off);
            *end = if is_end { self.end } else { *end };
            *carried = if is_end { *distance } else { *carried };
            n_open += u16::from(is_open & !is_end);
        }
        n_open == 0
    }
}

/// Carries distances one row on in the columns whose span holds it, and keeps the smaller ones.
struct Carry<'a> {
    row: u16,
    /// Whether what was there before no longer counts.
    is_anew: bool,
    spans: (&'a [u16], &'a [u16]),
    carried: &'a mut [u16],
    here: &'a [bool],
    before: &'a [bool],
    distances: &'a mut [u16],
}

impl Work for Carry<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let kinds = self.here.iter().zip(self.before);
        let spans = self.spans.0.iter().zip(self.spans.1);
        let values = self.carried.iter_mut().zip(self.distances);
        for (((carried, distance), (here, before)), (first, end)) in values.zip(kinds).zip(spans) {
            let is_inside = (*first <= self.row) & (self.row < *end);
            let on = one_on(*carried, here == before);
            *carried = if is_inside { on } else { *carried };
            let least = if self.is_anew { on } else { on.min(*distance) };
            *distance = if is_inside { least } else { *distance };
        }
    }
}
