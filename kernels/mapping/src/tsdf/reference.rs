//! A frame's update of a TSDF once more, slow and obvious: each voxel and each pixel by itself.
//! Laws hold the product's update against it, number by number.

use nalgebra::Vector3;

use super::frustum::Frustum;
use super::seen::Seen;
use super::slab::NEAR_M;
use super::slant::{BEND_MAX, COSINE_FACING, COSINE_MIN, FRONT_ALL, N_FEET, NOISE, SPAN_PX};
use super::strips::Strips;
use super::tiles::{SIDE_SPARE, Tiles, is_asked, side_for};
use super::update::View;
use super::{BLOCK_SIDE, BLOCK_VOXELS, BlockKey, Integrated, Tsdf, TsdfConfig};
use crate::image::{DepthFrame, Mask};
use crate::projection::TrustedDepth;

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
        side: side_for(camera.fx.min(camera.fy), config.voxel_m, config.limits.max_m),
    };
    let mut done = Integrated { n_blocks_refused: slow.reserve(tsdf, frame), ..Integrated::default() };
    let clears = config.clears();
    let frustum = Frustum::new(frame, &config);
    let steps = frustum.steps(config.voxel_m).map(Vector3::from);
    let mut emptied = Vec::new();
    for (idx, (head, block)) in tsdf.heads.iter().zip(&mut tsdf.blocks).enumerate() {
        let first = Vector3::from(frustum.first(head.key));
        let (is_reserved, mut n_hit, mut n_looked) = (head.frame == tsdf.frame, 0, 0);
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
            let at = first + steps[2] * z as f32 + (steps[1] * y as f32 + steps[0] * x as f32);
            let Some(pixel) = slow.pixel(at) else { continue };
            n_looked += 1;
            let lost = match slow.look(at.z, pixel, (*weight > 0.0).then_some(*mean_m), is_reserved) {
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
        let is_seen = frustum.sees(head.key);
        assert!(is_seen || n_looked == 0, "a block with {n_looked} voxels in view is passed over");
        if is_seen && n_hit == 0 && block.weight.iter().all(|w| *w <= 0.0) {
            emptied.push(idx);
        }
    }
    tsdf.remove(&emptied);
    let strips = Strips::new(frame, mask, &config, slow.side).one_by_one();
    done.n_blocks_refused += tsdf.thin.see(&strips, frame, tsdf.frame, &config);
    if clears {
        // What a place loses is what its voxel does; nothing there depends on what is seen of the object.
        let (seen, tiles) = (Seen::default(), Tiles::default());
        tsdf.thin.clear(&View::new(frame, mask, (&seen, &tiles), &config), tsdf.frame);
    }
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
            // One pixel of each tile of a row comes first.
            let (mut pixels, mut firsts, mut others) = (Vec::new(), Vec::new(), Vec::new());
            for col in (cols.start / self.side..cols.end.div_ceil(self.side)).map(|col| col * self.side) {
                if self.side >= SIDE_SPARE && !is_asked(col / self.side, row / self.side) {
                    continue;
                }
                match self.shown(col, row).as_slice() {
                    [] => {}
                    [only] if *only == self.middle(col, row) => pixels.push(*only),
                    [first, rest @ ..] => {
                        firsts.push(*first);
                        others.extend_from_slice(rest);
                    }
                }
            }
            pixels.append(&mut firsts);
            pixels.append(&mut others);
            for (col, row) in pixels {
                let Some(depth_m) = self.trusted.at_in_mask(col, row) else { continue };
                let ray = turn * frame.intrinsics().unproject(col as f64, row as f64, 1.0).coords;
                for (step, last) in [-1.0, 0.0, 1.0].into_iter().zip(&mut last) {
                    let reach_m = f64::from(depth_m) + step * self.config.truncation_m;
                    let key: BlockKey = (eye + ray * reach_m).map(|c| c.floor() as i32).into();
                    if std::mem::replace(last, key) != key {
                        n_refused += usize::from(!tsdf.touch(key, &mut Vec::new()));
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

    /// Trusted pixels of the tile of a pixel: its middle, or else up to three others.
    fn shown(&self, col: usize, row: usize) -> Vec<(usize, usize)> {
        let (cols, rows) = self.trusted.bounds();
        let is_shown = |(c, r): &(usize, usize)| {
            cols.contains(c) && rows.contains(r) && self.trusted.at_in_mask(*c, *r).is_some()
        };
        let middle = self.middle(col, row);
        if is_shown(&middle) {
            return vec![middle];
        }
        let (col, row) = (col / self.side * self.side, row / self.side * self.side);
        let (quarter, end) = (self.side / 4, self.side - 1);
        let others = [(quarter, quarter), (end, quarter), (quarter, end)];
        others.map(|(c, r)| (col + c, row + r)).into_iter().filter(is_shown).collect()
    }

    /// Metres across the surface for each along the optical axis, as the tile of a pixel shows it, and how far behind it
    /// along that axis, and how far in front, voxels have their foot on it, metres.
    fn turned(&self, u: usize, v: usize) -> [f32; 3] {
        let voxel_m = self.config.voxel_m as f32;
        let truncation = self.config.truncation_m as f32 / voxel_m;
        let parts = |share: f32, n: f32| (share * n).round_ties_even().clamp(0.0, 255.0);
        let kept = |cosine, behind, front| {
            let reach_m = |voxels| parts(voxels, 16.0) * (1.0 / 16.0) * voxel_m;
            [parts(cosine, 255.0) * (1.0 / 255.0), reach_m(behind), reach_m(front)]
        };
        let Some(&(u, v)) = self.shown(u, v).first() else { return kept(1.0, truncation, FRONT_ALL) };
        let (u, v) = (u as i32, v as i32);
        let at = |u: i32, v: i32| self.depth_mm(u, v).filter(|mm| *mm > 0).map(|mm| 1000.0 / f32::from(mm));
        let here = at(u, v).unwrap();
        let a = slope(at(u - SPAN_PX, v), here, at(u + SPAN_PX, v));
        let b = slope(at(u, v - SPAN_PX), here, at(u, v + SPAN_PX));
        let (x, y) = (u as f32 - self.centre[0], v as f32 - self.centre[1]);
        let normal = Vector3::new(a * self.focal[0], b * self.focal[1], here - a * x - b * y);
        let cosine = (here / normal.norm()).clamp(COSINE_MIN, 1.0);
        // The foot of a voxel behind the pixel's point, on its plane: columns and rows times depth, and depth.
        let (across, depth_m) = (cosine / normal.norm(), 1.0 / here);
        let grain_m = 0.5 * (a.abs() + b.abs()) * depth_m * depth_m;
        let step = Vector3::new(
            x - across * normal.x * self.focal[0],
            y - across * normal.y * self.focal[1],
            1.0 - across * normal.z,
        );
        let reach = |side: f32| {
            let goes_on = |share: &f32| {
                let behind_m = side * share / cosine * voxel_m;
                let foot = Vector3::new(x * depth_m, y * depth_m, depth_m) + step * behind_m;
                let inverse = 1.0 / foot.z;
                let [u, v] =
                    [0, 1].map(|axis| (foot[axis] * inverse + self.centre[axis]).round_ties_even() as i32);
                let mm = self.depth_mm(u, v).filter(|_| self.in_mask(u, v)).unwrap_or(0);
                (f32::from(mm) * 0.001 - foot.z).abs() <= voxel_m + grain_m + NOISE * foot.z
            };
            if cosine >= COSINE_FACING || goes_on(&1.0) {
                return f32::INFINITY;
            }
            let feet = (1..N_FEET).map(|nth| nth as f32 / N_FEET as f32);
            feet.take_while(goes_on).last().map_or(1.0, |last| (last / cosine).max(1.0))
        };
        kept(cosine, reach(1.0).min(truncation.max(1.0 / cosine)), reach(-1.0).min(FRONT_ALL))
    }

    fn depth_mm(&self, u: i32, v: i32) -> Option<u16> {
        let is_inside = u >= 0 && v >= 0 && u < self.size[0] && v < self.size[1];
        is_inside.then(|| self.depth_mm[(v * self.size[0] + u) as usize])
    }

    fn in_mask(&self, u: i32, v: i32) -> bool {
        self.trusted.in_mask((v * self.size[0] + u) as usize)
    }

    /// The pixel that shows a place given as column times depth, row times depth, and depth.
    fn pixel(&self, at: Vector3<f32>) -> Option<(i32, i32)> {
        let inverse = 1.0 / at.z;
        let (u, v) = ((at.x * inverse).round_ties_even(), (at.y * inverse).round_ties_even());
        let in_view = u >= 0.0 && v >= 0.0 && u < self.size[0] as f32 && v < self.size[1] as f32;
        (in_view && at.z >= NEAR_M).then_some((u as i32, v as i32))
    }

    /// What the frame says of a voxel so far along the optical axis that is seen at a pixel; with its mean if it has weight.
    fn look(&self, z_m: f32, (u, v): (i32, i32), mean_m: Option<f32>, is_reserved: bool) -> Learnt {
        let (voxel_m, truncation_m) = (self.config.voxel_m as f32, self.config.truncation_m as f32);
        let clears = self.config.clears();
        let Some(mm) = self.depth_mm(u, v).filter(|mm| *mm > 0) else { return Learnt::Nothing };
        let ahead_m = f32::from(mm) * 0.001 - z_m;
        if self.trusted.at_in_mask(u as usize, v as usize).is_some() {
            let [cosine, behind_m, front_m] = self.turned(u as usize, v as usize);
            let off_m = if ahead_m > front_m { ahead_m } else { ahead_m * cosine };
            let is_far = off_m > truncation_m;
            if ahead_m < -behind_m {
                return Learnt::Nothing;
            }
            let is_worn = clears && mean_m.is_some_and(|mean_m| mean_m < voxel_m);
            if (is_reserved && !(is_far && is_worn)) || (mean_m.is_some() && !is_far) {
                return Learnt::Surface(off_m.min(truncation_m));
            }
        }
        if mean_m.is_none() {
            return Learnt::Nothing;
        }
        if ahead_m > if self.in_mask(u, v) { truncation_m } else { voxel_m } {
            return self.look_around(z_m, u, v);
        }
        let around = [(0, 0), (2, 0), (-2, 0), (0, 2), (0, -2)].map(|(du, dv)| (u + du, v + dv));
        let is_by_mask = around.into_iter().any(|(u, v)| self.depth_mm(u, v).is_some() && self.in_mask(u, v));
        if ahead_m >= -voxel_m && !is_by_mask { Learnt::Other } else { Learnt::Nothing }
    }

    fn look_around(&self, z_m: f32, u: i32, v: i32) -> Learnt {
        let voxel_m = self.config.voxel_m as f32;
        let off = ((0.5 * voxel_m * self.focal[0] / z_m) as i32 + 1).min(16);
        let mut learnt = Learnt::Through;
        for (u, v) in [(u + off, v), (u - off, v), (u, v + off), (u, v - off)] {
            let Some(mm) = self.depth_mm(u, v).filter(|mm| *mm > 0) else { continue };
            let ahead_m = f32::from(mm) * 0.001 - z_m;
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
}

/// Slope at the middle of three pixels in line, of which the outer ones may have no depth.
fn slope(before: Option<f32>, here: f32, after: Option<f32>) -> f32 {
    let step = match (before.map(|before| here - before), after.map(|after| after - here)) {
        (None, None) => 0.0,
        (Some(only), None) | (None, Some(only)) => only,
        (Some(from), Some(to)) if (to - from).abs() <= BEND_MAX * here => 0.5 * (from + to),
        (Some(from), Some(to)) if from.abs() < to.abs() => from,
        (Some(_), Some(to)) => to,
    };
    step / SPAN_PX as f32
}
