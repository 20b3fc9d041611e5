//! How a surface is turned to the camera, and how far around it voxels have their foot on it.
//!
//! Distances along the optical axis are longer than those across a surface that is seen at an angle: by as much as the
//! plane through a pixel and its neighbours says. Beyond an object's edge its plane goes on without it, so voxels whose
//! foot on the plane is no object must not be told that they are close to one.

use super::TsdfConfig;
use super::slab::nearest;
use super::tiles::{LANES, Shown};
use crate::image::DepthFrame;

/// Slopes are measured over this many pixels to both sides.
pub(super) const SPAN_PX: i32 = 2;
/// Three inverse depths in line, times depth, may bend this much and still be one plane.
pub(super) const BEND_MAX: f32 = 0.04;
/// Least cosine between ray and surface normal that is believed: below it a slope is mostly an edge or noise.
pub(super) const COSINE_MIN: f32 = 0.15;
/// Above this cosine the foot of a voxel that is a voxel behind a surface lies within a voxel beside it.
pub(super) const COSINE_FACING: f32 = 0.7;
/// A cosine of one: they are kept as whole numbers.
const COSINE_ONE: f32 = 255.0;
/// How far feet are on a surface is kept in parts of a voxel, …
const REACH_PARTS: f32 = 16.0;
/// … and looked for at so many places.
pub(super) const N_FEET: usize = 6;
/// Depth is uncertain by this share, and a foot's place with it.
pub(super) const NOISE: f32 = 0.01;
/// All that is in front, voxels.
pub(super) const FRONT_ALL: f32 = 15.9375;

/// How the surface that a tile shows is turned, and which voxels have their foot on it: a byte each, from the lowest one
/// on. Metres across the surface for each along the optical axis, of 255; how far behind the surface along that axis, in
/// sixteenths of a voxel; and how far in front.
pub(super) type Turned = u32;

#[inline(always)]
fn turned(cosine: f32, [behind, front]: [f32; 2]) -> Turned {
    let part = |whole: i32| whole.clamp(0, 255) as u32;
    let reach = |voxels: f32| part(nearest(voxels * REACH_PARTS));
    part(nearest(cosine * COSINE_ONE)) | reach(behind) << 8 | reach(front) << 16
}

/// Metres across the surface for each along the optical axis; how far behind it, and in front, its voxels are, voxels.
#[inline(always)]
pub(super) fn parts(turned: Turned) -> (f32, [f32; 2]) {
    let part = |nth: u32| (turned >> (8 * nth) & 255) as i32 as f32;
    (part(0) * (1.0 / COSINE_ONE), [part(1) * (1.0 / REACH_PARTS), part(2) * (1.0 / REACH_PARTS)])
}

/// Finds how surfaces are turned.
pub(super) struct Turning<'w, 'a> {
    frame: &'w DepthFrame<'a>,
    mask: Option<&'w [bool]>,
    focal: [f32; 2],
    centre: [f32; 2],
    voxel_m: f32,
    /// Voxels.
    truncation: f32,
}

/// A surface whose voxels do not all have their foot on it.
pub(super) struct Slanted {
    /// Which tile of all.
    tile: usize,
    slant: [f32; N_NUMBERS],
    /// Whether those behind have, and those in front.
    is_whole: [bool; 2],
}

/// Planes through pixels, number by number.
struct Slants([[f32; LANES]; N_NUMBERS]);

/// Numbers of a slant: the pixel's column and row from the image's centre; its depth; by how much that differs within half
/// a pixel, metres; the cosine between ray and normal; and, for each metre behind the surface, by how much the foot moves:
/// columns and rows times depth, and depth.
const N_NUMBERS: usize = 8;
const COSINE: usize = 4;

impl<'w, 'a> Turning<'w, 'a> {
    pub(super) fn new(frame: &'w DepthFrame<'a>, mask: Option<&'w [bool]>, config: &TsdfConfig) -> Self {
        let camera = frame.intrinsics();
        let voxel_m = config.voxel_m as f32;
        Turning {
            frame,
            mask,
            focal: [camera.fx as f32, camera.fy as f32],
            centre: [camera.cx as f32, camera.cy as f32],
            voxel_m,
            truncation: config.truncation_m as f32 / voxel_m,
        }
    }

    /// A surface that is turned straight to the camera.
    pub(super) fn facing(&self) -> Turned {
        turned(1.0, [self.truncation, FRONT_ALL])
    }

    /// Finds how up to [`LANES`] tiles of a row are turned, of which the first is the `first`th of all; adds those that
    /// [`Self::reach`] has to look at more closely.
    #[inline(always)]
    pub(super) fn turn(&self, batch: &[Shown], row: &mut [Turned], first: usize, slanted: &mut Vec<Slanted>) {
        let Some(slants) = self.slants(batch) else { return };
        let cosine = &slants.0[COSINE];
        let mut is_whole = [[true; LANES]; 2];
        let mut least = 1.0_f32;
        for cosine in cosine {
            least = least.min(*cosine);
        }
        if least < COSINE_FACING {
            is_whole = [self.feet(&slants, 1.0), self.feet(&slants, -1.0)];
        }
        let mut found = [0_u32; LANES];
        for n in 0..LANES {
            found[n] = turned(cosine[n], self.whole(cosine[n]));
        }
        for (n, shown) in batch.iter().enumerate() {
            let is_whole = [is_whole[0][n], is_whole[1][n]];
            if cosine[n] < COSINE_FACING && is_whole != [true; 2] {
                let slant = std::array::from_fn(|number| slants.0[number][n]);
                slanted.push(Slanted { tile: first + shown.tile, slant, is_whole });
            } else if let Some(tile) = row.get_mut(shown.tile) {
                *tile = found[n];
            }
        }
    }

    /// Finds how far around surfaces that do not go on voxels have their foot on them.
    #[inline(always)]
    pub(super) fn reach(&self, slanted: &[Slanted], tiles: &mut [Turned]) {
        for batch in slanted.chunks(LANES) {
            let Some(rest) = batch.last() else { return };
            let mut slants = Slants([[0.0; LANES]; N_NUMBERS]);
            for n in 0..LANES {
                let slanted = batch.get(n).unwrap_or(rest);
                for (lanes, number) in slants.0.iter_mut().zip(slanted.slant) {
                    lanes[n] = number;
                }
            }
            let reach = [self.reach_along(&slants, 1.0), self.reach_along(&slants, -1.0)];
            for (n, slanted) in batch.iter().enumerate() {
                let cosine = slanted.slant[COSINE];
                let whole = self.whole(cosine);
                let side = |side: usize| if slanted.is_whole[side] { whole[side] } else { reach[side][n] };
                if let Some(tile) = tiles.get_mut(slanted.tile) {
                    *tile = turned(cosine, [side(0).min(whole[0]), side(1).min(whole[1])]);
                }
            }
        }
    }

    /// How far behind a surface that goes on, and in front of it, its voxels are: as far as they are needed.
    #[inline(always)]
    fn whole(&self, cosine: f32) -> [f32; 2] {
        [self.truncation.max(1.0 / cosine), FRONT_ALL]
    }

    /// How far behind surfaces (`side` 1), or in front of them (-1), voxels have their foot on them, voxels; at least one.
    #[inline(always)]
    fn reach_along(&self, slants: &Slants, side: f32) -> [f32; LANES] {
        let (mut goes_on, mut reach) = ([true; LANES], [1.0_f32; LANES]);
        for nth in 1..N_FEET {
            let share = nth as f32 / N_FEET as f32;
            let is_there = self.feet(slants, side * share);
            for n in 0..LANES {
                goes_on[n] &= is_there[n];
                reach[n] = if goes_on[n] { reach[n].max(share / slants.0[COSINE][n]) } else { reach[n] };
            }
            if goes_on == [false; LANES] {
                break;
            }
        }
        reach
    }

    /// Whether the feet of voxels that are so far behind their pixel's surface are on the object; 1 is one voxel, measured
    /// across the surface.
    #[inline(always)]
    fn feet(&self, slants: &Slants, behind: f32) -> [bool; LANES] {
        let Slants([col, row, depth_m, grain_m, cosine, step_col, step_row, step_m]) = slants;
        let (mut place, mut foot_m) = ([[0_i32; LANES]; 2], [0.0_f32; LANES]);
        for n in 0..LANES {
            let behind_m = behind / cosine[n] * self.voxel_m;
            foot_m[n] = depth_m[n] + behind_m * step_m[n];
            let inverse = 1.0 / foot_m[n];
            place[0][n] = nearest((col[n] * depth_m[n] + behind_m * step_col[n]) * inverse + self.centre[0]);
            place[1][n] = nearest((row[n] * depth_m[n] + behind_m * step_row[n]) * inverse + self.centre[1]);
        }
        let mm = self.depth_mm(&place, (0, 0), self.mask);
        let mut is_there = [false; LANES];
        for n in 0..LANES {
            let tolerance_m = self.voxel_m + grain_m[n] + NOISE * foot_m[n];
            is_there[n] = (f32::from(mm[n]) * 0.001 - foot_m[n]).abs() <= tolerance_m;
        }
        is_there
    }

    /// The planes through pixels. With 1/z = a·u + b·v + c around a pixel, the plane there is n·P = 1 with
    /// n = (a·fx, b·fy, a·cx + b·cy + c), and a point P = ray·z is (1 − z/depth) / |n| in front of it.
    #[inline(always)]
    fn slants(&self, batch: &[Shown]) -> Option<Slants> {
        let rest = batch.last()?;
        let (mut place, mut here) = ([[0_i32; LANES]; 2], [0.0_f32; LANES]);
        for n in 0..LANES {
            let shown = batch.get(n).unwrap_or(rest);
            (place[0][n], place[1][n]) = (shown.col as i32, shown.row as i32);
            here[n] = 1000.0 / f32::from(shown.depth_mm);
        }
        let (left, right) = (self.inverse(&place, (-SPAN_PX, 0)), self.inverse(&place, (SPAN_PX, 0)));
        let (up, down) = (self.inverse(&place, (0, -SPAN_PX)), self.inverse(&place, (0, SPAN_PX)));
        let mut slants = Slants([[0.0; LANES]; N_NUMBERS]);
        let [cols, rows, depths_m, grains_m, cosines, steps @ ..] = &mut slants.0;
        for n in 0..LANES {
            let (a, b) = (slope(left[n], here[n], right[n]), slope(up[n], here[n], down[n]));
            let (col, row) = (place[0][n] as f32 - self.centre[0], place[1][n] as f32 - self.centre[1]);
            let normal = [a * self.focal[0], b * self.focal[1], here[n] - a * col - b * row];
            let norm = (normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]).sqrt();
            let cosine = (here[n] / norm).clamp(COSINE_MIN, 1.0);
            let (across, depth_m) = (cosine / norm, 1.0 / here[n]);
            let grain_m = 0.5 * (a.abs() + b.abs()) * depth_m * depth_m;
            (cols[n], rows[n], depths_m[n], grains_m[n]) = (col, row, depth_m, grain_m);
            cosines[n] = cosine;
            steps[0][n] = col - across * normal[0] * self.focal[0];
            steps[1][n] = row - across * normal[1] * self.focal[1];
            steps[2][n] = 1.0 - across * normal[2];
        }
        Some(slants)
    }

    /// Inverse depth beside pixels, masked or not; 0 where there is none.
    #[inline(always)]
    fn inverse(&self, place: &[[i32; LANES]; 2], off: (i32, i32)) -> [f32; LANES] {
        let mm = self.depth_mm(place, off, None);
        let mut inverse = [0.0_f32; LANES];
        for n in 0..LANES {
            inverse[n] = if mm[n] > 0 { 1000.0 / f32::from(mm[n]) } else { 0.0 };
        }
        inverse
    }

    /// Depth beside pixels, trusted or not, millimetres; 0 where there is none, or beside a mask.
    #[inline(always)]
    fn depth_mm(
        &self,
        place: &[[i32; LANES]; 2],
        (right, down): (i32, i32),
        mask: Option<&[bool]>,
    ) -> [u16; LANES] {
        let depth = self.frame.depth();
        let mut mm = [0_u16; LANES];
        for n in 0..LANES {
            // Left of the image, or above, comes out larger than any image.
            let col = place[0][n].wrapping_add(right) as u32;
            let row = place[1][n].wrapping_add(down) as u32;
            let idx = row.wrapping_mul(depth.width()).wrapping_add(col) as usize;
            let is_masked = mask.is_none_or(|mask| mask.get(idx) == Some(&true));
            let is_inside = (col < depth.width()) & (row < depth.height()) & is_masked;
            mm[n] = if is_inside { depth.depth_mm().get(idx).copied().unwrap_or(0) } else { 0 };
        }
        mm
    }
}

/// Slope of inverse depth by pixel at the middle of three in line, of which the outer ones may have none (0). At an edge
/// it is that of the side which lies on the surface.
#[inline(always)]
fn slope(before: f32, here: f32, after: f32) -> f32 {
    let (from, to) = (here - before, after - here);
    let is_before_nearer = from.abs() < to.abs();
    let nearer = if is_before_nearer { from } else { to };
    let is_straight = (to - from).abs() <= BEND_MAX * here;
    let both = if is_straight { 0.5 * (from + to) } else { nearer };
    let only = if before > 0.0 { from } else { to };
    let has_both = (before > 0.0) & (after > 0.0);
    let has_any = (before > 0.0) | (after > 0.0);
    let step = if has_both { both } else { only };
    if has_any { step / SPAN_PX as f32 } else { 0.0 }
}
