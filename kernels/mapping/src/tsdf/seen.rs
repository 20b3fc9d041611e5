//! What a frame shows of the object: the depth of its mask that can be trusted, found once for all voxels that ask.
//!
//! Nearly every pixel is told by whole numbers in loops over rows, which compilers turn into vectors: no neighbour is
//! far enough off to be an edge, no border of the mask is near. The few others are asked one by one
//! ([`TrustedDepth`]); the result is the same as if all were.

use std::ops::Range;

use crate::image::DepthFrame;
use crate::isa::Work;
use crate::projection::{DepthLimits, TrustedDepth};

/// Trusted depth in the box around a mask, row by row.
#[derive(Clone, Default)]
pub(super) struct Seen {
    first: [usize; 2],
    /// Columns and rows of the box.
    size: [usize; 2],
    /// Millimetres; 0 is not in the mask or not trusted. One more than pixels: that of no pixel, 0.
    depth_mm: Vec<u16>,
}

impl Seen {
    /// First column and row of the box, and one past the last.
    pub(super) fn bounds(&self) -> (Range<usize>, Range<usize>) {
        let range = |axis: usize| self.first[axis]..self.first[axis] + self.size[axis];
        (range(0), range(1))
    }

    /// First column and row of the box.
    pub(super) fn first(&self) -> [i32; 2] {
        self.first.map(|first| first as i32)
    }

    /// Number of columns and rows of the box.
    pub(super) fn size(&self) -> [u32; 2] {
        self.size.map(|size| size as u32)
    }

    /// All pixels of the box, row by row, and that of no pixel.
    pub(super) fn all_mm(&self) -> &[u16] {
        &self.depth_mm
    }

    /// The pixels of the box in a row of the image.
    #[inline(always)]
    pub(super) fn row(&self, row: usize) -> &[u16] {
        let start = row.wrapping_sub(self.first[1]).wrapping_mul(self.size[0]);
        self.depth_mm.get(start..start.wrapping_add(self.size[0])).unwrap_or(&[])
    }

    /// Depth at a pixel of the image, millimetres; 0 where none is to be trusted.
    #[inline(always)]
    pub(super) fn at(&self, col: usize, row: usize) -> u16 {
        let (col, row) = (col.wrapping_sub(self.first[0]), row.wrapping_sub(self.first[1]));
        if col >= self.size[0] || row >= self.size[1] {
            return 0;
        }
        self.depth_mm.get(row * self.size[0] + col).copied().unwrap_or(0)
    }
}

/// The finding of what is seen, into what was seen before: its space is used again.
pub(super) struct Sift<'w, 'a> {
    frame: &'w DepthFrame<'a>,
    trusted: &'w TrustedDepth<'a>,
    mask: Option<&'w [bool]>,
    seen: &'w mut Seen,
    limits: Limits,
}

/// What whole numbers tell.
#[derive(Clone, Copy)]
struct Limits {
    /// Least and greatest depth in range, millimetres.
    range_mm: [u32; 2],
    /// Neighbours that are less than this share of depth off, in 1/65536, are no edge.
    share: u32,
    /// How far the mask's border reaches, pixels; nothing where edges are not asked for.
    reach: usize,
    has_edges: bool,
}

impl Limits {
    fn new(limits: &DepthLimits) -> Self {
        let (min_m, max_m) = (limits.min_m as f32, limits.max_m as f32);
        // What compares as out of range is: NaN limits nothing. Zero is no depth.
        let least = first_mm(|depth_m| depth_m >= min_m || min_m.is_nan()).max(1);
        let past = first_mm(|depth_m| depth_m > max_m);
        let has_edges = limits.edge_relative.is_finite();
        Limits {
            range_mm: [least, past - 1],
            // A little less than the limit itself: what is close to it is asked with care.
            share: (limits.edge_relative.clamp(0.0, 0.99) * 0.998 * 65_536.0) as u32,
            reach: if has_edges { limits.erode_px } else { 0 },
            has_edges,
        }
    }
}

/// The least whole number of millimetres, from 1 to one more than there can be, of which something holds in metres that
/// holds of all above.
fn first_mm(holds: impl Fn(f32) -> bool) -> u32 {
    let (mut low, mut high) = (1, u32::from(u16::MAX) + 1);
    while low < high {
        let middle = (low + high) / 2;
        if holds(middle as f32 * 0.001) {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    low
}

impl<'w, 'a> Sift<'w, 'a> {
    /// The mask is that of `trusted`.
    pub(super) fn new(
        frame: &'w DepthFrame<'a>,
        trusted: &'w TrustedDepth<'a>,
        mask: Option<&'w [bool]>,
        limits: &DepthLimits,
        seen: &'w mut Seen,
    ) -> Self {
        Sift { frame, trusted, mask, seen, limits: Limits::new(limits) }
    }
}

impl Work for Sift<'_, '_> {
    type Output = ();

    // Never fused: every instruction set computes the same.
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let (cols, rows) = self.trusted.bounds();
        let n_cols = cols.len();
        self.seen.first = [cols.start, rows.start];
        self.seen.size = [n_cols, rows.len()];
        // What was there is overwritten row by row.
        self.seen.depth_mm.resize(n_cols * rows.len() + 1, 0);
        if let Some(last) = self.seen.depth_mm.last_mut() {
            *last = 0;
        }
        let mut doubted = vec![0_u8; n_cols];
        for (row, out) in rows.zip(self.seen.depth_mm.chunks_exact_mut(n_cols.max(1))) {
            doubted.fill(1);
            look_at_row(self.frame, self.limits, (&cols, row), out, &mut doubted);
            if let Some(mask) = self.mask {
                let width = self.trusted.width();
                keep_masked(mask, width, self.limits, (&cols, row), out, &mut doubted);
            }
            if self.limits.has_edges {
                settle(self.trusted, (cols.start, row), out, &doubted);
            }
        }
    }
}

/// Depth of a row that is in range, and where it may be an edge; doubt is left where it is at the image's border.
#[inline(always)]
fn look_at_row(
    frame: &DepthFrame<'_>,
    limits: Limits,
    (cols, row): (&Range<usize>, usize),
    out: &mut [u16],
    doubted: &mut [u8],
) {
    let (width, height) = (frame.depth().width() as usize, frame.depth().height() as usize);
    let depth_mm = frame.depth().depth_mm();
    let line = |row: usize, off: usize| depth_mm.get(row * width + off..).unwrap_or(&[]);
    let [least, most] = limits.range_mm;
    let in_range = |mm: u16| {
        let is_in = (u32::from(mm) >= least) & (u32::from(mm) <= most);
        if is_in { mm } else { 0 }
    };
    for (out, mm) in out.iter_mut().zip(line(row, cols.start)) {
        *out = in_range(*mm);
    }
    let (first, end) = (cols.start.max(1), cols.end.min(width - 1));
    if row == 0 || row + 1 >= height || first >= end {
        return;
    }
    let n = end - first;
    let around = [line(row, first - 1), line(row, first + 1), line(row - 1, first), line(row + 1, first)];
    let [Some(left), Some(right), Some(up), Some(down)] = around.map(|line| line.get(..n)) else { return };
    let Some(here) = line(row, first).get(..n) else { return };
    let Some(doubted) = doubted.get_mut(first - cols.start..).and_then(|rest| rest.get_mut(..n)) else {
        return;
    };
    for n in 0..n {
        let here = here[n];
        let off = |other: u16| if other > 0 { other.abs_diff(here) } else { 0 };
        let farthest = off(left[n]).max(off(right[n])).max(off(up[n]).max(off(down[n])));
        let limit = (u32::from(here).wrapping_mul(limits.share) >> 16) as u16;
        doubted[n] = u8::from((farthest > limit) & (here > 0));
    }
}

/// Leaves nothing beside the mask, and doubts what is near its border.
#[inline(always)]
fn keep_masked(
    mask: &[bool],
    width: usize,
    limits: Limits,
    (cols, row): (&Range<usize>, usize),
    out: &mut [u16],
    doubted: &mut [u8],
) {
    let reach = limits.reach;
    let line = |row: usize, off: usize| mask.get(row * width + off..).unwrap_or(&[]);
    let height = mask.len() / width.max(1);
    for (out, in_mask) in out.iter_mut().zip(line(row, cols.start)) {
        *out = if *in_mask { *out } else { 0 };
    }
    let (first, end) = (cols.start.max(reach), cols.end.min(width.saturating_sub(reach)));
    if row < reach || row + reach >= height || first >= end {
        doubted.fill(1);
        return;
    }
    let (inside_from, n) = (first - cols.start, end - first);
    doubted.iter_mut().take(inside_from).for_each(|doubted| *doubted = 1);
    doubted.iter_mut().skip(inside_from + n).for_each(|doubted| *doubted = 1);
    for off in 1..=reach {
        let around =
            [line(row, first - off), line(row, first + off), line(row - off, first), line(row + off, first)];
        for (doubted, ((left, right), (up, down))) in doubted
            .iter_mut()
            .skip(inside_from)
            .take(n)
            .zip(around[0].iter().zip(around[1]).zip(around[2].iter().zip(around[3])))
        {
            *doubted |= u8::from(!(*left & *right & *up & *down));
        }
    }
}

/// Asks doubted pixels of a row with care.
#[inline(always)]
fn settle(trusted: &TrustedDepth<'_>, (first_col, row): (usize, usize), out: &mut [u16], doubted: &[u8]) {
    /// So many at once are mostly all beyond doubt.
    const AT_ONCE: usize = 16;
    for (nth, (out, doubted)) in out.chunks_mut(AT_ONCE).zip(doubted.chunks(AT_ONCE)).enumerate() {
        if <&[u8; AT_ONCE]>::try_from(doubted).is_ok_and(|doubted| *doubted == [0; AT_ONCE]) {
            continue;
        }
        for (off, (out, doubted)) in out.iter_mut().zip(doubted).enumerate() {
            if *doubted > 0 && *out > 0 && trusted.at(first_col + nth * AT_ONCE + off, row).is_none() {
                *out = 0;
            }
        }
    }
}
