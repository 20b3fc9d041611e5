//! A depth image in small squares, each with the plane that it shows, and the blocks that its surface needs.
//!
//! A voxel asks for the plane at its pixel; most of the image is flat over some pixels, and a plane found once
//! serves all voxels that look there. Where a pixel does not lie on its tile's plane, the voxel finds its own.

use std::ops::Range;

use super::BlockKey;
use super::planes::{Found, LANES, Lanes, Planes};
use super::rays::Rays;
use crate::isa::Work;
use crate::projection::TrustedDepth;

/// Side of a tile, pixels: at least and at most.
const SIDE_MIN: usize = 2;
const SIDE_MAX: usize = 8;
/// A tile covers at most this many voxels at the far end of what is trusted.
const SIDE_VOXELS: f64 = 1.5;
/// A pixel lies on its tile's plane when its depth is within this share of the plane's.
pub(super) const ON_PLANE: f32 = 0.015;
/// So many pixels beside a tile must lie on its plane too: mask and depth are off by that much at edges.
pub(super) const BESIDE: usize = 2;

/// The tiles of the part of an image that holds a mask.
pub(super) struct Tiles {
    shift: u32,
    first: [u32; 2],
    n_cols: u32,
    n_rows: u32,
    /// Columns and rows that may hold masked pixels, first and last.
    cols: (i32, i32),
    rows: (i32, i32),
    /// Leaves of a pixel's column or row that of its tile's first.
    whole: i32,
    /// Half a side, pixels.
    half: i32,
    planes: Vec<TilePlane>,
    normals: Vec<[f32; 3]>,
}

/// Inverse depth at a tile's middle, its slopes by column and row, and how far off the plane it is for each metre along
/// the optical axis. All NaN where the tile is not flat, or not to be trusted.
pub(super) type TilePlane = [f32; 4];
const NO_PLANE: TilePlane = [f32::NAN; 4];

/// A pixel whose surface blocks are reserved for.
#[derive(Clone, Copy)]
pub(super) struct Seen {
    pub(super) col: usize,
    pub(super) row: usize,
    pub(super) depth_m: f32,
}

/// A tile whose middle shows a surface: which one, its low corner and its middle.
#[derive(Clone, Copy)]
struct Shown {
    idx: usize,
    low: [usize; 2],
    middle: Seen,
}

/// The cutting of an image into tiles.
pub(super) struct Cut<'w, 'a> {
    pub(super) trusted: &'w TrustedDepth<'a>,
    pub(super) planes: &'w Planes<'a>,
    pub(super) rays: &'w Rays,
    pub(super) side: usize,
}

impl Work for Cut<'_, '_> {
    /// The tiles, and the blocks around what they show: nearly each once, in order of the image.
    type Output = (Tiles, Vec<BlockKey>);

    // Never fused: every instruction set computes the same.
    #[inline(always)]
    fn run<const FUSED: bool>(self) -> Self::Output {
        let (mut tiles, mut wanted) = (Tiles::new(self.trusted.bounds(), self.side), Vec::new());
        let (mut shown, mut seen) = (Vec::new(), Vec::new());
        let mut last = [[i32::MAX; 3]; 3];
        for tile_row in 0..tiles.n_rows as usize {
            shown.clear();
            seen.clear();
            self.look_along(&tiles, tile_row, &mut shown, &mut seen);
            for batch in shown.chunks(LANES) {
                self.find_planes(&mut tiles, batch);
            }
            for batch in seen.chunks(LANES) {
                self.rays.blocks(batch, &mut last, &mut wanted);
            }
        }
        (tiles, wanted)
    }
}

impl Cut<'_, '_> {
    /// Looks at a row of tiles: which show a surface in their middle, and which pixels show one at all.
    #[inline(always)]
    fn look_along(&self, tiles: &Tiles, tile_row: usize, shown: &mut Vec<Shown>, seen: &mut Vec<Seen>) {
        let (Cut { trusted, side, .. }, (cols, rows)) = (self, self.trusted.bounds());
        let (shift, n_cols) = (tiles.shift, tiles.n_cols as usize);
        let [first_col, first_row] = tiles.first.map(|first| first as usize);
        for tile_col in 0..n_cols {
            let low = [(first_col + tile_col) << shift, (first_row + tile_row) << shift];
            let col = (low[0] + side / 2).clamp(cols.start, cols.end - 1);
            let row = (low[1] + side / 2).clamp(rows.start, rows.end - 1);
            if let Some(depth_m) = trusted.at_in_mask(col, row) {
                let middle = Seen { col, row, depth_m };
                shown.push(Shown { idx: tile_row * n_cols + tile_col, low, middle });
                seen.push(middle);
            } else if *side >= 4 {
                // Something thin may pass beside the middle.
                let (quarter, last) = (side / 4, side - 1);
                for (off_col, off_row) in [(quarter, quarter), (last, quarter), (quarter, last)] {
                    let (col, row) = (low[0] + off_col, low[1] + off_row);
                    if cols.contains(&col)
                        && rows.contains(&row)
                        && let Some(depth_m) = trusted.at_in_mask(col, row)
                    {
                        seen.push(Seen { col, row, depth_m });
                    }
                }
            }
        }
    }

    /// Finds the planes of up to [`LANES`] tiles, and keeps those that are flat.
    #[inline(always)]
    fn find_planes(&self, tiles: &mut Tiles, batch: &[Shown]) {
        let Some(last) = batch.last() else { return };
        let (mut middle, mut low) = ([[0_i32; LANES]; 2], [[0_i32; LANES]; 2]);
        let mut depth_m = [0.0_f32; LANES];
        for n in 0..LANES {
            let tile = batch.get(n).unwrap_or(last);
            (middle[0][n], middle[1][n]) = (tile.middle.col as i32, tile.middle.row as i32);
            (low[0][n], low[1][n]) = (tile.low[0] as i32, tile.low[1] as i32);
            depth_m[n] = tile.middle.depth_m;
        }
        let found = self.planes.at(&middle, &depth_m);
        let is_flat = self.are_flat(tiles, (&low, &middle), &depth_m, &found);
        for ((n, tile), is_flat) in batch.iter().enumerate().zip(is_flat) {
            if is_flat
                && let (Some(plane), Some(normal)) =
                    (tiles.planes.get_mut(tile.idx), tiles.normals.get_mut(tile.idx))
            {
                *plane = [1.0 / depth_m[n], found.slopes[0][n], found.slopes[1][n], found.cosine[n]];
                *normal = [found.normal[0][n], found.normal[1][n], found.normal[2][n]];
            }
        }
    }

    /// Whether tiles' corners and what lies just beside them are in the mask and on their planes: no edge is near.
    #[inline(always)]
    fn are_flat(
        &self,
        tiles: &Tiles,
        (low, middle): (&[[i32; LANES]; 2], &[[i32; LANES]; 2]),
        depth_m: &Lanes,
        found: &Found,
    ) -> [bool; LANES] {
        let (beside, half, last) = (BESIDE as i32, (self.side / 2) as i32, (self.side - 1) as i32);
        let corners = [(0, 0), (last, 0), (0, last), (last, last)];
        let around = [(-beside, half), (last + beside, half), (half, -beside), (half, last + beside)];
        let mut is_flat = [true; LANES];
        for (off_col, off_row) in corners.into_iter().chain(around) {
            let (mut place, mut seen_mm) = ([0_u32; LANES], [0_i32; LANES]);
            let (mut cols, mut rows) = ([0.0_f32; LANES], [0.0_f32; LANES]);
            for n in 0..LANES {
                let (col, row) = (low[0][n].wrapping_add(off_col), low[1][n].wrapping_add(off_row));
                (cols[n], rows[n]) = (col as f32 - middle[0][n] as f32, row as f32 - middle[1][n] as f32);
                let is_inside = (col >= tiles.cols.0)
                    & (col <= tiles.cols.1)
                    & (row >= tiles.rows.0)
                    & (row <= tiles.rows.1);
                let position =
                    (row as u32).wrapping_mul(self.trusted.width() as u32).wrapping_add(col as u32);
                place[n] = if is_inside { position } else { u32::MAX };
            }
            for (mm, place) in seen_mm.iter_mut().zip(&place) {
                *mm = self.trusted.masked_mm(*place as usize).map_or(0, i32::from);
            }
            for n in 0..LANES {
                let inverse = 1.0 / depth_m[n] + found.slopes[0][n] * cols[n] + found.slopes[1][n] * rows[n];
                is_flat[n] &= (seen_mm[n] as f32 * 0.001 * inverse - 1.0).abs() <= ON_PLANE;
            }
            if is_flat == [false; LANES] {
                break;
            }
        }
        is_flat
    }
}

impl Tiles {
    /// Side of the tiles for a camera and voxels, pixels: a power of two.
    pub(super) fn side_for(focal_px: f64, voxel_m: f64, far_m: f64) -> usize {
        let wanted = SIDE_VOXELS * focal_px * voxel_m / far_m.max(0.1);
        let mut side = SIDE_MIN;
        while side < SIDE_MAX && (2 * side) as f64 <= wanted {
            side *= 2;
        }
        side
    }

    /// Tiles without planes.
    fn new((cols, rows): (Range<usize>, Range<usize>), side: usize) -> Self {
        let shift = side.trailing_zeros();
        let first = [cols.start >> shift, rows.start >> shift];
        let end = [cols.end.div_ceil(side), rows.end.div_ceil(side)];
        let (n_cols, n_rows) = (end[0].saturating_sub(first[0]), end[1].saturating_sub(first[1]));
        let limits = |range: &Range<usize>| (range.start as i32, range.end as i32 - 1);
        Tiles {
            shift,
            first: first.map(|first| first as u32),
            n_cols: n_cols as u32,
            n_rows: n_rows as u32,
            cols: limits(&cols),
            rows: limits(&rows),
            whole: !(side as i32 - 1),
            half: side as i32 / 2,
            // The last one is that of none.
            planes: vec![NO_PLANE; n_cols * n_rows + 1],
            normals: vec![[0.0, 0.0, -1.0]; n_cols * n_rows + 1],
        }
    }

    /// Position of the tile of a pixel of the image; of none beside the mask.
    #[inline(always)]
    pub(super) fn position(&self, col: i32, row: i32) -> u32 {
        let col = (col as u32).wrapping_shr(self.shift).wrapping_sub(self.first[0]);
        let row = (row as u32).wrapping_shr(self.shift).wrapping_sub(self.first[1]);
        let is_inside = (col < self.n_cols) & (row < self.n_rows);
        let none = self.n_cols.wrapping_mul(self.n_rows);
        if is_inside { row.wrapping_mul(self.n_cols).wrapping_add(col) } else { none }
    }

    /// How far a pixel is from the middle of its tile, columns and rows.
    #[inline(always)]
    pub(super) fn off_middle(&self, col: i32, row: i32) -> [f32; 2] {
        let middle =
            |at: i32, (low, high): (i32, i32)| (at & self.whole).wrapping_add(self.half).max(low).min(high);
        [col as f32 - middle(col, self.cols) as f32, row as f32 - middle(row, self.rows) as f32]
    }

    /// The plane of the tile at a position.
    #[inline(always)]
    pub(super) fn plane(&self, position: u32) -> TilePlane {
        self.planes.get(position as usize).copied().unwrap_or(NO_PLANE)
    }

    /// The unit normal of the tile at a position, away from the camera, in `camera`.
    #[inline(always)]
    pub(super) fn normal(&self, position: u32) -> [f32; 3] {
        self.normals.get(position as usize).copied().unwrap_or([0.0, 0.0, -1.0])
    }
}
