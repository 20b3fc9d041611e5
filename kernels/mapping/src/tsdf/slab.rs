//! A slab of a block: 64 voxels, all asked at once where they are seen, what depth is there and what that means.
//!
//! Arrays in, arrays out, one written order of operations: every instruction set computes the same. Most voxels get
//! their verdict here; those that have to look closer are only named (`update` does).

use super::BLOCK_SIDE;
use super::planes::{COSINE_MIN, whole};
use super::tiles::{ON_PLANE, TilePlane};
use super::update::View;

/// Voxels of a slab.
pub(super) const N_SLAB: usize = BLOCK_SIDE * BLOCK_SIDE;
/// Nearer to the camera nothing is seen, metres.
pub(super) const NEAR_M: f32 = 0.05;
/// Above this cosine the foot of a voxel on its plane is less than a voxel beside it.
pub(super) const COSINE_FACING: f32 = 0.9;
/// A voxel looks closely at a pixel on no tile's plane within this many truncations.
pub(super) const EDGE_BAND: f32 = 4.0;

/// What a voxel learns, or has to find out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Verdict {
    /// Nothing: out of view, hidden, or depth that is not trusted.
    Nothing,
    /// The object's surface is near.
    Surface,
    /// A ray passed through it.
    Through,
    /// A surface is seen here that is not in the mask.
    Other,
    /// The object's surface is near if its plane goes on to the voxel's foot.
    Grazing,
    /// Its pixel lies on no tile's plane.
    Edge,
    /// It may lose weight.
    Doubted,
}

/// The voxels of a slab as the camera sees them, x by x, then y by y.
pub(super) struct Slab {
    /// Where each is, in `camera`: x, y and z.
    pub(super) at: [[f32; N_SLAB]; 3],
    /// Each one's pixel: column and row, and position in the image; the position is `u32::MAX` out of view.
    pub(super) col: [i32; N_SLAB],
    pub(super) row: [i32; N_SLAB],
    pub(super) pixel: [u32; N_SLAB],
    /// Position of the pixel's tile.
    pub(super) tile: [u32; N_SLAB],
    /// How far the pixel's depth is ahead of the voxel along the optical axis, metres.
    pub(super) ahead_m: [f32; N_SLAB],
    /// How far the object's surface is in front of it, metres; negative is behind it.
    pub(super) sdf_m: [f32; N_SLAB],
    pub(super) verdict: [Verdict; N_SLAB],
}

/// From the first voxel of a slab to each one, in `camera`: by x, and by y.
pub(super) struct Offsets {
    along_x: [[f32; N_SLAB]; 3],
    along_y: [[f32; N_SLAB]; 3],
}

impl Offsets {
    /// By steps of one voxel along x and y of `map`, in `camera`.
    pub(super) fn new(steps: &[[f32; 3]; 3]) -> Self {
        let along = |step: &[f32; 3], place: fn(usize) -> usize| {
            step.map(|step| std::array::from_fn(|nth| step * place(nth) as f32))
        };
        Offsets {
            along_x: along(&steps[0], |nth| nth % BLOCK_SIDE),
            along_y: along(&steps[1], |nth| nth / BLOCK_SIDE),
        }
    }
}

impl Slab {
    pub(super) const EMPTY: Slab = Slab {
        at: [[0.0; N_SLAB]; 3],
        col: [0; N_SLAB],
        row: [0; N_SLAB],
        pixel: [u32::MAX; N_SLAB],
        tile: [u32::MAX; N_SLAB],
        ahead_m: [0.0; N_SLAB],
        sdf_m: [0.0; N_SLAB],
        verdict: [Verdict::Nothing; N_SLAB],
    };

    /// Which voxels have to look closer, a bit for each.
    #[inline(always)]
    pub(super) fn open(&self) -> u64 {
        let mut is_open = [0_u8; N_SLAB];
        for (is_open, verdict) in is_open.iter_mut().zip(&self.verdict) {
            *is_open = u8::from(*verdict as u8 >= Verdict::Grazing as u8);
        }
        let rows = is_open.as_chunks::<BLOCK_SIDE>().0.iter().enumerate();
        rows.fold(0, |bits, (row, bytes)| {
            // Gathers the lowest bit of each of eight bytes in the highest byte.
            let gathered = u64::from_le_bytes(*bytes).wrapping_mul(0x0102_0408_1020_4080) >> 56;
            bits | gathered << (row * BLOCK_SIDE)
        })
    }

    /// Finds the pixels and tiles of the voxels of a slab that lies `up` from the one that begins at `first`, in
    /// `camera`.
    #[inline(always)]
    pub(super) fn place(&mut self, view: &View<'_>, first: &[f32; 3], up: &[f32; 3]) {
        let Offsets { along_x, along_y } = &view.offsets;
        for n in 0..N_SLAB {
            let x = first[0] + along_y[0][n] + up[0] + along_x[0][n];
            let y = first[1] + along_y[1][n] + up[1] + along_x[1][n];
            let z = first[2] + along_y[2][n] + up[2] + along_x[2][n];
            (self.at[0][n], self.at[1][n], self.at[2][n]) = (x, y, z);
            let inverse = 1.0 / z;
            let u = view.focal[0] * x * inverse + (view.centre[0] + 0.5);
            let v = view.focal[1] * y * inverse + (view.centre[1] + 0.5);
            let in_view = (u >= 0.0) & (v >= 0.0) & (u < view.size[0]) & (v < view.size[1]) & (z >= NEAR_M);
            let (col, row) = (whole(if in_view { u } else { 0.0 }), whole(if in_view { v } else { 0.0 }));
            let pixel = (row as u32).wrapping_mul(view.width).wrapping_add(col as u32);
            (self.col[n], self.row[n]) = (col, row);
            self.pixel[n] = if in_view { pixel } else { u32::MAX };
            self.tile[n] = view.tiles.position(col, row);
        }
    }

    /// Judges the placed voxels of a slab by their pixels; those without weight only where `reserved`.
    #[inline(always)]
    pub(super) fn judge(&mut self, view: &View<'_>, weight: &[f32; N_SLAB], reserved: bool) {
        let mut seen_mm = [0_i32; N_SLAB];
        for (mm, pixel) in seen_mm.iter_mut().zip(&self.pixel) {
            *mm = view.depth_mm.get(*pixel as usize).map_or(0, |mm| i32::from(*mm));
        }
        let mut in_mask = [true; N_SLAB];
        if let Some(bits) = view.mask {
            for (in_mask, pixel) in in_mask.iter_mut().zip(&self.pixel) {
                *in_mask = bits.get(*pixel as usize).copied().unwrap_or(false);
            }
        }
        let clears = view.clears();
        if !clears && in_mask == [false; N_SLAB] {
            self.verdict = [Verdict::Nothing; N_SLAB];
            return;
        }
        let mut planes: [TilePlane; N_SLAB] = [[0.0; 4]; N_SLAB];
        for (plane, tile) in planes.iter_mut().zip(&self.tile) {
            *plane = view.tiles.plane(*tile);
        }
        let View { voxel_m, truncation_m, .. } = *view;
        let (far_m, edge_m) = (truncation_m / COSINE_MIN, EDGE_BAND * truncation_m);
        for n in 0..N_SLAB {
            let has_weight = weight[n] > 0.0;
            let depth_m = seen_mm[n] as f32 * 0.001;
            let ahead_m = depth_m - self.at[2][n];
            // So far off that no slope brings the surface near, and nothing to lose.
            let is_hidden = ahead_m * COSINE_MIN < -truncation_m;
            let is_far = (ahead_m > far_m) & !has_weight;
            let is_asked = (seen_mm[n] > 0) & !is_hidden & !is_far & (reserved | has_weight);
            let is_masked = is_asked & in_mask[n] & (ahead_m * COSINE_MIN <= truncation_m);
            let [here, by_col, by_row, cosine] = planes[n];
            let [off_col, off_row] = view.tiles.off_middle(self.col[n], self.row[n]);
            let inverse = here + by_col * off_col + by_row * off_row;
            let is_on_plane = is_masked & ((depth_m * inverse - 1.0).abs() <= ON_PLANE);
            let is_loose = is_masked & !is_on_plane;
            let sdf_m = ahead_m * cosine;
            let is_near = is_on_plane & (sdf_m >= -truncation_m) & (sdf_m <= truncation_m);
            let is_facing = (ahead_m.abs() <= voxel_m) | (cosine >= COSINE_FACING);
            // At an edge slopes are guesses: only what is close is looked at closely.
            let is_edge = is_loose & (ahead_m.abs() <= edge_m);
            let is_behind = (is_on_plane & (sdf_m < -truncation_m)) | (is_loose & (ahead_m < 0.0));
            let is_seen = (ahead_m > voxel_m) | (!in_mask[n] & (ahead_m.abs() <= voxel_m));
            let is_doubted = is_asked & has_weight & clears & is_seen & !is_near & !is_edge & !is_behind;
            (self.ahead_m[n], self.sdf_m[n]) = (ahead_m, sdf_m);
            let of_surface = if is_facing { Verdict::Surface } else { Verdict::Grazing };
            let otherwise = if is_doubted { Verdict::Doubted } else { Verdict::Nothing };
            let of_edge = if is_edge { Verdict::Edge } else { otherwise };
            self.verdict[n] = if is_near { of_surface } else { of_edge };
        }
    }
}
