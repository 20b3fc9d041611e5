//! What a search still has to look at, the cheapest first.
//!
//! Cells wait in buckets of nearly equal cost, which need no order within (Dial, CACM 12, 1969): a cell that a cheaper
//! way reaches later is looked at again. Deliberately not here: which ways there are (`search`).

use super::place::Place;

/// Buckets for each cell's length. Of more many are empty where ways are narrow; with fewer, more cells are looked at
/// twice where they are wide.
pub(super) const BUCKETS_PER_CELL: f32 = 2.0;
/// So many buckets are ahead of the present one: more than the dearest step adds, out of an inflated area.
const N_BUCKETS: usize = 512;

/// Cells that are open, by the cost of the whole way over them, in a ring of chains.
pub(super) struct Buckets {
    /// Of each bucket, the place of its last entry.
    last: [u32; N_BUCKETS],
    /// Every entry there ever was, and the place of the one before it in its bucket.
    entries: Vec<(Place, u32)>,
    /// The present bucket, counted from cost 0; all that is open lies less than the ring's length ahead.
    at: i32,
    /// So many entries were looked at.
    n_popped: usize,
}

/// The place of no entry.
const NO_ENTRY: u32 = u32::MAX;

impl Buckets {
    /// With nothing in them; the first bucket is where the search starts.
    pub(super) fn starting_at(first: i32) -> Self {
        Buckets { last: [NO_ENTRY; N_BUCKETS], entries: Vec::with_capacity(4096), at: first, n_popped: 0 }
    }

    #[inline(always)]
    pub(super) fn push(&mut self, bucket: i32, place: Place) {
        // Too early is only looked at too early.
        let last = &mut self.last[bucket.max(self.at) as usize % N_BUCKETS];
        self.entries.push((place, std::mem::replace(last, self.entries.len() as u32)));
    }

    /// Takes all that is in the first bucket with anything in it, as a chain; `None` when nothing is open. What comes
    /// into that bucket meanwhile waits for the next call.
    #[inline(always)]
    pub(super) fn take(&mut self) -> Option<Chain> {
        if self.n_popped == self.entries.len() {
            return None;
        }
        // Within the ring there is one.
        let ahead = (self.at..).take(N_BUCKETS).find(|at| self.last[*at as usize % N_BUCKETS] != NO_ENTRY)?;
        self.at = ahead;
        let last = std::mem::replace(&mut self.last[ahead as usize % N_BUCKETS], NO_ENTRY);
        Some(Chain { last, bucket: ahead })
    }

    /// The next of a chain.
    #[inline(always)]
    pub(super) fn pop(&mut self, chain: &mut Chain) -> Option<Place> {
        let (place, before) = self.entries.get(chain.last as usize)?;
        chain.last = *before;
        self.n_popped = self.n_popped.wrapping_add(1);
        Some(*place)
    }
}

/// Entries that were in one bucket, the last one first.
pub(super) struct Chain {
    last: u32,
    bucket: i32,
}

impl Chain {
    /// No way over any of its cells costs less, buckets.
    pub(super) fn least(&self) -> f32 {
        self.bucket as f32
    }
}
