//! Upper bounds of heat over blocks of cells, for the search by branch and bound, and how grids of cells grow.

/// One level of the pyramid.
#[derive(Clone, Debug, Default)]
pub(super) struct Level {
    /// Highest heat of each block.
    pub(super) blocks: Vec<u8>,
    /// Highest heat of each block and its neighbours to the right, above, and both.
    pub(super) bounds: Vec<u8>,
}

/// The highest of each block and its neighbours to the right, above, and both.
pub(super) fn bounds_of(blocks: &[u8], n_cols: usize) -> Vec<u8> {
    let mut bounds = blocks.to_vec();
    for row in bounds.chunks_exact_mut(n_cols.max(1)) {
        for col in 1..n_cols {
            row[col - 1] = row[col - 1].max(row[col]);
        }
    }
    for idx in n_cols..bounds.len() {
        bounds[idx - n_cols] = bounds[idx - n_cols].max(bounds[idx]);
    }
    bounds
}

/// One level, to be looked up.
#[derive(Clone, Copy)]
pub(super) struct Bounds<'a> {
    pub(super) values: &'a [u8],
    pub(super) origin: [i32; 2],
    pub(super) n_side: [u32; 2],
    pub(super) level: u32,
}

impl Bounds<'_> {
    /// Adds, for each of `n_side` × `n_side` shifts from `first` on (cells; a block apart), the bounds of cells that
    /// are all shifted by it. At most 257 cells: sums have 16 bits.
    pub(super) fn add_rows(&self, cells: &[[i32; 2]], first: [i32; 2], n_side: usize, sums: &mut [u16]) {
        let [n_cols, n_rows] = self.n_side.map(|n| n as i32);
        for &[x, y] in cells {
            let col = (x.wrapping_add(first[0]).wrapping_sub(self.origin[0])) >> self.level;
            let row = (y.wrapping_add(first[1]).wrapping_sub(self.origin[1])) >> self.level;
            // The part of the shifts that lies on the grid.
            let begin = (-col).clamp(0, n_side as i32) as usize;
            let end = n_cols.saturating_sub(col).clamp(0, n_side as i32) as usize;
            if begin >= end {
                continue;
            }
            for (nth, sums) in sums.chunks_exact_mut(n_side).enumerate() {
                let row = row.wrapping_add(nth as i32);
                if !(0..n_rows).contains(&row) {
                    continue;
                }
                let from = (row * n_cols + col.wrapping_add(begin as i32)) as usize;
                let values = self.values.get(from..from + (end - begin)).unwrap_or_default();
                for (sum, value) in sums[begin..end].iter_mut().zip(values) {
                    *sum = sum.wrapping_add(u16::from(*value));
                }
            }
        }
    }

    /// Sum of bounds over cells that are all shifted by `off`.
    #[inline]
    pub(super) fn sum(&self, cells: &[[i32; 2]], off: [i32; 2]) -> u32 {
        let (dx, dy) = (off[0].wrapping_sub(self.origin[0]), off[1].wrapping_sub(self.origin[1]));
        let [n_cols, n_rows] = self.n_side;
        let mut sum = 0_u32;
        for &[x, y] in cells {
            // Negative positions become huge. Wrapping: nothing here comes near an integer's end, and checks
            // would cost as much as the sum.
            let (col, row) =
                ((x.wrapping_add(dx) >> self.level) as u32, (y.wrapping_add(dy) >> self.level) as u32);
            if col < n_cols && row < n_rows {
                let idx = row.wrapping_mul(n_cols).wrapping_add(col) as usize;
                sum = sum.wrapping_add(self.values.get(idx).map_or(0, |v| u32::from(*v)));
            }
        }
        sum
    }
}

/// A grid's contents going into a larger one, in cells.
pub(super) struct Move {
    pub(super) from: [i32; 2],
    pub(super) to: [i32; 2],
    pub(super) off: [i32; 2],
}

impl Move {
    pub(super) fn apply<T: Copy>(&self, old: &[T], empty: T, level: usize) -> Vec<T> {
        let [from, to, off] = [self.from, self.to, self.off].map(|pair| pair.map(|n| (n >> level) as usize));
        let mut moved = vec![empty; to[0] * to[1]];
        for (row, values) in old.chunks_exact(from[0].max(1)).enumerate() {
            let begin = (row + off[1]) * to[0] + off[0];
            moved[begin..begin + from[0]].copy_from_slice(values);
        }
        moved
    }
}
