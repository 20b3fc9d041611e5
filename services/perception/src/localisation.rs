//! Localisation: scans and odometry to a base map and a pose.
//!
//! For now the pose is odometry's own, placed in the map by configuration ([`pose_source`]); the base map
//! is built at the pose that the base had at each scan's own stamp.

use std::time::Duration;

use proto::{BaseMap, PoseEstimate, topics};
use service::{Inbox, Life};

pub mod config;
pub mod decider;
pub mod pose_source;

pub use config::Settings;
pub use decider::{Decider, Input, Output};

/// How often the decider looks at the clock.
const TICK: Duration = Duration::from_millis(50);

/// Lives as localisation until it is asked to stop.
///
/// # Errors
/// When the network refuses.
pub async fn serve(life: Life, settings: Settings) -> anyhow::Result<()> {
    let inbox = Inbox::new();
    life.bus.subscribe(&topics::ODOMETRY, &inbox, 64, |r| Input::Odometry(r.message)).await?;
    life.bus.subscribe(&topics::SCAN, &inbox, 4, |r| Input::Scan(r.message)).await?;
    let pose = life.bus.publisher::<PoseEstimate>(&topics::POSE).await?;
    let base_map = life.bus.publisher::<BaseMap>(&topics::BASE_MAP).await?;
    let mut decider = Decider::new(settings, &life.profile);
    let mut tick = tokio::time::interval(TICK);
    tick.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    life.ready().await?;
    loop {
        let input = tokio::select! {
            () = life.stopped() => return Ok(()),
            input = inbox.next() => input,
            _ = tick.tick() => Input::Tick,
        };
        for output in decider.step(life.clock.now(), input) {
            match output {
                Output::Pose(message) => pose.put(&message)?,
                Output::BaseMap(message) => base_map.put(&message)?,
                Output::Trouble(words) => life.counters.trouble(&words),
            }
        }
    }
}
