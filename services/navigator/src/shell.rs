//! The shell around the decider: bus, two clocks' ticks, and a thread that plans.

use std::time::Duration;

use proto::{Goal, NavigatorStatus, NominalCommand, topics};
use service::{Inbox, Life, Publisher, Received};
use tokio::sync::mpsc;
use tokio::time::MissedTickBehavior;

use crate::config::NavigatorSettings;
use crate::decider::{Input, NavigatorDecider, Output};
use crate::plan::{PlanJob, make};

/// Serves the navigator until the process is asked to stop.
///
/// # Errors
/// When the bus cannot be reached.
pub async fn serve(life: Life, settings: NavigatorSettings) -> anyhow::Result<()> {
    let mut decider = NavigatorDecider::new(&settings, &life.profile);
    let inbox: Inbox<Input> = Inbox::new();
    subscribe(&life, &inbox).await?;
    let outlets = Outlets {
        nominal: life.bus.publisher(&topics::NOMINAL).await?,
        reports: reporter(&life).await?,
        plans: planner(&life, &inbox),
        counters: life.counters.clone(),
    };
    let mut plan_ticks = ticks(settings.plan_rate_hz);
    let mut track_ticks = ticks(settings.track_rate_hz);
    life.ready().await?;
    loop {
        let input = tokio::select! {
            biased;
            () = life.stopped() => return Ok(()),
            _ = track_ticks.tick() => {
                // What came before the tick counts in it.
                while let Some(input) = inbox.try_next() {
                    outlets.perform(decider.step(life.clock.now(), input));
                }
                Input::TrackTick { wall_ns: life.clock.stamp_ns() }
            }
            _ = plan_ticks.tick() => Input::PlanTick,
            input = inbox.next() => input,
        };
        outlets.perform(decider.step(life.clock.now(), input));
    }
}

fn ticks(rate_hz: f64) -> tokio::time::Interval {
    let mut ticks = tokio::time::interval(Duration::from_secs_f64(1.0 / rate_hz));
    ticks.set_missed_tick_behavior(MissedTickBehavior::Skip);
    ticks
}

async fn subscribe(life: &Life, inbox: &Inbox<Input>) -> anyhow::Result<()> {
    let bus = &life.bus;
    bus.subscribe(&topics::GOAL, inbox, 4, |r: Received<Goal>| Input::Goal(r.message)).await?;
    bus.subscribe(&topics::ODOMETRY, inbox, 16, |r| Input::Odometry(r.message, r.at)).await?;
    bus.subscribe(&topics::POSE, inbox, 4, |r| Input::Pose(r.message, r.at)).await?;
    bus.subscribe(&topics::BASE_MAP, inbox, 1, |r| Input::BaseMap(r.message)).await?;
    bus.subscribe(&topics::DEPTH_OBSTACLES, inbox, 1, |r| Input::DepthObstacles(r.message)).await?;
    let n_rules = proto::rule_set::N_RULES_MAX;
    bus.subscribe(&topics::OBJECT_MAP, inbox, n_rules, |r| Input::ObjectMap(r.message)).await?;
    bus.subscribe(&topics::RULES, inbox, 4, |r| Input::Rules(r.message)).await
}

/// A thread that makes plans, one at a time.
fn planner(life: &Life, inbox: &Inbox<Input>) -> mpsc::Sender<PlanJob> {
    let (sender, mut jobs) = mpsc::channel::<PlanJob>(1);
    let (ready, profile) = (inbox.slot(1), life.profile.clone());
    tokio::task::spawn_blocking(move || {
        while let Some(job) = jobs.blocking_recv() {
            ready.push(Input::PlanReady(make(&job, &profile)));
        }
    });
    sender
}

/// A thread that tells the status: a reader that is stuck must not hold up the commands.
async fn reporter(life: &Life) -> anyhow::Result<mpsc::Sender<NavigatorStatus>> {
    let publisher: Publisher<NavigatorStatus> = life.bus.publisher(&topics::NAVIGATOR_STATUS).await?;
    let (sender, mut reports) = mpsc::channel(8);
    tokio::task::spawn_blocking(move || {
        while let Some(report) = reports.blocking_recv() {
            if let Err(e) = publisher.put(&report) {
                tracing::warn!(error = format!("{e:#}"), "status not published");
            }
        }
    });
    Ok(sender)
}

/// Where outputs go.
struct Outlets {
    nominal: Publisher<NominalCommand>,
    reports: mpsc::Sender<NavigatorStatus>,
    plans: mpsc::Sender<PlanJob>,
    counters: service::Counters,
}

impl Outlets {
    fn perform(&self, outputs: Vec<Output>) {
        for output in outputs {
            match output {
                Output::Command(command) => {
                    if let Err(e) = self.nominal.put(&command) {
                        tracing::warn!(error = format!("{e:#}"), "command not published");
                    }
                }
                Output::Status(status) => {
                    if self.reports.try_send(status).is_err() {
                        self.counters.dropped(topics::NAVIGATOR_STATUS.key);
                    }
                }
                Output::Plan(job) => {
                    if self.plans.try_send(*job).is_err() {
                        self.counters.trouble("plans cannot be made");
                    }
                }
                Output::Changed { state, words } => tracing::info!(state, words, "state"),
            }
        }
    }
}
