//! Localisation: scans and odometry to a base map and a pose.
//!
//! The pose is odometry's own, that of scans matched against the map that they make, or that of scans found in a
//! saved map ([`pose_source`]), by configuration; the base map is built at the pose that the base had at each
//! scan's own stamp.

use std::io::Read;
use std::path::Path;
use std::time::Duration;

use anyhow::Context;
use mapping::{Grid, Occupancy, map_file};

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
    let saved = settings.map.as_deref().map(saved_map).transpose()?;
    let mut decider = Decider::with_map(settings, &life.profile, saved);
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

/// Most bytes of a saved map's image: its largest grid and a header.
const N_MAP_BYTES_MAX: u64 = 8192 * 8192 + 4096;

/// Reads a saved map: a YAML file and the image that it names, relative to it.
///
/// # Errors
/// Names the file and what is wrong with it.
fn saved_map(yaml_file: &Path) -> anyhow::Result<Grid<Occupancy>> {
    let bytes = |file: &Path| -> anyhow::Result<Vec<u8>> {
        let mut found = Vec::new();
        std::fs::File::open(file)
            .and_then(|opened| opened.take(N_MAP_BYTES_MAX).read_to_end(&mut found))
            .with_context(|| file.display().to_string())?;
        Ok(found)
    };
    let shown = || yaml_file.display().to_string();
    let yaml = String::from_utf8(bytes(yaml_file)?).with_context(shown)?;
    let image = yaml_file.with_file_name(map_file::image_name(&yaml).with_context(shown)?);
    map_file::decode(&yaml, &bytes(&image)?).with_context(shown)
}
