//! Where the robot is, what stands around it, and the regions that rules speak of.

use geometry::{Point2, Pose2};
use serde::{Deserialize, Serialize};

use crate::codec::{Encoding, Invalid, Message, n_values, within};
use crate::header::Header;
use crate::motion::{COORDINATE_M_MAX, check_pose};
use crate::rule_set::Grounding;

/// Most cells along one side of a grid.
pub const N_CELLS_SIDE_MAX: u32 = 8192;

/// How well localisation knows the pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PoseQuality {
    /// Good enough to drive on.
    Good,
    /// In doubt: the pose is the last good one, repeated. Go on by odometry from there, for as long as it is fresh.
    Uncertain,
    /// Lost: do not drive on it.
    Lost,
}

/// Where `odom` lies in `map`. `stamp_ns` and `echo` are those of the scan it was matched from, or could not be.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseEstimate {
    /// Order, stamp, echo.
    pub header: Header,
    /// Counts relocalisations: maps of another epoch do not fit this pose.
    pub map_epoch: u64,
    /// `odom` in `map`; times `odom_from_base` it gives the pose.
    pub map_from_odom: Pose2,
    /// How well it is known.
    pub quality: PoseQuality,
}

impl Message for PoseEstimate {
    const NAME: &'static str = "PoseEstimate";
    const ENCODING: Encoding = Encoding::Binary { kind: 10 };
    const N_BYTES_MAX: usize = 256;

    fn check(&self) -> Result<(), Invalid> {
        check_pose(&self.map_from_odom)
    }

    fn header(&self) -> Option<&Header> {
        Some(&self.header)
    }
}

/// Where a grid lies in `map`: cell (0, 0) touches `origin_map`, x along columns, y along rows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GridLayout {
    /// Lower left corner, metres.
    pub origin_map: Point2,
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// Cells along x.
    pub n_cols: u32,
    /// Cells along y.
    pub n_rows: u32,
}

impl GridLayout {
    /// Number of cells.
    #[must_use]
    pub fn n_cells(&self) -> usize {
        self.n_cols as usize * self.n_rows as usize
    }

    fn check(&self) -> Result<(), Invalid> {
        within("origin_map.x", self.origin_map.x, -COORDINATE_M_MAX, COORDINATE_M_MAX)?;
        within("origin_map.y", self.origin_map.y, -COORDINATE_M_MAX, COORDINATE_M_MAX)?;
        within("resolution_m", self.resolution_m, 0.005, 1.0)?;
        within("n_cols", f64::from(self.n_cols), 1.0, f64::from(N_CELLS_SIDE_MAX))?;
        within("n_rows", f64::from(self.n_rows), 1.0, f64::from(N_CELLS_SIDE_MAX))
    }
}

/// The occupancy grid from the LiDAR: 0 unknown, 1 free, 2 occupied.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BaseMap {
    /// Order, stamp, echo.
    pub header: Header,
    /// Epoch of the map frame.
    pub map_epoch: u64,
    /// Where it lies.
    pub layout: GridLayout,
    /// One byte a cell, row-major.
    #[serde(with = "serde_bytes")]
    pub cells: Vec<u8>,
}

impl Message for BaseMap {
    const NAME: &'static str = "BaseMap";
    const ENCODING: Encoding = Encoding::Binary { kind: 11 };
    const N_BYTES_MAX: usize = 68 * 1024 * 1024;

    fn check(&self) -> Result<(), Invalid> {
        self.layout.check()?;
        n_values("cells", self.cells.len(), self.layout.n_cells())?;
        match self.cells.iter().find(|cell| **cell > 2) {
            None => Ok(()),
            Some(odd) => Err(Invalid::new("cell", odd, "0, 1 or 2")),
        }
    }

    fn header(&self) -> Option<&Header> {
        Some(&self.header)
    }
}

/// A set of cells, one bit each, row-major, least significant bit first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CellSet {
    /// Where the cells lie.
    pub layout: GridLayout,
    /// The bits.
    #[serde(with = "serde_bytes")]
    pub bits: Vec<u8>,
}

impl CellSet {
    /// A set from one boolean a cell, row-major.
    #[must_use]
    pub fn pack(layout: GridLayout, cells: &[bool]) -> Self {
        let byte = |chunk: &[bool]| {
            chunk.iter().enumerate().fold(0_u8, |byte, (bit, on)| byte | (u8::from(*on) << bit))
        };
        CellSet { layout, bits: cells.chunks(8).map(byte).collect() }
    }

    /// One boolean a cell, row-major.
    #[must_use]
    pub fn unpack(&self) -> Vec<bool> {
        let bits = self.bits.iter().flat_map(|byte| (0..8).map(move |bit| byte >> bit & 1 == 1));
        bits.take(self.layout.n_cells()).collect()
    }

    fn check(&self) -> Result<(), Invalid> {
        self.layout.check()?;
        n_values("bits", self.bits.len(), self.layout.n_cells().div_ceil(8))
    }
}

/// Obstacles within the robot's height that the camera saw: a LiDAR does not see table tops.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DepthObstacles {
    /// Order, stamp, echo.
    pub header: Header,
    /// Epoch of the map frame.
    pub map_epoch: u64,
    /// The cells; `None` while there are none.
    pub cells: Option<CellSet>,
}

impl Message for DepthObstacles {
    const NAME: &'static str = "DepthObstacles";
    const ENCODING: Encoding = Encoding::Binary { kind: 12 };
    const N_BYTES_MAX: usize = 10 * 1024 * 1024;

    fn check(&self) -> Result<(), Invalid> {
        self.cells.as_ref().map_or(Ok(()), CellSet::check)
    }

    fn header(&self) -> Option<&Header> {
        Some(&self.header)
    }
}

/// The region of one rule, as far as it was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObjectMap {
    /// Order, stamp (of the newest frame in it), echo.
    pub header: Header,
    /// Epoch of the map frame.
    pub map_epoch: u64,
    /// The rule.
    pub rule_id: String,
    /// How far the search got.
    pub grounding: Grounding,
    /// The cells of the region its relation speaks of, without the buffer; `None` while nothing is found.
    pub region: Option<CellSet>,
    /// What a person should know ("cannot tell red sofas from others: all are covered").
    pub remark: String,
}

impl Message for ObjectMap {
    const NAME: &'static str = "ObjectMap";
    const ENCODING: Encoding = Encoding::Binary { kind: 13 };
    const N_BYTES_MAX: usize = 10 * 1024 * 1024;

    fn check(&self) -> Result<(), Invalid> {
        within("length of rule_id", self.rule_id.len() as f64, 1.0, 64.0)?;
        within("length of remark", self.remark.len() as f64, 0.0, 2000.0)?;
        self.region.as_ref().map_or(Ok(()), CellSet::check)
    }

    fn header(&self) -> Option<&Header> {
        Some(&self.header)
    }
}

/// Proof that semantics still looks. `echo` is the odometry last heard.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SemanticsBeat {
    /// Order, stamp, echo.
    pub header: Header,
    /// Version of the rule set it works on.
    pub rules_version: u64,
    /// Frames looked at since the start.
    pub n_frames: u64,
    /// Frames dropped unseen because a newer one had come.
    pub n_frames_dropped: u64,
    /// Whether it cannot look at all: then this beat proves nothing, and its receivers let it age.
    pub is_blind: bool,
    /// What is wrong ("no answer from models/segments for 2.1 s"); empty when nothing.
    pub trouble: String,
}

impl Message for SemanticsBeat {
    const NAME: &'static str = "SemanticsBeat";
    const ENCODING: Encoding = Encoding::Binary { kind: 14 };
    const N_BYTES_MAX: usize = 4096;

    fn check(&self) -> Result<(), Invalid> {
        within("length of trouble", self.trouble.len() as f64, 0.0, 2000.0)
    }

    fn header(&self) -> Option<&Header> {
        Some(&self.header)
    }
}
