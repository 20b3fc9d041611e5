//! A row's distances from its columns', where none is far: by looking to both sides, many cells at a time.
//!
//! In squares of 16 bits that saturate, so that one instruction compares many. A cell is solved when all columns
//! were looked at that are nearer than its best. What is farther from all than 16 bits can square is left to the
//! envelope, and for some rows so are long runs after one that was.

use std::ops::Range;

use crate::isa::{Isa, Work};

/// Columns looked at to either side before a run is given up: their squares are below 2¹⁶.
const REACH: usize = 248;
/// After so many columns it is asked whether they were enough.
const STRIDE: usize = 8;
/// Cells solved at a time.
const N_CHUNK: usize = 32;
/// Rows that go to the envelope at once after one that had to.
const N_ROWS_OPEN: u32 = 8;

/// Scratch space for the rows of a grid.
#[derive(Clone, Debug)]
pub(super) struct Sweep {
    isa: Isa,
    /// Squared distances in the columns, of free and of occupied cells; the other kind has 0. With a border.
    lifts: [Vec<u16>; 2],
    /// Rows for which long runs are still left to the envelope.
    n_open: u32,
}

impl Sweep {
    pub(super) fn new(n_cols: usize) -> Self {
        let lifts = vec![u16::MAX; n_cols + 2 * REACH + N_CHUNK];
        Sweep { isa: Isa::detect(), lifts: [lifts.clone(), lifts], n_open: 0 }
    }

    /// Takes in a row: which cells are occupied, and each one's distance to the other kind in its column.
    pub(super) fn load(&mut self, occupied: &[bool], nearest: &[u16]) {
        self.n_open = self.n_open.saturating_sub(1);
        self.load_around(0..occupied.len(), occupied, nearest);
    }

    /// Takes in what cells in `span` of a row depend on.
    pub(super) fn load_around(&mut self, span: Range<usize>, occupied: &[bool], nearest: &[u16]) {
        let first = span.start.saturating_sub(REACH);
        let last = (span.end + REACH + N_CHUNK).min(occupied.len());
        let [of_free, of_occupied] = &mut self.lifts;
        let kept = REACH + first..REACH + last;
        let (of_free, of_occupied) = (&mut of_free[kept.clone()], &mut of_occupied[kept]);
        let row =
            Row { occupied: &occupied[first..last], nearest: &nearest[first..last], of_free, of_occupied };
        self.isa.run(row);
    }

    /// Writes the squared distances of equal cells in a row that was taken in around them; false when they are not
    /// solved.
    pub(super) fn solve_part(&self, part: Range<usize>, is_occupied: bool, squared: &mut [f32]) -> bool {
        let lifts = &self.lifts[usize::from(is_occupied)][part.start..];
        self.isa.run(Run { lifts, squared })
    }

    /// Writes the squared distances of a run of equal cells; false when it is not solved.
    pub(super) fn solve_run(&mut self, run: Range<usize>, is_occupied: bool, squared: &mut [f32]) -> bool {
        let is_long = run.len() > N_CHUNK;
        if is_long && self.n_open > 0 {
            return false;
        }
        let is_solved = self.solve_part(run.clone(), is_occupied, &mut squared[run]);
        if !is_solved {
            self.n_open = N_ROWS_OPEN;
        }
        is_solved
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

/// One run: the lifts from `REACH` cells before it on, and where its distances go.
struct Run<'a> {
    lifts: &'a [u16],
    squared: &'a mut [f32],
}

impl Work for Run<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> bool {
        for (nth, squared) in self.squared.chunks_mut(N_CHUNK).enumerate() {
            let Some(best) = solve_chunk(&self.lifts[nth * N_CHUNK..], squared.len()) else { return false };
            for (squared, best) in squared.iter_mut().zip(best) {
                *squared = f32::from(best);
            }
        }
        true
    }
}

/// Squares of `N_CHUNK` cells, of which the first `n` count; `None` when they are not all solved.
#[inline(always)]
fn solve_chunk(lifts: &[u16], n: usize) -> Option<[u16; N_CHUNK]> {
    let window = |first: usize| lifts.get(first..first + N_CHUNK)?.first_chunk::<N_CHUNK>();
    let mut counts = [0_u16; N_CHUNK];
    counts.iter_mut().take(n).for_each(|counts| *counts = u16::MAX);
    let mut best = *window(REACH)?;
    let mut off = 1;
    loop {
        let farthest = best.iter().zip(&counts).fold(0, |most: u16, (best, counts)| most.max(best & counts));
        if off * off >= usize::from(farthest) {
            return Some(best);
        }
        if off >= REACH {
            return None;
        }
        for off in off..off + STRIDE {
            let across = (off * off) as u16;
            let (before, after) = (window(REACH - off)?, window(REACH + off)?);
            for nth in 0..N_CHUNK {
                let nearer = before[nth].min(after[nth]).saturating_add(across);
                best[nth] = best[nth].min(nearer);
            }
        }
        off += STRIDE;
    }
}
