//! The surface that a TSDF holds, as points: where its distance passes through zero between neighbouring voxels, as
//! the corners of a mesh by marching cubes do (Lorensen & Cline 1987). Voxels near the surface are not on it: their
//! centres lie up to half a voxel beside.

use geometry::Point3;
use nalgebra::Vector3;

use super::{BLOCK_SIDE, BlockKey, Tsdf, Voxels};

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
            let place = move |voxel: usize| {
                [voxel % BLOCK_SIDE, voxel / BLOCK_SIDE % BLOCK_SIDE, voxel / (BLOCK_SIDE * BLOCK_SIDE)]
            };
            (0..super::BLOCK_VOXELS).flat_map(move |voxel| {
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
