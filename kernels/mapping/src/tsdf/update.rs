//! What one frame tells the voxels of blocks.
//!
//! Voxels are placed and averaged in loops over arrays ([`slab`](super::slab)), which compilers turn into vectors. Only
//! those with something to lose look closer, one by one.

use geometry::Point3;

use super::frustum::Frustum;
use super::seen::Seen;
use super::slab::{N_SLAB, NEAR_M, Offsets, Slab, nearest};
use super::tiles::Tiles;
use super::{BLOCK_SIDE, BlockKey, Head, Integrated, TsdfConfig, Voxels};
use crate::image::{DepthFrame, Mask};
use crate::isa::Work;

/// One frame, ready to be asked by voxels. Single precision: a camera sees metres, not kilometres.
pub(super) struct View<'a> {
    depth_mm: &'a [u16],
    mask: Option<&'a [bool]>,
    width: i32,
    height: i32,
    /// What is seen of the object in the box around its mask, that box's first column and row, and its size.
    pub(super) seen_mm: &'a [u16],
    pub(super) first_px: [i32; 2],
    pub(super) n_px: [u32; 2],
    pub(super) tiles: &'a Tiles,
    frustum: Frustum,
    /// Step of one voxel along z of `map`, as `Frustum::in_image`.
    up: [f32; 3],
    pub(super) offsets: Offsets,
    focal: f32,
    voxel_m: f32,
    truncation_m: f32,
    weight_max: f32,
    /// Whether anything loses weight; blocks that hold no surface of this frame are then looked at too.
    clears: bool,
    carve_step: f32,
    absent_step: f32,
}

/// The update of all blocks by a frame, of which `frame` is the number.
pub(super) struct Update<'v, 'a> {
    pub(super) view: &'v View<'a>,
    pub(super) heads: &'v [Head],
    pub(super) blocks: &'v mut [Voxels],
    pub(super) frame: u64,
    /// Positions of the blocks that the frame reserved, each once.
    pub(super) reserved: &'v [u32],
    pub(super) done: &'v mut Integrated,
}

impl Work for Update<'_, '_> {
    /// Positions of the blocks that nothing is left in, ascending.
    type Output = Vec<usize>;

    // Never fused: every instruction set computes the same.
    #[inline(always)]
    fn run<const FUSED: bool>(mut self) -> Vec<usize> {
        let mut emptied = Vec::new();
        if self.view.clears {
            for at in 0..self.heads.len() {
                let Some(head) = self.heads.get(at) else { continue };
                self.update(at, head.key, head.frame == self.frame, &mut emptied);
            }
        } else {
            for at in self.reserved {
                let at = *at as usize;
                let Some(head) = self.heads.get(at) else { continue };
                self.update(at, head.key, true, &mut emptied);
            }
            emptied.sort_unstable();
        }
        emptied
    }
}

impl Update<'_, '_> {
    #[inline(always)]
    fn update(&mut self, at: usize, key: BlockKey, reserved: bool, emptied: &mut Vec<usize>) {
        if !self.view.frustum.sees(key) {
            return;
        }
        let Some(block) = self.blocks.get_mut(at) else { return };
        let n_hit = self.view.update(key, block, reserved, self.done);
        if n_hit == 0 && block.weight.iter().all(|w| *w <= 0.0) {
            emptied.push(at);
        }
    }
}

impl<'a> View<'a> {
    pub(super) fn new(
        frame: &DepthFrame<'a>,
        mask: Option<&'a Mask>,
        (seen, tiles): (&'a Seen, &'a Tiles),
        config: &TsdfConfig,
    ) -> Self {
        let camera = frame.intrinsics();
        let frustum = Frustum::new(frame, config);
        let steps = frustum.steps(config.voxel_m);
        View {
            depth_mm: frame.depth().depth_mm(),
            mask: mask.map(Mask::bits),
            width: camera.width as i32,
            height: camera.height as i32,
            seen_mm: seen.all_mm(),
            first_px: seen.first(),
            n_px: seen.size(),
            tiles,
            frustum,
            up: steps[2],
            offsets: Offsets::new(&steps),
            focal: camera.fx as f32,
            voxel_m: config.voxel_m as f32,
            truncation_m: config.truncation_m as f32,
            weight_max: config.weight_max,
            clears: config.clears(),
            carve_step: config.carve_step,
            absent_step: config.absent_step,
        }
    }

    /// Lets every voxel of a block learn from its pixel; returns how many were hit.
    #[inline(always)]
    fn update(&self, key: BlockKey, block: &mut Voxels, reserved: bool, done: &mut Integrated) -> usize {
        let first = self.frustum.first(key);
        let (means, _) = block.sdf_m.as_chunks_mut::<N_SLAB>();
        let (weights, _) = block.weight.as_chunks_mut::<N_SLAB>();
        let (mut slab, mut n_hit_all) = (Slab::EMPTY, 0);
        for (nth, (mean_m, weight)) in means.iter_mut().zip(weights).enumerate() {
            let has_weight = self.clears && weight.iter().any(|w| *w > 0.0);
            if !reserved && !has_weight {
                continue;
            }
            let up = [0, 1, 2].map(|axis| first[axis] + self.up[axis] * nth as f32);
            if !slab.place(self, &up) && !has_weight {
                continue;
            }
            let barred =
                if has_weight { self.barred(&slab, mean_m, weight, reserved) } else { [false; N_SLAB] };
            n_hit_all += self.average(&slab, mean_m, weight, &barred);
            if has_weight {
                done.n_voxels_cleared += self.clear(&slab, weight, &barred);
            }
        }
        done.n_voxels_hit += n_hit_all;
        n_hit_all
    }

    /// Lets the voxels of a slab that see the object have what they learnt, save those that are `barred`; returns how
    /// many. What is farther in front of it than a truncation counts as just that far.
    #[inline(always)]
    fn average(
        &self,
        slab: &Slab,
        mean_m: &mut [f32; N_SLAB],
        weight: &mut [f32; N_SLAB],
        barred: &[bool; N_SLAB],
    ) -> usize {
        let mut n_hit = 0_u32;
        for n in 0..N_SLAB {
            let (off_m, is_near) = slab.off_m(n, self.voxel_m);
            let is_hit = (slab.seen_mm[n] > 0) & is_near & !barred[n];
            let sdf_m = off_m.min(self.truncation_m);
            let next_m = mean_m[n] + (sdf_m - mean_m[n]) / (weight[n] + 1.0);
            let next = (weight[n] + 1.0).min(self.weight_max);
            mean_m[n] = if is_hit { next_m } else { mean_m[n] };
            weight[n] = if is_hit { next } else { weight[n] };
            n_hit = n_hit.wrapping_add(u32::from(is_hit));
        }
        n_hit as usize
    }

    /// Which voxels of a slab are not told by the object what they are: all that do not see it, and those by the surface
    /// that see it farther behind them than a truncation. Free space must not wear away what is thin: that is for
    /// [`Self::lost_to_ray`] to judge. In blocks that are not reserved, no voxel is in front of anything.
    #[inline(always)]
    fn barred(
        &self,
        slab: &Slab,
        mean_m: &[f32; N_SLAB],
        weight: &[f32; N_SLAB],
        reserved: bool,
    ) -> [bool; N_SLAB] {
        let free_m = if reserved { self.voxel_m } else { f32::INFINITY };
        let mut barred = [false; N_SLAB];
        for n in 0..N_SLAB {
            let (off_m, _) = slab.off_m(n, self.voxel_m);
            let has_weight = weight[n] > 0.0;
            let is_worn = (off_m > self.truncation_m) & (mean_m[n] < free_m) & has_weight;
            barred[n] = (slab.seen_mm[n] == 0) | is_worn | !(reserved | has_weight);
        }
        barred
    }

    /// Takes weight from the barred voxels of a slab that are seen through, or where something else is seen; returns from
    /// how many.
    #[inline(always)]
    fn clear(&self, slab: &Slab, weight: &mut [f32; N_SLAB], barred: &[bool; N_SLAB]) -> usize {
        let mut doubted = [0_u8; N_SLAB];
        for n in 0..N_SLAB {
            doubted[n] = u8::from((weight[n] > 0.0) & (slab.z_m[n] >= NEAR_M) & barred[n]);
        }
        let mut n_cleared = 0;
        for (n, _) in doubted.iter().enumerate().filter(|(_, doubted)| **doubted > 0) {
            let lost = self.lost(slab.col[n], slab.row[n], slab.z_m[n]);
            if lost > 0.0 {
                weight[n] = (weight[n] - lost).max(0.0);
                n_cleared += 1;
            }
        }
        n_cleared
    }

    /// Weight that a place in `map` loses, as a voxel there would; none while the object is seen close by, about as far
    /// off: when poses are a little off, what is thin is seen beside its place.
    // Asked of few, beside an update of many.
    #[inline(never)]
    pub(super) fn lost_at(&self, point_map: &Point3) -> f32 {
        let [across, down, depth_m] = self.frustum.at(point_map);
        if depth_m < NEAR_M {
            return 0.0;
        }
        let (col, row) = (nearest(across / depth_m), nearest(down / depth_m));
        let lost = self.lost(col, row, depth_m);
        if lost > 0.0 && self.is_close_by(col, row, depth_m) { 0.0 } else { lost }
    }

    /// Whether the object is seen within two voxels of a pixel's place, in line with it.
    fn is_close_by(&self, col: i32, row: i32, depth_m: f32) -> bool {
        let close_m = 2.0 * self.voxel_m;
        let reach = ((close_m * self.focal / depth_m) as i32 + 1).min(64);
        let is_there = |right: i32, down: i32| {
            let Some(idx) = self.position(col + right, row + down) else { return false };
            let seen_mm = self.depth_mm.get(idx).copied().unwrap_or(0);
            self.in_mask(idx) && (f32::from(seen_mm) * 0.001 - depth_m).abs() <= close_m
        };
        // Eight looks to each side are closer together than what is thin is broad.
        let mut offs = (1..=reach).rev().step_by(reach as usize / 8 + 1);
        offs.any(|off| [(off, 0), (-off, 0), (0, off), (0, -off)].into_iter().any(|(r, d)| is_there(r, d)))
    }

    /// Weight that a voxel loses by its pixel.
    #[inline(always)]
    fn lost(&self, col: i32, row: i32, depth_m: f32) -> f32 {
        let Some(idx) = self.position(col, row) else { return 0.0 };
        let seen_mm = self.depth_mm.get(idx).copied().unwrap_or(0);
        let ahead_m = f32::from(seen_mm) * 0.001 - depth_m;
        if seen_mm == 0 || ahead_m < -self.voxel_m {
            return 0.0;
        }
        let free_m = if self.in_mask(idx) { self.truncation_m } else { self.voxel_m };
        if ahead_m > free_m {
            return self.lost_to_ray(depth_m, col, row);
        }
        if self.in_mask(idx) || self.is_beside_mask(col, row) { 0.0 } else { self.absent_step }
    }

    /// What a ray that passes through the voxel, `depth_m` along the optical axis, takes by what the pixels at the
    /// voxel's rim show: a pose that is a little off must not carve away what is thin, nor what touches the floor stay for
    /// ever.
    fn lost_to_ray(&self, depth_m: f32, col: i32, row: i32) -> f32 {
        let off = ((0.5 * self.voxel_m * self.focal / depth_m) as i32 + 1).min(16);
        let mut lost = self.carve_step;
        for (right, down) in [(off, 0), (-off, 0), (0, off), (0, -off)] {
            let Some(idx) = self.position(col + right, row + down) else { continue };
            let seen_mm = self.depth_mm.get(idx).copied().unwrap_or(0);
            let ahead_m = f32::from(seen_mm) * 0.001 - depth_m;
            // Zero, no depth, tells nothing.
            if ahead_m > self.voxel_m || seen_mm == 0 {
                continue;
            }
            if self.in_mask(idx) {
                return 0.0;
            }
            // A surface where the voxel is. What is clearly in front hides the rim and no more.
            if ahead_m >= -2.0 * self.voxel_m {
                lost = self.absent_step;
            }
        }
        lost
    }

    /// Whether the mask is within two pixels: its border is not exact enough to tell absence.
    fn is_beside_mask(&self, col: i32, row: i32) -> bool {
        let around =
            [(2, 0), (-2, 0), (0, 2), (0, -2)].map(|(right, down)| self.position(col + right, row + down));
        around.into_iter().flatten().any(|idx| self.in_mask(idx))
    }

    #[inline(always)]
    fn in_mask(&self, idx: usize) -> bool {
        self.mask.is_none_or(|mask| mask.get(idx) == Some(&true))
    }

    /// Position of a pixel in the image.
    #[inline(always)]
    fn position(&self, col: i32, row: i32) -> Option<usize> {
        let is_inside = col >= 0 && row >= 0 && col < self.width && row < self.height;
        is_inside.then(|| row as usize * self.width as usize + col as usize)
    }
}

/// Voxels of a block: a slab for each step along z.
const _: () = assert!(BLOCK_SIDE * N_SLAB == super::BLOCK_VOXELS);
