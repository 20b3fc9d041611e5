//! What an operator reads: JSON, in numbers and in words.

use geometry::{Pose2, Twist};
use serde::{Deserialize, Serialize};

use crate::codec::{Encoding, Invalid, Message};
use crate::rule_set::RuleHeld;

/// Health of one service.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Health {
    /// The service.
    pub service: String,
    /// Its version.
    pub version: String,
    /// SHA-256 of its effective configuration, hex.
    pub config_hash: String,
    /// Process id.
    pub pid: u32,
    /// Seconds since its start.
    pub up_s: f64,
    /// Payloads rejected, each counted once, by topic: (key, count, last reason).
    pub rejected: Vec<RejectedCount>,
    /// Messages dropped because newer ones came, by topic.
    pub dropped: Vec<DroppedCount>,
    /// What is wrong; empty when nothing.
    pub trouble: String,
}

/// Payloads of one key that were no valid messages.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RejectedCount {
    /// Key of the topic.
    pub key: String,
    /// How many.
    pub count: u64,
    /// Why the last one was.
    pub last_reason: String,
}

/// Messages of one key that gave way to newer ones.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DroppedCount {
    /// Key of the topic.
    pub key: String,
    /// How many.
    pub count: u64,
}

/// What the filter did in one tick, and why.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FilterStatus {
    /// The tick.
    pub tick: u64,
    /// One word: `passed`, `blended`, `backup`, `resting`, `recovering`, `unfreezing`, `stopped`.
    pub action: String,
    /// What the operator reads: "slowed: 0.4 m from the crib".
    pub words: String,
    /// Why the robot is stopped: the input and its age; empty when it is not.
    pub stop_reason: String,
    /// The pose in `map`, when known.
    pub map_from_base: Option<Pose2>,
    /// What was asked for.
    pub nominal: Option<Twist>,
    /// What was sent.
    pub sent: Twist,
    /// Safety score of the state, metres.
    pub v_safe_m: Option<f64>,
    /// Safety score of what was sent, metres.
    pub v_sent_m: Option<f64>,
    /// The rule or layer that binds: its id, and by how much.
    pub binding: Option<Binding>,
    /// Whether a certified plan stands behind the command, and if not, why.
    pub certified: bool,
    /// Why it is not certified; empty when it is.
    pub uncertified_reason: String,
    /// Distance from the nominal in control space, scaled by the limits; 0 is untouched.
    pub deviation: f64,
    /// Rule set it acts on.
    pub rules_version: Option<u64>,
    /// Each rule, as the filter holds it.
    pub rules: Vec<RuleHeld>,
    /// Time from the start of the tick to the command, microseconds.
    pub used_us: u64,
    /// Ticks that came too late since the start.
    pub n_late: u64,
    /// Ages of the inputs, milliseconds.
    pub ages_ms: Vec<InputAge>,
}

/// How old one input is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InputAge {
    /// The input.
    pub input: String,
    /// Its age, milliseconds; `None` when it never came.
    pub age_ms: Option<u64>,
}

/// Which margin is the smallest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Binding {
    /// Rule id, or name of the base layer.
    pub id: String,
    /// As the operator would call it.
    pub label: String,
    /// The margin.
    pub margin: f64,
    /// Its unit: `m`, `m/s` or `rad/s`.
    pub unit: String,
}

/// What the nominal policy is doing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NavigatorStatus {
    /// One word: `idle`, `driving`, `arrived`, `no_path`, `waiting`.
    pub state: String,
    /// In words, with the reason.
    pub words: String,
    /// The path in `map`, from the robot to the goal, metres.
    pub path: Vec<[f64; 2]>,
    /// The goal, when there is one.
    pub goal: Option<[f64; 2]>,
}

/// What the last guard before the motors does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotStatus {
    /// What the motors get.
    pub applied: Twist,
    /// Whether the guard holds the robot.
    pub stopped: bool,
    /// Why; empty when it does not.
    pub reason: String,
    /// How often the guard has stepped in since the start.
    pub n_interventions: u64,
}

/// Ground truth of a simulation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Truth {
    /// Seconds since the simulation's start.
    pub time_s: f64,
    /// The base in `map`.
    pub map_from_base: Pose2,
    /// How it moves.
    pub twist: Twist,
    /// Hull to the nearest obstacle, metres.
    pub clearance_m: f64,
    /// Collisions since the start.
    pub n_collisions: u64,
    /// Distance of the hull to each object's projection, metres, below 0 inside.
    pub objects: Vec<ObjectDistance>,
}

/// How far the hull is from one object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectDistance {
    /// The object's id in the scene.
    pub id: String,
    /// To the projection of all of it, metres.
    pub any_height_m: f64,
    /// To the projection of what is above the robot, metres; `None` when nothing is.
    pub overhead_m: Option<f64>,
}

macro_rules! json_message {
    ($type:ty, $name:literal, $n_bytes_max:expr) => {
        impl Message for $type {
            const NAME: &'static str = $name;
            const ENCODING: Encoding = Encoding::Json;
            const N_BYTES_MAX: usize = $n_bytes_max;

            fn check(&self) -> Result<(), Invalid> {
                Ok(())
            }
        }
    };
}

json_message!(Health, "Health", 64 * 1024);
json_message!(FilterStatus, "FilterStatus", 64 * 1024);
json_message!(NavigatorStatus, "NavigatorStatus", 1024 * 1024);
json_message!(RobotStatus, "RobotStatus", 16 * 1024);
json_message!(Truth, "Truth", 1024 * 1024);
