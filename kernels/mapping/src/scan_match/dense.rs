//! Sums of bounds over all shifts of a window at once: a row of shifts is a row of the grid, added point by point.
//!
//! Sums of some rows stay in registers while all points are added. The loop is compiled for each instruction set.

use super::pyramid::{Bounds, N_BESIDE};
use crate::isa::{Isa, Work};

/// Shifts along a side at most.
pub(super) const N_SIDE_MAX: usize = N_BESIDE;
/// So many rows are summed at once, at one heading after the other: what they look at stays near the processor.
const N_ROWS: usize = 4;

/// What is summed.
pub(super) struct Dense<'a> {
    isa: Isa,
    bounds: Bounds<'a>,
    n_side: usize,
    /// Where in the bounds each point of each heading sees the first shift.
    starts: Vec<u32>,
    n_points: usize,
    rows: [Row; N_ROWS],
}

/// Sums of a row of shifts.
#[derive(Clone, Copy, Default)]
struct Row {
    sums: [u16; N_SIDE_MAX],
    /// No sum is higher.
    most: u16,
}

impl<'a> Dense<'a> {
    /// So many shifts along a side, at most [`N_SIDE_MAX`], from `first` on (cells; a block apart) of cells, `n_points`
    /// at each heading: at most 257, sums have 16 bits.
    pub(super) fn new(
        bounds: Bounds<'a>,
        n_side: usize,
        cells: &[[i32; 2]],
        n_points: usize,
        first: [i32; 2],
    ) -> Self {
        let isa = Isa::detect();
        let mut starts = vec![0; cells.len()];
        isa.run(Beginning { bounds, cells, first, starts: &mut starts });
        Dense {
            isa,
            bounds,
            n_side: n_side.min(N_SIDE_MAX),
            starts,
            n_points,
            rows: [Row::default(); N_ROWS],
        }
    }

    /// The bands that rows are summed in, the middle one first.
    pub(super) fn bands(&self) -> impl Iterator<Item = usize> + use<> {
        let n_bands = self.n_side.div_ceil(N_ROWS);
        let middle = n_bands / 2;
        (0..2 * n_bands).filter_map(move |nth| {
            let off = nth.div_ceil(2);
            let band = if nth % 2 == 0 { middle.checked_add(off) } else { middle.checked_sub(off) };
            band.filter(|band| *band < n_bands)
        })
    }

    /// For each shift of a band of rows the sum of the bounds of a heading's cells that are all shifted by it, with the
    /// rows' numbers; rows with no sum of `least` are left out.
    pub(super) fn sums(
        &mut self,
        heading: usize,
        band: usize,
        least: u16,
    ) -> impl Iterator<Item = (usize, &[u16])> {
        let from = heading.wrapping_mul(self.n_points);
        let first_row = band.wrapping_mul(N_ROWS);
        let stride = self.bounds.stride();
        self.rows = self.isa.run(Adding {
            values: self.bounds.values().get(first_row.wrapping_mul(stride)..).unwrap_or_default(),
            starts: self.starts.get(from..from.wrapping_add(self.n_points)).unwrap_or_default(),
            stride,
        });
        let n_side = self.n_side;
        let n_rows = n_side.saturating_sub(first_row);
        let rows = self.rows.iter().take(n_rows).enumerate().filter(move |(_, row)| row.most >= least);
        rows.map(move |(nth, row)| (first_row + nth, &row.sums[..n_side]))
    }
}

/// The loop over cells: where each sees the first shift.
struct Beginning<'a> {
    bounds: Bounds<'a>,
    cells: &'a [[i32; 2]],
    first: [i32; 2],
    starts: &'a mut [u32],
}

impl Work for Beginning<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let [x, y] = self.first;
        for (start, cell) in self.starts.iter_mut().zip(self.cells) {
            *start = self.bounds.start([cell[0].wrapping_add(x), cell[1].wrapping_add(y)]);
        }
    }
}

/// The loop over points: a band of rows.
struct Adding<'a> {
    /// The bounds from the first row on.
    values: &'a [u8],
    starts: &'a [u32],
    stride: usize,
}

impl Work for Adding<'_> {
    type Output = [Row; N_ROWS];

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> [Row; N_ROWS] {
        let mut so_far = [[0_u16; N_SIDE_MAX]; N_ROWS];
        // The rows are slices of one length: what lies in one lies in all, and is asked once.
        let n_values = self.values.len().saturating_sub(self.stride.wrapping_mul(N_ROWS - 1));
        let rows: [&[u8]; N_ROWS] = std::array::from_fn(|nth| {
            let values = self.values.get(nth.wrapping_mul(self.stride)..).unwrap_or_default();
            values.get(..n_values).unwrap_or_default()
        });
        for &start in self.starts {
            let start = start as usize;
            let end = start.wrapping_add(N_SIDE_MAX);
            if end > n_values {
                continue;
            }
            for (sums, values) in so_far.iter_mut().zip(rows) {
                for (sum, value) in sums.iter_mut().zip(values.get(start..end).unwrap_or_default()) {
                    *sum = sum.wrapping_add(u16::from(*value));
                }
            }
        }
        so_far.map(|sums| Row { sums, most: highest(sums) })
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
            // Two headings: of the second one all is looked at.
            let mut dense = Dense::new(bounds, n_side, &[vec![[0; 2]; cells.len()], cells.clone()].concat(), cells.len(), first);
            let bands: Vec<usize> = dense.bands().collect();
            let mut all = |least: u16| -> Vec<(usize, Vec<u16>)> {
                let of_band = |band: &usize| -> Vec<(usize, Vec<u16>)> {
                    dense.sums(1, *band, least).map(|(row, sums)| (row, sums.to_vec())).collect()
                };
                bands.iter().flat_map(of_band).collect()
            };
            let mut rows: Vec<usize> = all(0).iter().map(|(row, _)| *row).collect();
            rows.sort_unstable();
            prop_assert_eq!(rows, (0..n_side).collect::<Vec<_>>());
            let highest = all(0).iter().flat_map(|(_, row)| row).copied().max().unwrap();
            prop_assert!(all(highest).iter().any(|(_, row)| row.contains(&highest)));
            for (row, sums) in &all(0) {
                prop_assert_eq!(sums.len(), n_side);
                for (col, sum) in sums.iter().enumerate() {
                    let off = [first[0] + step * col as i32, first[1] + step * *row as i32];
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
