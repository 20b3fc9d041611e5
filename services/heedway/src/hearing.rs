//! What an operator's command listens to: the public topics, and the truth when it is asked for.

use proto::topics;
use proto::{
    BaseMap, FilterStatus, Health, InstructionReply, NavigatorStatus, ObjectMap, Odometry, RobotStatus,
    RuleSet, RulesHeld, Truth,
};
use service::{Bus, Inbox, PeerChange, Received};

/// Something heard on the network.
#[derive(Clone, Debug)]
pub enum Heard {
    /// A service came or went.
    Peer(PeerChange),
    /// Motion of the base.
    Odometry(Received<Odometry>),
    /// What the filter does.
    Filter(Received<FilterStatus>),
    /// What the navigator does.
    Navigator(Received<NavigatorStatus>),
    /// What the last guard does.
    Robot(Received<RobotStatus>),
    /// The rules in force.
    Rules(Received<RuleSet>),
    /// How far a service got with them.
    Held(Received<RulesHeld>),
    /// A service's health.
    Health(Received<Health>),
    /// What was made of an instruction.
    Reply(Received<InstructionReply>),
    /// The base map.
    BaseMap(Received<BaseMap>),
    /// The region of a rule.
    ObjectMap(Received<ObjectMap>),
    /// The ground truth of a simulation.
    Truth(Received<Truth>),
}

/// Listens to rules, how they are held, and the coming and going of services.
///
/// # Errors
/// When the session refuses.
pub async fn listen_to_rules(bus: &Bus, inbox: &Inbox<Heard>) -> anyhow::Result<()> {
    bus.watch_peers(inbox, Heard::Peer).await?;
    bus.subscribe(&topics::RULES, inbox, 16, Heard::Rules).await?;
    bus.subscribe(&topics::RULES_HELD, inbox, 16, Heard::Held).await
}

/// Listens to all that an operator reads.
///
/// # Errors
/// When the session refuses.
pub async fn listen_to_all(bus: &Bus, inbox: &Inbox<Heard>) -> anyhow::Result<()> {
    listen_to_rules(bus, inbox).await?;
    bus.subscribe(&topics::REPLY, inbox, 16, Heard::Reply).await?;
    // The newest is enough of what comes often.
    bus.subscribe(&topics::ODOMETRY, inbox, 2, Heard::Odometry).await?;
    bus.subscribe(&topics::FILTER_STATUS, inbox, 64, Heard::Filter).await?;
    bus.subscribe(&topics::NAVIGATOR_STATUS, inbox, 4, Heard::Navigator).await?;
    bus.subscribe(&topics::ROBOT_STATUS, inbox, 4, Heard::Robot).await?;
    bus.subscribe(&topics::HEALTH, inbox, 16, Heard::Health).await
}

/// Listens to what a picture of a run is drawn from: the maps, and the ground truth.
///
/// # Errors
/// When the session refuses.
pub async fn listen_to_maps_and_truth(bus: &Bus, inbox: &Inbox<Heard>) -> anyhow::Result<()> {
    bus.subscribe(&topics::BASE_MAP, inbox, 2, Heard::BaseMap).await?;
    bus.subscribe(&topics::OBJECT_MAP, inbox, 32, Heard::ObjectMap).await?;
    bus.subscribe(&topics::TRUTH, inbox, 256, Heard::Truth).await
}
