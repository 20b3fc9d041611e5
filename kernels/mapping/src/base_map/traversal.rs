//! The cells under a straight line.

use geometry::Point2;

use crate::grid::{Cell, Layout, Shape};

/// The cells a straight line passes, in order, without the one it ends in (Amanatides & Woo 1987).
pub(super) struct Traversal {
    at: [i64; 2],
    step: [i64; 2],
    /// Share of the line at which the next border is crossed, by axis, and from one border to the next.
    next: [f64; 2],
    each: [f64; 2],
    n_left: i64,
    shape: Shape,
}

impl Traversal {
    /// Both ends must lie in the grid.
    pub(super) fn new(layout: &Layout, from: Point2, to: Point2) -> Self {
        let (a, b) =
            ((from - layout.origin) / layout.resolution_m, (to - layout.origin) / layout.resolution_m);
        let (mut at, mut step, mut next, mut each) = ([0; 2], [0; 2], [f64::INFINITY; 2], [f64::INFINITY; 2]);
        let mut n_left = 0;
        for axis in 0..2 {
            at[axis] = a[axis].floor() as i64;
            let along = b[axis] - a[axis];
            n_left += (b[axis].floor() as i64 - at[axis]).abs();
            step[axis] = if along > 0.0 { 1 } else { -1 };
            if along != 0.0 {
                let border = if along > 0.0 { a[axis].floor() + 1.0 } else { a[axis].floor() };
                next[axis] = (border - a[axis]) / along;
                each[axis] = 1.0 / along.abs();
            }
        }
        Traversal { at, step, next, each, n_left, shape: layout.shape }
    }
}

impl Iterator for Traversal {
    type Item = Cell;

    fn next(&mut self) -> Option<Cell> {
        if self.n_left <= 0 {
            return None;
        }
        self.n_left -= 1;
        let here = Cell { col: usize::try_from(self.at[0]).ok()?, row: usize::try_from(self.at[1]).ok()? };
        let axis = usize::from(self.next[1] < self.next[0]);
        self.at[axis] += self.step[axis];
        self.next[axis] += self.each[axis];
        (here.col < self.shape.n_cols && here.row < self.shape.n_rows).then_some(here)
    }
}
