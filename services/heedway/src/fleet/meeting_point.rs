//! Where the services of a fleet meet: a session that listens on a free port of the loopback interface.

use std::net::{Ipv4Addr, TcpListener};
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};

use anyhow::{Context, anyhow};
use proto::Segment;
use service::config::Network;
use service::{Bus, Clock, Counters};

/// How often a port is picked before giving up: another program may take it first.
const N_PORT_TRIES: usize = 5;

/// A name that no other fleet on this host has while it runs.
pub(super) fn unique_robot() -> anyhow::Result<Segment> {
    static N_FLEETS: AtomicU32 = AtomicU32::new(0);
    let idx = N_FLEETS.fetch_add(1, Ordering::Relaxed);
    Ok(Segment::new(&format!("demo-{}-{idx}", std::process::id()))?)
}

/// Opens a session that listens on a free port of the loopback interface.
pub(super) async fn open(robot: &Segment) -> anyhow::Result<(Bus, String)> {
    let mut last_error = anyhow!("no port tried");
    for _ in 0..N_PORT_TRIES {
        let endpoint = format!("tcp/127.0.0.1:{}", free_port()?);
        let network = Network {
            zenoh: None,
            mode: "peer".to_owned(),
            connect: Vec::new(),
            listen: vec![endpoint.clone()],
            multicast: false,
        };
        match service::session::open(&network, Path::new(".")).await {
            Ok(session) => {
                let bus = Bus::new(session, robot.clone(), Clock::start(), Counters::default());
                return Ok((bus, endpoint));
            }
            // Somebody took the port in between: pick another.
            Err(e) => last_error = e.context(endpoint),
        }
    }
    Err(last_error.context("no port to meet at"))
}

fn free_port() -> anyhow::Result<u16> {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).context("pick a free port")?;
    Ok(listener.local_addr().context("pick a free port")?.port())
}
