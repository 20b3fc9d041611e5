//! What one frame tells the voxels of one block.
//!
//! A slab of voxels at a time: where all of them are seen, and how far ahead of each its pixel's depth lies, in
//! loops over arrays ([`slab`](super::slab)), which compilers turn into vectors. Only those near the surface, or
//! with something to lose, are looked at here one by one.

use nalgebra::{Point3, Vector3};

use super::slab::{N_SLAB, NEAR_M, ROUNDING, Slab};
use super::tiles::{EDGE_BAND, Tile, Tiles};
use super::{BLOCK_SIDE, Block, Integrated, TsdfConfig};
use crate::image::DepthFrame;
use crate::isa::{Isa, Work};
use crate::projection::TrustedDepth;

/// Above this cosine the foot of a voxel on its plane is less than a voxel beside it.
const COSINE_FACING: f32 = 0.9;

/// One frame, ready to be asked by voxels. Single precision: a camera sees metres, not kilometres.
pub(super) struct View<'a> {
    isa: Isa,
    pub(super) depth_mm: &'a [u16],
    trusted: &'a TrustedDepth<'a>,
    pub(super) tiles: &'a Tiles,
    pub(super) width: i32,
    pub(super) height: i32,
    pub(super) focal: [f32; 2],
    pub(super) centre: [f32; 2],
    camera_from_map: geometry::Pose3,
    /// Steps of one voxel along x, y and z of `map`, in `camera`.
    steps: [Vector3<f32>; 3],
    /// From the first voxel of a slab to each one, in `camera`: x, y and z.
    pub(super) offsets: [[f32; N_SLAB]; 3],
    pub(super) voxel_m: f32,
    pub(super) truncation_m: f32,
    weight_max: f32,
    carve_step: f32,
    absent_step: f32,
    block_radius_m: f64,
}

/// The update of a block, for any instruction set.
struct Update<'v, 'a> {
    view: &'v View<'a>,
    block: &'v mut Block,
    reserved: bool,
    done: &'v mut Integrated,
}

impl Work for Update<'_, '_> {
    type Output = ();

    // Never fused: every instruction set computes the same.
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        self.view.update_rows(self.block, self.reserved, self.done);
    }
}

/// What a voxel learns.
enum Evidence {
    /// Nothing: out of view, hidden, or depth that is not trusted.
    None,
    /// The object's surface is this far in front of it, metres; negative is behind it.
    Surface(f32),
    /// A ray passed through it.
    Through,
    /// A surface is seen here that is not in the mask.
    Other,
}

impl<'a> View<'a> {
    pub(super) fn new(
        frame: &DepthFrame<'a>,
        trusted: &'a TrustedDepth<'a>,
        tiles: &'a Tiles,
        config: &TsdfConfig,
    ) -> Self {
        let camera = frame.intrinsics();
        let camera_from_map = frame.map_from_camera().inverse();
        let step = |axis: Vector3<f64>| (camera_from_map.rotation * axis * config.voxel_m).cast::<f32>();
        let steps = [step(Vector3::x()), step(Vector3::y()), step(Vector3::z())];
        View {
            isa: Isa::detect(),
            depth_mm: frame.depth().depth_mm(),
            trusted,
            tiles,
            width: camera.width as i32,
            height: camera.height as i32,
            focal: [camera.fx as f32, camera.fy as f32],
            centre: [camera.cx as f32, camera.cy as f32],
            camera_from_map,
            offsets: Slab::offsets(&steps),
            steps,
            voxel_m: config.voxel_m as f32,
            truncation_m: config.truncation_m as f32,
            weight_max: config.weight_max,
            carve_step: config.carve_step,
            absent_step: config.absent_step,
            block_radius_m: config.voxel_m * BLOCK_SIDE as f64 * 3.0_f64.sqrt() / 2.0,
        }
    }

    /// Whether blocks that hold no surface of this frame are looked at too.
    pub(super) fn clears(&self) -> bool {
        self.carve_step > 0.0 || self.absent_step > 0.0
    }

    /// Whether any voxel of a block may be in view.
    pub(super) fn sees(&self, block: &Block) -> bool {
        let middle = self.camera_from_map * self.corner_map(block, 0.5);
        let radius_m = self.block_radius_m;
        if middle.z < -radius_m {
            return false;
        }
        // A sphere against the image's four side planes.
        let inside = |along: f64, focal: f32, centre: f32, n: i32| {
            let focal = f64::from(focal);
            let low = f64::from(centre) / focal;
            let high = (f64::from(n) - f64::from(centre)) / focal;
            along + low * middle.z > -radius_m * 1.0_f64.hypot(low)
                && high * middle.z - along > -radius_m * 1.0_f64.hypot(high)
        };
        inside(middle.x, self.focal[0], self.centre[0], self.width)
            && inside(middle.y, self.focal[1], self.centre[1], self.height)
    }

    /// A point of a block: its low corner and `share` of its sides, in `map`.
    fn corner_map(&self, block: &Block, share: f64) -> geometry::Point3 {
        let side_m = f64::from(self.voxel_m) * BLOCK_SIDE as f64;
        geometry::Point3::from(Vector3::from(block.key.map(|k| (f64::from(k) + share) * side_m)))
    }

    /// Lets every voxel of a block look at its pixel.
    pub(super) fn update(&self, block: &mut Block, reserved: bool, done: &mut Integrated) {
        self.isa.run(Update { view: self, block, reserved, done });
    }

    #[inline(always)]
    fn update_rows(&self, block: &mut Block, reserved: bool, done: &mut Integrated) {
        let corner: Point3<f32> = (self.camera_from_map * self.corner_map(block, 0.0)).cast();
        let first = corner + (self.steps[0] + self.steps[1] + self.steps[2]) * 0.5;
        let clears = self.clears();
        let slabs = block.sdf_m.as_chunks_mut::<N_SLAB>().0.iter_mut();
        for ((z, sdf_m), weight) in (0_u8..).zip(slabs).zip(block.weight.as_chunks_mut::<N_SLAB>().0) {
            if !reserved && weight.iter().all(|w| *w <= 0.0) {
                continue;
            }
            let slab = Slab::new(self, first + self.steps[2] * f32::from(z));
            let mut wanted = slab.wanted(self, weight, reserved, clears);
            while let Some(nth) = wanted.next() {
                let (mean_m, weight) = (&mut sdf_m[nth], &mut weight[nth]);
                let lost = match self.look(&slab, nth, *weight > 0.0) {
                    Evidence::None => continue,
                    Evidence::Surface(sdf_m) => {
                        *mean_m += (sdf_m - *mean_m) / (*weight + 1.0);
                        *weight = (*weight + 1.0).min(self.weight_max);
                        done.n_voxels_hit += 1;
                        continue;
                    }
                    Evidence::Through => self.carve_step,
                    Evidence::Other => self.absent_step,
                };
                if lost > 0.0 {
                    *weight = (*weight - lost).max(0.0);
                    done.n_voxels_cleared += 1;
                }
            }
        }
    }

    /// What the frame says of the nth voxel of a slab, which has depth; `has_weight` when there is something to
    /// lose.
    #[inline]
    fn look(&self, slab: &Slab, nth: usize, has_weight: bool) -> Evidence {
        let (idx, ahead_m) = (slab.pixel[nth] as usize, slab.ahead_m[nth]);
        let (u, v) = (slab.cols[nth] as i32, slab.rows[nth] as i32);
        let at = slab.begin + Vector3::from(self.offsets.each_ref().map(|offsets| offsets[nth]));
        if self.trusted.in_mask(idx) {
            if let Some(evidence) = self.surface(at, (u, v), self.tiles.tile(slab.tile[nth]), ahead_m) {
                return evidence;
            }
        } else if ahead_m.abs() <= self.voxel_m && has_weight {
            return if self.beside_mask(u, v) { Evidence::None } else { Evidence::Other };
        }
        if has_weight && ahead_m > self.voxel_m { self.look_around(at, u, v) } else { Evidence::None }
    }

    /// What a masked pixel says of a voxel in `camera` that it is `ahead_m` of; `None` when its surface is far
    /// behind the voxel.
    #[inline]
    fn surface(
        &self,
        at: Point3<f32>,
        (u, v): (i32, i32),
        tile: Option<&Tile>,
        ahead_m: f32,
    ) -> Option<Evidence> {
        let is_inside = tile.is_some_and(|tile| tile.is_inside);
        let is_trusted = || {
            let (col, row) = (u as usize, v as usize);
            if is_inside {
                self.trusted.is_trusted_inside(col, row)
            } else {
                self.trusted.at(col, row).is_some()
            }
        };
        let tile = tile.filter(|tile| tile.holds(u, v, ahead_m + at.z));
        // Off its tile's plane, at an edge or in noise, a slope would be a guess: the surface is taken to face the
        // camera.
        let (cosine, is_sure) = tile.map_or((1.0, false), |tile| (tile.cosine, tile.is_sure));
        if !is_sure && ahead_m.abs() > EDGE_BAND * self.truncation_m {
            return (ahead_m < 0.0).then_some(Evidence::None);
        }
        let sdf_m = ahead_m * cosine;
        if sdf_m > self.truncation_m {
            return None;
        }
        if sdf_m < -self.truncation_m || (!is_sure && !is_trusted()) {
            return Some(Evidence::None);
        }
        let is_over = match tile {
            Some(tile) if ahead_m.abs() > self.voxel_m && !(is_sure && cosine >= COSINE_FACING) => {
                self.is_over_object(at + tile.normal * sdf_m)
            }
            _ => true,
        };
        Some(if is_over { Evidence::Surface(sdf_m) } else { Evidence::None })
    }

    /// Whether the foot of a voxel on the plane of its pixel, in `camera`, is object: at a grazing angle the
    /// two are far apart, and beyond the object's edge its plane goes on without it.
    fn is_over_object(&self, foot: Point3<f32>) -> bool {
        let Some(idx) = self.pixel(foot) else { return false };
        let depth_m = f32::from(self.depth_mm[idx]) * 0.001;
        self.trusted.in_mask(idx) && (depth_m - foot.z).abs() <= self.voxel_m
    }

    /// Position in the image of the pixel that shows a point in `camera`.
    #[inline]
    fn pixel(&self, at: Point3<f32>) -> Option<usize> {
        if at.z < NEAR_M {
            return None;
        }
        let inverse = 1.0 / at.z;
        let place = |along: f32, axis: usize| {
            let pixel = self.focal[axis] * along * inverse + self.centre[axis];
            (pixel + ROUNDING).to_bits().wrapping_sub(ROUNDING.to_bits())
        };
        let (u, v) = (place(at.x, 0), place(at.y, 1));
        let in_view = u < self.width as u32 && v < self.height as u32;
        in_view.then(|| v as usize * self.width as usize + u as usize)
    }

    /// What a ray that passes through the voxel's centre means, by the pixels at the voxel's rim: a pose that
    /// is a little off must not carve away what is thin, nor what touches the floor stay for ever.
    fn look_around(&self, at: Point3<f32>, u: i32, v: i32) -> Evidence {
        let off = ((0.5 * self.voxel_m * self.focal[0] / at.z) as i32 + 1).min(16);
        let mut evidence = Evidence::Through;
        for (du, dv) in [(off, 0), (-off, 0), (0, off), (0, -off)] {
            let (u, v) = (u + du, v + dv);
            if u < 0 || v < 0 || u >= self.width || v >= self.height {
                continue;
            }
            let idx = (v * self.width + u) as usize;
            let ahead_m = f32::from(self.depth_mm[idx]) * 0.001 - at.z;
            // Zero, no depth, tells nothing.
            if ahead_m > self.voxel_m || self.depth_mm[idx] == 0 {
                continue;
            }
            if self.trusted.in_mask(idx) {
                return Evidence::None;
            }
            // A surface where the voxel is. What is clearly in front hides the rim and no more.
            if ahead_m >= -2.0 * self.voxel_m {
                evidence = Evidence::Other;
            }
        }
        evidence
    }

    /// Whether the mask is within two pixels: its border is not exact enough to tell absence.
    fn beside_mask(&self, u: i32, v: i32) -> bool {
        [(2, 0), (-2, 0), (0, 2), (0, -2)].into_iter().any(|(du, dv)| {
            let (u, v) = (u + du, v + dv);
            let in_image = u >= 0 && v >= 0 && u < self.width && v < self.height;
            in_image && self.trusted.in_mask((v * self.width + u) as usize)
        })
    }
}
