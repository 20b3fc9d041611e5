//! What the robot sees: LiDAR turns, colour with depth, and answers of the two model roles.

use geometry::CameraIntrinsics;
use serde::{Deserialize, Serialize};

use crate::codec::{Encoding, Invalid, Message, n_values, within};
use crate::header::Header;

/// Most beams in one turn.
pub const N_BEAMS_MAX: usize = 8192;

/// One turn of a 2D LiDAR. Beam `i` points at `angle_min_rad + i · angle_step_rad` in the LiDAR's frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scan {
    /// Order, stamp (of the first beam), echo.
    pub header: Header,
    /// Direction of the first beam, radians.
    pub angle_min_rad: f64,
    /// From beam to beam, radians; positive is counter-clockwise.
    pub angle_step_rad: f64,
    /// From the first beam to the last, seconds; 0 when all are at once.
    pub duration_s: f64,
    /// Nearest range that is measured, metres.
    pub range_m_min: f64,
    /// Farthest range that is measured, metres.
    pub range_m_max: f64,
    /// Ranges, metres; `+∞`: nothing within reach; NaN: no measurement.
    pub ranges_m: Vec<f32>,
}

impl Message for Scan {
    const NAME: &'static str = "Scan";
    const ENCODING: Encoding = Encoding::Binary { kind: 4 };
    const N_BYTES_MAX: usize = 64 * 1024;

    fn check(&self) -> Result<(), Invalid> {
        within("angle_min_rad", self.angle_min_rad, -7.0, 7.0)?;
        within("angle_step_rad", self.angle_step_rad.abs(), 1e-5, 1.0)?;
        within("duration_s", self.duration_s, 0.0, 1.0)?;
        within("range_m_min", self.range_m_min, 0.0, 10.0)?;
        within("range_m_max", self.range_m_max, self.range_m_min, 1000.0)?;
        within("number of ranges", self.ranges_m.len() as f64, 1.0, N_BEAMS_MAX as f64)?;
        if let Some(negative) = self.ranges_m.iter().find(|r| **r < 0.0) {
            return Err(Invalid::new("ranges_m", negative, "0 or more, +inf or NaN"));
        }
        Ok(())
    }

    fn header(&self) -> Option<&Header> {
        Some(&self.header)
    }
}

/// A colour image and its registered depth, row-major, of one moment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RgbdFrame {
    /// Order, stamp, echo.
    pub header: Header,
    /// The pinhole of both images.
    pub intrinsics: CameraIntrinsics,
    /// Red, green, blue; `height × width × 3` bytes.
    #[serde(with = "serde_bytes")]
    pub rgb: Vec<u8>,
    /// Depth along the optical axis, millimetres, 0 for none; `height × width` little-endian u16.
    #[serde(with = "serde_bytes")]
    pub depth_mm_le: Vec<u8>,
}

impl RgbdFrame {
    /// The depth image, millimetres, row-major; 0 for none.
    #[must_use]
    pub fn depth_mm(&self) -> Vec<u16> {
        self.depth_mm_le.as_chunks::<2>().0.iter().map(|pair| u16::from_le_bytes(*pair)).collect()
    }

    /// The bytes of a depth image.
    #[must_use]
    pub fn depth_bytes(depth_mm: &[u16]) -> Vec<u8> {
        depth_mm.iter().flat_map(|mm| mm.to_le_bytes()).collect()
    }
}

impl Message for RgbdFrame {
    const NAME: &'static str = "RgbdFrame";
    const ENCODING: Encoding = Encoding::Binary { kind: 5 };
    const N_BYTES_MAX: usize = 48 * 1024 * 1024;

    fn check(&self) -> Result<(), Invalid> {
        let intrinsics =
            self.intrinsics.checked().map_err(|e| Invalid::new("intrinsics", e, "those of a camera"))?;
        n_values("rgb", self.rgb.len(), 3 * intrinsics.n_pixels())?;
        n_values("depth_mm_le", self.depth_mm_le.len(), 2 * intrinsics.n_pixels())
    }

    fn header(&self) -> Option<&Header> {
        Some(&self.header)
    }
}

/// An image for a model host. `seq` and `stamp_ns` are those of the frame it was taken from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelImage {
    /// The frame's sequence number.
    pub seq: u64,
    /// The frame's stamp.
    pub stamp_ns: u64,
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Red, green, blue; `height × width × 3` bytes.
    #[serde(with = "serde_bytes")]
    pub rgb: Vec<u8>,
}

impl ModelImage {
    fn check(&self) -> Result<(), Invalid> {
        within("width", f64::from(self.width), 1.0, 8192.0)?;
        within("height", f64::from(self.height), 1.0, 8192.0)?;
        n_values("rgb", self.rgb.len(), 3 * self.width as usize * self.height as usize)
    }
}

/// Where in this image might these things be?
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeatMapsRequest {
    /// The image.
    pub image: ModelImage,
    /// What is looked for, as spoken.
    pub phrases: Vec<String>,
}

impl Message for HeatMapsRequest {
    const NAME: &'static str = "HeatMapsRequest";
    const ENCODING: Encoding = Encoding::Binary { kind: 6 };
    const N_BYTES_MAX: usize = 32 * 1024 * 1024;

    fn check(&self) -> Result<(), Invalid> {
        self.image.check()?;
        within("number of phrases", self.phrases.len() as f64, 1.0, 256.0)?;
        match self.phrases.iter().find(|p| p.trim().is_empty() || p.chars().count() > 240) {
            None => Ok(()),
            Some(odd) => Err(Invalid::new("phrase", format_args!("{odd:?}"), "1 to 240 characters")),
        }
    }
}

/// One coarse heat map a phrase, in the order asked: each covers the whole image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeatMaps {
    /// The frame's sequence number.
    pub seq: u64,
    /// Who answered, for the logs.
    pub model: String,
    /// Columns of each map.
    pub width: u32,
    /// Rows of each map.
    pub height: u32,
    /// Probability that the phrase is seen, 0 to 255; `phrases × height × width`, row-major.
    #[serde(with = "serde_bytes")]
    pub values: Vec<u8>,
    /// Number of maps.
    pub n_phrases: u32,
}

impl Message for HeatMaps {
    const NAME: &'static str = "HeatMaps";
    const ENCODING: Encoding = Encoding::Binary { kind: 7 };
    const N_BYTES_MAX: usize = 32 * 1024 * 1024;

    fn check(&self) -> Result<(), Invalid> {
        within("width", f64::from(self.width), 1.0, 1024.0)?;
        within("height", f64::from(self.height), 1.0, 1024.0)?;
        within("number of phrases", f64::from(self.n_phrases), 1.0, 256.0)?;
        let wanted = self.width as usize * self.height as usize * self.n_phrases as usize;
        n_values("values", self.values.len(), wanted)
    }
}

/// Which segments make up this image?
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SegmentsRequest {
    /// The image.
    pub image: ModelImage,
}

impl Message for SegmentsRequest {
    const NAME: &'static str = "SegmentsRequest";
    const ENCODING: Encoding = Encoding::Binary { kind: 8 };
    const N_BYTES_MAX: usize = 32 * 1024 * 1024;

    fn check(&self) -> Result<(), Invalid> {
        self.image.check()
    }
}

/// A panoptic segmentation: one label a pixel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Segments {
    /// The frame's sequence number.
    pub seq: u64,
    /// Who answered, for the logs.
    pub model: String,
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Number of segments; labels run from 1, 0 is none.
    pub n_segments: u16,
    /// Label of each pixel, row-major, as little-endian u16.
    #[serde(with = "serde_bytes")]
    pub labels_le: Vec<u8>,
}

impl Segments {
    /// The label of each pixel, row-major.
    #[must_use]
    pub fn labels(&self) -> Vec<u16> {
        self.labels_le.as_chunks::<2>().0.iter().map(|pair| u16::from_le_bytes(*pair)).collect()
    }

    /// The bytes of a label image.
    #[must_use]
    pub fn label_bytes(labels: &[u16]) -> Vec<u8> {
        labels.iter().flat_map(|label| label.to_le_bytes()).collect()
    }
}

impl Message for Segments {
    const NAME: &'static str = "Segments";
    const ENCODING: Encoding = Encoding::Binary { kind: 9 };
    const N_BYTES_MAX: usize = 32 * 1024 * 1024;

    fn check(&self) -> Result<(), Invalid> {
        within("width", f64::from(self.width), 1.0, 8192.0)?;
        within("height", f64::from(self.height), 1.0, 8192.0)?;
        n_values("labels_le", self.labels_le.len(), 2 * self.width as usize * self.height as usize)
    }
}
