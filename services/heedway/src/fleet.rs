//! The whole system on one host: every service its own process, over loopback, without a router.
//!
//! The fleet's own session is where the services meet: it listens on a free port, each service connects
//! to it, and gossip connects them with each other. Names are unique, so that two fleets do not meet.
//! Used by the demonstration and by the process tests. Deliberately not here: what is said to the robot,
//! and any reading of what it does.

mod configs;
mod meeting_point;
mod member;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, anyhow, bail};
use geometry::Profile;
use proto::Segment;
use service::{Bus, Inbox, PeerChange};

pub use configs::{OFFICE_SCENE, shipped_profile};
pub use member::Death;
use member::Member;

use crate::carry::ServiceName;

/// How often it is looked whether a process has died.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// Longest time from SIGTERM to SIGKILL in an orderly stop; services drain within 3 s.
const STOP_MAX: Duration = Duration::from_secs(5);

/// Which scene is simulated.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SceneSource {
    /// The office that is built in.
    Office,
    /// A scene file, its meshes beside it.
    File(PathBuf),
}

/// What the planner of the nominal policy sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Planner {
    /// The base map only: then it is the filter alone that keeps the rules.
    Base,
    /// The base map and the regions of the rules.
    Rules,
}

/// Which filter is used; names as in the filter's configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Method {
    /// Changes the nominal command as little as the next step allows.
    SmoothBlending,
    /// Leaves the nominal command alone until the last moment.
    LeastRestrictive,
    /// The paper's least-restrictive filter as printed, for comparison only.
    PaperLiteral,
    /// The paper's smooth-blending filter as printed, for comparison only.
    PaperLiteralBlending,
}

/// What to start.
#[derive(Clone, Debug)]
pub struct FleetOptions {
    /// The scene.
    pub scene: SceneSource,
    /// What the planner sees.
    pub planner: Planner,
    /// The filter; as configured when not given.
    pub method: Option<Method>,
    /// Seed of everything random in the simulation.
    pub seed: u64,
    /// Which services.
    pub services: Vec<ServiceName>,
    /// The `heedway` binary.
    pub program: PathBuf,
    /// Where configurations, logs and journals go; a temporary folder, removed at the end, when not given.
    pub folder: Option<PathBuf>,
    /// The robot's name; unique when not given.
    pub robot: Option<String>,
    /// What else differs from the shipped configurations.
    pub changes: Vec<Change>,
}

/// One value that differs from a shipped configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// Whose configuration.
    pub service: ServiceName,
    /// The key, with its section, as in `simulator.noise.range_m`; the shipped file must have it.
    pub key: String,
    /// The value.
    pub value: toml::Value,
}

impl std::str::FromStr for Change {
    type Err = anyhow::Error;

    /// Reads `filter.rate_hz=100.0`: a key with its section, which is the service's name, and a value as in TOML.
    fn from_str(text: &str) -> anyhow::Result<Change> {
        let (key, value) = text.split_once('=').with_context(|| format!("{text:?} is not KEY=VALUE"))?;
        let section = key.split('.').next().unwrap_or_default();
        let service = ServiceName::ALL.into_iter().find(|name| name.as_str() == section);
        let service = service.with_context(|| {
            format!("{section:?} is no service: {}", ServiceName::ALL.map(ServiceName::as_str).join(", "))
        })?;
        let mut table: toml::Table = toml::from_str(&format!("value = {value}"))
            .with_context(|| format!("value of {key}: {value:?}"))?;
        let value = table.remove("value").context("no value")?;
        Ok(Change { service, key: key.to_owned(), value })
    }
}

impl FleetOptions {
    /// Every service over the office.
    #[must_use]
    pub fn office(program: PathBuf) -> Self {
        FleetOptions {
            scene: SceneSource::Office,
            planner: Planner::Rules,
            method: None,
            seed: 1,
            services: ServiceName::ALL.to_vec(),
            program,
            folder: None,
            robot: None,
            changes: Vec::new(),
        }
    }
}

/// A running system. Dropping it kills every process of it.
pub struct Fleet {
    robot: Segment,
    endpoint: String,
    folder: PathBuf,
    bus: Bus,
    peers: Inbox<PeerChange>,
    alive: BTreeMap<String, bool>,
    members: BTreeMap<ServiceName, Member>,
    /// Last, so that the folder goes after the processes that write to it.
    _temporary: Option<tempfile::TempDir>,
}

impl Fleet {
    /// Opens the session where the services meet, writes their configurations, and starts them.
    ///
    /// The processes die with the thread that polls this (and, orderly, with the fleet): call it from a
    /// thread that lives as long as the fleet, as `block_on` on the main thread does.
    ///
    /// # Errors
    /// When a file cannot be written, no port is free, or a process cannot be started.
    pub async fn launch(options: FleetOptions) -> anyhow::Result<Fleet> {
        let robot = match &options.robot {
            Some(name) => Segment::new(name)?,
            None => meeting_point::unique_robot()?,
        };
        let (folder, temporary) = match &options.folder {
            Some(folder) => (folder.clone(), None),
            None => {
                let folder =
                    tempfile::Builder::new().prefix("heedway-").tempdir().context("temporary folder")?;
                (folder.path().to_owned(), Some(folder))
            }
        };
        std::fs::create_dir_all(&folder).with_context(|| format!("create {}", folder.display()))?;
        let (bus, endpoint) = meeting_point::open(&robot).await?;
        let peers = Inbox::new();
        bus.watch_peers(&peers, |peer| peer).await?;

        let facts =
            configs::Facts { folder: &folder, robot: robot.as_str(), endpoint: &endpoint, options: &options };
        configs::write_shared(&facts)?;
        let mut members = BTreeMap::new();
        for name in &options.services {
            let config = configs::write_config(*name, &facts)?;
            let log = folder.join(format!("{name}.log"));
            let mut member = Member::new(*name, options.program.clone(), config, log);
            member.start()?;
            members.insert(*name, member);
        }
        let alive = BTreeMap::new();
        Ok(Fleet { robot, endpoint, folder, bus, peers, alive, members, _temporary: temporary })
    }

    /// The robot's name on the network.
    #[must_use]
    pub fn robot(&self) -> &Segment {
        &self.robot
    }

    /// Where others can connect to, as `heedway say --connect` takes it.
    #[must_use]
    pub fn endpoint(&self) -> &str {
        &self.endpoint
    }

    /// Where configurations, logs and journals are.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The fleet's own session, at which the services meet.
    #[must_use]
    pub fn bus(&self) -> &Bus {
        &self.bus
    }

    /// The file that one service logs to.
    #[must_use]
    pub fn log(&self, service: ServiceName) -> PathBuf {
        self.folder.join(format!("{service}.log"))
    }

    /// The last lines of one service's log.
    #[must_use]
    pub fn log_tail(&self, service: ServiceName) -> String {
        member::tail(&self.log(service))
    }

    /// The process id of a service that runs.
    #[must_use]
    pub fn pid(&self, service: ServiceName) -> Option<u32> {
        self.members.get(&service).and_then(Member::pid)
    }

    /// Waits until each started service has said on the network that it is alive.
    ///
    /// # Errors
    /// When one dies, with its exit code and the end of its log; or when `patience` is over.
    pub async fn wait_until_alive(&mut self, patience: Duration) -> anyhow::Result<()> {
        let waiting = async {
            let mut look = tokio::time::interval(LOOK_EVERY);
            while !self.missing().is_empty() {
                tokio::select! {
                    peer = self.peers.next() => {
                        self.alive.insert(peer.service, peer.alive);
                    }
                    _ = look.tick() => self.check()?,
                }
            }
            anyhow::Ok(())
        };
        match tokio::time::timeout(patience, waiting).await {
            Ok(end) => end,
            Err(_) => {
                let missing = self.missing();
                let tails: Vec<String> = missing.iter().map(|name| self.log_tail(*name)).collect();
                bail!(
                    "not alive within {} s: {missing:?}\n{}\nlogs are in {}",
                    patience.as_secs_f64(),
                    tails.join("\n"),
                    self.folder.display()
                )
            }
        }
    }

    /// Services that are started and have not said that they are alive.
    fn missing(&self) -> Vec<ServiceName> {
        let silent = |name: &&ServiceName| !self.alive.get(name.as_str()).copied().unwrap_or(false);
        self.members.keys().filter(silent).copied().collect()
    }

    /// Looks whether a service has died that was not told to.
    ///
    /// # Errors
    /// [`Death`], with the exit code and the end of the log.
    pub fn check(&mut self) -> anyhow::Result<()> {
        for member in self.members.values_mut() {
            if let Some(death) = member.death()? {
                return Err(anyhow!(death));
            }
        }
        Ok(())
    }

    /// Kills a service with SIGKILL, as a crash would, and waits until it is gone.
    ///
    /// # Errors
    /// When it does not run.
    pub async fn kill9(&mut self, service: ServiceName) -> anyhow::Result<()> {
        self.member(service)?.kill().await?;
        self.alive.insert(service.as_str().to_owned(), false);
        Ok(())
    }

    /// Sends a signal to a service, as in `libc::SIGSTOP`.
    ///
    /// # Errors
    /// When it does not run.
    pub fn signal(&mut self, service: ServiceName, signal: i32) -> anyhow::Result<()> {
        self.member(service)?.signal(signal)
    }

    /// Starts a service that was killed or has died, with the same configuration; its log goes on.
    ///
    /// # Errors
    /// When it still runs or cannot be started.
    pub fn restart(&mut self, service: ServiceName) -> anyhow::Result<()> {
        self.member(service)?.start()
    }

    /// Stops every service in an orderly way, with SIGTERM, and kills what does not stop in time.
    ///
    /// # Errors
    /// When one had to be killed, or ended with an exit code other than 0.
    pub async fn stop(mut self) -> anyhow::Result<()> {
        for member in self.members.values_mut() {
            member.ask_to_stop();
        }
        let mut trouble = Vec::new();
        for member in self.members.values_mut() {
            if let Err(e) = member.wait_or_kill(STOP_MAX).await {
                trouble.push(format!("{e:#}"));
            }
        }
        if trouble.is_empty() { Ok(()) } else { bail!("{}", trouble.join("; ")) }
    }

    fn member(&mut self, service: ServiceName) -> anyhow::Result<&mut Member> {
        self.members.get_mut(&service).with_context(|| format!("{service} is not part of this fleet"))
    }
}

/// The robot's profile that a fleet runs with.
#[must_use]
pub fn profile() -> Profile {
    Profile::sim()
}
