//! THE table: every key of the system, who publishes it, how often, how old it may grow, how it travels.
//!
//! All else is derived from it: the bus declares publishers and subscribers from these rows,
//! `docs/topics.md` is generated from them, and a test holds each message to its row.

use std::time::Duration;

/// How a topic travels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delivery {
    /// Control loop: real-time priority, express, dropped under congestion; the latest wins.
    Control,
    /// Bulk sensor data: low priority, dropped under congestion.
    Bulk,
    /// Something that must arrive: reliable, blocks under congestion.
    Event,
    /// State: like an event, and late joiners are given the last value at once.
    Latched,
    /// A question to whoever answers, and its answer.
    Query,
}

/// One row of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Topic {
    /// Key below `heedway/<robot>/`; a trailing `*` stands for one more segment.
    pub key: &'static str,
    /// Name of the message ([`crate::Message::NAME`]).
    pub message: &'static str,
    /// Who publishes or answers it.
    pub publisher: &'static str,
    /// Publications per second while all is well; 0 for events.
    pub rate_hz: f64,
    /// Oldest age at which a receiver still acts on it; `None` where age does not matter.
    pub age_max: Option<Duration>,
    /// How it travels.
    pub delivery: Delivery,
}

const fn row(
    key: &'static str,
    message: &'static str,
    publisher: &'static str,
    rate_hz: f64,
    age_ms_max: u64,
    delivery: Delivery,
) -> Topic {
    let age_max = if age_ms_max == 0 { None } else { Some(Duration::from_millis(age_ms_max)) };
    Topic { key, message, publisher, rate_hz, age_max, delivery }
}

/// Words for the robot, from any zenoh client: plain text, or JSON.
pub const INSTRUCTION: Topic = row("instruction", "Instruction", "anyone", 0.0, 0, Delivery::Event);
/// What the language service made of an instruction.
pub const REPLY: Topic = row("reply", "InstructionReply", "language", 0.0, 0, Delivery::Event);
/// The rules in force. Repeated each second, so that a lost one heals.
pub const RULES: Topic = row("rules", "RuleSet", "language", 1.0, 0, Delivery::Latched);
/// Which rules a service holds and how far it got with each; one key a service.
pub const RULES_HELD: Topic =
    row("rules_held/*", "RulesHeld", "filter, semantics", 2.0, 0, Delivery::Latched);
/// Named places, as polygons in the map; replaces those of the file until the next start.
pub const PLACES: Topic = row("places", "Places", "anyone", 0.0, 0, Delivery::Event);
/// Where the robot is asked to go.
pub const GOAL: Topic = row("goal", "Goal", "anyone", 0.0, 0, Delivery::Event);

/// Wheel odometry and the state of the base.
pub const ODOMETRY: Topic = row("robot/odometry", "Odometry", "robot", 50.0, 100, Delivery::Control);
/// One turn of the LiDAR.
pub const SCAN: Topic = row("robot/scan", "Scan", "robot", 10.0, 300, Delivery::Control);
/// A colour image and its registered depth.
pub const RGBD: Topic = row("robot/rgbd", "RgbdFrame", "robot", 5.0, 0, Delivery::Bulk);
/// What the nominal policy wants.
pub const NOMINAL: Topic =
    row("command/nominal", "NominalCommand", "navigator", 20.0, 250, Delivery::Control);
/// What the motors get, after the envelope.
pub const SAFE: Topic = row("command/safe", "SafeCommand", "filter", 20.0, 150, Delivery::Control);

/// Where the odometry frame lies in the map.
pub const POSE: Topic =
    row("localisation/pose", "PoseEstimate", "localisation", 10.0, 900, Delivery::Control);
/// The occupancy grid from the LiDAR.
pub const BASE_MAP: Topic = row("map/base", "BaseMap", "localisation", 1.0, 0, Delivery::Latched);
/// Obstacles within the robot's height that the camera saw.
pub const DEPTH_OBSTACLES: Topic =
    row("map/depth_obstacles", "DepthObstacles", "semantics", 2.0, 0, Delivery::Latched);
/// The region of one rule; one key a rule.
pub const OBJECT_MAP: Topic = row("map/object/*", "ObjectMap", "semantics", 2.0, 0, Delivery::Latched);
/// Proof that the semantics still look.
pub const SEMANTICS_BEAT: Topic =
    row("semantics/beat", "SemanticsBeat", "semantics", 3.0, 1000, Delivery::Control);

/// Phrases and an image to coarse heat maps: the open-vocabulary model role.
pub const HEAT_MAPS: Topic =
    row("models/heat_maps", "HeatMapsRequest", "a model host", 0.0, 0, Delivery::Query);
/// An image to segments with exact borders: the panoptic model role.
pub const SEGMENTS: Topic =
    row("models/segments", "SegmentsRequest", "a model host", 0.0, 0, Delivery::Query);

/// What the filter does and why, in numbers and in words.
pub const FILTER_STATUS: Topic = row("filter/status", "FilterStatus", "filter", 20.0, 0, Delivery::Event);
/// What the navigator is doing, and its path.
pub const NAVIGATOR_STATUS: Topic =
    row("navigator/status", "NavigatorStatus", "navigator", 2.0, 0, Delivery::Event);
/// What the last guard before the motors does.
pub const ROBOT_STATUS: Topic = row("robot/status", "RobotStatus", "robot", 5.0, 0, Delivery::Event);
/// Health of one service; one key a service.
pub const HEALTH: Topic = row("health/*", "Health", "every service", 1.0, 0, Delivery::Event);

/// Ground truth of a simulation. Only the evaluation and the demo's report read it.
pub const TRUTH: Topic = row("truth/state", "Truth", "simulator", 20.0, 0, Delivery::Event);

/// The whole table.
pub const ALL: &[Topic] = &[
    INSTRUCTION,
    REPLY,
    RULES,
    RULES_HELD,
    PLACES,
    GOAL,
    ODOMETRY,
    SCAN,
    RGBD,
    NOMINAL,
    SAFE,
    POSE,
    BASE_MAP,
    DEPTH_OBSTACLES,
    OBJECT_MAP,
    SEMANTICS_BEAT,
    HEAT_MAPS,
    SEGMENTS,
    FILTER_STATUS,
    NAVIGATOR_STATUS,
    ROBOT_STATUS,
    HEALTH,
    TRUTH,
];

/// The table as a Markdown page, for `docs/topics.md`.
#[must_use]
pub fn as_markdown() -> String {
    let mut page = String::from(
        "# Topics\n\nWritten from the table in `proto/src/topics.rs`; a test keeps it fresh. Keys lie below \
         `heedway/<robot>/`.\nAn age limit is judged by the receiver's own clock.\n\n\
         | key | message | publisher | rate | age limit | delivery |\n|---|---|---|---|---|---|\n",
    );
    for topic in ALL {
        let rate = if topic.rate_hz > 0.0 { format!("{} Hz", topic.rate_hz) } else { "on demand".into() };
        let age = topic.age_max.map_or_else(|| "none".into(), |age| format!("{} ms", age.as_millis()));
        let Topic { key, message, publisher, delivery, .. } = topic;
        page += &format!("| `{key}` | {message} | {publisher} | {rate} | {age} | {delivery:?} |\n");
    }
    page
}
