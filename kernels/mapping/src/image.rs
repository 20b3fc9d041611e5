//! What a camera and the models hand over, checked at the door: depth, masks, and the frame that joins a
//! depth image to where it was taken. All images are row-major, pixel (column, row), first row on top.

use geometry::{CameraIntrinsics, IntrinsicsError, Pose3};

/// Most pixels along one side of an image.
pub const N_PIXELS_SIDE_MAX: u32 = 8192;

/// An image that cannot be, or two that do not belong together.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ImageError {
    /// A side of zero pixels or too many.
    #[error("image of {width}×{height} pixels, each side must be 1 to {N_PIXELS_SIDE_MAX}")]
    Side {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
    },
    /// The number of values is not the number of pixels.
    #[error("{found} values for an image of {wanted} pixels")]
    Length {
        /// Values given.
        found: usize,
        /// Pixels of the image.
        wanted: usize,
    },
    /// Two images that should show the same are of different sizes.
    #[error("{what} is {found_width}×{found_height} pixels, must be {width}×{height}")]
    Size {
        /// Which image is of the wrong size.
        what: &'static str,
        /// Its width.
        found_width: u32,
        /// Its height.
        found_height: u32,
        /// The width it must have.
        width: u32,
        /// The height it must have.
        height: u32,
    },
    /// A heat that is no share.
    #[error("heat {value} at {idx}, must be 0 to 1")]
    Heat {
        /// Position in the values.
        idx: usize,
        /// The value found.
        value: f32,
    },
    /// A label of no segment.
    #[error("segment {label} at pixel {idx}, there are only {n_segments}")]
    Label {
        /// Position in the labels.
        idx: usize,
        /// The label found.
        label: u16,
        /// Number of segments.
        n_segments: u16,
    },
    /// A camera pose that is NaN or infinite.
    #[error("pose of the camera is not finite")]
    Pose,
    /// Intrinsics that cannot be.
    #[error(transparent)]
    Intrinsics(#[from] IntrinsicsError),
}

/// Checks a size against a number of values.
pub(crate) fn check_size(width: u32, height: u32, found: usize) -> Result<(), ImageError> {
    let side = 1..=N_PIXELS_SIDE_MAX;
    if !side.contains(&width) || !side.contains(&height) {
        return Err(ImageError::Side { width, height });
    }
    let wanted = width as usize * height as usize;
    if found != wanted {
        return Err(ImageError::Length { found, wanted });
    }
    Ok(())
}

/// A depth image, borrowed: millimetres along the optical axis, 0 where there is none.
#[derive(Clone, Copy, Debug)]
pub struct DepthImage<'a> {
    width: u32,
    height: u32,
    depth_mm: &'a [u16],
}

impl<'a> DepthImage<'a> {
    /// A depth image from its pixels, row-major, millimetres.
    ///
    /// # Errors
    /// [`ImageError`] when the size is impossible or not that of the pixels.
    pub fn new(width: u32, height: u32, depth_mm: &'a [u16]) -> Result<Self, ImageError> {
        check_size(width, height, depth_mm.len())?;
        Ok(DepthImage { width, height, depth_mm })
    }

    /// Width, pixels.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height, pixels.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The pixels, row-major, millimetres.
    #[must_use]
    pub fn depth_mm(&self) -> &'a [u16] {
        self.depth_mm
    }
}

/// Which pixels belong to something.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    width: u32,
    height: u32,
    bits: Vec<bool>,
    bounds: Option<(std::ops::Range<usize>, std::ops::Range<usize>)>,
}

impl Mask {
    /// A mask from its pixels, row-major.
    ///
    /// # Errors
    /// [`ImageError`] when the size is impossible or not that of the pixels.
    pub fn new(width: u32, height: u32, bits: Vec<bool>) -> Result<Self, ImageError> {
        check_size(width, height, bits.len())?;
        let bounds = bounds_of(&bits, width as usize);
        Ok(Mask { width, height, bits, bounds })
    }

    /// Width, pixels.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height, pixels.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The pixels, row-major.
    #[must_use]
    pub fn bits(&self) -> &[bool] {
        &self.bits
    }

    /// Number of pixels in the mask.
    #[must_use]
    pub fn n_set(&self) -> usize {
        self.bits.iter().filter(|b| **b).count()
    }

    /// The smallest box that holds the mask as (columns, rows), half open; `None` when it is empty.
    #[must_use]
    pub fn bounds(&self) -> Option<(std::ops::Range<usize>, std::ops::Range<usize>)> {
        self.bounds.clone()
    }
}

/// The smallest box of set bits.
fn bounds_of(all: &[bool], width: usize) -> Option<(std::ops::Range<usize>, std::ops::Range<usize>)> {
    let mut bounds: Option<(std::ops::Range<usize>, std::ops::Range<usize>)> = None;
    for (row, bits) in all.chunks_exact(width).enumerate() {
        let Some(first) = bits.iter().position(|b| *b) else { continue };
        let last = bits.iter().rposition(|b| *b).unwrap_or(first);
        bounds = Some(match bounds {
            Some((cols, rows)) => (cols.start.min(first)..cols.end.max(last + 1), rows.start..row + 1),
            None => (first..last + 1, row..row + 1),
        });
    }
    bounds
}

/// A depth image, the camera that took it and where that camera was: sizes agree, the pose is finite.
#[derive(Clone, Copy, Debug)]
pub struct DepthFrame<'a> {
    depth: DepthImage<'a>,
    intrinsics: CameraIntrinsics,
    map_from_camera: Pose3,
}

impl<'a> DepthFrame<'a> {
    /// Joins depth, camera and pose.
    ///
    /// # Errors
    /// [`ImageError`] when the intrinsics are impossible or of another size, or the pose is not finite.
    pub fn new(
        depth: DepthImage<'a>,
        intrinsics: CameraIntrinsics,
        map_from_camera: Pose3,
    ) -> Result<Self, ImageError> {
        let intrinsics = intrinsics.checked()?;
        if (intrinsics.width, intrinsics.height) != (depth.width, depth.height) {
            return Err(ImageError::Size {
                what: "depth image",
                found_width: depth.width,
                found_height: depth.height,
                width: intrinsics.width,
                height: intrinsics.height,
            });
        }
        let translation = map_from_camera.translation.vector.iter();
        if !translation.chain(map_from_camera.rotation.coords.iter()).all(|v| v.is_finite()) {
            return Err(ImageError::Pose);
        }
        Ok(DepthFrame { depth, intrinsics, map_from_camera })
    }

    /// The depth image.
    #[must_use]
    pub fn depth(&self) -> DepthImage<'a> {
        self.depth
    }

    /// The camera.
    #[must_use]
    pub fn intrinsics(&self) -> &CameraIntrinsics {
        &self.intrinsics
    }

    /// Where the camera was.
    #[must_use]
    pub fn map_from_camera(&self) -> &Pose3 {
        &self.map_from_camera
    }

    /// Checks that a mask is of this frame's size.
    ///
    /// # Errors
    /// [`ImageError::Size`] when it is not.
    pub fn check_mask(&self, mask: &Mask) -> Result<(), ImageError> {
        if (mask.width, mask.height) == (self.depth.width, self.depth.height) {
            return Ok(());
        }
        Err(ImageError::Size {
            what: "mask",
            found_width: mask.width,
            found_height: mask.height,
            width: self.depth.width,
            height: self.depth.height,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: CameraIntrinsics =
        CameraIntrinsics { width: 4, height: 3, fx: 4.0, fy: 4.0, cx: 1.5, cy: 1.0 };

    #[test]
    fn images_of_the_wrong_size_are_refused() {
        assert_eq!(
            DepthImage::new(4, 3, &[0; 11]).unwrap_err(),
            ImageError::Length { found: 11, wanted: 12 }
        );
        assert!(matches!(Mask::new(0, 3, vec![]), Err(ImageError::Side { .. })));
        let depth = DepthImage::new(3, 4, &[0; 12]).unwrap();
        let error = DepthFrame::new(depth, CAMERA, Pose3::identity()).unwrap_err();
        assert_eq!(error.to_string(), "depth image is 3×4 pixels, must be 4×3");
    }

    #[test]
    fn a_frame_without_a_finite_pose_or_camera_is_refused() {
        let depth = DepthImage::new(4, 3, &[0; 12]).unwrap();
        let lost = Pose3::translation(0.0, f64::NAN, 0.0);
        assert_eq!(DepthFrame::new(depth, CAMERA, lost).unwrap_err(), ImageError::Pose);
        let blind = CameraIntrinsics { fx: 0.0, ..CAMERA };
        assert!(matches!(DepthFrame::new(depth, blind, Pose3::identity()), Err(ImageError::Intrinsics(_))));
        let frame = DepthFrame::new(depth, CAMERA, Pose3::identity()).unwrap();
        assert!(frame.check_mask(&Mask::new(3, 4, vec![false; 12]).unwrap()).is_err());
        assert!(frame.check_mask(&Mask::new(4, 3, vec![false; 12]).unwrap()).is_ok());
    }

    #[test]
    fn the_bounds_of_a_mask_hold_it() {
        let mut bits = vec![false; 12];
        assert_eq!(Mask::new(4, 3, bits.clone()).unwrap().bounds(), None);
        bits[5] = true;
        bits[11] = true;
        assert_eq!(Mask::new(4, 3, bits).unwrap().bounds(), Some((1..4, 1..3)));
    }
}
