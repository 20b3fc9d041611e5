//! A slab of a block: 64 voxels, all asked at once where they are seen and how far in front of that surface they are.
//!
//! Arrays in, arrays out, one written order of operations: every instruction set computes the same.

use super::BLOCK_SIDE;
use super::slant::{Turned, parts};
use super::update::View;

/// Voxels of a slab.
pub(super) const N_SLAB: usize = BLOCK_SIDE * BLOCK_SIDE;
/// Nearer to the camera nothing is seen, metres.
pub(super) const NEAR_M: f32 = 0.05;

/// The voxels of a slab as the camera sees them, x by x, then y by y.
pub(super) struct Slab {
    /// Depth along the optical axis, metres.
    pub(super) z_m: [f32; N_SLAB],
    /// Each one's pixel, column and row, in the image or not.
    pub(super) col: [i32; N_SLAB],
    pub(super) row: [i32; N_SLAB],
    /// Trusted depth of the object there, millimetres; 0 is none.
    pub(super) seen_mm: [i32; N_SLAB],
    /// How the surface there is turned.
    pub(super) turned: [Turned; N_SLAB],
}

/// From the first voxel of a slab to each one, as [`Frustum::in_image`](super::frustum::Frustum).
pub(super) struct Offsets([[f32; N_SLAB]; 3]);

impl Offsets {
    /// By steps of one voxel along x and y of `map`.
    pub(super) fn new(steps: &[[f32; 3]; 3]) -> Self {
        let place = |axis: usize, nth: usize| {
            steps[1][axis] * (nth / BLOCK_SIDE) as f32 + steps[0][axis] * (nth % BLOCK_SIDE) as f32
        };
        Offsets([0, 1, 2].map(|axis| std::array::from_fn(|nth| place(axis, nth))))
    }
}

impl Slab {
    pub(super) const EMPTY: Slab = Slab {
        z_m: [0.0; N_SLAB],
        col: [0; N_SLAB],
        row: [0; N_SLAB],
        seen_mm: [0; N_SLAB],
        turned: [0; N_SLAB],
    };

    /// How far the surface that a voxel sees is behind it, metres, and whether it is near enough to belong to it: across
    /// the surface if the voxel's foot is on it, or else along the optical axis.
    #[inline(always)]
    pub(super) fn off_m(&self, n: usize, voxel_m: f32) -> (f32, bool) {
        let ahead_m = self.seen_mm[n] as f32 * 0.001 - self.z_m[n];
        let (cosine, [behind, front]) = parts(self.turned[n]);
        let cosine = if ahead_m > front * voxel_m { 1.0 } else { cosine };
        (ahead_m * cosine, ahead_m >= -behind * voxel_m)
    }

    /// Finds where the voxels of a slab are seen, and what is seen of the object there; whether there is any.
    #[inline(always)]
    pub(super) fn place(&mut self, view: &View<'_>, first: &[f32; 3]) -> bool {
        let Offsets([along_u, along_v, along_z]) = &view.offsets;
        let ([first_col, first_row], [n_cols, n_rows]) = (view.first_px, view.n_px);
        // The last one is that of no pixel.
        let none = view.seen_mm.len() as u32 - 1;
        let tiles = view.tiles;
        let (mut place, mut tile) = ([0_u32; N_SLAB], [0_u32; N_SLAB]);
        for n in 0..N_SLAB {
            let z_m = first[2] + along_z[n];
            let inverse = 1.0 / z_m;
            let col = nearest((first[0] + along_u[n]) * inverse);
            let row = nearest((first[1] + along_v[n]) * inverse);
            let (in_cols, in_rows) = (col.wrapping_sub(first_col) as u32, row.wrapping_sub(first_row) as u32);
            let is_seen = (in_cols < n_cols) & (in_rows < n_rows) & (z_m >= NEAR_M);
            place[n] = if is_seen { in_rows.wrapping_mul(n_cols).wrapping_add(in_cols) } else { none };
            let tile_col = (col as u32).wrapping_shr(tiles.shift).wrapping_sub(tiles.first[0]);
            let tile_row = (row as u32).wrapping_shr(tiles.shift).wrapping_sub(tiles.first[1]);
            tile[n] = if is_seen { tile_row.wrapping_mul(tiles.n_cols).wrapping_add(tile_col) } else { 0 };
            (self.z_m[n], self.col[n], self.row[n]) = (z_m, col, row);
        }
        if place == [none; N_SLAB] {
            self.seen_mm = [0; N_SLAB];
            return false;
        }
        for (mm, place) in self.seen_mm.iter_mut().zip(&place) {
            *mm = view.seen_mm.get(*place as usize).map_or(0, |mm| i32::from(*mm));
        }
        for (turned, tile) in self.turned.iter_mut().zip(&tile) {
            *turned = tiles.turned.get(*tile as usize).copied().unwrap_or(0);
        }
        true
    }
}

/// The nearest whole number, of two the even one; far beyond any image where that is farther than millions off, or NaN.
/// A cast has cases for all numbers, which vectors have not.
#[inline(always)]
pub(super) fn nearest(value: f32) -> i32 {
    /// Between this and twice as much f32 are whole numbers, and their lowest bits count them.
    const WHOLE: f32 = 12_582_912.0;
    (value + WHOLE).to_bits().wrapping_sub(WHOLE.to_bits()) as i32
}
