//! What a search still has to look at, the cheapest first.
//!
//! Cells wait in buckets of nearly equal cost, which need no order within (Dial, CACM 12, 1969): a cell that a cheaper
//! way reaches later is looked at again. Deliberately not here: which ways there are (`search`).

use super::place::Place;

/// Buckets for each cell's length. More are walked in vain where ways are narrow, with fewer cells are looked at more
/// than once.
pub(super) const BUCKETS_PER_CELL: f32 = 4.0;
/// So many buckets are ahead of the present one: more than the dearest step adds, out of an inflated area.
const N_BUCKETS: usize = 512;

/// Cells that are open, by the cost of the whole way over them, in a ring of chains.
pub(super) struct Buckets {
    /// Of each bucket, the place of its last entry.
    last: [u32; N_BUCKETS],
    /// Every entry there ever was, and the place of the one before it in its bucket.
    entries: Vec<(Place, u32)>,
    /// The present bucket, counted from cost 0.
    at: i32,
    n_open: usize,
}

/// The place of no entry.
const NO_ENTRY: u32 = u32::MAX;

impl Buckets {
    pub(super) fn new() -> Self {
        Buckets { last: [NO_ENTRY; N_BUCKETS], entries: Vec::with_capacity(4096), at: 0, n_open: 0 }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.n_open == 0
    }

    /// No way over a cell that is open costs less, buckets.
    pub(super) fn present(&self) -> f32 {
        self.at as f32
    }

    /// Goes on to the next bucket.
    pub(super) fn next(&mut self) {
        self.at += 1;
    }

    #[inline(always)]
    pub(super) fn push(&mut self, bucket: i32, place: Place) {
        // Too early is only looked at too early.
        let last = &mut self.last[bucket.max(self.at) as usize % N_BUCKETS];
        self.entries.push((place, std::mem::replace(last, self.entries.len() as u32)));
        self.n_open = self.n_open.wrapping_add(1);
    }

    /// One of the present bucket.
    #[inline(always)]
    pub(super) fn pop(&mut self) -> Option<Place> {
        let last = &mut self.last[self.at as usize % N_BUCKETS];
        let (place, before) = self.entries.get(*last as usize)?;
        *last = *before;
        self.n_open = self.n_open.wrapping_sub(1);
        Some(*place)
    }
}
