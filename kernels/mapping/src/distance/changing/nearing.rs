//! Cells that can only have come nearer to the other kind: as near as they were, or as near as they are to what is new.

use super::super::{NONE, Scale};
use crate::isa::Work;

/// Cells at a time.
pub(super) const N_CHUNK: usize = 32;
/// Distances whose squares are below 2¹⁶, cells: one instruction takes twice as many of them.
const NEAR: usize = 256;
/// The square of a distance that there is not; sums with it do not overflow.
const FAR: i32 = 1 << 29;

/// Squares of how far cells beside each other are from a column, which is as many cells after the first as the first entry
/// is before the `CENTRE`.
static SQUARES: [u16; 2 * CENTRE] = squares();
const CENTRE: usize = NEAR + N_CHUNK;

const fn squares() -> [u16; 2 * CENTRE] {
    let mut squares = [u16::MAX; 2 * CENTRE];
    let mut off = 0;
    while off < NEAR {
        squares[CENTRE - off] = (off * off) as u16;
        squares[CENTRE + off] = (off * off) as u16;
        off += 1;
    }
    squares
}

/// Cells of a row that are brought nearer to cells that became the other kind.
pub(super) struct Nearing<'a> {
    pub(super) scale: Scale,
    /// The kind that there is more of.
    pub(super) to_occupied: bool,
    /// For some columns, from the first on, how many rows off the nearest such cell is.
    pub(super) lifts: &'a [u16],
    pub(super) first_lift: usize,
    /// Which cells are occupied, from the first on, and their values.
    pub(super) kinds: &'a [bool],
    pub(super) first: usize,
    pub(super) values: &'a mut [f32],
}

impl Work for Nearing<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Nearing { values, kinds, first, .. } = self;
        let (chunks, rest) = values.as_chunks_mut::<N_CHUNK>();
        let (chunks_kinds, rest_kinds) = kinds.as_chunks::<N_CHUNK>();
        let lifts = Lifts { lifts: self.lifts, first: self.first_lift };
        let to = (self.scale, self.to_occupied);
        let mut col = first;
        for (values, kinds) in chunks.iter_mut().zip(chunks_kinds) {
            lifts.bring_near(col, kinds, values, to);
            col += N_CHUNK;
        }
        for (col, (value, kind)) in (col..).zip(rest.iter_mut().zip(rest_kinds)) {
            lifts.bring_near(col, &[*kind], std::array::from_mut(value), to);
        }
    }
}

/// Of some columns, from the first on, how many rows off something is.
struct Lifts<'a> {
    lifts: &'a [u16],
    first: usize,
}

impl Lifts<'_> {
    /// Brings cells from a column on nearer to it, the kind that it is of aside.
    #[inline(always)]
    fn bring_near<const N: usize>(
        &self,
        col: usize,
        kinds: &[bool; N],
        values: &mut [f32; N],
        (scale, to_occupied): (Scale, bool),
    ) {
        // As whole numbers: the largest of many floats would be looked for one by one.
        let farthest = values.iter().fold(0, |most: u32, value| most.max(value.abs().to_bits()));
        // One cell for what was read back, one for rounding down.
        let reach = (scale.cells_of(f32::from_bits(farthest)) as usize).saturating_add(2);
        let squared: [_; N] = if reach < NEAR { self.near(col, reach) } else { self.squared(col, reach) };
        for ((value, kind), squared) in values.iter_mut().zip(kinds).zip(squared) {
            let near_m = scale.signed_m(squared as f32, !to_occupied);
            let nearer_m = if to_occupied { value.min(near_m) } else { value.max(near_m) };
            *value = if *kind == to_occupied { *value } else { nearer_m };
        }
    }

    /// The columns that cells from one on can reach: the first one, and its lift and those after it.
    #[inline(always)]
    fn within(&self, col: usize, n: usize, reach: usize) -> (usize, &[u16]) {
        let begin = col.saturating_sub(reach).saturating_sub(self.first).min(self.lifts.len());
        let end = reach.saturating_add(col + n).saturating_sub(self.first).clamp(begin, self.lifts.len());
        (self.first + begin, &self.lifts[begin..end])
    }

    /// Squared distances of cells from a column on, as far as that is within a reach below `NEAR`.
    #[inline(always)]
    fn near<const N: usize>(&self, col: usize, reach: usize) -> [i32; N] {
        let (first, lifts) = self.within(col, N, reach);
        let mut best = [u16::MAX; N];
        for (other, rows) in (first..).zip(lifts) {
            let lift = if usize::from(*rows) < NEAR { rows.wrapping_mul(*rows) } else { u16::MAX };
            if let Some(across) = SQUARES[CENTRE + col - other..].first_chunk::<N>() {
                for (best, across) in best.iter_mut().zip(across) {
                    *best = across.saturating_add(lift).min(*best);
                }
            }
        }
        best.map(i32::from)
    }

    /// Squared distances of cells from a column on, as far as that is within reach.
    #[inline(always)]
    fn squared<const N: usize>(&self, col: usize, reach: usize) -> [i32; N] {
        let (first, lifts) = self.within(col, N, reach);
        let mut best = [FAR; N];
        // Squares of how far each cell is from a column, and by what they change to the next column.
        let (mut across, mut change) = ([0_i32; N], [0_i32; N]);
        for cell in 0..N {
            let off = (col + cell) as i32 - first as i32;
            across[cell] = off.wrapping_mul(off);
            change[cell] = 1_i32.wrapping_sub(off.wrapping_mul(2));
        }
        for rows in lifts {
            let lift = if *rows == NONE { FAR } else { i32::from(*rows).wrapping_mul(i32::from(*rows)) };
            for cell in 0..N {
                best[cell] = best[cell].min(across[cell].wrapping_add(lift));
                across[cell] = across[cell].wrapping_add(change[cell]);
                change[cell] = change[cell].wrapping_add(2);
            }
        }
        best
    }
}
