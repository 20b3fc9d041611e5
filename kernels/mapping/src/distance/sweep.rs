//! A row's distances from its columns', where none is far: by looking to both sides, many cells at a time.
//!
//! In squares of 16 bits that saturate, so that one instruction compares many. A cell is solved when all columns
//! were looked at that are nearer than its best. What is farther from all than 16 bits can square is left to the
//! envelope.

use std::ops::Range;

use crate::isa::{Isa, Work};

/// Columns looked at to either side before cells are given up: their squares are below 2¹⁶.
const REACH: usize = 248;
/// After so many columns it is asked whether they were enough.
const STRIDE: usize = 8;
/// Cells solved at a time.
const N_CHUNK: usize = 32;
/// Cells that can matter to those.
const N_WINDOW: usize = N_CHUNK + 2 * REACH;

/// Scratch space for the rows of a grid.
#[derive(Clone, Debug)]
pub(super) struct Sweep {
    isa: Isa,
    /// Squared distances in the columns, of free and of occupied cells; the other kind has 0. With a border.
    lifts: [Vec<u16>; 2],
}

impl Sweep {
    pub(super) fn new(n_cols: usize) -> Self {
        let lifts = vec![u16::MAX; n_cols + 2 * REACH + N_CHUNK];
        Sweep { isa: Isa::detect(), lifts: [lifts.clone(), lifts] }
    }

    /// Takes in a row, or so much of one as can matter: which of its cells are occupied, and each one's distance to the
    /// other kind in its column. No longer than the rows that it was made for.
    pub(super) fn load(&mut self, occupied: &[bool], nearest: &[u16]) {
        let (n, [of_free, of_occupied]) = (occupied.len(), &mut self.lifts);
        for lifts in [&mut *of_free, of_occupied] {
            lifts[REACH + n..2 * REACH + n + N_CHUNK].fill(u16::MAX);
        }
        let (of_free, of_occupied) = (&mut of_free[REACH..REACH + n], &mut of_occupied[REACH..REACH + n]);
        self.isa.run(Row { occupied, nearest, of_free, of_occupied });
    }

    /// Writes the squared distances of the cells in `span` of the row that was taken in; returns the first column that is
    /// too far from all to be solved, or the span's end.
    pub(super) fn solve(
        &self,
        span: Range<usize>,
        occupied: &[bool],
        side: Side,
        squared: &mut [f32],
    ) -> usize {
        let [of_free, of_occupied] = &self.lifts;
        let cells = Cells {
            of_free: &of_free[span.start..],
            of_occupied: &of_occupied[span.start..],
            occupied: &occupied[span.clone()],
            side,
            squared: &mut squared[span.clone()],
        };
        span.start + self.isa.run(cells)
    }
}

/// Whose distances to the other kind are wanted; the others' are 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    /// Those of free cells.
    Free,
    /// Those of occupied cells.
    Occupied,
    /// Each cell's.
    Both,
}

impl Side {
    /// Whether the distances of a kind are wanted.
    #[inline(always)]
    pub(super) fn is_of(self, is_occupied: bool) -> bool {
        self == Side::Both || (self == Side::Occupied) == is_occupied
    }
}

/// A row's distances in the columns, to be squared.
struct Row<'a> {
    occupied: &'a [bool],
    nearest: &'a [u16],
    of_free: &'a mut [u16],
    of_occupied: &'a mut [u16],
}

impl Work for Row<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let lifts = self.of_free.iter_mut().zip(self.of_occupied);
        for (((of_free, of_occupied), occupied), nearest) in lifts.zip(self.occupied).zip(self.nearest) {
            // Too far, or nothing there: beyond any reach.
            let square = if *nearest > 255 { u16::MAX } else { nearest.wrapping_mul(*nearest) };
            *of_free = if *occupied { 0 } else { square };
            *of_occupied = if *occupied { square } else { 0 };
        }
    }
}

/// Cells of a row: the lifts from `REACH` cells before them on, and where their distances go.
struct Cells<'a> {
    of_free: &'a [u16],
    of_occupied: &'a [u16],
    occupied: &'a [bool],
    side: Side,
    squared: &'a mut [f32],
}

impl Work for Cells<'_> {
    type Output = usize;

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> usize {
        let mut n_done = 0;
        for (squared, occupied) in self.squared.chunks_mut(N_CHUNK).zip(self.occupied.chunks(N_CHUNK)) {
            let n_occupied = occupied.iter().map(|occupied| u8::from(*occupied)).sum::<u8>();
            let mut best = [0; N_CHUNK];
            // A cell is at 0 from its own kind: of both distances the larger is the one across the border.
            if usize::from(n_occupied) < occupied.len() && self.side.is_of(false) {
                let Some(of_free) = solve_chunk(&self.of_free[n_done..], squared.len()) else { break };
                best = of_free;
            }
            if n_occupied > 0 && self.side.is_of(true) {
                let Some(of_occupied) = solve_chunk(&self.of_occupied[n_done..], squared.len()) else {
                    break;
                };
                best.iter_mut().zip(of_occupied).for_each(|(best, other)| *best = other.max(*best));
            }
            if let Some(squared) = squared.first_chunk_mut::<N_CHUNK>() {
                squared.iter_mut().zip(best).for_each(|(squared, best)| *squared = f32::from(best));
            } else {
                squared.iter_mut().zip(best).for_each(|(squared, best)| *squared = f32::from(best));
            }
            n_done += squared.len();
        }
        n_done
    }
}

/// Squares of `N_CHUNK` cells, of which the first `n` count; `None` when they are not all solved.
#[inline(always)]
fn solve_chunk(lifts: &[u16], n: usize) -> Option<[u16; N_CHUNK]> {
    let lifts = lifts.first_chunk::<N_WINDOW>()?;
    let mut counts = [0_u16; N_CHUNK];
    counts.iter_mut().take(n).for_each(|counts| *counts = u16::MAX);
    let mut best = *lifts[REACH..].first_chunk::<N_CHUNK>()?;
    for nth in 0..=REACH / STRIDE {
        let done = nth * STRIDE;
        // No column that is farther than those looked at is nearer than this.
        let across = ((done + 1) * (done + 1)) as u16;
        let is_open =
            best.iter().zip(&counts).fold(false, |any, (best, counts)| any | (best & counts > across));
        if !is_open {
            return Some(best);
        }
        if nth < REACH / STRIDE {
            let before = lifts[REACH - done - STRIDE..].first_chunk::<{ N_CHUNK + STRIDE }>()?;
            let after = lifts[REACH + done + 1..].first_chunk::<{ N_CHUNK + STRIDE - 1 }>()?;
            for cell in 0..N_CHUNK {
                let mut least = best[cell];
                for off in 0..STRIDE {
                    let across = ((done + off + 1) * (done + off + 1)) as u16;
                    let nearer = before[cell + STRIDE - 1 - off].min(after[cell + off]);
                    least = least.min(nearer.saturating_add(across));
                }
                best[cell] = least;
            }
        }
    }
    None
}
