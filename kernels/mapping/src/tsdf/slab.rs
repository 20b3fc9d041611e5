//! A slab of a block: 64 voxels, all asked at once where they are seen and what depth is there.
//!
//! Arrays in, arrays out, one written order of operations: every instruction set computes the same. What the depth
//! means is not decided here (`update`), only which voxels are worth a look.

use nalgebra::{Point3, Vector3};

use super::BLOCK_SIDE;
use super::update::View;

/// Voxels of a slab.
pub(super) const N_SLAB: usize = BLOCK_SIDE * BLOCK_SIDE;
/// Nearer to the camera nothing is seen, metres.
pub(super) const NEAR_M: f32 = 0.05;
/// Added to a number of a few millions at most, leaves it rounded to a whole one in the lowest bits: no cast, which
/// has a case for every number that is none.
pub(super) const ROUNDING: f32 = 12_582_912.0;

/// The voxels of a slab as the camera sees them, x by x, then y by y.
pub(super) struct Slab {
    /// The first one, in `camera`.
    pub(super) begin: Point3<f32>,
    /// Each one's pixel: column, row, and position in the image; the position is 0 out of view.
    pub(super) cols: [u32; N_SLAB],
    pub(super) rows: [u32; N_SLAB],
    pub(super) pixel: [u32; N_SLAB],
    /// Position of the pixel's tile.
    pub(super) tile: [u32; N_SLAB],
    /// How far the pixel's depth is ahead of the voxel along the optical axis, metres; NaN where there is none.
    pub(super) ahead_m: [f32; N_SLAB],
}

impl Slab {
    /// From the first voxel of a slab to each one, by steps of one voxel along x and y of `map`, in `camera`.
    pub(super) fn offsets(steps: &[Vector3<f32>; 3]) -> [[f32; N_SLAB]; 3] {
        [0, 1, 2].map(|axis| {
            std::array::from_fn(|nth| {
                let (x, y) = (nth % BLOCK_SIDE, nth / BLOCK_SIDE);
                steps[0][axis] * x as f32 + steps[1][axis] * y as f32
            })
        })
    }

    /// Asks the image for all voxels of the slab that begins at `begin`, in `camera`.
    #[inline(always)]
    pub(super) fn new(view: &View<'_>, begin: Point3<f32>) -> Self {
        let mut slab = Slab {
            begin,
            cols: [0; N_SLAB],
            rows: [0; N_SLAB],
            pixel: [0; N_SLAB],
            tile: [0; N_SLAB],
            ahead_m: [f32::NAN; N_SLAB],
        };
        let (width, height) = (view.width as u32, view.height as u32);
        let mut depth_m = [0.0_f32; N_SLAB];
        let [along_x, along_y, along_z] = &view.offsets;
        for nth in 0..N_SLAB {
            let z = begin.z + along_z[nth];
            let inverse = 1.0 / z;
            let u = view.focal[0] * (begin.x + along_x[nth]) * inverse + view.centre[0];
            let v = view.focal[1] * (begin.y + along_y[nth]) * inverse + view.centre[1];
            // What is no number, or far outside, comes out larger than any image.
            let col = (u + ROUNDING).to_bits().wrapping_sub(ROUNDING.to_bits());
            let row = (v + ROUNDING).to_bits().wrapping_sub(ROUNDING.to_bits());
            let in_view = (col < width) & (row < height) & (z >= NEAR_M);
            (slab.cols[nth], slab.rows[nth]) = (col, row);
            slab.pixel[nth] = if in_view { row.wrapping_mul(width).wrapping_add(col) } else { 0 };
            slab.tile[nth] = view.tiles.position(col, row);
            // NaN makes what comes of it NaN.
            depth_m[nth] = if in_view { z } else { f32::NAN };
        }
        let mut seen_mm = [0_i32; N_SLAB];
        for (mm, pixel) in seen_mm.iter_mut().zip(&slab.pixel) {
            *mm = view.depth_mm.get(*pixel as usize).map_or(0, |mm| i32::from(*mm));
        }
        for nth in 0..N_SLAB {
            let ahead_m = seen_mm[nth] as f32 * 0.001 - depth_m[nth];
            slab.ahead_m[nth] = if seen_mm[nth] > 0 { ahead_m } else { f32::NAN };
        }
        slab
    }

    /// Which voxels are near a masked surface, or have something to lose.
    #[inline(always)]
    pub(super) fn wanted(
        &self,
        view: &View<'_>,
        weight: &[f32; N_SLAB],
        reserved: bool,
        clears: bool,
    ) -> Wanted {
        let mut cosine = [0.0_f32; N_SLAB];
        for (cosine, tile) in cosine.iter_mut().zip(&self.tile) {
            *cosine = view.tiles.cosine(*tile);
        }
        let mut flags = [0_u8; N_SLAB];
        for nth in 0..N_SLAB {
            let (ahead_m, has_weight) = (self.ahead_m[nth], weight[nth] > 0.0);
            // Steep surfaces are nearer than their depth.
            let is_near = (ahead_m.abs() * cosine[nth] <= view.truncation_m) & (reserved | has_weight);
            let may_lose = has_weight & clears & (ahead_m >= -view.voxel_m);
            flags[nth] = u8::from(is_near | may_lose);
        }
        Wanted { flags, at: 0, rest: 0 }
    }
}

/// Goes through the voxels that are wanted, in order, a row of eight at a time.
pub(super) struct Wanted {
    flags: [u8; N_SLAB],
    /// Rows begun.
    at: usize,
    /// What is left of the last one, a byte for each voxel.
    rest: u64,
}

impl Wanted {
    /// Place in the slab of the next one.
    #[inline(always)]
    pub(super) fn next(&mut self) -> Option<usize> {
        while self.rest == 0 {
            let row = self.flags.as_chunks::<BLOCK_SIDE>().0.get(self.at)?;
            self.rest = u64::from_le_bytes(*row);
            self.at += 1;
        }
        let x = self.rest.trailing_zeros() as usize / 8;
        self.rest &= self.rest - 1;
        Some((self.at - 1) * BLOCK_SIDE + x)
    }
}
