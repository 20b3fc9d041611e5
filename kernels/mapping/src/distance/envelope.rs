//! A row's distances from its columns', as the lower envelope of parabolas: linear, however far they are.
//!
//! No sum leaves the 31 bits of the largest grid; the inner loops do without the checks for it.

use super::NONE;

/// One parabola of an envelope.
#[derive(Clone, Copy, Debug)]
struct Parabola {
    /// Its column.
    col: i32,
    /// Its value there, cells².
    lift: i32,
    /// First column where it is the lowest.
    from: i32,
}

/// Scratch space for lower envelopes along rows.
#[derive(Clone, Debug)]
pub(super) struct Envelope {
    parabolas: Vec<Parabola>,
    /// 1 / 2n: a multiplication instead of a division for each intersection.
    half_inverse: Vec<f64>,
}

impl Envelope {
    pub(super) fn new(n_cols: usize) -> Self {
        let half_inverse = (0..n_cols + 2).map(|n| 0.5 / n.max(1) as f64).collect();
        Envelope { parabolas: Vec::with_capacity(n_cols + 2), half_inverse }
    }

    /// Writes the squared distances of the run of equal cells that begins at `first`.
    pub(super) fn solve_run(&mut self, first: usize, n: usize, nearest: &[u16], squared: &mut [f32]) {
        let end = first + n;
        let (is_closed_left, is_closed_right) = (first > 0, end < squared.len());
        if n <= 2 && is_closed_left && is_closed_right {
            // Every cell has the other kind beside it.
            squared[first..end].fill(1.0);
            return;
        }
        let run = (first as i32, end as i32);
        self.parabolas.clear();
        if is_closed_left {
            self.push(run.0 - 1, 0, run);
        }
        for (col, &rows) in (run.0..).zip(&nearest[first..end]) {
            if rows != NONE {
                self.push(col, i32::from(rows) * i32::from(rows), run);
            }
        }
        if is_closed_right {
            self.push(run.1, 0, run);
        }
        self.write(run, squared);
    }

    /// Adds a parabola to the right of all others, unless it is nowhere lowest in the run.
    #[inline]
    fn push(&mut self, col: i32, lift: i32, (first, end): (i32, i32)) {
        let mut from = first;
        while let Some(last) = self.parabolas.last() {
            let (off, last_off) = (last.from - col, last.from - last.col);
            if off.wrapping_mul(off).wrapping_add(lift)
                > last_off.wrapping_mul(last_off).wrapping_add(last.lift)
            {
                // The last one keeps its beginning. Exact: a crossing that is not a whole number is at
                // least 1/2n away from one, far more than f64 rounds; at a whole number both parabolas
                // are equal and either may have the column. It lies right of the beginning, so it is
                // positive and rounds down by truncation.
                let rise = (lift - last.lift).wrapping_add((col + last.col).wrapping_mul(col - last.col));
                from = (f64::from(rise) * self.half_inverse[(col - last.col) as usize]) as i32 + 1;
                break;
            }
            self.parabolas.pop();
        }
        if from < end {
            self.parabolas.push(Parabola { col, lift, from });
        }
    }

    /// Evaluates the envelope over the run.
    fn write(&self, (first, end): (i32, i32), squared: &mut [f32]) {
        let mut rest = &mut squared[first as usize..end as usize];
        if self.parabolas.is_empty() {
            rest.fill(f32::INFINITY);
            return;
        }
        for (idx, parabola) in self.parabolas.iter().enumerate() {
            let until = self.parabolas.get(idx + 1).map_or(end, |next| next.from);
            let (own, after) = rest.split_at_mut((until - parabola.from) as usize);
            let off = parabola.from - parabola.col;
            // (off + 1)² = off² + (2·off + 1): no product, and none that a check could keep from the
            // inner loop. All stay below 2³¹ for the largest grid.
            let (mut value, mut rise) = (off * off + parabola.lift, 2 * off + 1);
            for out in own {
                *out = value as f32;
                value = value.wrapping_add(rise);
                rise = rise.wrapping_add(2);
            }
            rest = after;
        }
    }
}
