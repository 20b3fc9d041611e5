//! How the operator's commands reach a robot: one session, no service of their own.

use std::time::Duration;

use anyhow::{Context, anyhow, bail};
use clap::Args;
use proto::{Segment, Topic, keys};
use service::config::Network;
use service::{Bus, Clock, Counters};

/// How long a command waits for a robot to answer.
pub const PATIENCE: Duration = Duration::from_secs(5);

/// How often a condition is looked at that nobody announces.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// Which robot, and where.
#[derive(Args, Clone, Debug)]
pub struct Reach {
    /// The robot's name on the network.
    #[arg(long, env = "HEEDWAY_ROBOT", default_value = "robot", value_name = "NAME")]
    pub robot: String,
    /// Where its network is entered: a zenoh endpoint.
    #[arg(long, env = "HEEDWAY_CONNECT", default_value = "tcp/127.0.0.1:7447", value_name = "ENDPOINT")]
    pub connect: String,
}

impl Reach {
    /// Opens a session to the robot's network.
    ///
    /// # Errors
    /// When the robot's name cannot stand in a key, or nobody listens at the endpoint.
    pub async fn open(&self) -> anyhow::Result<Bus> {
        let robot = Segment::new(&self.robot).context("--robot")?;
        let network = Network {
            zenoh: None,
            mode: "client".to_owned(),
            connect: vec![self.connect.clone()],
            listen: Vec::new(),
            multicast: false,
        };
        let opening = service::session::open(&network, std::path::Path::new("."));
        let session = tokio::time::timeout(PATIENCE, opening)
            .await
            .map_err(|_| anyhow!("no answer within {} s", PATIENCE.as_secs()))
            .and_then(|opened| opened)
            .with_context(|| format!("nobody reached at {} (--connect)", self.connect))?;
        Ok(Bus::new(session, robot, Clock::start(), Counters::default()))
    }
}

/// Puts a payload on a key as soon as somebody listens to it.
///
/// A payload put with nobody listening is lost without an error; therefore this waits first.
///
/// # Errors
/// When nobody listens within `patience`, or the session refuses.
pub async fn put_when_heard(
    bus: &Bus,
    topic: &Topic,
    payload: Vec<u8>,
    patience: Duration,
) -> anyhow::Result<()> {
    let key = keys::key(bus.robot(), topic);
    let publisher = bus
        .session()
        .declare_publisher(key.clone())
        .await
        .map_err(|e| anyhow!("{e}"))
        .with_context(|| format!("declare publisher {key}"))?;
    let heard = async {
        let mut look = tokio::time::interval(LOOK_EVERY);
        loop {
            look.tick().await;
            let status = publisher.matching_status().await.map_err(|e| anyhow!("{e}"))?;
            if status.matching() {
                return anyhow::Ok(());
            }
        }
    };
    match tokio::time::timeout(patience, heard).await {
        Ok(heard) => heard?,
        Err(_) => bail!("nobody listens to {key}, waited {} s", patience.as_secs_f64()),
    }
    publisher.put(payload).await.map_err(|e| anyhow!("{e}")).with_context(|| format!("put on {key}"))
}
