//! The pinhole camera.

use crate::Point3;

/// A pinhole camera without distortion: pixel (u, v) is (column, row), its centre at whole numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct CameraIntrinsics {
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Focal length along columns, pixels.
    pub fx: f64,
    /// Focal length along rows, pixels.
    pub fy: f64,
    /// Principal point, column.
    pub cx: f64,
    /// Principal point, row.
    pub cy: f64,
}

/// Intrinsics that cannot be of a camera.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum IntrinsicsError {
    /// A size outside 1 to 8192 pixels.
    #[error("image is {width}×{height} pixels, each side must be 1 to 8192")]
    Size {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
    },
    /// A focal length that is not positive and finite.
    #[error("focal length ({fx}, {fy}) px must be finite and above 0")]
    Focal {
        /// Along columns, pixels.
        fx: f64,
        /// Along rows, pixels.
        fy: f64,
    },
    /// A principal point outside the image.
    #[error("principal point ({cx}, {cy}) px lies outside the {width}×{height} image")]
    Principal {
        /// Column.
        cx: f64,
        /// Row.
        cy: f64,
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
    },
}

impl CameraIntrinsics {
    /// Checked intrinsics.
    ///
    /// # Errors
    /// [`IntrinsicsError`] names the value and its limit.
    pub fn checked(self) -> Result<Self, IntrinsicsError> {
        let CameraIntrinsics { width, height, fx, fy, cx, cy } = self;
        if !(1..=8192).contains(&width) || !(1..=8192).contains(&height) {
            return Err(IntrinsicsError::Size { width, height });
        }
        if !(fx.is_finite() && fy.is_finite() && fx > 0.0 && fy > 0.0) {
            return Err(IntrinsicsError::Focal { fx, fy });
        }
        if !((0.0..f64::from(width)).contains(&cx) && (0.0..f64::from(height)).contains(&cy)) {
            return Err(IntrinsicsError::Principal { cx, cy, width, height });
        }
        Ok(self)
    }

    /// Number of pixels.
    #[must_use]
    pub fn n_pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// The point seen at pixel (u, v) with depth `depth_m` along the optical axis, in `camera`.
    #[must_use]
    pub fn unproject(&self, u: f64, v: f64, depth_m: f64) -> Point3 {
        Point3::new((u - self.cx) / self.fx * depth_m, (v - self.cy) / self.fy * depth_m, depth_m)
    }

    /// The pixel (u, v) where a point in `camera` is seen; `None` at or behind the image plane.
    #[must_use]
    pub fn project(&self, point_camera: Point3) -> Option<(f64, f64)> {
        (point_camera.z > 1e-6).then(|| {
            (
                self.fx * point_camera.x / point_camera.z + self.cx,
                self.fy * point_camera.y / point_camera.z + self.cy,
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const VGA: CameraIntrinsics =
        CameraIntrinsics { width: 640, height: 480, fx: 600.0, fy: 600.0, cx: 319.5, cy: 239.5 };

    proptest! {
        #[test]
        fn projecting_what_was_unprojected_is_the_same_pixel(u in 0.0..640.0, v in 0.0..480.0, z in 0.1..9.0) {
            let (u2, v2) = VGA.project(VGA.unproject(u, v, z)).unwrap();
            prop_assert!((u - u2).abs() < 1e-9 && (v - v2).abs() < 1e-9);
        }
    }

    #[test]
    fn what_is_behind_the_camera_has_no_pixel() {
        assert_eq!(VGA.project(Point3::new(0.0, 0.0, -1.0)), None);
        assert_eq!(VGA.project(Point3::new(0.0, 0.0, 0.0)), None);
    }

    #[test]
    fn impossible_intrinsics_are_named() {
        assert!(VGA.checked().is_ok());
        assert!(matches!(CameraIntrinsics { width: 0, ..VGA }.checked(), Err(IntrinsicsError::Size { .. })));
        assert!(matches!(
            CameraIntrinsics { fx: f64::NAN, ..VGA }.checked(),
            Err(IntrinsicsError::Focal { .. })
        ));
        assert!(matches!(
            CameraIntrinsics { cx: 640.0, ..VGA }.checked(),
            Err(IntrinsicsError::Principal { .. })
        ));
    }
}
