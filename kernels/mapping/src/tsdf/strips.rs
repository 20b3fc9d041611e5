//! Strips of an image that show something thin: beside them, on both sides, is what is farther away.
//!
//! A voxel learns from the one pixel that it is seen at. What is thinner than voxels lie apart may pass between two layers
//! of them and show itself to none, and an image in which it is one pixel broad has nothing of it but edges, which no
//! voxel trusts. Here pixels are asked instead. The rim of a flying pixel is no strip: on its other side is what is nearer.

use super::TsdfConfig;
use crate::image::{DepthFrame, Mask};
use crate::isa::Work;

/// Pixels that are looked at at once: a vector of the widest instructions.
const LANES: usize = 32;
/// What differs by more than this share of depth, in 1/65536, is something else: 4 %.
const OTHER: u32 = 2621;
/// What is broader than this many voxels is seen by one of them, wherever they lie.
const BREADTH_VOXELS: f32 = 1.5;
/// A strip's two outermost pixels are edges, on each side: pixels.
const MARGIN_PX: usize = 3;
/// Pixels in line that may have no depth within a strip, or beside it.
const GAP_PX: usize = 2;
/// Beside a pixel, along its strip, this many of [`ALONG_PX`] must show the same thing: noise is no line.
const N_ALONG_MIN: usize = 3;
const ALONG_PX: [isize; 4] = [-2, -1, 1, 2];

/// A pixel in the middle of a strip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Strip {
    pub(super) col: usize,
    pub(super) row: usize,
    pub(super) depth_mm: u16,
}

/// The search for strips in the box around a mask.
pub(super) struct Strips<'w, 'a> {
    depth_mm: &'a [u16],
    mask: Option<&'w Mask>,
    size: [usize; 2],
    /// Breadth of a strip at 1 m that is broad enough for voxels, by columns and by rows, pixels.
    breadth_px: [f32; 2],
    /// Least and greatest depth in range, metres.
    range_m: [f32; 2],
    /// Strips are looked for in every so many-th line; a power of two.
    stride: usize,
}

/// Across a strip: from left to right, or downwards.
#[derive(Clone, Copy)]
enum Across {
    Right,
    Down,
}

impl Across {
    /// Columns and rows of a step.
    #[inline(always)]
    fn step(self) -> [isize; 2] {
        match self {
            Across::Right => [1, 0],
            Across::Down => [0, 1],
        }
    }
}

impl Work for Strips<'_, '_> {
    type Output = Vec<Strip>;

    // Never fused: every instruction set computes the same.
    #[inline(always)]
    fn run<const FUSED: bool>(self) -> Vec<Strip> {
        let mut found = Vec::new();
        let Some((cols, rows)) = self.bounds() else { return found };
        let mut lines: [Line; 3] = Default::default();
        let [before, here, after] = &mut lines;
        let first = cols.start.next_multiple_of(self.stride);
        let down = (first..cols.end, self.stride);
        self.copy(rows.start.wrapping_sub(1), &down, here);
        self.copy(rows.start, &down, after);
        for row in rows.clone() {
            std::mem::swap(before, here);
            std::mem::swap(here, after);
            self.copy(row + 1, &down, after);
            self.look_along([before, here, after], (first, self.stride), (row, Across::Down), &mut found);
        }
        for row in rows.filter(|row| row.is_multiple_of(self.stride)) {
            self.copy(row, &(cols.start - 1..cols.end - 1, 1), before);
            self.copy(row, &(cols.clone(), 1), here);
            self.copy(row, &(cols.start + 1..cols.end + 1, 1), after);
            self.look_along([before, here, after], (cols.start, 1), (row, Across::Right), &mut found);
        }
        found
    }
}

/// Depth of pixels of a row, so many at once; 0, no depth, behind the last.
type Line = Vec<[u16; LANES]>;

impl<'w, 'a> Strips<'w, 'a> {
    /// The mask is of the frame's size. `tile_px` is how far apart voxels' pixels lie about twice, at the far end.
    pub(super) fn new(
        frame: &DepthFrame<'a>,
        mask: Option<&'w Mask>,
        config: &TsdfConfig,
        tile_px: usize,
    ) -> Self {
        let (camera, depth) = (frame.intrinsics(), frame.depth());
        Strips {
            depth_mm: depth.depth_mm(),
            mask,
            size: [depth.width() as usize, depth.height() as usize],
            breadth_px: [camera.fx, camera.fy].map(|focal| BREADTH_VOXELS * (focal * config.voxel_m) as f32),
            range_m: [config.limits.min_m as f32, config.limits.max_m as f32],
            stride: tile_px.max(1),
        }
    }

    /// The strips, slowly: every pixel is asked.
    #[cfg(test)]
    pub(super) fn one_by_one(&self) -> Vec<Strip> {
        let mut found = Vec::new();
        let Some((cols, rows)) = self.bounds() else { return found };
        for row in rows.clone() {
            let down = cols.clone().filter(|col| col % self.stride == 0);
            found.extend(down.filter_map(|col| self.strip(col, row, Across::Down)));
        }
        for row in rows.filter(|row| row % self.stride == 0) {
            found.extend(cols.clone().filter_map(|col| self.strip(col, row, Across::Right)));
        }
        found
    }

    /// Columns and rows of the mask's box that have pixels all around.
    fn bounds(&self) -> Option<(std::ops::Range<usize>, std::ops::Range<usize>)> {
        let (cols, rows) = match self.mask {
            Some(mask) => mask.bounds()?,
            None => (0..self.size[0], 0..self.size[1]),
        };
        let [last_col, last_row] = self.size.map(|n| n.saturating_sub(1));
        let (cols, rows) =
            (cols.start.max(1)..cols.end.min(last_col), rows.start.max(1)..rows.end.min(last_row));
        (!cols.is_empty() && !rows.is_empty()).then_some((cols, rows))
    }

    /// Copies every `stride`-th pixel of some columns of a row.
    #[inline(always)]
    fn copy(&self, row: usize, (cols, stride): &(std::ops::Range<usize>, usize), into: &mut Line) {
        let start = row.wrapping_mul(self.size[0]);
        let line = self.depth_mm.get(start.wrapping_add(cols.start)..start.wrapping_add(cols.end));
        let line = line.unwrap_or(&[]);
        into.resize(line.len().div_ceil(*stride).div_ceil(LANES), [0; LANES]);
        for (into, line) in into.iter_mut().zip(line.chunks(LANES * stride)) {
            if *stride == 1
                && let Ok(line) = <&[u16; LANES]>::try_from(line)
            {
                *into = *line;
                continue;
            }
            *into = [0; LANES];
            for (into, mm) in into.iter_mut().zip(line.iter().step_by(*stride)) {
                *into = *mm;
            }
        }
    }

    /// Adds the strips that begin in a line of pixels, of which are given the first column and how far apart they are.
    /// `lines` are that before it, across strips, it, and that after it.
    #[inline(always)]
    fn look_along(
        &self,
        lines: [&Line; 3],
        (first_col, stride): (usize, usize),
        (row, across): (usize, Across),
        found: &mut Vec<Strip>,
    ) {
        let [before, here, after] = lines;
        let mut col = first_col;
        for ((before, here), after) in before.iter().zip(here).zip(after) {
            let mut rims = rims([before, here, after]);
            while rims != 0 {
                found.extend(self.strip(col + stride * rims.trailing_zeros() as usize, row, across));
                rims &= rims - 1;
            }
            col += stride * LANES;
        }
    }

    /// The strip that begins at a pixel, if one does.
    fn strip(&self, col: usize, row: usize, across: Across) -> Option<Strip> {
        let step = across.step();
        let at = |n: isize| self.at((col, row), step, n);
        let here = at(0)?;
        let depth_m = f32::from(here) * 0.001;
        if here == 0 || depth_m < self.range_m[0] || depth_m > self.range_m[1] {
            return None;
        }
        let focal_px = match across {
            Across::Right => self.breadth_px[0],
            Across::Down => self.breadth_px[1],
        };
        let reach = (focal_px / depth_m) as usize + MARGIN_PX;
        // Most surfaces go on: told by one look.
        if at(reach as isize).is_some_and(|mm| is_same(here, mm)) {
            return None;
        }
        let before = (1..=GAP_PX as isize + 1).map(|n| at(-n)).find(|mm| *mm != Some(0));
        if before.is_some_and(|mm| mm.is_none_or(|mm| !is_farther(here, mm))) {
            return None;
        }
        let last = self.last(here, reach, at)?;
        // The middle, or what of it has depth.
        let (n, depth_mm) = (0..=last / 2)
            .rev()
            .filter_map(|n| Some((n as isize, at(n as isize)?)))
            .find(|(_, mm)| is_same(here, *mm))?;
        let (col, row) = (col.wrapping_add_signed(n * step[0]), row.wrapping_add_signed(n * step[1]));
        if self.mask.is_some_and(|mask| mask.bits().get(row * self.size[0] + col) != Some(&true)) {
            return None;
        }
        let along = [step[1], step[0]];
        let n_along = ALONG_PX
            .iter()
            .filter(|n| self.at((col, row), along, **n).is_some_and(|mm| is_same(depth_mm, mm)))
            .count();
        (n_along >= N_ALONG_MIN).then_some(Strip { col, row, depth_mm })
    }

    /// The last pixel of a strip, counted from its first; nothing where it does not end before something farther, or
    /// nothing at all.
    fn last(&self, here: u16, reach: usize, at: impl Fn(isize) -> Option<u16>) -> Option<usize> {
        let mut last = 0;
        for n in 1..=reach + GAP_PX {
            let mm = at(n as isize)?;
            if is_same(here, mm) {
                last = n;
            } else if is_farther(here, mm) || (mm == 0 && n - last > GAP_PX) {
                return Some(last);
            } else if mm > 0 {
                return None;
            }
        }
        None
    }

    /// Depth so many steps from a pixel, millimetres, 0 where there is none; nothing beside the image.
    #[inline(always)]
    fn at(&self, (col, row): (usize, usize), step: [isize; 2], n: isize) -> Option<u16> {
        let (col, row) = (col.wrapping_add_signed(n * step[0]), row.wrapping_add_signed(n * step[1]));
        let is_inside = col < self.size[0] && row < self.size[1];
        is_inside.then(|| self.depth_mm.get(row * self.size[0] + col).copied())?
    }
}

/// By how much depth may differ on one thing, millimetres.
#[inline(always)]
fn tolerance(here: u16) -> u16 {
    ((u32::from(here) * OTHER) >> 16) as u16
}

/// Which pixels a strip may begin at, a bit each: what is before them is farther or has no depth, what is after them is not
/// nearer.
#[inline(always)]
fn rims([before, here, after]: [&[u16; LANES]; 3]) -> u32 {
    let mut rims = 0;
    for n in 0..LANES {
        let tolerance = tolerance(here[n]);
        // Zero, no depth, becomes the farthest.
        let is_rim = before[n].wrapping_sub(1) >= here[n].saturating_add(tolerance);
        let goes_on = after[n].wrapping_sub(1) >= here[n].saturating_sub(tolerance).wrapping_sub(1);
        rims |= u32::from((here[n] > 0) & is_rim & goes_on) << n;
    }
    rims
}

#[inline(always)]
fn is_same(here: u16, there: u16) -> bool {
    there > 0 && here.abs_diff(there) <= tolerance(here)
}

#[inline(always)]
fn is_farther(here: u16, there: u16) -> bool {
    there > here && !is_same(here, there)
}
