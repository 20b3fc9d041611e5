//! A frame's update of a TSDF once more, slow and obvious: each voxel by itself, each tile anew for each voxel that asks.
//! Laws hold the product's update against it, number by number.

use geometry::Point3;
use nalgebra::Vector3;

use super::frustum::Frustum;
use super::planes::{COSINE_MIN, PLANE_BEND_MAX};
use super::slab::{COSINE_FACING, EDGE_BAND, NEAR_M};
use super::tiles::{BESIDE, ON_PLANE, Tiles};
use super::{BLOCK_SIDE, BLOCK_VOXELS, BlockKey, Integrated, Tsdf, TsdfConfig};
use crate::image::{DepthFrame, Mask};
use crate::projection::TrustedDepth;

type Vec3 = Vector3<f32>;

/// The plane at a pixel: unit normal, metres off it for each along the optical axis, slopes of inverse depth.
struct Plane {
    normal: Vec3,
    cosine: f32,
    slopes: [f32; 2],
}

/// What a voxel learns.
enum Learnt {
    Nothing,
    Surface(f32),
    Through,
    Other,
}

struct Slow<'a> {
    depth_mm: &'a [u16],
    size: [i32; 2],
    focal: [f32; 2],
    centre: [f32; 2],
    trusted: TrustedDepth<'a>,
    config: TsdfConfig,
    side: usize,
}

/// [`Tsdf::integrate`], slowly.
pub(super) fn integrate(tsdf: &mut Tsdf, frame: &DepthFrame<'_>, mask: Option<&Mask>) -> Integrated {
    tsdf.frame += 1;
    let (camera, config) = (frame.intrinsics(), tsdf.config);
    let slow = Slow {
        depth_mm: frame.depth().depth_mm(),
        size: [camera.width as i32, camera.height as i32],
        focal: [camera.fx as f32, camera.fy as f32],
        centre: [camera.cx as f32, camera.cy as f32],
        trusted: TrustedDepth::new(frame, mask, &config.limits),
        config,
        side: Tiles::side_for(camera.fx.min(camera.fy), config.voxel_m, config.limits.max_m),
    };
    let mut done = Integrated { n_blocks_refused: slow.reserve(tsdf, frame), ..Integrated::default() };
    let camera_from_map = frame.map_from_camera().inverse();
    let step = |axis: Vector3<f64>| (camera_from_map.rotation * axis * config.voxel_m).cast::<f32>();
    let steps = [step(Vector3::x()), step(Vector3::y()), step(Vector3::z())];
    let clears = config.carve_step > 0.0 || config.absent_step > 0.0;
    let frustum = Frustum::new(frame, &config);
    let mut emptied = Vec::new();
    for (idx, block) in tsdf.blocks.iter_mut().enumerate() {
        let side_m = f64::from(config.voxel_m as f32) * BLOCK_SIDE as f64;
        let corner_map = Point3::from(Vector3::from(block.key.map(|k| f64::from(k) * side_m)));
        let corner: nalgebra::Point3<f32> = (camera_from_map * corner_map).cast();
        let first = corner + (steps[0] + steps[1] + steps[2]) * 0.5;
        let (is_reserved, mut n_hit, mut n_looked) = (block.frame == tsdf.frame, 0, 0);
        if !is_reserved && !clears {
            continue;
        }
        for voxel in 0..BLOCK_VOXELS {
            let (x, y, z) =
                (voxel % BLOCK_SIDE, voxel / BLOCK_SIDE % BLOCK_SIDE, voxel / (BLOCK_SIDE * BLOCK_SIDE));
            let (mean_m, weight) = (&mut block.sdf_m[voxel], &mut block.weight[voxel]);
            if !is_reserved && *weight <= 0.0 {
                continue;
            }
            let at = first + steps[1] * y as f32 + steps[2] * z as f32 + steps[0] * x as f32;
            let Some(pixel) = slow.pixel(at, true) else { continue };
            n_looked += 1;
            let lost = match slow.look(at, pixel, *weight > 0.0) {
                Learnt::Nothing => continue,
                Learnt::Surface(sdf_m) => {
                    *mean_m += (sdf_m - *mean_m) / (*weight + 1.0);
                    *weight = (*weight + 1.0).min(config.weight_max);
                    n_hit += 1;
                    continue;
                }
                Learnt::Through => config.carve_step,
                Learnt::Other => config.absent_step,
            };
            if lost > 0.0 {
                *weight = (*weight - lost).max(0.0);
                done.n_voxels_cleared += 1;
            }
        }
        done.n_voxels_hit += n_hit;
        let is_seen = frustum.sees(block);
        assert!(is_seen || n_looked == 0, "a block with {n_looked} voxels in view is passed over");
        if is_seen && n_hit == 0 && block.weight.iter().all(|w| *w <= 0.0) {
            emptied.push(idx);
        }
    }
    tsdf.remove(&emptied);
    done
}

impl Slow<'_> {
    /// Reserves blocks tile by tile; returns how many were refused.
    fn reserve(&self, tsdf: &mut Tsdf, frame: &DepthFrame<'_>) -> usize {
        let block_m = self.config.voxel_m * BLOCK_SIDE as f64;
        let eye = frame.map_from_camera().translation.vector / block_m;
        let turn = frame.map_from_camera().rotation.to_rotation_matrix().into_inner() / block_m;
        let (cols, rows) = self.trusted.bounds();
        let (mut last, mut n_refused) = ([[i32::MAX; 3]; 3], 0);
        for row in (rows.start / self.side..rows.end.div_ceil(self.side)).map(|row| row * self.side) {
            for col in (cols.start / self.side..cols.end.div_ceil(self.side)).map(|col| col * self.side) {
                let middle = self.middle(col, row);
                let (quarter, end) = (self.side / 4, self.side - 1);
                let beside =
                    [(quarter, quarter), (end, quarter), (quarter, end)].map(|(c, r)| (col + c, row + r));
                let pixels = match self.trusted.at_in_mask(middle.0, middle.1) {
                    Some(_) => vec![middle],
                    None if self.side >= 4 => beside.to_vec(),
                    None => vec![],
                };
                for (col, row) in pixels.into_iter().filter(|(c, r)| cols.contains(c) && rows.contains(r)) {
                    let Some(depth_m) = self.trusted.at_in_mask(col, row) else { continue };
                    let ray = turn * frame.intrinsics().unproject(col as f64, row as f64, 1.0).coords;
                    for (step, last) in [-1.0, 0.0, 1.0].into_iter().zip(&mut last) {
                        let reach_m = f64::from(depth_m) + step * self.config.truncation_m;
                        let key: BlockKey = (eye + ray * reach_m).map(|c| c.floor() as i32).into();
                        if std::mem::replace(last, key) != key {
                            n_refused += usize::from(!tsdf.touch(key));
                        }
                    }
                }
            }
        }
        n_refused
    }

    /// Middle pixel of the tile of a pixel.
    fn middle(&self, col: usize, row: usize) -> (usize, usize) {
        let (cols, rows) = self.trusted.bounds();
        let middle = |at: usize| at / self.side * self.side + self.side / 2;
        (middle(col).clamp(cols.start, cols.end - 1), middle(row).clamp(rows.start, rows.end - 1))
    }

    /// The plane of a pixel's tile, when the tile is flat and the pixel lies on it.
    fn tile(&self, (u, v): (i32, i32), depth_m: f32) -> Option<Plane> {
        let (cols, rows) = self.trusted.bounds();
        let (col, row) = self.middle(u as usize, v as usize);
        let middle_m = self.trusted.at_in_mask(col, row)?;
        let plane = self.plane(col as i32, row as i32, middle_m);
        let holds = |u: i32, v: i32, depth_m: f32| {
            let [a, b] = plane.slopes;
            let inverse = 1.0 / middle_m + a * (u as f32 - col as f32) + b * (v as f32 - row as f32);
            (depth_m * inverse - 1.0).abs() <= ON_PLANE
        };
        let (side, beside) = (self.side as i32, BESIDE as i32);
        let (low_u, low_v) = (u / side * side, v / side * side);
        let (half, end) = (side / 2, side - 1);
        let corners = [(0, 0), (end, 0), (0, end), (end, end)];
        let around = [(-beside, half), (end + beside, half), (half, -beside), (half, end + beside)];
        let is_flat = corners.into_iter().chain(around).all(|(du, dv)| {
            let (u, v) = (low_u + du, low_v + dv);
            u >= 0
                && v >= 0
                && cols.contains(&(u as usize))
                && rows.contains(&(v as usize))
                && self.masked_m(u, v).is_some_and(|depth_m| holds(u, v, depth_m))
        });
        let is_on_it = is_flat && holds(u, v, depth_m);
        is_on_it.then_some(plane)
    }

    fn depth_mm(&self, u: i32, v: i32) -> Option<u16> {
        let is_inside = u >= 0 && v >= 0 && u < self.size[0] && v < self.size[1];
        is_inside.then(|| self.depth_mm[(v * self.size[0] + u) as usize])
    }

    fn in_mask(&self, u: i32, v: i32) -> bool {
        self.trusted.in_mask((v * self.size[0] + u) as usize)
    }

    fn masked_m(&self, u: i32, v: i32) -> Option<f32> {
        self.depth_mm(u, v).filter(|_| self.in_mask(u, v)).map(|mm| f32::from(mm) * 0.001)
    }

    /// The pixel that shows a point in `camera`. A voxel's centre rounds as the product's does, its foot too.
    fn pixel(&self, at: nalgebra::Point3<f32>, is_centre: bool) -> Option<(i32, i32)> {
        let inverse = 1.0 / at.z;
        let place = |axis: usize| {
            let off = self.focal[axis] * at[axis] * inverse;
            if is_centre { off + (self.centre[axis] + 0.5) } else { off + self.centre[axis] + 0.5 }
        };
        let (u, v) = (place(0), place(1));
        let in_view = u >= 0.0 && v >= 0.0 && u < self.size[0] as f32 && v < self.size[1] as f32;
        (in_view && at.z >= NEAR_M).then_some((u as i32, v as i32))
    }

    /// What the frame says of a voxel at a place in `camera` that is seen at a pixel.
    fn look(&self, at: nalgebra::Point3<f32>, (u, v): (i32, i32), has_weight: bool) -> Learnt {
        let (voxel_m, truncation_m) = (self.config.voxel_m as f32, self.config.truncation_m as f32);
        let Some(mm) = self.depth_mm(u, v).filter(|mm| *mm > 0) else { return Learnt::Nothing };
        let depth_m = f32::from(mm) * 0.001;
        let ahead_m = depth_m - at.z;
        if ahead_m * COSINE_MIN < -truncation_m {
            return Learnt::Nothing;
        }
        if self.in_mask(u, v) {
            let of_tile = self.tile((u, v), depth_m);
            let is_sure = of_tile.is_some();
            let is_close =
                ahead_m.abs() <= if is_sure { truncation_m / COSINE_MIN } else { EDGE_BAND * truncation_m };
            if !is_close && ahead_m < 0.0 {
                return Learnt::Nothing;
            }
            if is_close && ahead_m * COSINE_MIN <= truncation_m {
                let plane = of_tile.unwrap_or_else(|| self.plane(u, v, depth_m));
                let sdf_m = ahead_m * plane.cosine;
                if sdf_m < -truncation_m {
                    return Learnt::Nothing;
                }
                if sdf_m <= truncation_m {
                    let is_near = ahead_m.abs() <= voxel_m || (is_sure && plane.cosine >= COSINE_FACING);
                    let is_object = is_near || self.is_over_object(at + plane.normal * sdf_m);
                    let is_trusted = is_sure || self.trusted.at(u as usize, v as usize).is_some();
                    return if is_object && is_trusted { Learnt::Surface(sdf_m) } else { Learnt::Nothing };
                }
            }
        } else if ahead_m.abs() <= voxel_m && has_weight {
            let around = [(2, 0), (-2, 0), (0, 2), (0, -2)].map(|(du, dv)| (u + du, v + dv));
            let is_beside =
                around.into_iter().any(|(u, v)| self.depth_mm(u, v).is_some() && self.in_mask(u, v));
            return if is_beside { Learnt::Nothing } else { Learnt::Other };
        }
        if has_weight && ahead_m > voxel_m { self.look_around(at, u, v) } else { Learnt::Nothing }
    }

    fn is_over_object(&self, foot: nalgebra::Point3<f32>) -> bool {
        let Some((u, v)) = self.pixel(foot, false) else { return false };
        self.masked_m(u, v).is_some_and(|depth_m| (depth_m - foot.z).abs() <= self.config.voxel_m as f32)
    }

    fn look_around(&self, at: nalgebra::Point3<f32>, u: i32, v: i32) -> Learnt {
        let voxel_m = self.config.voxel_m as f32;
        let off = ((0.5 * voxel_m * self.focal[0] / at.z) as i32 + 1).min(16);
        let mut learnt = Learnt::Through;
        for (u, v) in [(u + off, v), (u - off, v), (u, v + off), (u, v - off)] {
            let Some(mm) = self.depth_mm(u, v).filter(|mm| *mm > 0) else { continue };
            let ahead_m = f32::from(mm) * 0.001 - at.z;
            if ahead_m > voxel_m {
                continue;
            }
            if self.in_mask(u, v) {
                return Learnt::Nothing;
            }
            if ahead_m >= -2.0 * voxel_m {
                learnt = Learnt::Other;
            }
        }
        learnt
    }

    /// The plane at a pixel, by inverse depth.
    fn plane(&self, u: i32, v: i32, depth_m: f32) -> Plane {
        let off = ((self.focal[0] * self.config.voxel_m as f32 / depth_m) as i32).clamp(2, 10);
        let inverse = 1.0 / depth_m;
        let at = |u: i32, v: i32| self.depth_mm(u, v).filter(|mm| *mm > 0).map(|mm| 1000.0 / f32::from(mm));
        let a = slope(at(u - off, v), inverse, at(u + off, v)) / off as f32;
        let b = slope(at(u, v - off), inverse, at(u, v + off)) / off as f32;
        let (x, y) = (u as f32 - self.centre[0], v as f32 - self.centre[1]);
        let normal = Vec3::new(a * self.focal[0], b * self.focal[1], inverse - a * x - b * y);
        let norm = normal.norm();
        Plane { normal: normal / norm, cosine: (inverse / norm).clamp(COSINE_MIN, 1.0), slopes: [a, b] }
    }
}

/// Slope at the middle of three pixels in line, of which the outer ones may have no depth.
fn slope(before: Option<f32>, here: f32, after: Option<f32>) -> f32 {
    match (before.map(|before| here - before), after.map(|after| after - here)) {
        (None, None) => 0.0,
        (Some(only), None) | (None, Some(only)) => only,
        (Some(from), Some(to)) if (to - from).abs() <= PLANE_BEND_MAX * here => (from + to) / 2.0,
        (Some(from), Some(to)) if from.abs() < to.abs() => from,
        (Some(_), Some(to)) => to,
    }
}
