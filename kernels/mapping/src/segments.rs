//! What the two models say of one image: where a phrase is, coarsely, and what belongs together, exactly.
//!
//! An open-vocabulary model says *roughly where* the phrase is (a heat map of few, blurred cells), a panoptic
//! model says *exactly what belongs together* (segments without names). [`fuse`] makes one mask of both.

mod fusion;
mod see_through;

pub use fusion::{FusedMask, Fusion, fuse};

use crate::image::{ImageError, check_size};

/// Where a phrase is, coarsely: values 0 to 1, row-major, over the same view as the image.
#[derive(Clone, Debug, PartialEq)]
pub struct HeatMap {
    width: u32,
    height: u32,
    values: Vec<f32>,
}

impl HeatMap {
    /// A heat map from its values, row-major; any size, it covers the same view as the image.
    ///
    /// # Errors
    /// [`ImageError`] when the length is wrong or a value is NaN or outside 0 to 1.
    pub fn new(width: u32, height: u32, values: Vec<f32>) -> Result<Self, ImageError> {
        check_size(width, height, values.len())?;
        if let Some(idx) = values.iter().position(|v| !(0.0..=1.0).contains(v)) {
            return Err(ImageError::Heat { idx, value: values[idx] });
        }
        Ok(HeatMap { width, height, values })
    }

    /// Width, coarse cells.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height, coarse cells.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The values, row-major.
    #[must_use]
    pub fn values(&self) -> &[f32] {
        &self.values
    }
}

/// Which segment each pixel belongs to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Segments {
    width: u32,
    height: u32,
    labels: Vec<u16>,
    n_segments: u16,
}

impl Segments {
    /// Segments from each pixel's label, row-major: 1 to `n_segments`, 0 for none.
    ///
    /// # Errors
    /// [`ImageError`] when the length is wrong or a label is above `n_segments`.
    pub fn new(width: u32, height: u32, labels: Vec<u16>, n_segments: u16) -> Result<Self, ImageError> {
        check_size(width, height, labels.len())?;
        if let Some(idx) = labels.iter().position(|l| *l > n_segments) {
            return Err(ImageError::Label { idx, label: labels[idx], n_segments });
        }
        Ok(Segments { width, height, labels, n_segments })
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

    /// The segment of each pixel, row-major, 0 for none.
    #[must_use]
    pub fn labels(&self) -> &[u16] {
        &self.labels
    }

    /// Number of segments.
    #[must_use]
    pub fn n_segments(&self) -> u16 {
        self.n_segments
    }
}

#[cfg(test)]
mod tests;
