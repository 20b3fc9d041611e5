//! One object's surface in space, from many masked depth images: a sparse, voxel-hashed TSDF that also
//! forgets.
//!
//! Each voxel holds a mean signed distance to the surface, metres, positive towards the camera, and a capped
//! weight. Weight is evidence: a masked pixel on the surface adds to it; a ray that passes through, or a
//! surface seen there that is *not* in the mask, takes from it. So an object that was carried off
//! disappears, and one wrong mask among many right ones leaves nothing. Distances are to the plane
//! through the pixel's neighbours, not along the ray: seen at a grazing angle, a table top is otherwise
//! full of holes. (Curless & Levoy 1996; Nießner et al. 2013 for the hashing.)
//!
//! Not here: which pixels belong to the object (`segments`), and what its surface means (`occupancy`).

use geometry::Point3;
use rustc_hash::FxHashMap;

use crate::image::{DepthFrame, ImageError, Mask};
use crate::projection::{DepthLimits, TrustedDepth};
use tiles::Tiles;

mod tiles;
mod update;

/// Voxels along one side of a block.
pub const BLOCK_SIDE: usize = 8;
const BLOCK_VOXELS: usize = BLOCK_SIDE * BLOCK_SIDE * BLOCK_SIDE;

/// How a TSDF sees, remembers and forgets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TsdfConfig {
    /// Side of a voxel, metres, 0.005 to 0.5.
    pub voxel_m: f64,
    /// Distances are kept up to this far from a surface, metres; at least two voxels.
    pub truncation_m: f64,
    /// A voxel's weight never exceeds this: old evidence does not outlive new.
    pub weight_max: f32,
    /// A voxel counts as surface from this weight on: 1.5 is two masks that agree.
    pub weight_min: f32,
    /// Weight taken by a ray that passes through; 0 turns carving off.
    pub carve_step: f32,
    /// Weight taken when the surface at the voxel is seen and is not in the mask.
    pub absent_step: f32,
    /// Most blocks held. Beyond it new ones are refused and counted.
    pub n_blocks_max: usize,
    /// Which depth is trusted.
    pub limits: DepthLimits,
}

impl Default for TsdfConfig {
    /// Voxels of 4 cm. Twelve frames fill a voxel, four to six empty it: at two frames a second an object that
    /// was moved is gone within 3 s of its place being seen empty. 20 000 blocks are 80 MB.
    fn default() -> Self {
        TsdfConfig {
            voxel_m: 0.04,
            truncation_m: 0.12,
            weight_max: 12.0,
            weight_min: 1.5,
            carve_step: 3.0,
            absent_step: 2.0,
            n_blocks_max: 20_000,
            limits: DepthLimits::default(),
        }
    }
}

/// A configuration that cannot work.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{key} is {value}, must be {limit}")]
pub struct TsdfConfigError {
    /// Which value.
    pub key: &'static str,
    /// What it is.
    pub value: f64,
    /// What it must be.
    pub limit: &'static str,
}

/// What one frame did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Integrated {
    /// Voxels that a masked surface added weight to.
    pub n_voxels_hit: usize,
    /// Voxels that lost weight.
    pub n_voxels_cleared: usize,
    /// Blocks that were wanted and not given: the limit is reached.
    pub n_blocks_refused: usize,
}

/// A piece of surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// On the surface, near the voxel's centre, in `map`.
    pub point_map: Point3,
    /// The voxel's weight.
    pub weight: f32,
}

/// Indices of a block: its low corner in `map`, in sides of a block.
type BlockKey = [i32; 3];

#[derive(Clone)]
struct Block {
    key: BlockKey,
    /// Number of the last frame that reserved it.
    frame: u64,
    sdf_m: [f32; BLOCK_VOXELS],
    weight: [f32; BLOCK_VOXELS],
}

/// The TSDF of one object, in `map`.
#[derive(Clone)]
pub struct Tsdf {
    config: TsdfConfig,
    blocks: Vec<Block>,
    index: FxHashMap<BlockKey, u32>,
    frame: u64,
}

impl Tsdf {
    /// An empty TSDF.
    ///
    /// # Errors
    /// [`TsdfConfigError`] names the value and its limit.
    pub fn new(config: TsdfConfig) -> Result<Self, TsdfConfigError> {
        let check = |key, value: f64, ok: bool, limit| {
            if ok { Ok(()) } else { Err(TsdfConfigError { key, value, limit }) }
        };
        let TsdfConfig { voxel_m, truncation_m, weight_max, weight_min, carve_step, absent_step, .. } =
            config;
        check("voxel_m", voxel_m, (0.005..=0.5).contains(&voxel_m), "0.005 to 0.5")?;
        check(
            "truncation_m",
            truncation_m,
            (2.0 * voxel_m..=8.0 * voxel_m).contains(&truncation_m),
            "2 to 8 voxels",
        )?;
        check("weight_max", weight_max.into(), (1.0..=1000.0).contains(&weight_max), "1 to 1000")?;
        check(
            "weight_min",
            weight_min.into(),
            weight_min > 0.0 && weight_min <= weight_max,
            "0 to weight_max",
        )?;
        check("carve_step", carve_step.into(), (0.0..=1000.0).contains(&carve_step), "0 to 1000")?;
        check("absent_step", absent_step.into(), (0.0..=1000.0).contains(&absent_step), "0 to 1000")?;
        let n_blocks = config.n_blocks_max;
        check("n_blocks_max", n_blocks as f64, (1..=1_000_000).contains(&n_blocks), "1 to 1000000")?;
        Ok(Tsdf { config, blocks: Vec::new(), index: FxHashMap::default(), frame: 0 })
    }

    /// How it was set up.
    #[must_use]
    pub fn config(&self) -> &TsdfConfig {
        &self.config
    }

    /// Number of blocks held.
    #[must_use]
    pub fn n_blocks(&self) -> usize {
        self.blocks.len()
    }

    /// Takes in one frame. Masked, trusted depth adds surface (all of it when there is no mask); what is
    /// seen through, and what is seen and not masked, loses weight. Voxels out of view or hidden behind
    /// something keep what they have.
    ///
    /// # Errors
    /// [`ImageError::Size`] when the mask is not of the frame's size.
    pub fn integrate(
        &mut self,
        frame: &DepthFrame<'_>,
        mask: Option<&Mask>,
    ) -> Result<Integrated, ImageError> {
        if let Some(mask) = mask {
            frame.check_mask(mask)?;
        }
        self.frame += 1;
        let trusted = TrustedDepth::new(frame, mask, &self.config.limits);
        let planes = update::Planes::new(frame, self.config.voxel_m);
        let (tiles, n_blocks_refused) = self.reserve(frame, &trusted, &planes);
        let mut done = Integrated { n_blocks_refused, ..Integrated::default() };
        let view = update::View::new(frame, &trusted, (&planes, &tiles), &self.config);
        let mut emptied = Vec::new();
        for (idx, block) in self.blocks.iter_mut().enumerate() {
            let reserved = block.frame == self.frame;
            if (!reserved && !view.clears()) || !view.sees(block) {
                continue;
            }
            let n_before = done.n_voxels_hit;
            view.update(block, reserved, &mut done);
            if done.n_voxels_hit == n_before && block.weight.iter().all(|w| *w <= 0.0) {
                emptied.push(idx);
            }
        }
        self.remove(&emptied);
        Ok(done)
    }

    /// Takes in a frame in which the model looked for the object and found it nowhere.
    ///
    /// # Errors
    /// Never at present; the signature is that of [`Self::integrate`].
    pub fn observe_absent(&mut self, frame: &DepthFrame<'_>) -> Result<Integrated, ImageError> {
        let (width, height) = (frame.depth().width(), frame.depth().height());
        let nothing = Mask::new(width, height, vec![false; width as usize * height as usize])?;
        self.integrate(frame, Some(&nothing))
    }

    /// Multiplies every weight by `keep` (clamped to 0 to 1; NaN keeps nothing) and gives back the space of
    /// what falls below a hundredth: evidence that is not renewed fades.
    pub fn decay(&mut self, keep: f32) {
        let keep = if keep.is_nan() { 0.0 } else { keep.clamp(0.0, 1.0) };
        let mut emptied = Vec::new();
        for (idx, block) in self.blocks.iter_mut().enumerate() {
            for weight in &mut block.weight {
                *weight *= keep;
                if *weight < 0.01 {
                    *weight = 0.0;
                }
            }
            if block.weight.iter().all(|w| *w <= 0.0) {
                emptied.push(idx);
            }
        }
        self.remove(&emptied);
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.blocks.clear();
        self.index.clear();
    }

    /// The surface: one point for each voxel within one voxel of it that has weight enough. In no order.
    pub fn surface_voxels(&self) -> impl Iterator<Item = SurfacePoint> + '_ {
        let near_m = self.config.voxel_m as f32;
        let weight_min = self.config.weight_min;
        self.blocks.iter().flat_map(move |block| {
            (0..BLOCK_VOXELS)
                .filter(move |&v| block.weight[v] >= weight_min && block.sdf_m[v].abs() < near_m)
                .map(move |v| SurfacePoint { point_map: self.on_surface(block, v), weight: block.weight[v] })
        })
    }

    /// The points of [`Self::surface_voxels`], in `map`.
    #[must_use]
    pub fn surface_points(&self) -> Vec<Point3> {
        self.surface_voxels().map(|s| s.point_map).collect()
    }

    /// A voxel's centre moved to the surface along the field's gradient, as far as its neighbours tell it.
    fn on_surface(&self, block: &Block, voxel: usize) -> Point3 {
        let at = [voxel % BLOCK_SIDE, voxel / BLOCK_SIDE % BLOCK_SIDE, voxel / (BLOCK_SIDE * BLOCK_SIDE)];
        let mut cell = [0_i32; 3];
        for axis in 0..3 {
            cell[axis] = block.key[axis] * BLOCK_SIDE as i32 + at[axis] as i32;
        }
        let here_m = block.sdf_m[voxel];
        let mut slope = nalgebra::Vector3::<f64>::zeros();
        for axis in 0..3 {
            let beside = |off: i32| {
                let mut other = cell;
                other[axis] += off;
                self.sdf_at(other)
            };
            let rise_m = match (beside(-1), beside(1)) {
                (Some(before), Some(after)) => (after - before) / 2.0,
                (Some(before), None) => here_m - before,
                (None, Some(after)) => after - here_m,
                (None, None) => 0.0,
            };
            slope[axis] = f64::from(rise_m);
        }
        let centre =
            Point3::from(nalgebra::Vector3::from(cell.map(|c| (f64::from(c) + 0.5) * self.config.voxel_m)));
        // The gradient of a distance has length one. It is shorter where neighbours are missing or both faces
        // of something thin have been averaged: a shorter step then still leads towards the surface.
        let gradient = slope / slope.norm().max(self.config.voxel_m);
        centre - gradient * f64::from(here_m)
    }

    /// The distance stored at a voxel of the whole grid; `None` where nothing was seen.
    fn sdf_at(&self, cell: [i32; 3]) -> Option<f32> {
        let side = BLOCK_SIDE as i32;
        let block = &self.blocks[*self.index.get(&cell.map(|c| c.div_euclid(side)))? as usize];
        let [x, y, z] = cell.map(|c| c.rem_euclid(side) as usize);
        let voxel = x + BLOCK_SIDE * (y + BLOCK_SIDE * z);
        (block.weight[voxel] > 0.0).then(|| block.sdf_m[voxel])
    }

    /// Makes room along the rays around each masked surface; returns the image's tiles and how many blocks were
    /// refused.
    fn reserve(
        &mut self,
        frame: &DepthFrame<'_>,
        trusted: &TrustedDepth<'_>,
        planes: &update::Planes<'_>,
    ) -> (Tiles, usize) {
        let TsdfConfig { voxel_m, truncation_m, limits, .. } = self.config;
        let block_m = voxel_m * BLOCK_SIDE as f64;
        let camera = frame.intrinsics();
        let eye = frame.map_from_camera().translation.vector / block_m;
        let turn = frame.map_from_camera().rotation.to_rotation_matrix().into_inner() / block_m;
        let side = Tiles::side_for(camera.fx.min(camera.fy), voxel_m, limits.max_m);
        let mut n_refused = 0;
        let mut last = [[i32::MAX; 3]; 3];
        let tiles = Tiles::new(trusted, planes, side, |seen| {
            let ray = turn * camera.unproject(seen.col as f64, seen.row as f64, 1.0).coords;
            for (step, last) in [-1.0, 0.0, 1.0].into_iter().zip(&mut last) {
                let reach_m = f64::from(seen.depth_m) + step * truncation_m;
                let key: BlockKey = (eye + ray * reach_m).map(|c| c.floor() as i32).into();
                if key != *last {
                    *last = key;
                    n_refused += usize::from(!self.touch(key));
                }
            }
        });
        (tiles, n_refused)
    }

    /// Marks a block as reserved in this frame, made anew if need be; false when there is no room.
    fn touch(&mut self, key: BlockKey) -> bool {
        if let Some(&idx) = self.index.get(&key) {
            self.blocks[idx as usize].frame = self.frame;
            return true;
        }
        if self.blocks.len() >= self.config.n_blocks_max {
            return false;
        }
        self.index.insert(key, self.blocks.len() as u32);
        let (sdf_m, weight) = ([0.0; BLOCK_VOXELS], [0.0; BLOCK_VOXELS]);
        self.blocks.push(Block { key, frame: self.frame, sdf_m, weight });
        true
    }

    /// Gives back the space of blocks, named by ascending position.
    fn remove(&mut self, positions: &[usize]) {
        for &position in positions.iter().rev() {
            let gone = self.blocks.swap_remove(position);
            self.index.remove(&gone.key);
            if let Some(moved) = self.blocks.get(position) {
                self.index.insert(moved.key, position as u32);
            }
        }
    }
}

#[cfg(test)]
mod tests;
