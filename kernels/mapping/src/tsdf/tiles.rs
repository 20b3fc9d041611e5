//! A depth image in small squares: how each is turned to the camera, and the blocks that what it shows needs.
//!
//! Distances along the optical axis are longer than those across a surface that is seen at an angle. Most of an image is
//! flat over some pixels: what is found out once in the middle of a tile serves all voxels that look there.

use super::seen::Seen;
use super::slab::nearest;
use super::{BLOCK_SIDE, BlockKey, TsdfConfig};
use crate::image::DepthFrame;
use crate::isa::Work;

/// Side of a tile, pixels: at least and at most.
const SIDE_MIN: usize = 2;
const SIDE_MAX: usize = 8;
/// A tile covers at most this many voxels at the far end of what is trusted.
const SIDE_VOXELS: f64 = 1.5;
/// Of tiles of this side on every second is asked which blocks it needs: blocks are much larger.
pub(super) const SIDE_SPARE: usize = 4;
/// Slopes are measured over this many pixels to both sides.
pub(super) const SPAN_PX: i32 = 2;
/// Three inverse depths in line, times depth, may bend this much and still be one plane.
pub(super) const BEND_MAX: f32 = 0.04;
/// Least cosine between ray and surface normal that is believed: below it a slope is mostly an edge or noise.
pub(super) const COSINE_MIN: f32 = 0.15;
/// A cosine of one: they are kept as whole numbers.
pub(super) const COSINE_ONE: f32 = 255.0;
/// Pixels that are asked for at once: a vector of the widest instructions.
const LANES: usize = 16;

/// The tiles of the box around a mask.
#[derive(Clone, Default)]
pub(super) struct Tiles {
    /// Tile of a pixel: its column and row shifted by this, less those of the first.
    pub(super) shift: u32,
    pub(super) first: [u32; 2],
    pub(super) n_cols: u32,
    /// Metres across the surface for each along the optical axis, of 255.
    pub(super) cosines: Vec<u8>,
}

/// The cutting of what is seen into tiles, which were cut before: their space is used again.
pub(super) struct Cut<'w, 'a> {
    pub(super) frame: &'w DepthFrame<'a>,
    pub(super) seen: &'w Seen,
    pub(super) rays: &'w Rays,
    /// Side of the tiles, pixels.
    pub(super) side: usize,
    pub(super) tiles: &'w mut Tiles,
}

impl Work for Cut<'_, '_> {
    /// The blocks around what is seen: nearly each once, in order of the image.
    type Output = Vec<BlockKey>;

    // Never fused: every instruction set computes the same.
    #[inline(always)]
    fn run<const FUSED: bool>(self) -> Self::Output {
        let (mut wanted, mut shown) = (Vec::new(), Vec::new());
        let mut last = [[i32::MAX; 3]; 3];
        let (cols, rows) = self.seen.bounds();
        let first = [cols.start / self.side, rows.start / self.side];
        let n_tiles = [cols.end.div_ceil(self.side) - first[0], rows.end.div_ceil(self.side) - first[1]];
        let tiles = &mut *self.tiles;
        tiles.shift = self.side.trailing_zeros();
        tiles.first = first.map(|first| first as u32);
        tiles.n_cols = n_tiles[0] as u32;
        tiles.cosines.clear();
        tiles.cosines.resize(n_tiles[0] * n_tiles[1], COSINE_ONE as u8);
        let all = Look { frame: self.frame, seen: self.seen, side: self.side };
        for (row, cosines) in (0..n_tiles[1]).zip(tiles.cosines.chunks_mut(n_tiles[0].max(1))) {
            shown.clear();
            let low_row = (first[1] + row) * self.side;
            let n_middles = all.look_along(low_row, first[0], n_tiles[0], &mut shown);
            for batch in shown.get(..n_middles).unwrap_or(&[]).chunks(LANES) {
                all.turn(batch, cosines);
            }
            if self.side >= SIDE_SPARE {
                shown.retain(|shown| is_asked(first[0] + shown.tile, first[1] + row));
            }
            for batch in shown.chunks(LANES) {
                self.rays.blocks(batch, &mut last, &mut wanted);
            }
        }
        wanted
    }
}

/// What tiles are cut from.
struct Look<'w, 'a> {
    frame: &'w DepthFrame<'a>,
    seen: &'w Seen,
    side: usize,
}

impl Look<'_, '_> {
    /// Looks at the row of tiles that begins at a row of pixels: which pixels show a surface. First those in the middles
    /// of tiles, of which it returns the number.
    #[inline(always)]
    fn look_along(&self, low_row: usize, first: usize, n_tiles: usize, shown: &mut Vec<Shown>) -> usize {
        let (side, (cols, rows)) = (self.side, self.seen.bounds());
        let row = (low_row + side / 2).clamp(rows.start, rows.end - 1);
        let line = self.seen.row(row);
        let middle = |tile: usize| ((first + tile) * side + side / 2).clamp(cols.start, cols.end - 1);
        for tile in 0..n_tiles {
            let col = middle(tile);
            let depth_mm = line.get(col - cols.start).copied().unwrap_or(0);
            if depth_mm > 0 {
                shown.push(Shown { tile, col, row, depth_mm });
            }
        }
        let n_middles = shown.len();
        if side < 4 || n_middles == n_tiles {
            return n_middles;
        }
        // Something thin may pass beside the middle.
        let (quarter, last) = (side / 4, side - 1);
        for tile in 0..n_tiles {
            if line.get(middle(tile) - cols.start).is_some_and(|mm| *mm > 0) {
                continue;
            }
            for (right, down) in [(quarter, quarter), (last, quarter), (quarter, last)] {
                let (col, row) = ((first + tile) * side + right, low_row + down);
                let depth_mm = self.seen.at(col, row);
                if depth_mm > 0 {
                    shown.push(Shown { tile, col, row, depth_mm });
                }
            }
        }
        n_middles
    }

    /// Finds how up to [`LANES`] tiles are turned. With 1/z = a·u + b·v + c around a pixel, the plane there is
    /// n·P = 1 with n = (a·fx, b·fy, a·cx + b·cy + c), and a point P = ray·z is (1 − z/depth) / |n| in front of it.
    #[inline(always)]
    fn turn(&self, batch: &[Shown], cosines: &mut [u8]) {
        let Some(rest) = batch.last() else { return };
        let camera = self.frame.intrinsics();
        let (mut place, mut here) = ([[0_i32; LANES]; 2], [0.0_f32; LANES]);
        for n in 0..LANES {
            let shown = batch.get(n).unwrap_or(rest);
            (place[0][n], place[1][n]) = (shown.col as i32, shown.row as i32);
            here[n] = 1000.0 / f32::from(shown.depth_mm);
        }
        let [left, right] = [-SPAN_PX, SPAN_PX].map(|off| self.inverse(&place, (off, 0)));
        let [up, down] = [-SPAN_PX, SPAN_PX].map(|off| self.inverse(&place, (0, off)));
        let mut found = [0_u8; LANES];
        let (focal, centre) = ([camera.fx as f32, camera.fy as f32], [camera.cx as f32, camera.cy as f32]);
        for n in 0..LANES {
            let (a, b) = (slope(left[n], here[n], right[n]), slope(up[n], here[n], down[n]));
            let (col, row) = (place[0][n] as f32 - centre[0], place[1][n] as f32 - centre[1]);
            let normal = [a * focal[0], b * focal[1], here[n] - a * col - b * row];
            let norm = (normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]).sqrt();
            let cosine = (here[n] / norm).clamp(COSINE_MIN, 1.0);
            found[n] = nearest(cosine * COSINE_ONE) as u8;
        }
        for (shown, found) in batch.iter().zip(found) {
            if let Some(cosine) = cosines.get_mut(shown.tile) {
                *cosine = found;
            }
        }
    }

    /// Inverse depth beside pixels, masked or not; 0 where there is none.
    #[inline(always)]
    fn inverse(&self, place: &[[i32; LANES]; 2], (right, down): (i32, i32)) -> [f32; LANES] {
        let (width, height) = (self.frame.depth().width(), self.frame.depth().height());
        let mut mm = [0_u16; LANES];
        for n in 0..LANES {
            // Left of the image, or above, comes out larger than any image.
            let col = place[0][n].wrapping_add(right) as u32;
            let row = place[1][n].wrapping_add(down) as u32;
            let idx = row.wrapping_mul(width).wrapping_add(col) as usize;
            let is_inside = (col < width) & (row < height);
            mm[n] = if is_inside { self.frame.depth().depth_mm().get(idx).copied().unwrap_or(0) } else { 0 };
        }
        let mut inverse = [0.0_f32; LANES];
        for n in 0..LANES {
            inverse[n] = if mm[n] > 0 { 1000.0 / f32::from(mm[n]) } else { 0.0 };
        }
        inverse
    }
}

/// Slope of inverse depth by pixel at the middle of three in line, of which the outer ones may have none (0). At an edge
/// it is that of the side which lies on the surface.
#[inline(always)]
fn slope(before: f32, here: f32, after: f32) -> f32 {
    let (from, to) = (here - before, after - here);
    let is_before_nearer = from.abs() < to.abs();
    let nearer = if is_before_nearer { from } else { to };
    let is_straight = (to - from).abs() <= BEND_MAX * here;
    let both = if is_straight { 0.5 * (from + to) } else { nearer };
    let only = if before > 0.0 { from } else { to };
    let has_both = (before > 0.0) & (after > 0.0);
    let has_any = (before > 0.0) | (after > 0.0);
    let step = if has_both { both } else { only };
    if has_any { step / SPAN_PX as f32 } else { 0.0 }
}

/// A pixel whose surface blocks are reserved for.
#[derive(Clone, Copy)]
struct Shown {
    /// Which tile of its row it lies in.
    tile: usize,
    col: usize,
    row: usize,
    depth_mm: u16,
}

/// Whether a tile, counted from the image's corner, is one of every second: as the black squares of a chessboard.
#[inline(always)]
pub(super) fn is_asked(tile_col: usize, tile_row: usize) -> bool {
    (tile_col ^ tile_row) & 1 == 0
}

/// A whole number that is one, as long as it fits: a cast has cases for all others, which vectors have not.
#[inline(always)]
fn whole(value: f64) -> i32 {
    /// Between this and twice as much f64 are whole numbers, and their lowest bits count them.
    const WHOLE: f64 = 6_755_399_441_055_744.0;
    (value + WHOLE).to_bits() as i32
}

/// Side of the tiles for a camera and voxels, pixels: a power of two.
pub(super) fn side_for(focal_px: f64, voxel_m: f64, far_m: f64) -> usize {
    let wanted = SIDE_VOXELS * focal_px * voxel_m / far_m.max(0.1);
    let mut side = SIDE_MIN;
    while side < SIDE_MAX && (2 * side) as f64 <= wanted {
        side *= 2;
    }
    side
}

/// Rays of a camera through pixels, in sides of a block.
pub(super) struct Rays {
    eye: [f64; 3],
    /// From a ray in `camera` to one in `map`, row by row.
    turn: [[f64; 3]; 3],
    focal: [f64; 2],
    centre: [f64; 2],
    truncation_m: f64,
}

impl Rays {
    pub(super) fn new(frame: &DepthFrame<'_>, config: &TsdfConfig) -> Self {
        let block_m = config.voxel_m * BLOCK_SIDE as f64;
        let camera = frame.intrinsics();
        let eye = frame.map_from_camera().translation.vector / block_m;
        let turn = frame.map_from_camera().rotation.to_rotation_matrix().into_inner() / block_m;
        Rays {
            eye: eye.into(),
            turn: [0, 1, 2].map(|row| [0, 1, 2].map(|col| turn[(row, col)])),
            focal: [camera.fx, camera.fy],
            centre: [camera.cx, camera.cy],
            truncation_m: config.truncation_m,
        }
    }

    /// Adds the blocks around up to [`LANES`] surfaces; `last` are those that each of the three places on a ray was in
    /// before: neighbours mostly ask for the same.
    #[inline(always)]
    fn blocks(&self, batch: &[Shown], last: &mut [BlockKey; 3], wanted: &mut Vec<BlockKey>) {
        let Some(rest) = batch.last() else { return };
        let mut pixel = [[0.0_f64; LANES]; 2];
        let mut depth_m = [0.0_f64; LANES];
        for n in 0..LANES {
            let shown = batch.get(n).unwrap_or(rest);
            (pixel[0][n], pixel[1][n]) = (shown.col as u32 as f64, shown.row as u32 as f64);
            depth_m[n] = f64::from(f32::from(shown.depth_mm) * 0.001);
        }
        let mut rays = [[0.0_f64; LANES]; 3];
        for n in 0..LANES {
            let x = (pixel[0][n] - self.centre[0]) / self.focal[0];
            let y = (pixel[1][n] - self.centre[1]) / self.focal[1];
            for (ray, [right, down, ahead]) in rays.iter_mut().zip(&self.turn) {
                ray[n] = right * x + down * y + ahead;
            }
        }
        let mut keys = [[[0_i32; LANES]; 3]; 3];
        for (step, keys) in [-1.0, 0.0, 1.0].into_iter().zip(&mut keys) {
            for ((eye, ray), keys) in self.eye.iter().zip(&rays).zip(keys) {
                for n in 0..LANES {
                    let reach_m = depth_m[n] + step * self.truncation_m;
                    keys[n] = whole((eye + ray[n] * reach_m).floor());
                }
            }
        }
        for n in 0..batch.len() {
            for (keys, last) in keys.iter().zip(&mut *last) {
                let key = [keys[0][n], keys[1][n], keys[2][n]];
                if key != *last {
                    *last = key;
                    wanted.push(key);
                }
            }
        }
    }
}
