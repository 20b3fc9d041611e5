//! Distances within columns: for each cell, how many rows away the nearest cell of the other kind is.
//!
//! All is done row by row, many columns at a time: going along a column would touch a cache line for each cell.

use super::NONE;
use crate::isa::{Isa, Work};

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
