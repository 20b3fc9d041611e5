//! What a frame shows of the object: the depth of its mask that can be trusted, found once for all voxels that ask.
//!
//! Nearly every pixel is told by whole numbers in loops over some in line, which compilers turn into vectors: no
//! neighbour is far enough off to be an edge, and it is not at the mask's border or nothing nearer is beside it. The few
//! others are asked one by one ([`TrustedDepth`]); the result is the same as if all were.

use std::ops::Range;

use crate::image::DepthFrame;
use crate::isa::Work;
use crate::projection::{DepthLimits, LEAK, TrustedDepth};

/// Pixels that are looked at at once: a vector of the widest instructions.
const LANES: usize = 32;

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
        let line = Line { frame: self.frame, trusted: self.trusted, mask: self.mask, limits: self.limits };
        for (row, out) in rows.zip(self.seen.depth_mm.chunks_exact_mut(n_cols.max(1))) {
            line.look(row, cols.start, out);
        }
    }
}

/// Pixels of a row.
type Lanes<T> = [T; LANES];

/// How rows of a frame are looked at.
struct Line<'w, 'a> {
    frame: &'w DepthFrame<'a>,
    trusted: &'w TrustedDepth<'a>,
    mask: Option<&'w [bool]>,
    limits: Limits,
}

impl Line<'_, '_> {
    /// Writes what is seen in a row, from a column on.
    #[inline(always)]
    fn look(&self, row: usize, first_col: usize, out: &mut [u16]) {
        for (nth, out) in out.chunks_mut(LANES).enumerate() {
            let col = first_col + nth * LANES;
            // The last pixels of a row are looked at with those before them.
            let from = col.min(self.trusted.width().saturating_sub(LANES));
            let Some((mut seen_mm, doubted)) = self.look_at(from, row) else {
                self.look_with_care((col, row), out);
                continue;
            };
            self.settle((from, row), &mut seen_mm, &doubted);
            if let Ok(out) = <&mut Lanes<u16>>::try_from(&mut *out) {
                *out = seen_mm;
            } else if let Some(seen_mm) = seen_mm.get(col - from..col - from + out.len()) {
                out.copy_from_slice(seen_mm);
            }
        }
    }

    /// Depth of some pixels in line that is in range and in the mask, millimetres, and which of them are doubted; nothing
    /// where the image has no rows to compare them with, or is narrower than they are. At an image's sides they are compared
    /// with the end of another row as well: that can but add doubts.
    #[inline(always)]
    fn look_at(&self, col: usize, row: usize) -> Option<(Lanes<u16>, Lanes<bool>)> {
        let Limits { range_mm: [least, most], share, has_edges, .. } = self.limits;
        let (width, depth_mm) = (self.trusted.width(), self.frame.depth().depth_mm());
        if width < LANES {
            return None;
        }
        let start = row * width + col;
        let here = lanes(depth_mm, start)?;
        let mut seen_mm = [0; LANES];
        for n in 0..LANES {
            let is_in = (u32::from(here[n]) >= least) & (u32::from(here[n]) <= most);
            seen_mm[n] = if is_in { here[n] } else { 0 };
        }
        if let Some(mask) = self.mask {
            let in_mask = lanes(mask, start)?;
            for n in 0..LANES {
                seen_mm[n] = if in_mask[n] { seen_mm[n] } else { 0 };
            }
        }
        let mut doubted = [false; LANES];
        if !has_edges {
            return Some((seen_mm, doubted));
        }
        let around = around(depth_mm, start, width, 1)?;
        for n in 0..LANES {
            let off = |other: u16| if other > 0 { other.abs_diff(here[n]) } else { 0 };
            let farthest = around.iter().fold(0, |farthest, there| off(there[n]).max(farthest));
            let limit = (u32::from(here[n]).wrapping_mul(share) >> 16) as u16;
            doubted[n] = farthest > limit;
        }
        if let Some(mask) = self.mask {
            self.doubt_border(mask, start, &mut doubted)?;
        }
        Some((seen_mm, doubted))
    }

    /// Doubts pixels at the mask's border beside which something may be nearer.
    #[inline(always)]
    fn doubt_border(&self, mask: &[bool], start: usize, doubted: &mut Lanes<bool>) -> Option<()> {
        /// Of 65536: a little more than what counts as nearer.
        const NEARER: u32 = ((1.0 - 0.998 * LEAK) * 65_536.0) as u32;
        let (depth_mm, width) = (self.frame.depth().depth_mm(), self.trusted.width());
        let mut is_inside = [true; LANES];
        for off in 1..=self.limits.reach {
            let around = around(mask, start, width, off)?;
            for n in 0..LANES {
                is_inside[n] &= around.iter().fold(true, |is_inside, there| is_inside & there[n]);
            }
        }
        if is_inside == [true; LANES] {
            return Some(());
        }
        let here = lanes(depth_mm, start)?;
        let mut nearest = [u16::MAX; LANES];
        for off in 1..=self.limits.reach {
            let around = around(depth_mm, start, width, off)?;
            for n in 0..LANES {
                // Zero, no depth, becomes the farthest.
                nearest[n] =
                    around.iter().fold(nearest[n], |nearest, there| nearest.min(there[n].wrapping_sub(1)));
            }
        }
        for n in 0..LANES {
            let is_nearer = u32::from(nearest[n]) <= u32::from(here[n]).wrapping_mul(NEARER) >> 16;
            doubted[n] |= !is_inside[n] & is_nearer;
        }
        Some(())
    }

    /// Asks doubted pixels with care.
    #[inline(always)]
    fn settle(&self, (col, row): (usize, usize), seen_mm: &mut Lanes<u16>, doubted: &Lanes<bool>) {
        let mut open = 0_u32;
        for n in 0..LANES {
            open |= u32::from(doubted[n] & (seen_mm[n] > 0)) << n;
        }
        while open != 0 {
            let n = open.trailing_zeros() as usize;
            open &= open - 1;
            if self.trusted.at(col + n, row).is_none()
                && let Some(seen_mm) = seen_mm.get_mut(n)
            {
                *seen_mm = 0;
            }
        }
    }

    /// Asks all pixels of a row, from a column on, with care.
    fn look_with_care(&self, (col, row): (usize, usize), out: &mut [u16]) {
        let start = row * self.trusted.width() + col;
        let depth_mm = self.frame.depth().depth_mm();
        for (n, out) in out.iter_mut().enumerate() {
            let is_seen = self.trusted.at_in_mask(col + n, row).is_some();
            *out = if is_seen { depth_mm.get(start + n).copied().unwrap_or(0) } else { 0 };
        }
    }
}

/// Those from a position on.
#[inline(always)]
fn lanes<T>(all: &[T], start: usize) -> Option<&Lanes<T>> {
    all.get(start..)?.first_chunk()
}

/// Those so many to the left, to the right, above and below, in an image of a width.
#[inline(always)]
fn around<T>(all: &[T], start: usize, width: usize, off: usize) -> Option<[&Lanes<T>; 4]> {
    let before = |back: usize| lanes(all, start.checked_sub(back)?);
    Some([before(off)?, lanes(all, start + off)?, before(off * width)?, lanes(all, start + off * width)?])
}
