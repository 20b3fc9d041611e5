//! Sums of bounds over all shifts of a window at once: a row of shifts is a row of the grid, added point by point.
//!
//! Sums of a row stay in registers while all points are added. The loop is compiled for each instruction set.

use super::pyramid::{BORDER, Bounds};
use crate::isa::{Isa, Work};

/// Shifts along a side at most.
pub(super) const N_SIDE_MAX: usize = BORDER;

/// What is summed at one heading.
pub(super) struct Dense {
    isa: Isa,
    n_side: usize,
    /// Row by row; shifts beyond the side are whatever.
    rows: Vec<Row>,
}

/// Sums of a row of shifts.
#[derive(Clone, Copy, Default)]
struct Row {
    sums: [u16; N_SIDE_MAX],
    /// No sum is higher.
    most: u16,
}

impl Dense {
    /// Room for so many shifts along a side, at most [`N_SIDE_MAX`].
    pub(super) fn new(n_side: usize) -> Self {
        let n_side = n_side.min(N_SIDE_MAX);
        Dense { isa: Isa::detect(), n_side, rows: vec![Row::default(); n_side] }
    }

    /// For each shift from `first` on (cells; a block apart) the sum of the bounds of cells that are all shifted by
    /// it, in rows by their numbers; rows with no sum of `least` are left out. At most 257 cells: sums have 16 bits.
    pub(super) fn sums(
        &mut self,
        bounds: &Bounds<'_>,
        cells: &[[i32; 2]],
        first: [i32; 2],
        least: u16,
    ) -> impl Iterator<Item = (usize, &[u16])> {
        let shifted = |cell: &[i32; 2]| [cell[0].wrapping_add(first[0]), cell[1].wrapping_add(first[1])];
        let seen: Vec<&[u8]> = cells.iter().map(|cell| bounds.from(shifted(cell))).collect();
        self.isa.run(Adding { seen: &seen, stride: bounds.stride(), rows: &mut self.rows });
        let is_high = move |(_, row): &(usize, &Row)| row.most >= least;
        self.rows.iter().enumerate().filter(is_high).map(|(nth, row)| (nth, &row.sums[..self.n_side]))
    }
}

/// The loop.
struct Adding<'a> {
    /// What each point sees, from the first shift on.
    seen: &'a [&'a [u8]],
    stride: usize,
    rows: &'a mut [Row],
}

impl Work for Adding<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        for (nth, row) in self.rows.iter_mut().enumerate() {
            let mut so_far = [0_u16; N_SIDE_MAX];
            for values in self.seen {
                let values = values.get(nth.wrapping_mul(self.stride)..).unwrap_or_default();
                if let Some(values) = values.first_chunk::<N_SIDE_MAX>() {
                    for (sum, value) in so_far.iter_mut().zip(values) {
                        *sum = sum.wrapping_add(u16::from(*value));
                    }
                }
            }
            *row = Row { sums: so_far, most: highest(so_far) };
        }
    }
}

/// The highest of all, by halves: lanes beside each other are compared at once.
#[inline(always)]
fn highest(mut sums: [u16; N_SIDE_MAX]) -> u16 {
    let mut n = N_SIDE_MAX;
    while n > 1 {
        n /= 2;
        let (low, high) = sums.split_at_mut(n);
        for (low, high) in low.iter_mut().zip(high) {
            *low = (*low).max(*high);
        }
    }
    sums[0]
}

#[cfg(test)]
mod tests {
    use geometry::Pose2;
    use nalgebra::{Point2, Vector2};
    use proptest::prelude::*;

    use super::*;
    use crate::scan_match::{Cloud, CloudPoint, MatchMap};

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        /// The slow, obvious way: of each point the highest heat in the square that a block of shifts reaches.
        #[test]
        fn sums_bound_the_heat_of_every_shift_and_those_of_a_row_are_those_of_each_alone(
            surface in prop::collection::vec((-3.0..3.0_f32, -3.0..3.0_f32), 1..60),
            cells in prop::collection::vec([-150..150_i32, -150..150_i32], 0..64),
            n_side in 1..=N_SIDE_MAX, first in [-40..40_i32, -40..40_i32], level in 1..=4_usize,
        ) {
            let point = |&(x, y): &(f32, f32)| CloudPoint { at: Point2::new(x, y), normal: Vector2::zeros() };
            let mut map = MatchMap::new(0.05);
            // By halves: growing keeps what there is.
            for half in surface.chunks(30) {
                map.insert(&Cloud::from_points(half.iter().map(point).collect()), Pose2::IDENTITY);
            }
            let bounds = map.bounds(level).unwrap();
            let step = 1 << level;
            let mut dense = Dense::new(n_side);
            prop_assert_eq!(dense.sums(&bounds, &cells, first, 0).count(), n_side);
            let highest = dense.sums(&bounds, &cells, first, 0).flat_map(|(_, row)| row).copied().max().unwrap();
            prop_assert!(dense.sums(&bounds, &cells, first, highest).any(|(_, row)| row.contains(&highest)));
            for (row, sums) in dense.sums(&bounds, &cells, first, 0) {
                for (col, sum) in sums.iter().enumerate() {
                    let off = [first[0] + step * col as i32, first[1] + step * row as i32];
                    prop_assert_eq!(u32::from(*sum), bounds.four_sums(&cells, off)[0]);
                    for part in [[0, 0], [step - 1, 0], [step / 2, step - 1]] {
                        let heat = map.four_heat_sums(&cells, [off[0] + part[0], off[1] + part[1]])[0];
                        prop_assert!(heat <= u32::from(*sum), "{heat} at {off:?} and {part:?}, bound by {sum}");
                    }
                }
            }
        }
    }
}
