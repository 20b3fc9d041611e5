//! What localisation can be told.

use std::path::PathBuf;
use std::time::Duration;

use geometry::{Pose2, Profile};
use mapping::base_map::BaseMapConfig;
use proto::{Invalid, codec::within};
use serde::{Deserialize, Serialize};

/// Who knows the pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PoseBy {
    /// Odometry is believed.
    Odometry,
    /// Scans are matched against the map that they make.
    Slam,
    /// Scans are matched against a saved map.
    Localise,
}

/// Section `[localisation]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Who knows the pose.
    pub pose: PoseBy,
    /// The saved map, a YAML file as ROS's `map_server` writes it; with `pose = "localise"` only.
    pub map: Option<PathBuf>,
    /// Where odometry's origin lies in the map: x and y in metres, yaw in radians.
    pub start: [f64; 3],
    /// Epoch of the map frame at the start.
    pub map_epoch: u64,
    /// Side of a cell of the base map, metres.
    pub resolution_m: f64,
    /// Beams are followed at most this far, metres.
    pub range_used_m: f64,
    /// Whether a beam that meets nothing frees its way. Only for a LiDAR that tells nothing from black or glass.
    pub no_return_is_free: bool,
    /// Odometry is interpolated over at most this, milliseconds.
    pub odometry_gap_ms: u64,
    /// A scan waits at most this long for odometry to get to its stamp, milliseconds.
    pub scan_wait_ms: u64,
}

impl Default for Settings {
    /// At odometry's origin; 5 cm cells. Odometry comes at 50 Hz: four missing in a row are a gap.
    fn default() -> Self {
        Settings {
            pose: PoseBy::Odometry,
            map: None,
            start: [0.0; 3],
            map_epoch: 1,
            resolution_m: 0.05,
            range_used_m: 25.0,
            no_return_is_free: false,
            odometry_gap_ms: 100,
            scan_wait_ms: 150,
        }
    }
}

impl Settings {
    /// Where odometry's origin lies in the map.
    #[must_use]
    pub fn map_from_odom(&self) -> Pose2 {
        let [x_m, y_m, yaw_rad] = self.start;
        Pose2::new(x_m, y_m, yaw_rad)
    }

    /// How the base map is built.
    #[must_use]
    pub fn base_map(&self) -> BaseMapConfig {
        BaseMapConfig {
            resolution_m: self.resolution_m,
            range_used_m: self.range_used_m,
            ..BaseMapConfig::default()
        }
    }

    /// Odometry is interpolated over at most this.
    #[must_use]
    pub fn odometry_gap(&self) -> Duration {
        Duration::from_millis(self.odometry_gap_ms)
    }

    /// A scan waits at most this long for odometry.
    #[must_use]
    pub fn scan_wait(&self) -> Duration {
        Duration::from_millis(self.scan_wait_ms)
    }
}

impl service::Settings for Settings {
    const SECTION: &'static str = "localisation";

    fn check(&self, _: &Profile) -> Result<(), Invalid> {
        if self.map.is_some() != (self.pose == PoseBy::Localise) {
            let found = self.map.as_ref().map_or("missing".into(), |map| map.display().to_string());
            let limit = "given with pose = \"localise\" and only then";
            return Err(Invalid::new("map", found, limit));
        }
        let [x_m, y_m, yaw_rad] = self.start;
        within("start.x", x_m, -10_000.0, 10_000.0)?;
        within("start.y", y_m, -10_000.0, 10_000.0)?;
        within("start.yaw", yaw_rad, -7.0, 7.0)?;
        within("map_epoch", self.map_epoch as f64, 1.0, 1e12)?;
        within("resolution_m", self.resolution_m, 0.01, 0.25)?;
        within("range_used_m", self.range_used_m, 1.0, 100.0)?;
        within("odometry_gap_ms", self.odometry_gap_ms as f64, 10.0, 1000.0)?;
        within("scan_wait_ms", self.scan_wait_ms as f64, 0.0, 1000.0)
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
        check(Settings { start: [0.0, f64::NAN, 0.0], ..good.clone() }, "start.y");
        check(Settings { resolution_m: 0.0, ..good.clone() }, "resolution_m");
        check(Settings { odometry_gap_ms: 1001, ..good }, "odometry_gap_ms");
    }
}
