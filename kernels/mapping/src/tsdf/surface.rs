//! The surface that a TSDF holds, as points: where its distance passes through zero between neighbouring voxels, as
//! the corners of a mesh by marching cubes do (Lorensen & Cline 1987). Voxels near the surface are not on it: their
//! centres lie up to half a voxel beside.

use geometry::Point3;
use nalgebra::Vector3;

use super::{BLOCK_SIDE, BLOCK_VOXELS, BlockKey, Tsdf, Voxels};

/// Voxels count as next to a surface up to a voxel behind it and this share of one in front, where those behind mostly count
/// anyway: what is told to voxels in front, beside an edge, is the least sure.
const IN_FRONT: f32 = 0.6;

/// A piece of surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// On the surface, between two neighbouring voxels, in `map`.
    pub point_map: Point3,
    /// Weight of the voxel behind it.
    pub weight: f32,
}

impl Tsdf {
    /// The surface: a point wherever it passes between two neighbouring voxels of which the one behind it
    /// has weight enough and the one in front was seen. In no order. Costs a look at every voxel.
    pub fn surface(&self) -> impl Iterator<Item = SurfacePoint> + '_ {
        self.heads.iter().zip(&self.blocks).flat_map(move |(head, block)| {
            let beside = [0, 1, 2].map(|axis| {
                let mut key = head.key;
                key[axis] = key[axis].wrapping_add(1);
                self.blocks.get(*self.index.get(&key)? as usize)
            });
            (0..BLOCK_VOXELS).flat_map(move |voxel| {
                let at = place(voxel);
                (0..3).filter_map(move |axis| {
                    let (share, weight) = self.passing(block, beside[axis], (voxel, at[axis]), axis)?;
                    Some(SurfacePoint { point_map: self.between(head.key, at, axis, share), weight })
                })
            })
        })
    }

    /// The points of [`Self::surface`], in `map`.
    #[must_use]
    pub fn surface_points(&self) -> Vec<Point3> {
        self.surface().map(|piece| piece.point_map).collect()
    }

    /// Points of all that the object covers, in `map`: one for each voxel that is next to the surface, and one for each
    /// place where something thinner than voxels was seen. For footprints: what is thin, or seen from one side only, has
    /// such voxels where no surface passes between two.
    #[must_use]
    pub fn covered_points(&self) -> Vec<Point3> {
        let voxel_m = self.config.voxel_m as f32;
        let near_m = -voxel_m..IN_FRONT * voxel_m;
        let blocks = self.heads.iter().zip(&self.blocks);
        let near = blocks.flat_map(|(head, block)| {
            let is_near = |voxel: &usize| {
                block.weight[*voxel] >= self.config.weight_min && near_m.contains(&block.sdf_m[*voxel])
            };
            (0..BLOCK_VOXELS).filter(is_near).map(|voxel| self.foot(head.key, block, voxel))
        });
        near.chain(self.thin.points(self.config.weight_min)).collect()
    }

    /// The foot of a voxel on the surface next to it, by the slope of distance there.
    fn foot(&self, key: BlockKey, block: &Voxels, voxel: usize) -> Point3 {
        let (at, here_m) = (place(voxel), block.sdf_m[voxel]);
        let slope = Vector3::from([0, 1, 2].map(|axis| {
            let beside = [-1, 1].map(|step| self.beside(key, at, axis, step));
            f64::from(match beside {
                [Some(before_m), Some(after_m)] => 0.5 * (after_m - before_m),
                [Some(before_m), None] => here_m - before_m,
                [None, Some(after_m)] => after_m - here_m,
                [None, None] => 0.0,
            })
        }));
        // The gradient of a distance has length one. It is shorter where neighbours are missing or both faces of something
        // thin have been averaged: a shorter step then still leads towards the surface.
        let gradient = slope / slope.norm().max(self.config.voxel_m);
        self.between(key, at, 0, 0.0) - gradient * f64::from(here_m)
    }

    /// Distance of the voxel beside one that has weight.
    fn beside(&self, key: BlockKey, at: [usize; 3], axis: usize, step: i32) -> Option<f32> {
        let side = BLOCK_SIDE as i32;
        let (mut key, mut at) = (key, at.map(|at| at as i32));
        at[axis] += step;
        key[axis] = key[axis].wrapping_add(at[axis].div_euclid(side));
        let block = self.blocks.get(*self.index.get(&key)? as usize)?;
        let [x, y, z] = at.map(|at| at.rem_euclid(side) as usize);
        let voxel = x + BLOCK_SIDE * (y + BLOCK_SIDE * z);
        (block.weight[voxel] > 0.0).then_some(block.sdf_m[voxel])
    }

    /// Where between a voxel and the next along an axis the surface passes, as a share of a voxel, and the weight there.
    fn passing(
        &self,
        block: &Voxels,
        beside: Option<&Voxels>,
        (voxel, along): (usize, usize),
        axis: usize,
    ) -> Option<(f32, f32)> {
        let weight_min = self.config.weight_min;
        let step = BLOCK_SIDE.pow(axis as u32);
        let (other, next) = if along + 1 < BLOCK_SIDE {
            (block, voxel + step)
        } else {
            (beside?, voxel - step * (BLOCK_SIDE - 1))
        };
        let (here_m, there_m) = (block.sdf_m[voxel], other.sdf_m[next]);
        let (here, there) = (block.weight[voxel], other.weight[next]);
        let (behind, front, front_m) =
            if here_m < 0.0 { (here, there, there_m) } else { (there, here, here_m) };
        // Once seen to be free, what is in front stays so: where weight is taken away, it loses its own by that very fact.
        let front_min = if self.config.clears() { 0.0 } else { weight_min };
        let is_seen = front_m > 0.0 && front >= front_min;
        let passes = (here_m < 0.0) != (there_m < 0.0) && behind >= weight_min && is_seen;
        passes.then(|| (here_m / (here_m - there_m), behind))
    }

    /// A point between a voxel of a block and the next along an axis, in `map`.
    fn between(&self, key: BlockKey, at: [usize; 3], axis: usize, share: f32) -> Point3 {
        let mut place = [0.0; 3];
        for axis in 0..3 {
            place[axis] = f64::from(key[axis]) * BLOCK_SIDE as f64 + at[axis] as f64;
        }
        place[axis] += f64::from(share);
        Point3::from(Vector3::from(place) * self.config.voxel_m)
    }
}

/// Where in its block a voxel lies, along x, y and z.
fn place(voxel: usize) -> [usize; 3] {
    [voxel % BLOCK_SIDE, voxel / BLOCK_SIDE % BLOCK_SIDE, voxel / (BLOCK_SIDE * BLOCK_SIDE)]
}
