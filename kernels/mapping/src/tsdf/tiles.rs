//! A depth image in small squares, each with the plane that it shows.
//!
//! A voxel asks for the plane at its pixel; most of the image is flat over some pixels, and a plane found once
//! serves all voxels that look there. Where a pixel does not lie on its tile's plane, the voxel finds its own.

use nalgebra::Vector3;

use super::update::Planes;
use crate::projection::TrustedDepth;

/// Side of a tile, pixels: at least and at most.
const SIDE_MIN: usize = 2;
const SIDE_MAX: usize = 8;
/// A tile covers at most this many voxels at the far end of what is trusted.
const SIDE_VOXELS: f64 = 1.5;
/// A pixel lies on its tile's plane when its depth is within this share of the plane's.
const ON_PLANE: f32 = 0.015;

/// So many pixels beside a tile must lie on its plane too: mask and depth are off by that much at edges.
const BESIDE: usize = 2;

/// One tile.
#[derive(Clone, Copy)]
pub(super) struct Tile {
    /// Unit normal, away from the camera, in `camera`.
    pub(super) normal: Vector3<f32>,
    /// Its cosine to the ray through the tile's middle, times what that ray is longer than its depth: metres
    /// off the plane for each metre along the optical axis.
    pub(super) cosine: f32,
    /// Inverse depth at the middle, and its slopes by column and row.
    inverse: [f32; 3],
    /// Middle pixel.
    middle: [f32; 2],
    /// It is flat, and its depth to be trusted.
    is_sure: bool,
}

/// The tiles of the part of an image that holds a mask.
pub(super) struct Tiles {
    shift: u32,
    first: [usize; 2],
    n_cols: usize,
    tiles: Vec<Tile>,
}

/// What a tile's surface is reserved by: depth at its middle pixel.
pub(super) struct Seen {
    pub(super) col: usize,
    pub(super) row: usize,
    pub(super) depth_m: f32,
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

    /// Cuts the masked part into tiles and finds their planes; `seen` hears of each that shows a surface.
    pub(super) fn new(
        trusted: &TrustedDepth<'_>,
        planes: &Planes<'_>,
        side: usize,
        mut seen: impl FnMut(&Seen),
    ) -> Self {
        let (cols, rows) = trusted.bounds();
        let shift = side.trailing_zeros();
        let first = [cols.start >> shift, rows.start >> shift];
        let end = [cols.end.div_ceil(side), rows.end.div_ceil(side)];
        let (n_cols, n_rows) = (end[0].saturating_sub(first[0]), end[1].saturating_sub(first[1]));
        let mut tiles = Vec::with_capacity(n_cols * n_rows);
        for tile_row in 0..n_rows {
            for tile_col in 0..n_cols {
                let low = [(first[0] + tile_col) << shift, (first[1] + tile_row) << shift];
                let col = (low[0] + side / 2).clamp(cols.start, cols.end - 1);
                let row = (low[1] + side / 2).clamp(rows.start, rows.end - 1);
                let mut tile = Tile::UNKNOWN;
                if let Some(depth_m) = trusted.at_in_mask(col, row) {
                    tile = planes.tile(col, row, depth_m);
                    tile.is_sure = is_flat(trusted, &tile, low, side);
                    seen(&Seen { col, row, depth_m });
                } else if side >= 4 {
                    // Something thin may pass beside the middle.
                    let quarter = side / 4;
                    for (off_col, off_row) in [(quarter, quarter), (side - 1, quarter), (quarter, side - 1)] {
                        let (col, row) = (low[0] + off_col, low[1] + off_row);
                        if cols.contains(&col)
                            && rows.contains(&row)
                            && let Some(depth_m) = trusted.at_in_mask(col, row)
                        {
                            seen(&Seen { col, row, depth_m });
                        }
                    }
                }
                tiles.push(tile);
            }
        }
        Tiles { shift, first, n_cols, tiles }
    }

    /// The tile of a pixel within the mask's bounds.
    #[inline]
    pub(super) fn at(&self, u: i32, v: i32) -> Option<&Tile> {
        let col = (u as usize >> self.shift).wrapping_sub(self.first[0]);
        let row = (v as usize >> self.shift).wrapping_sub(self.first[1]);
        if col >= self.n_cols {
            return None;
        }
        self.tiles.get(row.wrapping_mul(self.n_cols).wrapping_add(col))
    }
}

/// Whether a tile's corners and what lies just beside it are in the mask and on its plane: no edge is near.
fn is_flat(trusted: &TrustedDepth<'_>, tile: &Tile, low: [usize; 2], side: usize) -> bool {
    let (cols, rows) = trusted.bounds();
    let (last, half) = (side - 1, side / 2);
    let beside = [(0, half + BESIDE), (last + 2 * BESIDE, half + BESIDE)];
    let above = beside.map(|(col, row)| (row, col));
    let corners = [(0, 0), (last, 0), (0, last), (last, last)].map(|(c, r)| (c + BESIDE, r + BESIDE));
    corners.into_iter().chain(beside).chain(above).all(|(off_col, off_row)| {
        let (col, row) = ((low[0] + off_col).wrapping_sub(BESIDE), (low[1] + off_row).wrapping_sub(BESIDE));
        cols.contains(&col)
            && rows.contains(&row)
            && trusted.masked_m(col, row).is_some_and(|depth_m| tile.holds(col as i32, row as i32, depth_m))
    })
}

impl Tile {
    const UNKNOWN: Tile = Tile {
        normal: Vector3::new(0.0, 0.0, -1.0),
        cosine: 1.0,
        inverse: [0.0; 3],
        middle: [0.0; 2],
        is_sure: false,
    };

    pub(super) fn new(
        normal: Vector3<f32>,
        cosine: f32,
        inverse: [f32; 3],
        (col, row): (usize, usize),
    ) -> Self {
        Tile { normal, cosine, inverse, middle: [col as f32, row as f32], is_sure: true }
    }

    /// Whether a pixel's depth lies on the plane.
    #[inline]
    pub(super) fn holds(&self, u: i32, v: i32, depth_m: f32) -> bool {
        let [here, by_col, by_row] = self.inverse;
        let inverse = here + by_col * (u as f32 - self.middle[0]) + by_row * (v as f32 - self.middle[1]);
        self.is_sure && (depth_m * inverse - 1.0).abs() <= ON_PLANE
    }
}
