//! What one frame tells the voxels of one block.
//!
//! All voxels are placed and judged in loops over arrays ([`slab`](super::slab)), which compilers turn into vectors.
//! Those that have to look closer do so here: where surfaces are seen at a grazing angle or at an edge, in batches;
//! where there is weight to lose, one by one.

use super::frustum::Frustum;
use super::planes::{LANES, Lanes, Planes, whole};
use super::slab::{N_SLAB, NEAR_M, Offsets, Slab, Verdict};
use super::tiles::Tiles;
use super::{BLOCK_SIDE, BLOCK_VOXELS, Block, Integrated, TsdfConfig};
use crate::image::{DepthFrame, Mask};
use crate::isa::Work;
use crate::projection::TrustedDepth;

/// One frame, ready to be asked by voxels. Single precision: a camera sees metres, not kilometres.
pub(super) struct View<'a> {
    pub(super) depth_mm: &'a [u16],
    pub(super) mask: Option<&'a [bool]>,
    trusted: &'a TrustedDepth<'a>,
    planes: &'a Planes<'a>,
    pub(super) tiles: &'a Tiles,
    pub(super) width: u32,
    height: u32,
    /// Width and height again.
    pub(super) size: [f32; 2],
    pub(super) focal: [f32; 2],
    pub(super) centre: [f32; 2],
    pub(super) frustum: Frustum,
    /// Steps of one voxel along x, y and z of `map`, in `camera`.
    steps: [[f32; 3]; 3],
    pub(super) offsets: Offsets,
    pub(super) voxel_m: f32,
    pub(super) truncation_m: f32,
    weight_max: f32,
    carve_step: f32,
    absent_step: f32,
}

/// The update of all blocks by a frame, of which `frame` is the number; yields the positions of those emptied.
pub(super) struct Update<'v, 'a> {
    pub(super) view: &'v View<'a>,
    pub(super) blocks: &'v mut [Block],
    pub(super) frame: u64,
    pub(super) done: &'v mut Integrated,
}

impl Work for Update<'_, '_> {
    type Output = Vec<usize>;

    // Never fused: every instruction set computes the same.
    #[inline(always)]
    fn run<const FUSED: bool>(self) -> Vec<usize> {
        let mut slabs = [const { Slab::EMPTY }; BLOCK_SIDE];
        let mut open = Open { grazing: List::new(), edges: List::new(), doubted: List::new() };
        let mut emptied = Vec::new();
        for (idx, block) in self.blocks.iter_mut().enumerate() {
            let reserved = block.frame == self.frame;
            if (!reserved && !self.view.clears()) || !self.view.frustum.sees(block) {
                continue;
            }
            let n_before = self.done.n_voxels_hit;
            self.view.judge(block, reserved, &mut slabs, &mut open);
            self.view.look_closer(block, &mut slabs, &mut open);
            self.view.apply(block, &slabs, self.done);
            if self.done.n_voxels_hit == n_before && block.weight.iter().all(|w| *w <= 0.0) {
                emptied.push(idx);
            }
        }
        emptied
    }
}

/// Voxels of a block that have to look closer, by what they have to find out.
struct Open {
    grazing: List,
    edges: List,
    doubted: List,
}

/// Positions in a block.
struct List {
    n: usize,
    positions: [u16; BLOCK_VOXELS],
}

impl List {
    fn new() -> Self {
        List { n: 0, positions: [0; BLOCK_VOXELS] }
    }

    /// Without a branch: which voxel is of which kind is not to be foreseen. No block has more than there is room for.
    #[inline(always)]
    fn push_if(&mut self, is_kept: bool, position: usize) {
        let last = BLOCK_VOXELS - 1;
        self.positions[self.n.min(last)] = position as u16;
        self.n = self.n.wrapping_add(usize::from(is_kept));
    }

    #[inline(always)]
    fn all(&self) -> &[u16] {
        &self.positions[..self.n.min(BLOCK_VOXELS)]
    }
}

/// The slab of a voxel of a block, and its place there.
#[inline(always)]
fn place(slabs: &[Slab; BLOCK_SIDE], position: u16) -> (&Slab, usize) {
    (&slabs[position as usize / N_SLAB % BLOCK_SIDE], position as usize % N_SLAB)
}

impl<'a> View<'a> {
    pub(super) fn new(
        frame: &DepthFrame<'a>,
        mask: Option<&'a Mask>,
        trusted: &'a TrustedDepth<'a>,
        (planes, tiles): (&'a Planes<'a>, &'a Tiles),
        config: &TsdfConfig,
    ) -> Self {
        let camera = frame.intrinsics();
        let frustum = Frustum::new(frame, config);
        let steps = frustum.steps(config.voxel_m);
        View {
            depth_mm: frame.depth().depth_mm(),
            mask: mask.map(Mask::bits),
            trusted,
            planes,
            tiles,
            width: camera.width,
            height: camera.height,
            size: [camera.width as f32, camera.height as f32],
            focal: [camera.fx as f32, camera.fy as f32],
            centre: [camera.cx as f32, camera.cy as f32],
            frustum,
            offsets: Offsets::new(&steps),
            steps,
            voxel_m: config.voxel_m as f32,
            truncation_m: config.truncation_m as f32,
            weight_max: config.weight_max,
            carve_step: config.carve_step,
            absent_step: config.absent_step,
        }
    }

    /// Whether anything loses weight; blocks that hold no surface of this frame are then looked at too.
    #[inline(always)]
    pub(super) fn clears(&self) -> bool {
        self.carve_step > 0.0 || self.absent_step > 0.0
    }

    /// Lets every voxel of a block look at its pixel, and names those that have to look closer.
    #[inline(always)]
    fn judge(&self, block: &Block, reserved: bool, slabs: &mut [Slab; BLOCK_SIDE], open: &mut Open) {
        let corner: nalgebra::Point3<f32> = self.frustum.in_camera(block, 0.0).cast();
        let [x, y, z] = &self.steps;
        let first = [0, 1, 2].map(|axis| corner[axis] + (x[axis] + y[axis] + z[axis]) * 0.5);
        (open.grazing.n, open.edges.n, open.doubted.n) = (0, 0, 0);
        let (weights, _) = block.weight.as_chunks::<N_SLAB>();
        for ((nth, slab), weight) in slabs.iter_mut().enumerate().zip(weights) {
            if !reserved && weight.iter().all(|w| *w <= 0.0) {
                slab.verdict = [Verdict::Nothing; N_SLAB];
                continue;
            }
            slab.place(self, &first, &z.map(|step| step * nth as f32));
            slab.judge(self, weight, reserved);
            let mut rest = slab.open();
            while rest != 0 {
                let n = rest.trailing_zeros() as usize % N_SLAB;
                rest &= rest - 1;
                let (position, verdict) = (nth * N_SLAB + n, slab.verdict[n]);
                open.grazing.push_if(verdict == Verdict::Grazing, position);
                open.edges.push_if(verdict == Verdict::Edge, position);
                open.doubted.push_if(verdict == Verdict::Doubted, position);
            }
        }
    }

    /// Settles what the voxels of a block have to find out.
    #[inline(always)]
    fn look_closer(&self, block: &Block, slabs: &mut [Slab; BLOCK_SIDE], open: &mut Open) {
        for positions in open.grazing.all().chunks(LANES) {
            let (mut at, mut normal) = ([[0.0_f32; LANES]; 3], [[0.0_f32; LANES]; 3]);
            let mut sdf_m = [0.0_f32; LANES];
            for (lane, position) in positions.iter().take(LANES).enumerate() {
                let (slab, n) = place(slabs, *position);
                (at[0][lane], at[1][lane], at[2][lane]) = (slab.at[0][n], slab.at[1][n], slab.at[2][n]);
                [normal[0][lane], normal[1][lane], normal[2][lane]] = self.tiles.normal(slab.tile[n]);
                sdf_m[lane] = slab.sdf_m[n];
            }
            let is_over = self.are_over_object(&at, &normal, &sdf_m);
            for (position, is_over) in positions.iter().zip(is_over) {
                let (slab, n) = (*position as usize / N_SLAB, *position as usize % N_SLAB);
                slabs[slab].verdict[n] = if is_over { Verdict::Surface } else { Verdict::Nothing };
            }
        }
        for positions in open.edges.all().chunks(LANES) {
            self.look_at_edges(slabs, positions, block, &mut open.doubted);
        }
        for position in open.doubted.all() {
            let (slab, n) = (*position as usize / N_SLAB, *position as usize % N_SLAB);
            slabs[slab].verdict[n] = self.doubt(&slabs[slab], n);
        }
    }

    /// What masked pixels that lie on no tile's plane say; whose surface is far behind may lose.
    #[inline(always)]
    fn look_at_edges(
        &self,
        slabs: &mut [Slab; BLOCK_SIDE],
        positions: &[u16],
        block: &Block,
        doubted: &mut List,
    ) {
        let mut at = [[0.0_f32; LANES]; 3];
        let (mut pixels, mut mm) = ([[0_i32; LANES]; 2], [1_i32; LANES]);
        let mut ahead_m = [0.0_f32; LANES];
        for (lane, position) in positions.iter().take(LANES).enumerate() {
            let (slab, n) = place(slabs, *position);
            (at[0][lane], at[1][lane], at[2][lane]) = (slab.at[0][n], slab.at[1][n], slab.at[2][n]);
            (pixels[0][lane], pixels[1][lane]) = (slab.col[n], slab.row[n]);
            ahead_m[lane] = slab.ahead_m[n];
            mm[lane] = self.depth_mm.get(slab.pixel[n] as usize).map_or(1, |mm| i32::from(*mm));
        }
        let (mut depth_m, mut sdf_m) = ([0.0_f32; LANES], ahead_m);
        for (depth_m, mm) in depth_m.iter_mut().zip(&mm) {
            *depth_m = *mm as f32 * 0.001;
        }
        let found = self.planes.at(&pixels, &depth_m);
        for (sdf_m, cosine) in sdf_m.iter_mut().zip(&found.cosine) {
            *sdf_m *= cosine;
        }
        let is_over = self.are_over_object(&at, &found.normal, &sdf_m);
        for (lane, position) in positions.iter().enumerate() {
            let position = *position as usize;
            let (slab, n) = (&mut slabs[position / N_SLAB], position % N_SLAB);
            let (ahead_m, sdf_m) = (ahead_m[lane], sdf_m[lane]);
            slab.verdict[n] = Verdict::Nothing;
            if sdf_m > self.truncation_m {
                let may_lose = self.clears() && ahead_m > self.voxel_m && block.weight[position] > 0.0;
                doubted.push_if(may_lose, position);
            } else if sdf_m >= -self.truncation_m && (ahead_m.abs() <= self.voxel_m || is_over[lane]) {
                let is_trusted = self.trusted.at(slab.col[n] as usize, slab.row[n] as usize).is_some();
                (slab.sdf_m[n], slab.verdict[n]) =
                    (sdf_m, if is_trusted { Verdict::Surface } else { Verdict::Nothing });
            }
        }
    }

    /// Whether the feet of voxels on the planes of their pixels, in `camera`, are object: at a grazing angle the
    /// two are far apart, and beyond the object's edge its plane goes on without it.
    #[inline(always)]
    fn are_over_object(&self, at: &[Lanes; 3], normal: &[Lanes; 3], sdf_m: &Lanes) -> [bool; LANES] {
        let (mut place, mut foot_z) = ([0_u32; LANES], [0.0_f32; LANES]);
        for n in 0..LANES {
            let x = at[0][n] + normal[0][n] * sdf_m[n];
            let y = at[1][n] + normal[1][n] * sdf_m[n];
            let z = at[2][n] + normal[2][n] * sdf_m[n];
            let inverse = 1.0 / z;
            let u = self.focal[0] * x * inverse + self.centre[0] + 0.5;
            let v = self.focal[1] * y * inverse + self.centre[1] + 0.5;
            let in_view = (u >= 0.0) & (v >= 0.0) & (u < self.size[0]) & (v < self.size[1]) & (z >= NEAR_M);
            let (u, v) = (whole(if in_view { u } else { 0.0 }), whole(if in_view { v } else { 0.0 }));
            let position = (v as u32).wrapping_mul(self.width).wrapping_add(u as u32);
            place[n] = if in_view { position } else { u32::MAX };
            foot_z[n] = z;
        }
        // Beside the mask: farther than any foot.
        let mut seen_mm = [i32::MAX; LANES];
        for (mm, place) in seen_mm.iter_mut().zip(&place) {
            *mm = self.trusted.masked_mm(*place as usize).map_or(i32::MAX, i32::from);
        }
        let mut is_over = [false; LANES];
        for n in 0..LANES {
            is_over[n] = (seen_mm[n] as f32 * 0.001 - foot_z[n]).abs() <= self.voxel_m;
        }
        is_over
    }

    /// What a voxel with weight learns that is seen through, or where something else is seen.
    fn doubt(&self, slab: &Slab, n: usize) -> Verdict {
        let (u, v) = (slab.col[n], slab.row[n]);
        if slab.ahead_m[n] > self.voxel_m {
            return self.look_around(slab.at[2][n], u, v);
        }
        if self.is_beside_mask(u, v) { Verdict::Nothing } else { Verdict::Other }
    }

    /// What a ray that passes through the voxel's centre, `depth_m` along the optical axis, means by the pixels at the
    /// voxel's rim: a pose that is a little off must not carve away what is thin, nor what touches the floor stay for
    /// ever.
    fn look_around(&self, depth_m: f32, u: i32, v: i32) -> Verdict {
        let off = ((0.5 * self.voxel_m * self.focal[0] / depth_m) as i32 + 1).min(16);
        let mut verdict = Verdict::Through;
        for (du, dv) in [(off, 0), (-off, 0), (0, off), (0, -off)] {
            let Some(idx) = self.position(u + du, v + dv) else { continue };
            let ahead_m = f32::from(self.depth_mm[idx]) * 0.001 - depth_m;
            // Zero, no depth, tells nothing.
            if ahead_m > self.voxel_m || self.depth_mm[idx] == 0 {
                continue;
            }
            if self.trusted.in_mask(idx) {
                return Verdict::Nothing;
            }
            // A surface where the voxel is. What is clearly in front hides the rim and no more.
            if ahead_m >= -2.0 * self.voxel_m {
                verdict = Verdict::Other;
            }
        }
        verdict
    }

    /// Whether the mask is within two pixels: its border is not exact enough to tell absence.
    fn is_beside_mask(&self, u: i32, v: i32) -> bool {
        let around = [(2, 0), (-2, 0), (0, 2), (0, -2)].map(|(du, dv)| self.position(u + du, v + dv));
        around.into_iter().flatten().any(|idx| self.trusted.in_mask(idx))
    }

    /// Position of a pixel in the image.
    fn position(&self, u: i32, v: i32) -> Option<usize> {
        let is_inside = u >= 0 && v >= 0 && (u as u32) < self.width && (v as u32) < self.height;
        is_inside.then(|| v as usize * self.width as usize + u as usize)
    }

    /// Lets the voxels of a block have what they learnt.
    #[inline(always)]
    fn apply(&self, block: &mut Block, slabs: &[Slab; BLOCK_SIDE], done: &mut Integrated) {
        let (means, _) = block.sdf_m.as_chunks_mut::<N_SLAB>();
        let (weights, _) = block.weight.as_chunks_mut::<N_SLAB>();
        for ((slab, mean_m), weight) in slabs.iter().zip(means).zip(weights) {
            if slab.verdict == [Verdict::Nothing; N_SLAB] {
                continue;
            }
            let (mut n_hit, mut n_cleared) = (0_u32, 0_u32);
            for n in 0..N_SLAB {
                let verdict = slab.verdict[n];
                let is_hit = verdict == Verdict::Surface;
                let of_other = if verdict == Verdict::Other { self.absent_step } else { 0.0 };
                let lost = if verdict == Verdict::Through { self.carve_step } else { of_other };
                let next_m = mean_m[n] + (slab.sdf_m[n] - mean_m[n]) / (weight[n] + 1.0);
                let (more, less) = ((weight[n] + 1.0).min(self.weight_max), (weight[n] - lost).max(0.0));
                mean_m[n] = if is_hit { next_m } else { mean_m[n] };
                let unless_hit = if lost > 0.0 { less } else { weight[n] };
                weight[n] = if is_hit { more } else { unless_hit };
                n_hit = n_hit.wrapping_add(u32::from(is_hit));
                n_cleared = n_cleared.wrapping_add(u32::from(lost > 0.0));
            }
            done.n_voxels_hit += n_hit as usize;
            done.n_voxels_cleared += n_cleared as usize;
        }
    }
}
