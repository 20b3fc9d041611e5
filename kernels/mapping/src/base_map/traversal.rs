//! The cells under a straight line.

use geometry::Point2;

use crate::grid::Layout;

/// The cells a straight line passes, in order, without the one it ends in, as positions in row-major order
/// (Amanatides & Woo 1987).
pub(super) struct Traversal {
    at: usize,
    /// To the next cell along each axis; wraps for a step back.
    step: [usize; 2],
    /// Share of the line at which the next border is crossed, by axis, and from one border to the next.
    next: [f64; 2],
    each: [f64; 2],
    /// Borders left to cross, by axis.
    n_left: [u32; 2],
}

impl Traversal {
    /// Both ends must lie in the grid.
    pub(super) fn new(layout: &Layout, from: Point2, to: Point2) -> Self {
        let (a, b) =
            ((from - layout.origin) / layout.resolution_m, (to - layout.origin) / layout.resolution_m);
        let (mut next, mut each) = ([f64::INFINITY; 2], [f64::INFINITY; 2]);
        let (mut step, mut n_left) = ([0; 2], [0; 2]);
        let stride = [1, layout.shape.n_cols];
        for axis in 0..2 {
            let (first, last) = (a[axis].floor(), b[axis].floor());
            let along = b[axis] - a[axis];
            n_left[axis] = (last - first).abs() as u32;
            step[axis] = if along > 0.0 { stride[axis] } else { stride[axis].wrapping_neg() };
            if along != 0.0 {
                let border = if along > 0.0 { first + 1.0 } else { first };
                next[axis] = (border - a[axis]) / along;
                each[axis] = 1.0 / along.abs();
            }
        }
        let at = a[1].floor().max(0.0) as usize * layout.shape.n_cols + a[0].floor().max(0.0) as usize;
        Traversal { at, step, next, each, n_left }
    }
}

impl Iterator for Traversal {
    type Item = usize;

    #[inline]
    fn next(&mut self) -> Option<usize> {
        let here = self.at;
        // Neither axis is followed beyond the line's end, whatever rounding says of the order of borders.
        let axis = match self.n_left {
            [0, 0] => return None,
            [_, 0] => 0,
            [0, _] => 1,
            _ => usize::from(self.next[1] < self.next[0]),
        };
        self.n_left[axis] -= 1;
        self.at = here.wrapping_add(self.step[axis]);
        self.next[axis] += self.each[axis];
        Some(here)
    }
}
