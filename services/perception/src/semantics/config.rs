//! What semantics can be told.

use std::path::PathBuf;
use std::time::Duration;

use geometry::Profile;
use mapping::Fusion;
use mapping::floor_area::FloorConfig;
use mapping::obstacle_layer::ObstacleConfig;
use mapping::occupancy::Closing;
use mapping::projection::DepthLimits;
use mapping::tsdf::TsdfConfig;
use proto::{Invalid, codec::within};
use serde::{Deserialize, Serialize};

use super::frame_door::DoorLimits;
use super::keyframes::KeyframeLimits;
use super::models::configured::{ClipSegSettings, YoloSettings};
use super::models::runtime::RuntimeSettings;
use super::object_maps::MapConfig;

/// Who plays the model roles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ModelSource {
    /// Whoever answers on the bus.
    #[default]
    Remote,
    /// A YOLO segmentation in this process, for robots without a GPU.
    Yolo,
    /// CLIPSeg and Mask2Former in this process.
    Clipseg,
}

/// How heat maps choose segments.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FusionRule {
    /// By the share of each segment that is hot.
    #[default]
    Coverage,
    /// The paper's, by intersection over union.
    PaperIou,
}

/// Section `[semantics]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Who plays the model roles.
    pub models: ModelSource,
    /// A file of named places; relative to the folder of the configuration. None is needed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub places: Option<PathBuf>,
    /// A model is given this long for an answer, milliseconds.
    pub model_patience_ms: u64,
    /// In so many frames an object must have been seen where it is, before it counts.
    pub n_masks_agreeing: u32,
    /// Most phrases that are searched for at once; rules beyond are reported as not grounded.
    pub n_phrases_max: usize,
    /// How heat maps choose segments.
    pub fusion: FusionRule,
    /// A heat map that is nowhere this hot has not found its phrase, 0 to 1.
    pub heat_min: f64,
    /// Intersection over union from which the paper's rule takes a segment.
    pub paper_iou_min: f64,
    /// Side of a cell of all 2D maps, metres.
    pub resolution_m: f64,
    /// Side of a voxel of the object maps, metres.
    pub voxel_m: f64,
    /// Most blocks of 8³ voxels in one object map, 4 kB each.
    pub n_blocks_max: usize,
    /// Depth is used up to here, metres.
    pub depth_m_max: f64,
    /// Every how many-th pixel is looked at for obstacles.
    pub obstacle_stride_px: usize,
    /// Obstacles are published within this far around the robot, metres.
    pub obstacle_reach_m: f64,
    /// How far a region without an end of its own reaches (`beyond`), metres.
    pub region_reach_m: f64,
    /// Most keyframes kept.
    pub n_keyframes_max: usize,
    /// Most memory for keyframes, megabytes.
    pub keyframes_mb_max: u64,
    /// Keyframes are at least this far apart, metres, …
    pub keyframe_distance_m: f64,
    /// … or turned by this, radians.
    pub keyframe_angle_rad: f64,
    /// Odometry is interpolated over at most this, milliseconds.
    pub odometry_gap_ms: u64,
    /// A robot at rest looks this often, milliseconds.
    pub idle_period_ms: u64,
    /// The library that runs models in this process.
    pub onnx: RuntimeSettings,
    /// The models of `yolo`.
    pub yolo: YoloSettings,
    /// The models of `clipseg`.
    pub clipseg: ClipSegSettings,
}

impl Default for Settings {
    /// For a camera of 640 × 480 at 5 Hz on a small indoor robot.
    fn default() -> Self {
        Settings {
            models: ModelSource::Remote,
            places: None,
            model_patience_ms: 2000,
            n_masks_agreeing: 2,
            n_phrases_max: 32,
            fusion: FusionRule::Coverage,
            heat_min: 0.3,
            paper_iou_min: 0.5,
            resolution_m: 0.05,
            voxel_m: 0.04,
            n_blocks_max: 4000,
            depth_m_max: 6.0,
            obstacle_stride_px: 4,
            obstacle_reach_m: 10.0,
            region_reach_m: 12.0,
            n_keyframes_max: 40,
            keyframes_mb_max: 80,
            keyframe_distance_m: 0.3,
            keyframe_angle_rad: 0.35,
            odometry_gap_ms: 100,
            idle_period_ms: 500,
            onnx: RuntimeSettings::default(),
            yolo: YoloSettings::default(),
            clipseg: ClipSegSettings::default(),
        }
    }
}

impl Settings {
    /// A model is given this long for an answer.
    #[must_use]
    pub fn model_patience(&self) -> Duration {
        Duration::from_millis(self.model_patience_ms)
    }

    /// A robot at rest looks this often.
    #[must_use]
    pub fn idle_period(&self) -> Duration {
        Duration::from_millis(self.idle_period_ms)
    }

    /// How long frames wait, and what places them.
    #[must_use]
    pub fn door(&self) -> DoorLimits {
        DoorLimits {
            odometry_gap: Duration::from_millis(self.odometry_gap_ms),
            frame_wait: Duration::from_millis(250),
            // As long as the filter itself would drive on it, and a little for the way here.
            pose_age: Duration::from_millis(1200),
            silence: Duration::from_secs(1),
        }
    }

    /// Which frames are kept.
    #[must_use]
    pub fn keyframes(&self) -> KeyframeLimits {
        KeyframeLimits {
            distance_m: self.keyframe_distance_m,
            angle_rad: self.keyframe_angle_rad,
            period: Duration::from_secs(2),
            n_max: self.n_keyframes_max,
            n_bytes_max: usize::try_from(self.keyframes_mb_max * 1_000_000).unwrap_or(usize::MAX),
        }
    }

    /// How frames become maps.
    #[must_use]
    pub fn maps(&self, profile: &Profile) -> MapConfig {
        let limits = DepthLimits { max_m: self.depth_m_max, ..DepthLimits::default() };
        let obstacles = ObstacleConfig::for_height(profile.height_m);
        let coverage = Fusion::default();
        let heat_min = self.heat_min as f32;
        MapConfig {
            fusion: match (self.fusion, coverage) {
                (
                    FusionRule::Coverage,
                    Fusion::Coverage { share_of_peak, coverage_min, coverage_weak, explained_min, .. },
                ) => Fusion::Coverage {
                    peak_min: heat_min,
                    share_of_peak,
                    coverage_min,
                    coverage_weak,
                    explained_min,
                },
                _ => Fusion::PaperIou { threshold: self.paper_iou_min as f32 },
            },
            tsdf: TsdfConfig {
                voxel_m: self.voxel_m,
                truncation_m: 3.0 * self.voxel_m,
                n_blocks_max: self.n_blocks_max,
                // Between two whole numbers of masks, so that rounding decides nothing.
                weight_min: self.n_masks_agreeing as f32 - 0.5,
                limits,
                ..TsdfConfig::default()
            },
            floor: FloorConfig {
                resolution_m: self.resolution_m,
                evidence_min: self.n_masks_agreeing as f32 - 0.5,
                ..FloorConfig::default()
            },
            obstacles: ObstacleConfig {
                resolution_m: self.resolution_m,
                // As many points as make a hit at the kernel's own stride of two, thinned alike.
                n_points_min: if self.obstacle_stride_px > 2 { 2 } else { obstacles.n_points_min },
                limits: DepthLimits { stride_px: self.obstacle_stride_px, ..obstacles.limits },
                ..obstacles
            },
            closing: Closing { resolution_m: self.resolution_m, ..Closing::default() },
            obstacle_reach_m: self.obstacle_reach_m,
            region_reach_m: self.region_reach_m,
            n_phrases_max: self.n_phrases_max,
        }
    }
}

impl service::Settings for Settings {
    const SECTION: &'static str = "semantics";

    fn check(&self, _: &Profile) -> Result<(), Invalid> {
        within("model_patience_ms", self.model_patience_ms as f64, 50.0, 60_000.0)?;
        within("n_masks_agreeing", f64::from(self.n_masks_agreeing), 1.0, 8.0)?;
        within("onnx.n_threads", self.onnx.n_threads as f64, 1.0, 64.0)?;
        self.yolo.check()?;
        within("n_phrases_max", self.n_phrases_max as f64, 1.0, 256.0)?;
        within("heat_min", self.heat_min, 0.01, 1.0)?;
        within("paper_iou_min", self.paper_iou_min, 0.0, 1.0)?;
        within("resolution_m", self.resolution_m, 0.01, 0.25)?;
        within("voxel_m", self.voxel_m, 0.01, 0.2)?;
        within("n_blocks_max", self.n_blocks_max as f64, 16.0, 100_000.0)?;
        within("depth_m_max", self.depth_m_max, 0.5, 20.0)?;
        within("obstacle_stride_px", self.obstacle_stride_px as f64, 1.0, 16.0)?;
        within("obstacle_reach_m", self.obstacle_reach_m, 1.0, 50.0)?;
        within("region_reach_m", self.region_reach_m, 2.0, 50.0)?;
        within("n_keyframes_max", self.n_keyframes_max as f64, 0.0, 1000.0)?;
        within("keyframes_mb_max", self.keyframes_mb_max as f64, 0.0, 4000.0)?;
        within("keyframe_distance_m", self.keyframe_distance_m, 0.05, 5.0)?;
        within("keyframe_angle_rad", self.keyframe_angle_rad, 0.05, 3.2)?;
        within("odometry_gap_ms", self.odometry_gap_ms as f64, 10.0, 1000.0)?;
        // Obstacles and the models' view of the world must not be older than a second.
        within("idle_period_ms", self.idle_period_ms as f64, 0.0, 1000.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use service::Settings as _;

    #[test]
    fn the_defaults_are_within_their_limits_and_others_are_named() {
        let good = Settings::default();
        assert_eq!(good.check(&Profile::sim()), Ok(()));
        let check = |settings: Settings, field: &str| {
            assert_eq!(settings.check(&Profile::sim()).unwrap_err().field, field);
        };
        check(Settings { heat_min: f64::NAN, ..good.clone() }, "heat_min");
        check(Settings { voxel_m: 0.0, ..good.clone() }, "voxel_m");
        check(Settings { idle_period_ms: 1001, ..good }, "idle_period_ms");
    }

    #[test]
    fn every_voxel_within_its_limits_makes_a_map() {
        for voxel_m in [0.01, 0.04, 0.2] {
            let config = Settings { voxel_m, ..Settings::default() }.maps(&Profile::sim());
            assert!(mapping::tsdf::Tsdf::new(config.tsdf).is_ok(), "{voxel_m}");
        }
    }
}
