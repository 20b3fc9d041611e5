//! What one robot can do and how big it is: the numbers that every service must agree on.

use std::time::Duration;

use crate::{CameraIntrinsics, Pose3};

/// The robot's limits, size, sensors and delays. Safety limits have no default.
///
/// The hull is a disc of `radius_m` around the base origin, `height_m` tall.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Profile {
    /// Name of the profile, as in its file name.
    pub name: String,
    /// Largest forward speed, m/s. Reverse is never planned.
    pub speed_m_s_max: f64,
    /// Largest turn rate either way, rad/s.
    pub yaw_rate_rad_s_max: f64,
    /// Largest acceleration and deceleration, m/s².
    pub accel_m_s2_max: f64,
    /// Radius of the hull, metres.
    pub radius_m: f64,
    /// Height of the hull above the floor, metres.
    pub height_m: f64,
    /// Cap on the speed while a rule's object has not been found, m/s.
    pub ungrounded_speed_m_s: f64,
    /// Time from a command to its effect at the wheels, seconds, as measured.
    pub actuation_delay_s: f64,
    /// Where the LiDAR sits.
    pub lidar: LidarMount,
    /// Where the camera sits and what it sees.
    pub camera: CameraMount,
}

/// The LiDAR's place on the base; its scan plane is level.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct LidarMount {
    /// Forward of the base origin, metres.
    pub x_m: f64,
    /// Left of the base origin, metres.
    pub y_m: f64,
    /// Above the floor, metres.
    pub z_m: f64,
    /// Direction of the scanner's zero, radians from the base's x axis.
    pub yaw_rad: f64,
}

/// The camera's place on the base, and its pinhole.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct CameraMount {
    /// Forward of the base origin, metres.
    pub x_m: f64,
    /// Left of the base origin, metres.
    pub y_m: f64,
    /// Above the floor, metres.
    pub z_m: f64,
    /// Downward tilt of the optical axis, radians; positive looks down.
    pub pitch_down_rad: f64,
    /// The pinhole; depth is registered to colour.
    pub intrinsics: CameraIntrinsics,
}

impl CameraMount {
    /// The camera's optical frame (z forward, x right, y down) in `base`.
    #[must_use]
    pub fn base_from_camera(&self) -> Pose3 {
        let optical_in_level = nalgebra::Rotation3::from_matrix_unchecked(nalgebra::Matrix3::new(
            0.0, 0.0, 1.0, //
            -1.0, 0.0, 0.0, //
            0.0, -1.0, 0.0,
        ));
        let tilt = nalgebra::Rotation3::from_axis_angle(&nalgebra::Vector3::y_axis(), self.pitch_down_rad);
        Pose3::from_parts(
            nalgebra::Translation3::new(self.x_m, self.y_m, self.z_m),
            nalgebra::UnitQuaternion::from_rotation_matrix(&(tilt * optical_in_level)),
        )
    }
}

/// A profile that no robot can have.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ProfileError {
    /// A number outside its range.
    #[error("{key} = {value}, must be within {low} to {high}")]
    Range {
        /// The key as written in the profile's file.
        key: &'static str,
        /// The value found.
        value: f64,
        /// Smallest value allowed.
        low: f64,
        /// Largest value allowed.
        high: f64,
    },
    /// Bad intrinsics.
    #[error("camera.intrinsics: {0}")]
    Intrinsics(#[from] crate::IntrinsicsError),
}

impl Profile {
    /// The profile, once every number is within its range.
    ///
    /// # Errors
    /// [`ProfileError`] names the first key outside its limits, the value and the limits.
    pub fn checked(self) -> Result<Self, ProfileError> {
        let speed = self.speed_m_s_max;
        for (key, value, low, high) in [
            ("speed_m_s_max", speed, 0.05, 5.0),
            ("yaw_rate_rad_s_max", self.yaw_rate_rad_s_max, 0.05, 10.0),
            ("accel_m_s2_max", self.accel_m_s2_max, 0.05, 20.0),
            ("radius_m", self.radius_m, 0.05, 2.0),
            ("height_m", self.height_m, 0.05, 3.0),
            ("ungrounded_speed_m_s", self.ungrounded_speed_m_s, 0.0, speed),
            ("actuation_delay_s", self.actuation_delay_s, 0.0, 0.5),
            ("lidar.x_m", self.lidar.x_m, -2.0, 2.0),
            ("lidar.y_m", self.lidar.y_m, -2.0, 2.0),
            ("lidar.z_m", self.lidar.z_m, 0.02, 3.0),
            ("lidar.yaw_rad", self.lidar.yaw_rad, -7.0, 7.0),
            ("camera.x_m", self.camera.x_m, -2.0, 2.0),
            ("camera.y_m", self.camera.y_m, -2.0, 2.0),
            ("camera.z_m", self.camera.z_m, 0.02, 3.0),
            ("camera.pitch_down_rad", self.camera.pitch_down_rad, -1.6, 1.6),
        ] {
            // Written so that NaN fails.
            if !(low..=high).contains(&value) {
                return Err(ProfileError::Range { key, value, low, high });
            }
        }
        self.camera.intrinsics.checked()?;
        Ok(self)
    }

    /// The measured time from a command to its effect.
    #[must_use]
    pub fn actuation_delay(&self) -> Duration {
        Duration::from_secs_f64(self.actuation_delay_s.clamp(0.0, 1.0))
    }

    /// The distance covered while braking from `speed_m_s` at full deceleration, metres.
    #[must_use]
    pub fn braking_distance_m(&self, speed_m_s: f64) -> f64 {
        speed_m_s * speed_m_s / (2.0 * self.accel_m_s2_max)
    }

    /// The paper's simulated robot: 1.5 m/s, 1 rad/s, 3 m/s², a disc of 0.25 m, 0.45 m tall.
    #[must_use]
    pub fn sim() -> Profile {
        Profile {
            name: "sim".into(),
            speed_m_s_max: 1.5,
            yaw_rate_rad_s_max: 1.0,
            accel_m_s2_max: 3.0,
            radius_m: 0.25,
            height_m: 0.45,
            ungrounded_speed_m_s: 0.3,
            actuation_delay_s: 0.02,
            lidar: LidarMount { x_m: 0.0, y_m: 0.0, z_m: 0.18, yaw_rad: 0.0 },
            camera: CameraMount {
                x_m: 0.1,
                y_m: 0.0,
                z_m: 0.4,
                pitch_down_rad: 0.0,
                intrinsics: CameraIntrinsics {
                    width: 640,
                    height: 480,
                    fx: 600.0,
                    fy: 600.0,
                    cx: 319.5,
                    cy: 239.5,
                },
            },
        }
    }

    /// The paper's hardware: a TurtleBot 2 held to 0.5 m/s, 0.5 m/s², a disc of 0.178 m, 0.42 m tall.
    #[must_use]
    pub fn turtlebot2() -> Profile {
        Profile {
            name: "turtlebot2".into(),
            speed_m_s_max: 0.5,
            accel_m_s2_max: 0.5,
            radius_m: 0.178,
            height_m: 0.42,
            ungrounded_speed_m_s: 0.15,
            actuation_delay_s: 0.05,
            camera: CameraMount { z_m: 0.35, ..Profile::sim().camera },
            ..Profile::sim()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Point3;

    #[test]
    fn the_two_profiles_of_the_paper_are_sound() {
        assert!(Profile::sim().checked().is_ok());
        assert!(Profile::turtlebot2().checked().is_ok());
    }

    #[test]
    fn a_number_out_of_range_is_named_with_its_limits() {
        let nan = Profile { radius_m: f64::NAN, ..Profile::sim() }.checked();
        assert!(matches!(nan, Err(ProfileError::Range { key: "radius_m", .. })));
        let fast = Profile { ungrounded_speed_m_s: 1.6, ..Profile::sim() }.checked();
        assert_eq!(
            fast,
            Err(ProfileError::Range { key: "ungrounded_speed_m_s", value: 1.6, low: 0.0, high: 1.5 })
        );
    }

    #[test]
    fn a_level_camera_looks_along_the_base_and_a_tilted_one_down() {
        let ahead_camera = Point3::new(0.0, 0.0, 2.0);
        let level = Profile::sim().camera;
        let seen_base = level.base_from_camera() * ahead_camera;
        assert!((seen_base - Point3::new(2.1, 0.0, 0.4)).norm() < 1e-9);
        let tilted = CameraMount { pitch_down_rad: 0.2, ..level };
        assert!((tilted.base_from_camera() * ahead_camera).z < 0.4 - 2.0 * 0.19);
        let right_of_image = level.base_from_camera() * Point3::new(1.0, 0.0, 2.0);
        assert!(right_of_image.y < 0.0);
    }
}
