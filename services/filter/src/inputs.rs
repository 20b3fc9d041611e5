//! What the filter's decider hears and what it wants done: plain data both ways.

use geometry::Time;
use proto::{
    BaseMap, DepthObstacles, FilterStatus, Grounding, Invalid, NominalCommand, ObjectMap, Odometry,
    PoseEstimate, RuleSet, RulesHeld, SafeCommand, Scan, SemanticsBeat,
};

use crate::fields::{FieldJob, FieldReady};
use crate::gate::Reason;
use crate::heard::Heard;

/// What the filter hears.
#[derive(Clone, Debug)]
pub enum Input {
    /// Base feedback.
    Odometry(Heard<Odometry>),
    /// A turn of the LiDAR.
    Scan(Heard<Scan>),
    /// What the nominal policy wants.
    Nominal(Heard<NominalCommand>),
    /// Where `odom` lies in `map`.
    Pose(Heard<PoseEstimate>),
    /// The grid from the LiDAR.
    BaseMap(Heard<BaseMap>),
    /// What the camera saw within the robot's height.
    DepthObstacles(Heard<DepthObstacles>),
    /// The region of one rule.
    ObjectMap(Heard<ObjectMap>),
    /// Proof that semantics still looks.
    SemanticsBeat(Heard<SemanticsBeat>),
    /// The rules in force.
    Rules(RuleSet),
    /// A service came or went.
    Peer {
        /// Its name.
        service: String,
        /// Whether it is alive now.
        alive: bool,
    },
    /// A field that was asked for.
    FieldReady(FieldReady),
    /// Time to send a command.
    Tick {
        /// When the tick should have come.
        due: Time,
        /// This host's wall clock, for the stamp of the command.
        wall_ns: u64,
    },
}

/// What the filter wants done.
#[derive(Clone, Debug)]
pub enum Output {
    /// Send this, first of all.
    Command(SafeCommand),
    /// Publish what was done and why; the time used is not filled in yet.
    Status(Box<FilterStatus>),
    /// Publish which rules are held.
    Held(RulesHeld),
    /// Compute this beside the loop.
    ComputeField(FieldJob),
    /// A message that was refused.
    Rejected {
        /// Key of its topic.
        key: &'static str,
        /// Why.
        reason: Invalid,
    },
    /// A change of state, for the log.
    Note(Note),
}

/// A change of state that the log tells.
#[derive(Clone, Debug, PartialEq)]
pub enum Note {
    /// The robot is not allowed to move.
    Stopped(Reason),
    /// The robot must go slowly.
    Slowed(Reason),
    /// The filter decides again.
    Going,
    /// Another rule set is in force.
    Rules {
        /// Its version.
        version: u64,
        /// Number of rules.
        n_rules: usize,
    },
    /// How far the grounding of one rule got.
    Grounding {
        /// The rule's id.
        rule_id: String,
        /// How far.
        grounding: Grounding,
    },
}
