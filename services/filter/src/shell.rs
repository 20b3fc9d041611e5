//! The shell around the decider: the bus in, the bus out, and a tick that waits for nobody.
//!
//! The safe command is put on the bus from the loop itself, which drops under congestion and never blocks.
//! Everything else, and every distance field, goes through threads of their own: a reader that is stuck
//! must not hold up a command. The loop's thread comes before all usual ones where that is allowed.

use std::time::Duration;

use anyhow::Context;
use geometry::Time;
use proto::{FilterStatus, RulesHeld, SafeCommand, topics};
use service::{Bus, Clock, Inbox, Life, PeerChange, Publisher, Received, Slot};
use tokio::sync::mpsc;
use tokio::time::MissedTickBehavior;

use crate::config::FilterSettings;
use crate::decider::{FilterDecider, Input, Note, Output};
use crate::fields::{FieldJob, FieldReady, Fields};
use crate::heard::Heard;

/// Most fields that wait: one in flight a layer, and there are no more layers than rules and two.
const N_FIELDS_MAX: usize = proto::rule_set::N_RULES_MAX + 2;
/// Most reports that wait for a slow reader before new ones are dropped: two seconds' worth.
const N_REPORTS_MAX: usize = 64;

/// What comes in, before the wall clock of its receipt is added.
enum Event {
    Odometry(Received<proto::Odometry>),
    Scan(Received<proto::Scan>),
    Nominal(Received<proto::NominalCommand>),
    Pose(Received<proto::PoseEstimate>),
    BaseMap(Received<proto::BaseMap>),
    DepthObstacles(Received<proto::DepthObstacles>),
    ObjectMap(Received<proto::ObjectMap>),
    SemanticsBeat(Received<proto::SemanticsBeat>),
    Rules(Received<proto::RuleSet>),
    Peer(PeerChange),
    FieldReady(FieldReady),
}

/// What the operator reads: it may wait, and under congestion it is dropped.
enum Report {
    Status(Box<FilterStatus>),
    Held(RulesHeld),
}

/// Serves the filter until the process is asked to stop.
///
/// # Errors
/// When the settings do not fit the profile, or the bus cannot be reached.
pub async fn serve(life: Life, settings: FilterSettings) -> anyhow::Result<()> {
    let decider = FilterDecider::new(&settings, &life.profile).context("[filter]")?;
    let inbox: Inbox<Event> = Inbox::new();
    subscribe(&life.bus, &inbox).await?;
    let outlets = Outlets {
        clock: life.clock,
        safe: life.bus.publisher(&topics::SAFE).await?,
        reports: reporter(&life).await?,
        fields: field_worker(inbox.slot(N_FIELDS_MAX)),
        counters: life.counters.clone(),
    };
    life.ready().await?;
    let FilterSettings { rate_hz, realtime_priority, .. } = settings;
    let ticking = async move { tick_until_stopped(&life, decider, &inbox, outlets, 1.0 / rate_hz).await };
    service::realtime::on_time(realtime_priority, ticking).await?
}

async fn subscribe(bus: &Bus, inbox: &Inbox<Event>) -> anyhow::Result<()> {
    bus.subscribe(&topics::ODOMETRY, inbox, 16, Event::Odometry).await?;
    bus.subscribe(&topics::SCAN, inbox, 2, Event::Scan).await?;
    bus.subscribe(&topics::NOMINAL, inbox, 4, Event::Nominal).await?;
    bus.subscribe(&topics::POSE, inbox, 4, Event::Pose).await?;
    bus.subscribe(&topics::BASE_MAP, inbox, 1, Event::BaseMap).await?;
    bus.subscribe(&topics::DEPTH_OBSTACLES, inbox, 1, Event::DepthObstacles).await?;
    bus.subscribe(&topics::OBJECT_MAP, inbox, proto::rule_set::N_RULES_MAX, Event::ObjectMap).await?;
    bus.subscribe(&topics::SEMANTICS_BEAT, inbox, 2, Event::SemanticsBeat).await?;
    bus.subscribe(&topics::RULES, inbox, 4, Event::Rules).await?;
    bus.watch_peers(inbox, Event::Peer).await
}

async fn tick_until_stopped(
    life: &Life,
    mut decider: FilterDecider,
    inbox: &Inbox<Event>,
    mut outlets: Outlets,
    period_s: f64,
) -> anyhow::Result<()> {
    let clock = life.clock;
    let mut ticks = tokio::time::interval(Duration::from_secs_f64(period_s));
    ticks.set_missed_tick_behavior(MissedTickBehavior::Skip);
    // The first tick is at once; all later ones are due a whole number of periods after it.
    let first = ticks.tick().await;
    let start = clock.now();
    loop {
        tokio::select! {
            biased;
            () = life.stopped() => return Ok(()),
            due = ticks.tick() => {
                let due = start + due.duration_since(first);
                let begun = clock.now();
                // What came before the tick counts in it.
                while let Some(event) = inbox.try_next() {
                    outlets.perform(decider.step(clock.now(), input(event, clock)), begun);
                }
                let tick = Input::Tick { due, wall_ns: clock.stamp_ns() };
                outlets.perform(decider.step(clock.now(), tick), begun);
            }
            event = inbox.next() => {
                let begun = clock.now();
                outlets.perform(decider.step(begun, input(event, clock)), begun);
            }
        }
    }
}

fn input(event: Event, clock: Clock) -> Input {
    match event {
        Event::Odometry(received) => Input::Odometry(heard(received, clock)),
        Event::Scan(received) => Input::Scan(heard(received, clock)),
        Event::Nominal(received) => Input::Nominal(heard(received, clock)),
        Event::Pose(received) => Input::Pose(heard(received, clock)),
        Event::BaseMap(received) => Input::BaseMap(heard(received, clock)),
        Event::DepthObstacles(received) => Input::DepthObstacles(heard(received, clock)),
        Event::ObjectMap(received) => Input::ObjectMap(heard(received, clock)),
        Event::SemanticsBeat(received) => Input::SemanticsBeat(heard(received, clock)),
        Event::Rules(received) => Input::Rules(received.message),
        Event::Peer(PeerChange { service, alive }) => Input::Peer { service, alive },
        Event::FieldReady(ready) => Input::FieldReady(ready),
    }
}

fn heard<M>(received: Received<M>, clock: Clock) -> Heard<M> {
    let Received { message, at, .. } = received;
    let waited_ns = u64::try_from(clock.now().since(at).as_nanos()).unwrap_or(u64::MAX);
    Heard { message, at, wall_ns: clock.stamp_ns().saturating_sub(waited_ns) }
}

/// A thread that publishes reports; it ends with its sender.
async fn reporter(life: &Life) -> anyhow::Result<mpsc::Sender<Report>> {
    let status: Publisher<FilterStatus> = life.bus.publisher(&topics::FILTER_STATUS).await?;
    let held: Publisher<RulesHeld> = life.bus.instance_publisher(&topics::RULES_HELD, &life.name).await?;
    let (sender, mut reports) = mpsc::channel(N_REPORTS_MAX);
    tokio::task::spawn_blocking(move || {
        while let Some(report) = reports.blocking_recv() {
            let put = match report {
                Report::Status(message) => status.put(&message),
                Report::Held(message) => held.put(&message),
            };
            if let Err(e) = put {
                tracing::warn!(error = format!("{e:#}"), "report not published");
            }
        }
    });
    Ok(sender)
}

/// A thread that computes distance fields, one after the other: one core is left to the loop.
fn field_worker(ready: Slot<Event>) -> mpsc::Sender<FieldJob> {
    let (sender, mut jobs) = mpsc::channel::<FieldJob>(N_FIELDS_MAX);
    tokio::task::spawn_blocking(move || {
        let mut fields = Fields::default();
        while let Some(job) = jobs.blocking_recv() {
            ready.push(Event::FieldReady(fields.compute(job)));
        }
    });
    sender
}

/// Where outputs go.
struct Outlets {
    clock: Clock,
    safe: Publisher<SafeCommand>,
    reports: mpsc::Sender<Report>,
    fields: mpsc::Sender<FieldJob>,
    counters: service::Counters,
}

impl Outlets {
    /// Performs the outputs of one step that began at `begun`.
    fn perform(&mut self, outputs: Vec<Output>, begun: Time) {
        let mut used = Duration::ZERO;
        for output in outputs {
            match output {
                Output::Command(command) => {
                    if let Err(e) = self.safe.put(&command) {
                        tracing::error!(error = format!("{e:#}"), "command not published");
                    }
                    used = self.clock.now().since(begun);
                }
                Output::Status(mut status) => {
                    status.used_us = u64::try_from(used.as_micros()).unwrap_or(u64::MAX);
                    self.report(Report::Status(status), topics::FILTER_STATUS.key);
                }
                Output::Held(held) => self.report(Report::Held(held), topics::RULES_HELD.key),
                Output::ComputeField(job) => {
                    // There is room for a job of every layer; without it the layer keeps its last field.
                    if self.fields.try_send(job).is_err() {
                        self.counters.trouble("distance fields cannot be computed");
                    }
                }
                Output::Rejected { key, reason } => self.counters.rejected(key, &reason.to_string()),
                Output::Note(note) => log(&note),
            }
        }
    }

    fn report(&self, report: Report, key: &str) {
        if self.reports.try_send(report).is_err() {
            self.counters.dropped(key);
        }
    }
}

fn log(note: &Note) {
    match note {
        Note::Stopped(reason) => {
            tracing::info!(reason = reason.words, age_ms = reason.age.map(|a| a.as_millis()), "stopped");
        }
        Note::Slowed(reason) => {
            tracing::info!(reason = reason.words, age_ms = reason.age.map(|a| a.as_millis()), "slowed");
        }
        Note::Going => tracing::info!("inputs are fresh"),
        Note::Rules { version, n_rules } => tracing::info!(version, n_rules, "rules in force"),
        Note::Grounding { rule_id, grounding } => {
            tracing::info!(rule = rule_id, grounding = ?grounding, "grounding changed");
        }
    }
}
