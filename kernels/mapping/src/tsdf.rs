//! One object's surface in space, from many masked depth images: a sparse, voxel-hashed TSDF that also
//! forgets.
//!
//! Each voxel holds a mean signed distance to the surface, metres, positive towards the camera, and a capped
//! weight. Weight is evidence: a masked pixel on the surface adds to it; a ray that passes through, or a
//! surface seen there that is *not* in the mask, takes from it. So an object that was carried off
//! disappears, and one wrong mask among many right ones leaves nothing. (Curless & Levoy 1996; Nießner et
//! al. 2013 for the hashing.)
//!
//! Distances are those along the optical axis to the nearest pixel's depth, shortened to those across the surface as it
//! is turned there, for voxels whose foot on that surface is the object: seen at a grazing angle, a table top is otherwise
//! full of holes, and would go on beyond its edge. What lies farther than a truncation
//! in front of a surface counts as just that far; what lies as far behind it is hidden. Voxels are the points whose
//! coordinates are whole multiples of their side, as in other implementations: on other points, edges and what is thin
//! would come out differently.
//!
//! What is thinner than voxels lie apart may pass between them. Places where it was seen are kept beside them (`thin`),
//! and count for footprints.
//!
//! Not here: which pixels belong to the object (`segments`), and what its surface means (`occupancy`).

use rustc_hash::FxHashMap;

use crate::image::{DepthFrame, ImageError, Mask};
use crate::isa::Isa;
use crate::projection::TrustedDepth;
use seen::{Seen, Sift};
use strips::Strips;
use thin::Thin;
use tiles::{Cut, Rays, Tiles, side_for};
use update::{Update, View};

mod config;
mod frustum;
mod seen;
mod slab;
mod slant;
mod strips;
mod surface;
mod thin;
mod tiles;
mod update;

pub use config::{TsdfConfig, TsdfConfigError};
pub use surface::SurfacePoint;

/// Voxels along one side of a block.
pub const BLOCK_SIDE: usize = 8;
const BLOCK_VOXELS: usize = BLOCK_SIDE * BLOCK_SIDE * BLOCK_SIDE;
/// A weight that fades below this is none.
const WEIGHT_LEFT: f32 = 0.01;

/// What one frame did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Integrated {
    /// Voxels that a masked surface added weight to.
    pub n_voxels_hit: usize,
    /// Voxels that lost weight.
    pub n_voxels_cleared: usize,
    /// Blocks, and places of what is thin, that were wanted and not given: the limit is reached.
    pub n_blocks_refused: usize,
}

/// Indices of a block: its low corner in `map`, in sides of a block.
type BlockKey = [i32; 3];

/// Which block, and when it was wanted. Apart from its voxels: whether to look at them is asked of every block.
#[derive(Clone, Copy)]
struct Head {
    key: BlockKey,
    /// Number of the last frame that reserved it.
    frame: u64,
}

#[derive(Clone)]
struct Voxels {
    sdf_m: [f32; BLOCK_VOXELS],
    weight: [f32; BLOCK_VOXELS],
}

/// The TSDF of one object, in `map`.
#[derive(Clone)]
pub struct Tsdf {
    config: TsdfConfig,
    /// One for each of `blocks`, at the same position.
    heads: Vec<Head>,
    blocks: Vec<Voxels>,
    index: FxHashMap<BlockKey, u32>,
    /// What may pass between voxels.
    thin: Thin,
    frame: u64,
    /// What the last frame showed, and in which tiles: their space is used again.
    seen: Seen,
    tiles: Tiles,
}

impl Tsdf {
    /// An empty TSDF.
    ///
    /// # Errors
    /// [`TsdfConfigError`] names the value and its limit.
    pub fn new(config: TsdfConfig) -> Result<Self, TsdfConfigError> {
        config.check()?;
        Ok(Tsdf {
            config,
            heads: Vec::new(),
            blocks: Vec::new(),
            index: FxHashMap::default(),
            thin: Thin::default(),
            frame: 0,
            seen: Seen::default(),
            tiles: Tiles::default(),
        })
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

    /// Whether nothing is known of the object.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.blocks.is_empty() && self.thin.is_empty()
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
        let mut seen = std::mem::take(&mut self.seen);
        let bits = mask.map(Mask::bits);
        isa.run(Sift::new(frame, &trusted, bits, &self.config.limits, &mut seen));
        let camera = frame.intrinsics();
        let side = side_for(camera.fx.min(camera.fy), self.config.voxel_m, self.config.limits.max_m);
        let rays = Rays::new(frame, &self.config);
        let mut tiles = std::mem::take(&mut self.tiles);
        let wanted = isa.run(Cut {
            frame,
            seen: &seen,
            mask: bits,
            config: &self.config,
            rays: &rays,
            side,
            tiles: &mut tiles,
        });
        let mut reserved = Vec::new();
        let n_blocks_refused = wanted.into_iter().filter(|key| !self.touch(*key, &mut reserved)).count();
        let mut done = Integrated { n_blocks_refused, ..Integrated::default() };
        let view = View::new(frame, mask, (&seen, &tiles), &self.config);
        let emptied = isa.run(Update {
            view: &view,
            heads: &self.heads,
            blocks: &mut self.blocks,
            frame: self.frame,
            reserved: &reserved,
            done: &mut done,
        });
        self.remove(&emptied);
        let strips = isa.run(Strips::new(frame, mask, &self.config, side));
        done.n_blocks_refused += self.thin.see(&strips, frame, self.frame, &self.config);
        if self.config.clears() {
            self.thin.clear(&view, self.frame);
        }
        (self.seen, self.tiles) = (seen, tiles);
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
                if *weight < WEIGHT_LEFT {
                    *weight = 0.0;
                }
            }
            if block.weight.iter().all(|w| *w <= 0.0) {
                emptied.push(idx);
            }
        }
        self.remove(&emptied);
        self.thin.decay(keep);
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.heads.clear();
        self.blocks.clear();
        self.index.clear();
        self.thin.forget();
    }

    /// Marks a block as reserved in this frame, made anew if need be, and adds its position to those that are; false
    /// when there is no room.
    #[inline]
    fn touch(&mut self, key: BlockKey, reserved: &mut Vec<u32>) -> bool {
        if let Some(&idx) = self.index.get(&key) {
            let head = &mut self.heads[idx as usize];
            if head.frame != self.frame {
                head.frame = self.frame;
                reserved.push(idx);
            }
            return true;
        }
        if self.blocks.len() >= self.config.n_blocks_max {
            return false;
        }
        let idx = self.blocks.len() as u32;
        self.index.insert(key, idx);
        reserved.push(idx);
        self.heads.push(Head { key, frame: self.frame });
        self.blocks.push(Voxels { sdf_m: [0.0; BLOCK_VOXELS], weight: [0.0; BLOCK_VOXELS] });
        true
    }

    /// Gives back the space of blocks, named by ascending position.
    fn remove(&mut self, positions: &[usize]) {
        for &position in positions.iter().rev() {
            self.blocks.swap_remove(position);
            let gone = self.heads.swap_remove(position);
            self.index.remove(&gone.key);
            if let Some(moved) = self.heads.get(position) {
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
