//! A depth image in small squares: how each is turned to the camera, and the blocks that what it shows needs.
//!
//! Distances along the optical axis are longer than those across a surface that is seen at an angle. Most of an image is
//! flat over some pixels: what is found out once in the middle of a tile serves all voxels that look there.

use super::seen::Seen;
use super::slant::{Slanted, Turned, Turning};
use super::{BLOCK_SIDE, BlockKey, TsdfConfig};
use crate::image::DepthFrame;
use crate::isa::Work;

/// Side of a tile, pixels: at least and at most.
const SIDE_MIN: usize = 2;
const SIDE_MAX: usize = 8;
/// A tile covers at most this many voxels at the far end of what is trusted.
const SIDE_VOXELS: f64 = 2.0;
/// Of tiles of this side on every second is asked which blocks it needs: blocks are much larger.
pub(super) const SIDE_SPARE: usize = 4;
/// Pixels that are asked for at once: a vector of the widest instructions.
pub(super) const LANES: usize = 16;

/// The tiles of the box around a mask.
#[derive(Clone, Default)]
pub(super) struct Tiles {
    /// Tile of a pixel: its column and row shifted by this, less those of the first.
    pub(super) shift: u32,
    pub(super) first: [u32; 2],
    pub(super) n_cols: u32,
    pub(super) turned: Vec<Turned>,
}

/// The cutting of what is seen into tiles, which were cut before: their space is used again.
pub(super) struct Cut<'w, 'a> {
    pub(super) frame: &'w DepthFrame<'a>,
    pub(super) seen: &'w Seen,
    pub(super) mask: Option<&'w [bool]>,
    pub(super) config: &'w TsdfConfig,
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
        let (mut wanted, mut shown, mut spare) = (Vec::new(), Vec::new(), Spare::default());
        let mut last = [[i32::MAX; 3]; 3];
        let (cols, rows) = self.seen.bounds();
        let first = [cols.start / self.side, rows.start / self.side];
        let n_tiles = [cols.end.div_ceil(self.side) - first[0], rows.end.div_ceil(self.side) - first[1]];
        let tiles = &mut *self.tiles;
        tiles.shift = self.side.trailing_zeros();
        tiles.first = first.map(|first| first as u32);
        tiles.n_cols = n_tiles[0] as u32;
        let turning = Turning::new(self.frame, self.mask, self.config);
        tiles.turned.clear();
        tiles.turned.resize(n_tiles[0] * n_tiles[1], turning.facing());
        let all = Look { seen: self.seen, side: self.side };
        let mut slanted: Vec<Slanted> = Vec::new();
        for (row, turned) in (0..n_tiles[1]).zip(tiles.turned.chunks_mut(n_tiles[0].max(1))) {
            let low_row = (first[1] + row) * self.side;
            let n_turned = all.look_along(low_row, first[0], &mut shown, &mut spare);
            for batch in shown.get(..n_turned).unwrap_or(&[]).chunks(LANES) {
                turning.turn(batch, turned, row * n_tiles[0], &mut slanted);
            }
            if self.side >= SIDE_SPARE {
                shown.retain(|shown| is_asked(first[0] + shown.tile, first[1] + row));
            }
            for batch in shown.chunks(LANES) {
                self.rays.blocks(batch, &mut last, &mut wanted);
            }
        }
        turning.reach(&slanted, &mut tiles.turned);
        wanted
    }
}

/// What tiles are cut from.
struct Look<'w> {
    seen: &'w Seen,
    side: usize,
}

impl Look<'_> {
    /// Looks at the row of tiles that begins at a row of pixels: which pixels show a surface. First one for each tile, of
    /// which it returns the number; `spare` is for its use.
    #[inline(always)]
    fn look_along(&self, low_row: usize, first: usize, shown: &mut Vec<Shown>, spare: &mut Spare) -> usize {
        let (side, (cols, rows)) = (self.side, self.seen.bounds());
        let row = (low_row + side / 2).clamp(rows.start, rows.end - 1);
        let line = self.seen.row(row);
        shown.clear();
        spare.open.clear();
        spare.others.clear();
        for tile in 0..cols.end.div_ceil(side) - first {
            let col = ((first + tile) * side + side / 2).clamp(cols.start, cols.end - 1);
            let depth_mm = line.get(col - cols.start).copied().unwrap_or(0);
            if depth_mm > 0 {
                shown.push(Shown { tile, col, row, depth_mm });
            } else {
                spare.open.push(tile);
            }
        }
        // Something thin, or the last of a surface, may pass beside the middle.
        let (quarter, last) = (side / 4, side - 1);
        for tile in spare.open.iter().copied() {
            let mut is_first = true;
            for (right, down) in [(quarter, quarter), (last, quarter), (quarter, last)] {
                let (col, row) = ((first + tile) * side + right, low_row + down);
                let depth_mm = self.seen.at(col, row);
                if depth_mm > 0 {
                    let list = if is_first { &mut *shown } else { &mut spare.others };
                    list.push(Shown { tile, col, row, depth_mm });
                    is_first = false;
                }
            }
        }
        let n_turned = shown.len();
        shown.append(&mut spare.others);
        n_turned
    }
}

/// A pixel whose surface blocks are reserved for.
#[derive(Clone, Copy)]
pub(super) struct Shown {
    /// Which tile of its row it lies in.
    pub(super) tile: usize,
    pub(super) col: usize,
    pub(super) row: usize,
    pub(super) depth_mm: u16,
}

/// What a look along a row of tiles writes down: the tiles whose middle shows nothing, and further pixels of theirs.
#[derive(Default)]
struct Spare {
    open: Vec<usize>,
    others: Vec<Shown>,
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
