//! `[simulator]`: which scene, which seed, and how imperfect everything is. All errors are off by default.

use std::path::PathBuf;
use std::time::Duration;

use geometry::Profile;
use proto::Invalid;
use proto::codec::within;
use robot::DriveSettings;
use serde::{Deserialize, Serialize};

use crate::base::{OdometryDrift, PlantLimits};
use crate::oracle_models::ModelErrors;
use crate::sensor_noise::SensorNoise;

/// The `[simulator]` section.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SimulatorSettings {
    /// The scene, a JSON file; relative to the folder of the configuration.
    pub scene: PathBuf,
    /// Where every random draw comes from.
    pub seed: u64,
    /// The start is moved by up to so much, drawn from the seed, metres.
    #[serde(default)]
    pub start_jitter_m: f64,
    /// The loop that drives the base.
    #[serde(default = "default_drive")]
    pub drive: DriveSettings,
    /// The base.
    #[serde(default)]
    pub base: BaseSettings,
    /// The camera.
    #[serde(default)]
    pub camera: CameraSettings,
    /// The LiDAR.
    #[serde(default)]
    pub lidar: LidarSettings,
    /// Errors of the sensors.
    #[serde(default)]
    pub noise: NoiseSettings,
    /// The models that answer from the instance image.
    #[serde(default)]
    pub models: ModelSettings,
}

fn default_drive() -> DriveSettings {
    DriveSettings { turn_rate_hz: 100.0 }
}

/// Where the wheels begin to count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OdometryOrigin {
    /// `odom` is the scene's own frame, until the wheels drift: who takes the pose from the wheels alone
    /// then speaks of the same places as the scene.
    #[default]
    Map,
    /// `odom` is where the robot starts, as on hardware.
    Start,
}

/// `[simulator.base]`.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BaseSettings {
    /// Largest change of the turn rate, rad/s².
    pub yaw_accel_rad_s2_max: f64,
    /// From command to effect, seconds; the profile's measured delay when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub delay_s: Option<f64>,
    /// Time constant of the drive, seconds; 0 for none.
    pub lag_s: f64,
    /// Without a command for so long the base stops by itself, seconds.
    pub watchdog_s: f64,
    /// Odometry messages per second.
    pub odometry_rate_hz: f64,
    /// Where the wheels begin to count.
    pub odometry_origin: OdometryOrigin,
    /// Whether a contact presses a bumper, which stops the robot for good.
    pub bumper: bool,
}

impl Default for BaseSettings {
    fn default() -> Self {
        BaseSettings {
            // A light differential base turns up at once, compared with how it speeds up.
            yaw_accel_rad_s2_max: 10.0,
            delay_s: None,
            lag_s: 0.0,
            // As the Kobuki's own.
            watchdog_s: 0.6,
            odometry_rate_hz: 50.0,
            odometry_origin: OdometryOrigin::Map,
            bumper: true,
        }
    }
}

/// `[simulator.camera]`.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraSettings {
    /// Frames per second.
    pub rate_hz: f64,
    /// Reach of its depth, metres.
    pub depth_m_max: f64,
    /// Threads that cast its rays; 0 for half of the machine's.
    pub n_threads: usize,
}

impl Default for CameraSettings {
    fn default() -> Self {
        CameraSettings { rate_hz: 5.0, depth_m_max: 6.0, n_threads: 0 }
    }
}

/// `[simulator.lidar]`.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LidarSettings {
    /// Turns per second.
    pub rate_hz: f64,
    /// Beams in a turn.
    pub n_beams: u32,
    /// Nearest range that is measured, metres.
    pub range_m_min: f64,
    /// Farthest range that is measured, metres.
    pub range_m_max: f64,
}

impl Default for LidarSettings {
    fn default() -> Self {
        // As of a common indoor scanner (RPLIDAR A2).
        LidarSettings { rate_hz: 10.0, n_beams: 360, range_m_min: 0.1, range_m_max: 12.0 }
    }
}

/// `[simulator.noise]`: all 0 by default.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NoiseSettings {
    /// Standard deviation of depth at 1 m, metres; it grows with the square of the distance.
    pub depth_m_at_1_m: f64,
    /// Share of depth pixels that are missing.
    pub depth_dropout: f64,
    /// Standard deviation of LiDAR ranges, metres.
    pub range_m: f64,
    /// Share by which the wheels measure ways too long.
    pub odometry_scale: f64,
    /// Turn that the wheels measure and do not make, radians a metre.
    pub odometry_yaw_rad_per_m: f64,
}

/// `[simulator.models]`: all 0 by default.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ModelSettings {
    /// Share of objects that a heat map misses.
    pub missed: f64,
    /// Share of heat maps that show some other object too.
    pub wrong: f64,
    /// Share of segments that fall in two.
    pub split: f64,
    /// How long an answer takes, seconds.
    pub delay_s: f64,
}

impl service::Settings for SimulatorSettings {
    const SECTION: &'static str = "simulator";

    fn check(&self, _: &Profile) -> Result<(), Invalid> {
        self.drive.check()?;
        if self.scene.as_os_str().is_empty() {
            return Err(Invalid::new("scene", "empty", "the path of a file"));
        }
        let SimulatorSettings { base, camera, lidar, noise, models, .. } = self;
        within("camera.n_threads", camera.n_threads as f64, 0.0, 256.0)?;
        within("lidar.range_m_max", lidar.range_m_max, lidar.range_m_min.max(0.1), 1000.0)?;
        for (field, value, low, high) in [
            ("start_jitter_m", self.start_jitter_m, 0.0, 1.0),
            ("base.yaw_accel_rad_s2_max", base.yaw_accel_rad_s2_max, 0.1, 1000.0),
            ("base.delay_s", base.delay_s.unwrap_or(0.0), 0.0, 0.5),
            ("base.lag_s", base.lag_s, 0.0, 1.0),
            ("base.watchdog_s", base.watchdog_s, 0.05, 10.0),
            ("base.odometry_rate_hz", base.odometry_rate_hz, 1.0, 200.0),
            ("camera.rate_hz", camera.rate_hz, 0.1, 60.0),
            ("camera.depth_m_max", camera.depth_m_max, 0.5, 65.0),
            ("lidar.rate_hz", lidar.rate_hz, 0.5, 50.0),
            ("lidar.n_beams", f64::from(lidar.n_beams), 8.0, proto::sensing::N_BEAMS_MAX as f64),
            ("lidar.range_m_min", lidar.range_m_min, 0.0, 10.0),
            ("noise.depth_m_at_1_m", noise.depth_m_at_1_m, 0.0, 0.5),
            ("noise.depth_dropout", noise.depth_dropout, 0.0, 1.0),
            ("noise.range_m", noise.range_m, 0.0, 1.0),
            ("noise.odometry_scale", noise.odometry_scale, -0.5, 0.5),
            ("noise.odometry_yaw_rad_per_m", noise.odometry_yaw_rad_per_m, -0.5, 0.5),
            ("models.missed", models.missed, 0.0, 1.0),
            ("models.wrong", models.wrong, 0.0, 1.0),
            ("models.split", models.split, 0.0, 1.0),
            ("models.delay_s", models.delay_s, 0.0, 30.0),
        ] {
            within(field, value, low, high)?;
        }
        Ok(())
    }
}

impl SimulatorSettings {
    /// The base of a robot with this profile.
    #[must_use]
    pub fn plant_limits(&self, profile: &Profile) -> PlantLimits {
        let seconds = |s: f64| Duration::from_secs_f64(s.clamp(0.0, 10.0));
        PlantLimits {
            speed_m_s_max: profile.speed_m_s_max,
            yaw_rate_rad_s_max: profile.yaw_rate_rad_s_max,
            accel_m_s2_max: profile.accel_m_s2_max,
            yaw_accel_rad_s2_max: self.base.yaw_accel_rad_s2_max,
            delay: seconds(self.base.delay_s.unwrap_or(profile.actuation_delay_s)),
            lag: seconds(self.base.lag_s),
            watchdog: seconds(self.base.watchdog_s),
            radius_m: profile.radius_m,
        }
    }
}

impl NoiseSettings {
    /// What depth and ranges suffer.
    #[must_use]
    pub fn sensors(&self) -> SensorNoise {
        SensorNoise {
            depth_m_at_1_m: self.depth_m_at_1_m,
            depth_dropout: self.depth_dropout,
            range_m: self.range_m,
        }
    }

    /// What the wheels suffer.
    #[must_use]
    pub fn wheels(&self) -> OdometryDrift {
        OdometryDrift { scale: self.odometry_scale, yaw_rad_per_m: self.odometry_yaw_rad_per_m }
    }
}

impl ModelSettings {
    /// How often the models err.
    #[must_use]
    pub fn errors(&self) -> ModelErrors {
        ModelErrors { missed: self.missed, wrong: self.wrong, split: self.split }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use service::Settings;

    fn settings(text: &str) -> Result<SimulatorSettings, String> {
        let whole = format!("scene = \"office.json\"\nseed = 1\n{text}");
        let settings: SimulatorSettings = serde_json::from_value(
            // TOML is read by `service`; the same structure as JSON does here.
            serde_json::from_str(&whole_to_json(&whole)).map_err(|e| e.to_string())?,
        )
        .map_err(|e| e.to_string())?;
        settings.check(&Profile::sim()).map_err(|e| e.to_string())?;
        Ok(settings)
    }

    /// `key = value` lines, with `[section]` lines in between.
    fn whole_to_json(text: &str) -> String {
        let mut root = serde_json::Map::new();
        let mut section = String::new();
        for line in text.lines() {
            if let Some(name) = line.strip_prefix('[') {
                section = name.trim_end_matches(']').to_owned();
                root.entry(section.clone()).or_insert_with(|| serde_json::json!({}));
            } else if let Some((key, value)) = line.split_once(" = ") {
                let value: serde_json::Value = serde_json::from_str(value).unwrap();
                let map =
                    if section.is_empty() { &mut root } else { root[&section].as_object_mut().unwrap() };
                map.insert(key.to_owned(), value);
            }
        }
        serde_json::Value::Object(root).to_string()
    }

    #[test]
    fn scene_and_seed_are_enough_and_then_nothing_errs() {
        let plain = settings("").unwrap();
        assert_eq!(plain.noise.sensors(), SensorNoise::default());
        assert_eq!(plain.noise.wheels(), OdometryDrift::default());
        assert_eq!(plain.models.errors(), ModelErrors::default());
        let delay = plain.plant_limits(&Profile::turtlebot2()).delay;
        assert_eq!(delay, Profile::turtlebot2().actuation_delay());
    }

    #[test]
    fn what_is_out_of_range_or_unknown_is_named() {
        for (text, word) in [
            ("[noise]\ndepth_dropout = 1.5", "noise.depth_dropout is 1.5, must be 0 to 1"),
            ("[camera]\nrate_hz = 0", "camera.rate_hz is 0"),
            ("[lidar]\nn_beams = 2", "lidar.n_beams is 2"),
            ("[base]\ndelay_s = 0.6", "base.delay_s is 0.6, must be 0 to 0.5"),
            ("[camera]\nspeed = 3", "unknown field `speed`"),
        ] {
            let told = settings(text).unwrap_err();
            assert!(told.contains(word), "{told}");
        }
    }
}
