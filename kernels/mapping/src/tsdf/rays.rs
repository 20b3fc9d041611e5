//! Which blocks lie around what a pixel shows: along its ray, at the surface and a truncation before and behind it.

use super::BlockKey;
use super::planes::LANES;
use super::tiles::Seen;
use super::{BLOCK_SIDE, TsdfConfig};
use crate::image::DepthFrame;

/// Rays of a camera through pixels, in sides of a block.
pub(super) struct Rays {
    eye: [f64; 3],
    /// From a ray in `camera` to one in `map`, row by row.
    turn: [[f64; 3]; 3],
    focal: [f64; 2],
    centre: [f64; 2],
    truncation_m: f64,
}

impl Rays {
    pub(super) fn new(frame: &DepthFrame<'_>, config: &TsdfConfig) -> Self {
        let block_m = config.voxel_m * BLOCK_SIDE as f64;
        let camera = frame.intrinsics();
        let eye = frame.map_from_camera().translation.vector / block_m;
        let turn = frame.map_from_camera().rotation.to_rotation_matrix().into_inner() / block_m;
        Rays {
            eye: eye.into(),
            turn: [0, 1, 2].map(|row| [0, 1, 2].map(|col| turn[(row, col)])),
            focal: [camera.fx, camera.fy],
            centre: [camera.cx, camera.cy],
            truncation_m: config.truncation_m,
        }
    }

    /// Adds the blocks around up to [`LANES`] surfaces; `last` are those that each of the three places on a ray was in
    /// before: neighbours mostly ask for the same.
    #[inline(always)]
    pub(super) fn blocks(&self, batch: &[Seen], last: &mut [BlockKey; 3], wanted: &mut Vec<BlockKey>) {
        let Some(rest) = batch.last() else { return };
        let mut pixel = [[0.0_f64; LANES]; 2];
        let mut depth_m = [0.0_f64; LANES];
        for n in 0..LANES {
            let seen = batch.get(n).unwrap_or(rest);
            (pixel[0][n], pixel[1][n]) = (seen.col as u32 as f64, seen.row as u32 as f64);
            depth_m[n] = f64::from(seen.depth_m);
        }
        let mut keys = [[[0_i32; LANES]; 3]; 3];
        for (step, keys) in [-1.0, 0.0, 1.0].into_iter().zip(&mut keys) {
            for (axis, keys) in keys.iter_mut().enumerate() {
                let [right, down, ahead] = self.turn[axis];
                for n in 0..LANES {
                    let x = (pixel[0][n] - self.centre[0]) / self.focal[0];
                    let y = (pixel[1][n] - self.centre[1]) / self.focal[1];
                    let ray = right * x + down * y + ahead;
                    let reach_m = depth_m[n] + step * self.truncation_m;
                    keys[n] = (self.eye[axis] + ray * reach_m).floor() as i32;
                }
            }
        }
        for n in 0..batch.len() {
            for (keys, last) in keys.iter().zip(&mut *last) {
                let key = [keys[0][n], keys[1][n], keys[2][n]];
                if key != *last {
                    *last = key;
                    wanted.push(key);
                }
            }
        }
    }
}
