//! Opening the zenoh session that a configuration describes.

use std::path::Path;

use anyhow::{Context, anyhow};

use crate::config::Network;

/// Opens the session; peers that are not there yet are tried again in the background.
///
/// # Errors
/// When the zenoh file cannot be read, an endpoint is malformed, or none can be listened on.
pub async fn open(network: &Network, folder: &Path) -> anyhow::Result<zenoh::Session> {
    let mut config = match &network.zenoh {
        Some(file) => zenoh::Config::from_file(folder.join(file))
            .map_err(|e| anyhow!("{e}"))
            .with_context(|| format!("network.zenoh {}", file.display()))?,
        None => zenoh::Config::default(),
    };
    let list = |endpoints: &[String]| serde_json::to_string(endpoints);
    let mut entries = vec![
        ("mode", format!("{:?}", network.mode)),
        ("scouting/multicast/enabled", network.multicast.to_string()),
    ];
    if !network.connect.is_empty() {
        entries.push(("connect/endpoints", list(&network.connect)?));
        // A service that is restarted must be back within a control period or two, not four seconds.
        let retry = r#"{ "period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2 }"#;
        entries.push(("connect/retry", retry.into()));
    }
    if !network.listen.is_empty() {
        entries.push(("listen/endpoints", list(&network.listen)?));
    }
    for (key, value) in entries {
        config
            .insert_json5(key, &value)
            .map_err(|e| anyhow!("{e}"))
            .with_context(|| format!("network: {key} = {value}"))?;
    }
    zenoh::open(config).await.map_err(|e| anyhow!("{e}")).context("open zenoh session")
}
