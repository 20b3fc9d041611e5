//! Which depth pixels can be trusted, and the points they stand for.
//!
//! Left out are pixels without depth, out of range, on a depth edge (*flying pixels*: a sensor averages over
//! the edge and reports points in mid-air), and the far side of an edge along a mask's border, where a mask
//! a pixel too large has caught the background.

use geometry::Point3;

use crate::image::{DepthFrame, ImageError, Mask};

/// A jump this large, relative to depth, is an edge whatever else the neighbourhood looks like.
const EDGE_ALWAYS: f32 = 0.15;
/// A smaller jump is no edge if inverse depth, which is linear on a plane, bends by less than this share of
/// the step: a floor or table top seen at a grazing angle.
const BEND_MAX: f32 = 0.3;
/// A pixel at the mask's border is background when something this much closer, relative to depth, is by.
pub(crate) const LEAK: f32 = 0.1;

/// Which depth pixels are used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthLimits {
    /// Nearest depth that is used, metres.
    pub min_m: f64,
    /// Farthest depth that is used, metres.
    pub max_m: f64,
    /// Jump to a 4-neighbour, relative to depth, above which a pixel lies on an edge; ∞ keeps all.
    pub edge_relative: f64,
    /// How far the far side of an edge is left out along the mask's border, pixels.
    pub erode_px: usize,
    /// Every how many-th pixel of each row and column becomes a point; 0 is taken as 1.
    pub stride_px: usize,
}

impl Default for DepthLimits {
    /// For a structured-light or time-of-flight camera indoors: 0.3 to 6 m, edges from 4 %, two pixels of
    /// border, every second pixel.
    fn default() -> Self {
        DepthLimits { min_m: 0.3, max_m: 6.0, edge_relative: 0.04, erode_px: 2, stride_px: 2 }
    }
}

/// The points of the trusted pixels in the mask (all pixels when there is none), in `map`, row by row.
///
/// # Errors
/// [`ImageError::Size`] when the mask is not of the frame's size.
pub fn project(
    frame: &DepthFrame<'_>,
    mask: Option<&Mask>,
    limits: &DepthLimits,
) -> Result<Vec<Point3>, ImageError> {
    if let Some(mask) = mask {
        frame.check_mask(mask)?;
    }
    let trusted = TrustedDepth::new(frame, mask, limits);
    let mut points_map = Vec::new();
    for (col, row) in trusted.pixels(limits.stride_px) {
        if let Some(depth_m) = trusted.at(col, row) {
            let seen_camera = frame.intrinsics().unproject(col as f64, row as f64, f64::from(depth_m));
            points_map.push(frame.map_from_camera() * seen_camera);
        }
    }
    Ok(points_map)
}

/// Judges pixels of one masked frame, each when asked.
pub(crate) struct TrustedDepth<'a> {
    depth_mm: &'a [u16],
    width: usize,
    height: usize,
    mask: Option<&'a Mask>,
    min_m: f32,
    max_m: f32,
    edge_relative: f32,
    erode_px: usize,
}

impl<'a> TrustedDepth<'a> {
    /// The mask must be of the frame's size.
    pub(crate) fn new(frame: &DepthFrame<'a>, mask: Option<&'a Mask>, limits: &DepthLimits) -> Self {
        debug_assert!(mask.is_none_or(|m| frame.check_mask(m).is_ok()));
        TrustedDepth {
            depth_mm: frame.depth().depth_mm(),
            width: frame.depth().width() as usize,
            height: frame.depth().height() as usize,
            mask,
            min_m: limits.min_m as f32,
            max_m: limits.max_m as f32,
            edge_relative: limits.edge_relative as f32,
            erode_px: limits.erode_px,
        }
    }

    /// Columns and rows that may hold masked pixels.
    pub(crate) fn bounds(&self) -> (std::ops::Range<usize>, std::ops::Range<usize>) {
        match self.mask {
            Some(mask) => mask.bounds().unwrap_or((0..0, 0..0)),
            None => (0..self.width, 0..self.height),
        }
    }

    /// Every `stride`-th (column, row) in the mask, trusted or not.
    pub(crate) fn pixels(&self, stride: usize) -> impl Iterator<Item = (usize, usize)> + use<'_> {
        let stride = stride.max(1);
        let (cols, rows) = self.bounds();
        rows.step_by(stride)
            .flat_map(move |row| cols.clone().step_by(stride).map(move |col| (col, row)))
            .filter(|&(col, row)| self.in_mask(row * self.width + col))
    }

    /// Whether a pixel is in the mask.
    #[inline(always)]
    pub(crate) fn in_mask(&self, idx: usize) -> bool {
        self.mask.is_none_or(|mask| mask.bits()[idx])
    }

    /// Depth at a pixel, metres; `None` when it is not in the mask or not to be trusted.
    pub(crate) fn at_in_mask(&self, col: usize, row: usize) -> Option<f32> {
        if self.in_mask(row * self.width + col) { self.at(col, row) } else { None }
    }

    /// Width of the image, pixels.
    #[inline(always)]
    pub(crate) fn width(&self) -> usize {
        self.width
    }

    /// Depth at a pixel of the mask, metres; `None` when it is not to be trusted.
    #[inline(always)]
    pub(crate) fn at(&self, col: usize, row: usize) -> Option<f32> {
        let depth_m = self.raw_m(row * self.width + col);
        // Zero, which is no depth, is below any range.
        if depth_m <= 0.0 || depth_m < self.min_m || depth_m > self.max_m {
            return None;
        }
        if self.edge_relative.is_finite()
            && (self.is_edge(col, row, depth_m) || self.is_leak(col, row, depth_m))
        {
            return None;
        }
        Some(depth_m)
    }

    #[inline(always)]
    fn raw_m(&self, idx: usize) -> f32 {
        f32::from(self.depth_mm[idx]) * 0.001
    }

    #[inline(always)]
    fn is_edge(&self, col: usize, row: usize, depth_m: f32) -> bool {
        let idx = row * self.width + col;
        let across = (
            if col > 0 { self.raw_m(idx - 1) } else { 0.0 },
            if col + 1 < self.width { self.raw_m(idx + 1) } else { 0.0 },
        );
        let down = (
            if row > 0 { self.raw_m(idx - self.width) } else { 0.0 },
            if row + 1 < self.height { self.raw_m(idx + self.width) } else { 0.0 },
        );
        [across, down].into_iter().any(|(before, after)| self.breaks(before, depth_m, after))
    }

    /// Whether three depths in line break at the middle one; 0 is a depth that is not known.
    #[inline(always)]
    fn breaks(&self, before: f32, here: f32, after: f32) -> bool {
        // Nearly all are no edge by far: told without a division.
        let off_m = |other: f32| if other > 0.0 { (other - here).abs() } else { 0.0 };
        if off_m(before).max(off_m(after)) < 0.999 * self.edge_relative * here {
            return false;
        }
        let jump = |other: f32| if other > 0.0 { (other - here).abs() / here } else { 0.0 };
        let largest = jump(before).max(jump(after));
        if largest <= self.edge_relative {
            return false;
        }
        largest > EDGE_ALWAYS || !is_straight(before, here, after)
    }

    /// Whether a pixel within `erode_px` of the mask's border lies behind something as close by.
    #[inline(always)]
    fn is_leak(&self, col: usize, row: usize, depth_m: f32) -> bool {
        let Some(bits) = self.mask.map(Mask::bits) else { return false };
        let (idx, reach) = (row * self.width + col, self.erode_px);
        let is_within = col >= reach && row >= reach && col + reach < self.width && row + reach < self.height;
        let is_inside = |off: usize| {
            bits[idx - off] & bits[idx + off] & bits[idx - off * self.width] & bits[idx + off * self.width]
        };
        // Most pixels are well inside.
        let is_at_border = if is_within {
            !(1..=reach).all(is_inside)
        } else {
            self.beside(col, row).any(|(step, room)| {
                (1..=reach.min(room)).any(|off| !bits[idx.wrapping_add_signed(step * off as isize)])
            })
        };
        is_at_border && self.is_behind(col, row, depth_m)
    }

    /// Steps from a pixel to each side, and how many there are to the image's border.
    #[inline(always)]
    fn beside(&self, col: usize, row: usize) -> impl Iterator<Item = (isize, usize)> + use<> {
        let (stride, to_right, to_low) = (self.width as isize, self.width - 1 - col, self.height - 1 - row);
        [(-1, col), (1, to_right), (-stride, row), (stride, to_low)].into_iter()
    }

    /// Whether a pixel lies behind something within `erode_px` that is not the same surface.
    fn is_behind(&self, col: usize, row: usize, depth_m: f32) -> bool {
        let (idx, closer_m) = (row * self.width + col, depth_m * (1.0 - LEAK));
        self.beside(col, row).any(|(step, room)| {
            let there_m = |off: usize| self.raw_m(idx.wrapping_add_signed(step * off as isize));
            let is_nearer = |there_m: f32| there_m > 0.0 && there_m < closer_m;
            // What comes nearer evenly is the same surface, seen at an angle.
            (1..=self.erode_px.min(room)).any(|off| is_nearer(there_m(off)))
                && !(room >= 2 && is_straight(depth_m, there_m(1), there_m(2)))
        })
    }
}

/// Whether three depths in line, metres, 0 where there is none, are those of a plane: inverse depth is linear on it.
#[inline(always)]
fn is_straight(first_m: f32, second_m: f32, third_m: f32) -> bool {
    let (step, next_step) = (1.0 / second_m - 1.0 / first_m, 1.0 / third_m - 1.0 / second_m);
    let bend = (next_step - step).abs() / step.abs().max(next_step.abs());
    first_m > 0.0 && second_m > 0.0 && third_m > 0.0 && bend <= BEND_MAX
}

#[cfg(test)]
mod tests {
    use geometry::{CameraIntrinsics, Pose3};
    use proptest::prelude::*;

    use super::*;
    use crate::image::DepthImage;

    const WIDTH: usize = 32;
    const HEIGHT: usize = 24;
    const CAMERA: CameraIntrinsics = CameraIntrinsics {
        width: WIDTH as u32,
        height: HEIGHT as u32,
        fx: 30.0,
        fy: 30.0,
        cx: 15.5,
        cy: 11.5,
    };
    const ALL: DepthLimits =
        DepthLimits { min_m: 0.3, max_m: 6.0, edge_relative: 0.04, erode_px: 2, stride_px: 1 };

    fn image(depth_m: impl Fn(usize, usize) -> f64) -> Vec<u16> {
        let pixels = (0..WIDTH * HEIGHT).map(|idx| depth_m(idx % WIDTH, idx / WIDTH));
        pixels.map(|z| (z * 1000.0).round() as u16).collect()
    }

    fn points(depth_mm: &[u16], mask: Option<&Mask>, limits: &DepthLimits) -> Vec<Point3> {
        let depth = DepthImage::new(CAMERA.width, CAMERA.height, depth_mm).unwrap();
        project(&DepthFrame::new(depth, CAMERA, Pose3::identity()).unwrap(), mask, limits).unwrap()
    }

    proptest! {
        #[test]
        fn a_plane_seen_at_any_angle_is_kept(slope_x in -0.6..0.6, slope_y in -0.6..0.6) {
            // n·P = 1 with P = ray·z.
            let depth = image(|u, v| {
                let ray = CAMERA.unproject(u as f64, v as f64, 1.0);
                2.0 / (1.0 + slope_x * ray.x + slope_y * ray.y)
            });
            // All but the image's border, where the other neighbour that tells a plane is missing.
            prop_assert!(points(&depth, None, &ALL).len() >= (WIDTH - 2) * (HEIGHT - 2));
        }

        #[test]
        fn projecting_back_finds_the_pixel_and_its_depth(z_mm in 400..5900_u16, u in 0..WIDTH, v in 0..HEIGHT) {
            let mut depth = vec![0; WIDTH * HEIGHT];
            depth[v * WIDTH + u] = z_mm;
            let found = points(&depth, None, &ALL);
            prop_assert_eq!(found.len(), 1);
            let (u2, v2) = CAMERA.project(found[0]).unwrap();
            prop_assert!((u2 - u as f64).abs() < 1e-4 && (v2 - v as f64).abs() < 1e-4);
            prop_assert!((found[0].z - f64::from(z_mm) / 1000.0).abs() < 1e-6);
        }
    }

    #[test]
    fn no_point_hangs_between_an_object_and_the_wall_behind_it() {
        // One column of flying pixels on the way from 1 m to 2 m.
        let depth = image(|u, _| match u.cmp(&16) {
            std::cmp::Ordering::Less => 1.0,
            std::cmp::Ordering::Equal => 1.5,
            std::cmp::Ordering::Greater => 2.0,
        });
        let found = points(&depth, None, &ALL);
        assert!(found.iter().all(|p| (p.z - 1.0).abs() < 1e-6 || (p.z - 2.0).abs() < 1e-6));
        assert_eq!(found.len(), (WIDTH - 3) * HEIGHT);
    }

    #[test]
    fn a_mask_two_pixels_too_large_catches_no_background() {
        let depth = image(|u, _| if u < 16 { 1.0 } else { 3.0 });
        let mask = Mask::new(
            CAMERA.width,
            CAMERA.height,
            image(|u, _| f64::from(u8::from(u < 18))).iter().map(|b| *b > 0).collect(),
        )
        .unwrap();
        let found = points(&depth, Some(&mask), &ALL);
        assert!(!found.is_empty() && found.iter().all(|p| p.z < 1.5));
    }

    #[test]
    fn missing_near_and_far_depth_is_left_out_and_the_stride_thins() {
        assert!(points(&image(|_, _| 0.0), None, &ALL).is_empty());
        assert!(points(&image(|_, _| 0.2), None, &ALL).is_empty());
        assert!(points(&image(|_, _| 7.0), None, &ALL).is_empty());
        assert!(points(&vec![u16::MAX; WIDTH * HEIGHT], None, &ALL).is_empty());
        let thin = DepthLimits { stride_px: 2, ..ALL };
        assert_eq!(points(&image(|_, _| 1.0), None, &thin).len(), WIDTH * HEIGHT / 4);
        let none = Mask::new(CAMERA.width, CAMERA.height, vec![false; WIDTH * HEIGHT]).unwrap();
        assert!(points(&image(|_, _| 1.0), Some(&none), &ALL).is_empty());
    }
}
