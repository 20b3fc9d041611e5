//! What a search still has to look at, the cheapest first.
//!
//! Cells wait in buckets of nearly equal cost, which need no order within (Dial, CACM 12, 1969): a cell that a cheaper
//! way reaches later is looked at again. Deliberately not here: which ways there are (`search`).

use std::f32::consts::SQRT_2;

/// A cell to be looked at, on the map with its border.
#[derive(Clone, Copy)]
pub(super) struct Place {
    pub(super) col: u16,
    pub(super) row: u16,
}

impl Place {
    #[inline(always)]
    pub(super) fn after(self, (dx, dy): (i32, i32)) -> Place {
        Place { col: self.col.wrapping_add_signed(dx as i16), row: self.row.wrapping_add_signed(dy as i16) }
    }

    /// Length of the shortest way over eight neighbours, cells.
    #[inline(always)]
    pub(super) fn octile(self, other: Place) -> f32 {
        let off_col = f32::from(self.col.abs_diff(other.col));
        let off_row = f32::from(self.row.abs_diff(other.row));
        off_col.max(off_row) + (SQRT_2 - 1.0) * off_col.min(off_row)
    }
}

/// Buckets for each cell's length.
const BUCKETS_PER_CELL: f32 = 8.0;
/// So many buckets are ahead of the present one: more than the dearest step adds, out of an inflated area.
const N_BUCKETS: usize = 1024;

/// Cells that are open, by the cost of the whole way over them, in a ring of chains.
pub(super) struct Buckets {
    /// Of each bucket, the place of its last entry.
    last: Vec<u32>,
    /// Every entry there ever was, and the place of the one before it in its bucket.
    entries: Vec<(Place, u32)>,
    /// The present bucket, counted from cost 0.
    at: usize,
    n_open: usize,
}

/// The place of no entry.
const NO_ENTRY: u32 = u32::MAX;

impl Buckets {
    pub(super) fn new() -> Self {
        Buckets { last: vec![NO_ENTRY; N_BUCKETS], entries: Vec::with_capacity(4096), at: 0, n_open: 0 }
    }

    #[inline(always)]
    pub(super) fn push(&mut self, whole_cost: f32, place: Place) {
        // Too early is only looked at too early.
        let bucket =
            ((whole_cost * BUCKETS_PER_CELL) as i32 as usize).clamp(self.at, self.at + N_BUCKETS - 1);
        let last = &mut self.last[bucket % N_BUCKETS];
        self.entries.push((place, std::mem::replace(last, self.entries.len() as u32)));
        self.n_open += 1;
    }

    /// One of the cheapest; `None` when no way over any could be cheaper than `enough`.
    #[inline(always)]
    pub(super) fn pop(&mut self, enough: f32) -> Option<Place> {
        while self.n_open > 0 && (self.at as f32) < enough * BUCKETS_PER_CELL {
            let last = &mut self.last[self.at % N_BUCKETS];
            if let Some((place, before)) = self.entries.get(*last as usize) {
                *last = *before;
                self.n_open -= 1;
                return Some(*place);
            }
            self.at += 1;
        }
        None
    }
}
