//! What the base does, what it is asked to do, and where it is asked to go.

use geometry::{Pose2, Twist};
use serde::{Deserialize, Serialize};

use crate::codec::{Encoding, Invalid, Message, within};
use crate::header::Header;

/// Farthest coordinate that is believed, metres.
pub const COORDINATE_M_MAX: f64 = 1e5;

pub(crate) fn check_pose(pose: &Pose2) -> Result<(), Invalid> {
    within("x_m", pose.x_m, -COORDINATE_M_MAX, COORDINATE_M_MAX)?;
    within("y_m", pose.y_m, -COORDINATE_M_MAX, COORDINATE_M_MAX)?;
    within("yaw_rad", pose.yaw_rad, -7.0, 7.0)
}

pub(crate) fn check_twist(twist: &Twist) -> Result<(), Invalid> {
    within("speed_m_s", twist.speed_m_s, -20.0, 20.0)?;
    within("yaw_rate_rad_s", twist.yaw_rate_rad_s, -50.0, 50.0)
}

/// What made the base stop by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BaseFault {
    /// A bumper is pressed.
    Bumper,
    /// A cliff sensor sees no floor.
    Cliff,
    /// A wheel hangs in the air.
    WheelDrop,
    /// The motors' own protection.
    Motor,
}

/// Where the wheels say the base is, and how it moves. `echo` is the safe command last taken.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Odometry {
    /// Order, stamp, echo.
    pub header: Header,
    /// The base in `odom`.
    pub odom_from_base: Pose2,
    /// Its measured motion.
    pub twist: Twist,
    /// What is wrong with the base, if anything.
    pub fault: Option<BaseFault>,
}

impl Message for Odometry {
    const NAME: &'static str = "Odometry";
    const ENCODING: Encoding = Encoding::Binary { kind: 1 };
    const N_BYTES_MAX: usize = 256;

    fn check(&self) -> Result<(), Invalid> {
        check_pose(&self.odom_from_base)?;
        check_twist(&self.twist)
    }

    fn header(&self) -> Option<&Header> {
        Some(&self.header)
    }
}

/// What the nominal policy wants: a set-point. `echo` is the odometry it was made from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NominalCommand {
    /// Order, stamp, echo.
    pub header: Header,
    /// The set-point.
    pub twist: Twist,
}

impl Message for NominalCommand {
    const NAME: &'static str = "NominalCommand";
    const ENCODING: Encoding = Encoding::Binary { kind: 2 };
    const N_BYTES_MAX: usize = 128;

    fn check(&self) -> Result<(), Invalid> {
        check_twist(&self.twist)
    }

    fn header(&self) -> Option<&Header> {
        Some(&self.header)
    }
}

/// The set-point that keeps the rules. `echo` is the odometry it was made from, so that the robot can
/// tell how old the thought behind it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SafeCommand {
    /// Order, stamp, echo.
    pub header: Header,
    /// The set-point.
    pub twist: Twist,
}

impl Message for SafeCommand {
    const NAME: &'static str = "SafeCommand";
    const ENCODING: Encoding = Encoding::Binary { kind: 3 };
    const N_BYTES_MAX: usize = 128;

    fn check(&self) -> Result<(), Invalid> {
        check_twist(&self.twist)
    }

    fn header(&self) -> Option<&Header> {
        Some(&self.header)
    }
}

/// Where the robot is asked to go.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Goal {
    /// The sender's handle.
    #[serde(default)]
    pub id: String,
    /// East in `map`, metres.
    pub x_m: f64,
    /// North in `map`, metres.
    pub y_m: f64,
    /// How near counts as there, metres.
    pub tolerance_m: f64,
    /// Go nowhere: drops the present goal.
    #[serde(default)]
    pub cancel: bool,
}

impl Message for Goal {
    const NAME: &'static str = "Goal";
    const ENCODING: Encoding = Encoding::Json;
    const N_BYTES_MAX: usize = 4096;

    fn check(&self) -> Result<(), Invalid> {
        within("x_m", self.x_m, -COORDINATE_M_MAX, COORDINATE_M_MAX)?;
        within("y_m", self.y_m, -COORDINATE_M_MAX, COORDINATE_M_MAX)?;
        within("tolerance_m", self.tolerance_m, 0.02, 5.0)
    }
}
