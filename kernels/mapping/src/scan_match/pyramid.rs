//! Upper bounds of heat over blocks of cells, for the search by branch and bound, and how grids of cells grow.

use super::tiles::SIDE_LOG2;

/// Blocks along the side of a tile of cells on the lowest level, at most.
const N_TILE: usize = 1 << (SIDE_LOG2 - 1);
/// Blocks that may be looked at beside each other.
pub(super) const N_BESIDE: usize = 32;
/// Blocks around the bounds of a level: one for what the outermost blocks tell their neighbours, and where there is
/// nothing, as many as are looked at beside each other.
const BORDER: usize = N_BESIDE + 1;

/// One level of the pyramid.
#[derive(Clone, Debug, Default)]
pub(super) struct Level {
    n_cols: usize,
    /// Highest heat of each block and its neighbours to the right, above, and both; with a border.
    bounds: Vec<u8>,
}

impl Level {
    /// Follows the grid of cells into a larger one; this is level `level`.
    pub(super) fn grow(&mut self, moved: &Move, level: usize) {
        self.bounds = moved.apply(&self.bounds, 0, level, BORDER);
        self.n_cols = (moved.to[0] >> level) as usize;
    }

    /// What is to be looked up; `origin` is the low corner, cells.
    pub(super) fn bounds(&self, origin: [i32; 2], level: u32) -> Bounds<'_> {
        let stride = self.n_cols + 2 * BORDER;
        let n_rows = (self.bounds.len() / stride).saturating_sub(2 * BORDER);
        Bounds { values: &self.bounds, origin, n_side: [self.n_cols as i32, n_rows as i32], level }
    }

    /// Takes in the highest heat of blocks of a tile, `n_side` rows of as many, from a column and a row on. Heat
    /// only ever rises.
    fn raise(&mut self, heats: &[u8], n_side: usize, first: [usize; 2]) {
        let heats_of = |row: Option<usize>| {
            row.and_then(|row| heats.get(row * n_side..(row + 1) * n_side)).unwrap_or(&[0; N_TILE])
        };
        // The blocks to the left and below look at these, too.
        for nth in 0..=n_side {
            let mut higher = [0_u8; N_TILE + 2];
            let both = heats_of(nth.checked_sub(1)).iter().zip(heats_of(Some(nth)));
            for (higher, (low, high)) in higher[1..=n_side].iter_mut().zip(both) {
                *higher = *low.max(high);
            }
            let from = (first[1] + nth + BORDER - 1) * (self.n_cols + 2 * BORDER) + first[0] + BORDER - 1;
            let bounds = self.bounds.get_mut(from..=from + n_side).unwrap_or_default();
            for (bound, (left, right)) in bounds.iter_mut().zip(higher.iter().zip(&higher[1..])) {
                *bound = *left.max(right).max(bound);
            }
        }
    }
}

/// Tells all levels of a tile of cells whose heat has changed.
pub(super) fn raise(levels: &mut [Level], cells: &[u8], tile: [usize; 2]) {
    let mut heats = cells.to_vec();
    let mut n_side = 1 << SIDE_LOG2;
    for level in levels {
        heats = halved(&heats, n_side);
        n_side /= 2;
        level.raise(&heats, n_side, tile.map(|at| at * n_side));
    }
}

/// The highest of each two by two.
fn halved(values: &[u8], n_side: usize) -> Vec<u8> {
    let mut halved = Vec::with_capacity(values.len() / 4);
    for rows in values.chunks_exact(2 * n_side) {
        let (low, high) = rows.split_at(n_side);
        let pairs = low.chunks_exact(2).zip(high.chunks_exact(2));
        halved.extend(pairs.map(|(low, high)| low[0].max(low[1]).max(high[0]).max(high[1])));
    }
    halved
}

/// One level, to be looked up.
#[derive(Clone, Copy)]
pub(super) struct Bounds<'a> {
    /// Row by row, with a border.
    values: &'a [u8],
    /// Low corner, cells.
    origin: [i32; 2],
    /// Without the border.
    n_side: [i32; 2],
    level: u32,
}

impl<'a> Bounds<'a> {
    /// From one row to the next.
    #[inline]
    pub(super) fn stride(&self) -> usize {
        self.n_side[0] as usize + 2 * BORDER
    }

    /// All of them, row by row.
    #[inline]
    pub(super) fn values(&self) -> &'a [u8] {
        self.values
    }

    /// Where the bounds from the block of a cell on begin, [`N_BESIDE`] beside each other and above each other, and
    /// more. What lies beyond the border is as empty as that.
    #[inline]
    pub(super) fn start(&self, cell: [i32; 2]) -> u32 {
        let at = |axis: usize| {
            let block = cell[axis].wrapping_sub(self.origin[axis]) >> self.level;
            block.max(-(BORDER as i32)).min(self.n_side[axis]).wrapping_add(BORDER as i32)
        };
        // Wrapping, here and below: there are some million blocks at most, and checks cost as much as all else.
        at(1).wrapping_mul(self.stride() as i32).wrapping_add(at(0)) as u32
    }

    /// Sums of bounds over cells that are all shifted by `off`, by a block more to the right, above, and both.
    #[inline]
    pub(super) fn four_sums(&self, cells: &[[i32; 2]], off: [i32; 2]) -> [u32; 4] {
        let stride = self.stride();
        let mut sums = [0_u32; 4];
        for &[x, y] in cells {
            let start = self.start([x.wrapping_add(off[0]), y.wrapping_add(off[1])]);
            let values = self.values.get(start as usize..).unwrap_or_default();
            let above = values.get(stride..).unwrap_or_default();
            if let (Some(low), Some(high)) = (values.first_chunk::<2>(), above.first_chunk::<2>()) {
                for (sum, value) in sums.iter_mut().zip([low[0], low[1], high[0], high[1]]) {
                    // Wrapping: thousands of points are nowhere near an integer's end, and checks cost as much.
                    *sum = sum.wrapping_add(value.into());
                }
            }
        }
        sums
    }
}

/// A grid's contents going into a larger one, in cells.
pub(super) struct Move {
    pub(super) from: [i32; 2],
    pub(super) to: [i32; 2],
    pub(super) off: [i32; 2],
}

impl Move {
    /// The contents of a level with a border of so many blocks, in their new places.
    pub(super) fn apply<T: Copy>(&self, old: &[T], empty: T, level: usize, border: usize) -> Vec<T> {
        let [from, to, off] = [self.from, self.to, self.off].map(|pair| pair.map(|n| (n >> level) as usize));
        let [from, to] = [from, to].map(|side| side.map(|n| n + 2 * border));
        let mut moved = vec![empty; to[0] * to[1]];
        for (row, values) in old.chunks_exact(from[0].max(1)).enumerate() {
            let begin = (row + off[1]) * to[0] + off[0];
            moved[begin..begin + from[0]].copy_from_slice(values);
        }
        moved
    }
}
