//! What a robot is.

use geometry::{Pose2, Time, Twist};
use proto::{BaseFault, RgbdFrame, Scan};

/// A base with its sensors, real or simulated.
///
/// Both calls come from one loop about a hundred times a second and must return within a millisecond or
/// two: slow sensors run on threads of their own and hand over what is ready.
pub trait Robot: Send + 'static {
    /// What was sensed since the last call.
    ///
    /// # Errors
    /// When the hardware does not answer; the loop stops the robot, says why, and asks again.
    fn sense(&mut self, now: Time) -> anyhow::Result<Senses>;

    /// Gives the motors a set-point. It comes at every turn of the loop, also when it is the same.
    ///
    /// # Errors
    /// When the hardware does not take it.
    fn actuate(&mut self, now: Time, command: Twist) -> anyhow::Result<()>;
}

/// What a robot sensed since it was last asked. The loop fills in sequence numbers and echoes.
#[derive(Clone, Debug, Default)]
pub struct Senses {
    /// The newest state of the base, if there is a new one.
    pub base: Option<BaseState>,
    /// LiDAR turns that were completed; their stamps are the robot's.
    pub scans: Vec<Scan>,
    /// Camera frames that were completed; their stamps are the robot's.
    pub frames: Vec<RgbdFrame>,
}

/// Where the wheels say the base is, and how it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BaseState {
    /// When this was so: nanoseconds since the Unix epoch, by the host's clock.
    pub stamp_ns: u64,
    /// The base in `odom`.
    pub odom_from_base: Pose2,
    /// Its measured motion.
    pub twist: Twist,
    /// What is wrong with the base, if anything.
    pub fault: Option<BaseFault>,
}
