//! The planes that a depth image shows around pixels, for many pixels at once.
//!
//! By inverse depth, which is linear on a plane, over a span as wide as a voxel: over less, slopes are mostly the
//! noise of depth. Arrays in, arrays out, one written order of operations: every instruction set computes the same.
//! Not here: which pixels are worth asking for (`tiles`, `update`).

use crate::image::DepthFrame;

/// Pixels or voxels that are asked for at once: a vector of the widest instructions.
pub(super) const LANES: usize = 16;
/// One number of each.
pub(super) type Lanes = [f32; LANES];

/// Least cosine between ray and surface normal that is believed: below it a slope is mostly noise.
pub(super) const COSINE_MIN: f32 = 0.1;
/// Three inverse depths in line, times depth, may bend this much and still be one plane.
pub(super) const PLANE_BEND_MAX: f32 = 0.04;
/// The pixels between which a slope is measured lie this far apart, at least and at most.
pub(super) const SPAN_PX: (f32, f32) = (2.0, 10.0);

/// A depth image that planes are looked for in.
pub(super) struct Planes<'a> {
    depth_mm: &'a [u16],
    width: u32,
    height: u32,
    focal: [f32; 2],
    centre: [f32; 2],
    voxel_m: f32,
}

/// Planes through pixels, in `camera`.
pub(super) struct Found {
    /// Unit normals, away from the camera: x, y and z.
    pub(super) normal: [Lanes; 3],
    /// How far it is off the plane for each metre along the optical axis.
    pub(super) cosine: Lanes,
    /// Slopes of inverse depth by column and row.
    pub(super) slopes: [Lanes; 2],
}

impl<'a> Planes<'a> {
    pub(super) fn new(frame: &DepthFrame<'a>, voxel_m: f64) -> Self {
        let camera = frame.intrinsics();
        Planes {
            depth_mm: frame.depth().depth_mm(),
            width: camera.width,
            height: camera.height,
            focal: [camera.fx as f32, camera.fy as f32],
            centre: [camera.cx as f32, camera.cy as f32],
            voxel_m: voxel_m as f32,
        }
    }

    /// The planes through pixels of the image, column and row, that have depth. With 1/z = a·u + b·v + c the plane is
    /// n·P = 1 with n = (a·fx, b·fy, a·cx + b·cy + c), and a point P = ray·z is (1 − z/depth) / |n| in front of it.
    #[inline(always)]
    pub(super) fn at(&self, pixels: &[[i32; LANES]; 2], depth_m: &Lanes) -> Found {
        let (mut span, mut inverse) = ([0_i32; LANES], [0.0_f32; LANES]);
        for n in 0..LANES {
            let pixels_wide = self.focal[0] * self.voxel_m / depth_m[n];
            span[n] = whole(pixels_wide.max(SPAN_PX.0).min(SPAN_PX.1));
            inverse[n] = 1.0 / depth_m[n];
        }
        let slopes =
            [self.slopes(pixels, &span, &inverse, (1, 0)), self.slopes(pixels, &span, &inverse, (0, 1))];
        let mut found = Found { normal: [[0.0; LANES]; 3], cosine: [0.0; LANES], slopes };
        for n in 0..LANES {
            let (a, b) = (found.slopes[0][n], found.slopes[1][n]);
            let x = pixels[0][n] as f32 - self.centre[0];
            let y = pixels[1][n] as f32 - self.centre[1];
            let normal = [a * self.focal[0], b * self.focal[1], inverse[n] - a * x - b * y];
            let norm = (normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]).sqrt();
            found.normal[0][n] = normal[0] / norm;
            found.normal[1][n] = normal[1] / norm;
            found.normal[2][n] = normal[2] / norm;
            found.cosine[n] = (inverse[n] / norm).clamp(COSINE_MIN, 1.0);
        }
        found
    }

    /// Slopes of inverse depth at pixels, along columns or rows.
    #[inline(always)]
    fn slopes(
        &self,
        pixels: &[[i32; LANES]; 2],
        span: &[i32; LANES],
        inverse: &Lanes,
        (du, dv): (i32, i32),
    ) -> Lanes {
        let before = self.beside(pixels, span, (-du, -dv));
        let after = self.beside(pixels, span, (du, dv));
        let mut slopes = [0.0_f32; LANES];
        for n in 0..LANES {
            slopes[n] = slope(before[n], inverse[n], after[n]) / span[n] as f32;
        }
        slopes
    }

    /// Inverse depth at the pixels one span beside in a direction; NaN where there is none.
    #[inline(always)]
    fn beside(&self, pixels: &[[i32; LANES]; 2], span: &[i32; LANES], (du, dv): (i32, i32)) -> Lanes {
        let mut place = [0_u32; LANES];
        for n in 0..LANES {
            // Left of the image, or above, comes out larger than any image.
            let u = pixels[0][n].wrapping_add(span[n].wrapping_mul(du)) as u32;
            let v = pixels[1][n].wrapping_add(span[n].wrapping_mul(dv)) as u32;
            let is_inside = (u < self.width) & (v < self.height);
            place[n] = if is_inside { v.wrapping_mul(self.width).wrapping_add(u) } else { u32::MAX };
        }
        let mut mm = [0_u32; LANES];
        for (mm, place) in mm.iter_mut().zip(&place) {
            *mm = self.depth_mm.get(*place as usize).map_or(0, |mm| u32::from(*mm));
        }
        let mut inverse = [f32::NAN; LANES];
        for n in 0..LANES {
            inverse[n] = if mm[n] > 0 { 1000.0 / (mm[n] as i32 as f32) } else { f32::NAN };
        }
        inverse
    }
}

/// The whole number at or below one from 0 to a few millions: a cast has cases for all others, which vectors have not.
#[inline(always)]
pub(super) fn whole(value: f32) -> i32 {
    /// From here on f32 are whole numbers, and their lowest bits count them.
    const WHOLE: f32 = 8_388_608.0;
    let nearest = value + WHOLE;
    let count = nearest.to_bits().wrapping_sub(WHOLE.to_bits()) as i32;
    count.wrapping_sub(i32::from(nearest - WHOLE > value))
}

/// Slope of inverse depth at the middle of three pixels in line, per distance between them. Next to an edge
/// the side with the smaller step is on the same surface. NaN is a pixel without depth; with none on either
/// side the surface is taken to face the camera.
#[inline(always)]
fn slope(before: f32, here: f32, after: f32) -> f32 {
    let (from, to) = (here - before, after - here);
    let smaller = if from.abs() < to.abs() { from } else { to };
    let is_plane = (to - from).abs() <= PLANE_BEND_MAX * here;
    let of_both = if is_plane { (from + to) / 2.0 } else { smaller };
    let without_from = if to.is_nan() { 0.0 } else { to };
    let without_to = if from.is_nan() { without_from } else { from };
    if from.is_nan() | to.is_nan() { without_to } else { of_both }
}
