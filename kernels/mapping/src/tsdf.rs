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
use crate::isa::Isa;
use crate::projection::TrustedDepth;
use planes::Planes;
use rays::Rays;
use tiles::{Cut, Tiles};
use update::{Update, View};

mod config;
mod frustum;
mod planes;
mod rays;
mod slab;
mod tiles;
mod update;

pub use config::{TsdfConfig, TsdfConfigError};

/// Voxels along one side of a block.
pub const BLOCK_SIDE: usize = 8;
const BLOCK_VOXELS: usize = BLOCK_SIDE * BLOCK_SIDE * BLOCK_SIDE;

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
        config.check()?;
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
        self.integrate_by(Isa::detect(), frame, mask)
    }

    /// [`Self::integrate`] by given instructions.
    fn integrate_by(
        &mut self,
        isa: Isa,
        frame: &DepthFrame<'_>,
        mask: Option<&Mask>,
    ) -> Result<Integrated, ImageError> {
        if let Some(mask) = mask {
            frame.check_mask(mask)?;
        }
        self.frame += 1;
        let trusted = TrustedDepth::new(frame, mask, &self.config.limits);
        let planes = Planes::new(frame, self.config.voxel_m);
        let camera = frame.intrinsics();
        let side = Tiles::side_for(camera.fx.min(camera.fy), self.config.voxel_m, self.config.limits.max_m);
        let rays = Rays::new(frame, &self.config);
        let (tiles, wanted) = isa.run(Cut { trusted: &trusted, planes: &planes, rays: &rays, side });
        let n_blocks_refused = wanted.into_iter().filter(|key| !self.touch(*key)).count();
        let mut done = Integrated { n_blocks_refused, ..Integrated::default() };
        let view = View::new(frame, mask, &trusted, (&planes, &tiles), &self.config);
        let emptied =
            isa.run(Update { view: &view, blocks: &mut self.blocks, frame: self.frame, done: &mut done });
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
mod laws;
#[cfg(test)]
mod reference;
#[cfg(test)]
mod tests;
