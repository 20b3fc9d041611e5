//! How a process lives: configuration, logs, session, liveliness, serving, draining, exit code.

use std::future::Future;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::Context;
use geometry::Profile;
use proto::{Health, Segment, topics};
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::watch;

use crate::bus::Bus;
use crate::clock::Clock;
use crate::config::{self, Loaded, Settings};
use crate::health::Counters;
use crate::priority;
use crate::session;

/// Orderly stop.
pub const EXIT_OK: u8 = 0;
/// Something failed while running; a restart may help.
pub const EXIT_FAILED: u8 = 1;
/// The command line is wrong (`EX_USAGE`).
pub const EXIT_USAGE: u8 = 64;
/// The configuration is wrong (`EX_CONFIG`); a restart will not help.
pub const EXIT_CONFIG: u8 = 78;
/// A bug: a panic ends the whole process, so that its peers see it gone.
pub const EXIT_PANIC: u8 = 101;

/// Longest time from the signal to the exit.
const DRAIN_MAX: Duration = Duration::from_secs(3);

/// What a service is given to live with.
pub struct Life {
    /// The service's name, fit for keys: `filter`, `semantics`, …
    pub name: Segment,
    /// The robot's profile.
    pub profile: Profile,
    /// The network.
    pub bus: Bus,
    /// The clock.
    pub clock: Clock,
    /// Folder of the configuration: relative paths start here.
    pub folder: PathBuf,
    /// Where trouble is told.
    pub counters: Counters,
    stop: watch::Receiver<bool>,
}

impl Life {
    /// Waits until the process is asked to stop. Safe to cancel.
    pub async fn stopped(&self) {
        let mut stop = self.stop.clone();
        // An error means that the sender is gone: the process ends anyway.
        let _ = stop.wait_for(|stopped| *stopped).await;
    }

    /// Tells the network and the supervisor that the service is ready: it has subscribed to what it needs,
    /// and what is said from now on is heard.
    ///
    /// # Errors
    /// When the session refuses.
    pub async fn ready(&self) -> anyhow::Result<()> {
        self.bus.declare_alive(&self.name).await?;
        if let Err(e) = sd_notify::notify(&[sd_notify::NotifyState::Ready]) {
            tracing::debug!(error = %e, "no supervisor to notify");
        }
        tracing::info!("ready");
        Ok(())
    }
}

/// Runs a service to its end, with this process's own arguments: `--config FILE`, or `--config FILE --check`.
pub fn run<S, F>(name: &'static str, serve: impl FnOnce(Life, S) -> F + Send + 'static) -> ExitCode
where
    S: Settings,
    F: Future<Output = anyhow::Result<()>> + Send + 'static,
{
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    run_with(name, &arguments, serve)
}

/// As [`run`], with given arguments.
pub fn run_with<S, F>(
    name: &'static str,
    arguments: &[String],
    serve: impl FnOnce(Life, S) -> F + Send + 'static,
) -> ExitCode
where
    S: Settings,
    F: Future<Output = anyhow::Result<()>> + Send + 'static,
{
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let (file, check_only) = match words.as_slice() {
        ["--config", file] => (PathBuf::from(file), false),
        ["--config", file, "--check"] => (PathBuf::from(file), true),
        _ => {
            eprintln!("usage: {name} --config FILE [--check]");
            return ExitCode::from(EXIT_USAGE);
        }
    };
    let loaded = match config::load::<S>(&file) {
        Ok(loaded) => loaded,
        Err(e) => {
            eprintln!("{name}: {e}");
            return ExitCode::from(EXIT_CONFIG);
        }
    };
    if check_only {
        eprintln!("{name}: {} is good, sha256 {}", file.display(), loaded.hash);
        return ExitCode::from(EXIT_OK);
    }
    if let Err(e) = start_logs(&loaded.common.log) {
        eprintln!("{name}: {}: log = {:?}: {e}", file.display(), loaded.common.log);
        return ExitCode::from(EXIT_CONFIG);
    }
    die_on_panic();
    // Before there are threads: they stand where the one stands that starts them.
    if let Err(e) = priority::lower_this_thread(loaded.common.niceness) {
        eprintln!("{name}: {}: niceness = {}: {e}", file.display(), loaded.common.niceness);
        return ExitCode::from(EXIT_CONFIG);
    }
    let runtime = match tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build() {
        Ok(runtime) => runtime,
        Err(e) => {
            eprintln!("{name}: start runtime: {e}");
            return ExitCode::from(EXIT_FAILED);
        }
    };
    let end = runtime.block_on(live(name, loaded, serve));
    // Whatever still blocks (a model, a disk) does not hold up the exit.
    runtime.shutdown_timeout(Duration::from_millis(200));
    match end {
        Ok(()) => {
            tracing::info!("stopped");
            ExitCode::from(EXIT_OK)
        }
        Err(e) => {
            tracing::error!(error = format!("{e:#}"), "failed");
            ExitCode::from(EXIT_FAILED)
        }
    }
}

fn start_logs(filter: &str) -> anyhow::Result<()> {
    let filter: tracing_subscriber::EnvFilter = filter.parse()?;
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(false)
        .try_init()
        .map_err(|e| anyhow::anyhow!("{e}"))
}

fn die_on_panic() {
    std::panic::set_hook(Box::new(|panic| {
        tracing::error!(%panic, "panic");
        std::process::exit(i32::from(EXIT_PANIC));
    }));
}

async fn live<S, F>(
    name: &'static str,
    loaded: Loaded<S>,
    serve: impl FnOnce(Life, S) -> F + Send + 'static,
) -> anyhow::Result<()>
where
    S: Settings,
    F: Future<Output = anyhow::Result<()>> + Send + 'static,
{
    // Two instances of one binary tell themselves apart by their section: `[localisation]`, `[semantics]`.
    let _ = name;
    let name = Segment::new(S::SECTION).context("name of the service")?;
    tracing::info!(
        service = %name, robot = %loaded.robot, config_hash = loaded.hash, effective = loaded.effective,
        "starting"
    );
    let (stop_sender, stop) = watch::channel(false);
    // Before anything else: who is told to stop while it starts must stop in order, too.
    let mut signals = Signals::listen()?;
    let clock = Clock::start();
    let counters = Counters::default();
    let session = session::open(&loaded.common.network, &loaded.folder).await?;
    let bus = Bus::new(session.clone(), loaded.robot.clone(), clock, counters.clone());
    let beat = tokio::spawn(beat(bus.clone(), name.clone(), loaded.hash.clone(), counters.clone(), clock));

    let life = Life { name, profile: loaded.profile, bus, clock, folder: loaded.folder, counters, stop };
    let mut serving = tokio::spawn(serve(life, loaded.settings));
    let end = tokio::select! {
        end = &mut serving => end,
        signal = signals.next() => {
            tracing::info!(signal, "stopping");
            let _ = stop_sender.send(true);
            match tokio::time::timeout(DRAIN_MAX, &mut serving).await {
                Ok(end) => end,
                Err(_) => {
                    serving.abort();
                    anyhow::bail!("did not stop within {} s", DRAIN_MAX.as_secs())
                }
            }
        }
    };
    beat.abort();
    // Closing tells the peers at once; a peer that does not listen must not hold up the exit.
    let _ = tokio::time::timeout(Duration::from_millis(500), session.close()).await;
    end.context("service task")?
}

/// The signals that ask a process to stop.
struct Signals {
    terminate: Signal,
    interrupt: Signal,
}

impl Signals {
    fn listen() -> anyhow::Result<Self> {
        let terminate = signal(SignalKind::terminate()).context("listen for SIGTERM")?;
        let interrupt = signal(SignalKind::interrupt()).context("listen for SIGINT")?;
        Ok(Signals { terminate, interrupt })
    }

    async fn next(&mut self) -> &'static str {
        tokio::select! {
            _ = self.terminate.recv() => "SIGTERM",
            _ = self.interrupt.recv() => "SIGINT",
        }
    }
}

/// Publishes the service's health each second.
async fn beat(bus: Bus, name: Segment, config_hash: String, counters: Counters, clock: Clock) {
    let publisher = match bus.instance_publisher::<Health>(&topics::HEALTH, &name).await {
        Ok(publisher) => publisher,
        Err(e) => {
            tracing::error!(error = format!("{e:#}"), "no health can be published");
            return;
        }
    };
    let mut second = tokio::time::interval(Duration::from_secs(1));
    loop {
        second.tick().await;
        let (rejected, dropped, trouble) = counters.snapshot();
        let health = Health {
            service: name.to_string(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            config_hash: config_hash.clone(),
            pid: std::process::id(),
            up_s: clock.now().as_secs_f64(),
            rejected,
            dropped,
            trouble,
        };
        if let Err(e) = publisher.put(&health) {
            tracing::warn!(error = format!("{e:#}"), "health not published");
        }
    }
}
