//! One run on the stage: processes started, messages heard, the director's deeds done.

use std::time::Duration;

use anyhow::{Context, bail};
use geometry::Point2;
use proto::{Goal, topics};
use service::{Clock, Inbox};

use super::director::{Deed, Director, End, GOAL_TOLERANCE_M, Input};
use super::judge::Judge;
use super::record::Record;
use crate::board::Board;
use crate::carry::ServiceName;
use crate::connection::{PATIENCE, put_when_heard};
use crate::fleet::{Fleet, FleetOptions};
use crate::hearing::{Heard, listen_to_all, listen_to_maps_and_truth};
use crate::terminal::Terminal;

/// Longest time until all services are alive.
const ALIVE_MAX: Duration = Duration::from_secs(20);
/// How often processes are looked after and the status line is rewritten.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// What is to be run.
pub struct Run<'a> {
    /// `without` or `with`.
    pub name: &'static str,
    /// The words, if any are said.
    pub words: Option<&'a str>,
    /// Where to go.
    pub goal_map: Point2,
    /// Who judges.
    pub judge: Judge,
    /// What is started.
    pub options: FleetOptions,
}

/// Plays one run.
///
/// # Errors
/// When a service does not start or dies, or the run cannot go on; with the end of the logs.
pub async fn play(run: Run<'_>, terminal: &mut Terminal) -> anyhow::Result<Record> {
    let name = run.name;
    terminal.line(&match run.words {
        Some(words) => format!("run {name}: {words:?}"),
        None => format!("run {name} a rule"),
    });
    let mut fleet = Fleet::launch(run.options.clone()).await.with_context(|| format!("run {name}"))?;
    terminal.line(&format!(
        "  watch it from another terminal: heedway watch --robot {} --connect {}",
        fleet.robot(),
        fleet.endpoint()
    ));
    let inbox: Inbox<Heard> = Inbox::new();
    listen_to_all(fleet.bus(), &inbox).await?;
    listen_to_maps_and_truth(fleet.bus(), &inbox).await?;
    terminal.status("starting the services");
    fleet.wait_until_alive(ALIVE_MAX).await.with_context(|| format!("run {name}"))?;

    let record = act(&run, &mut fleet, &inbox, terminal).await.with_context(|| format!("run {name}"))?;
    terminal.clear_status();
    if let Err(e) = fleet.stop().await {
        terminal.line(&format!("  note: {e:#}"));
    }
    Ok(record)
}

/// Everything from when the services are alive until the run is over.
async fn act(
    run: &Run<'_>,
    fleet: &mut Fleet,
    inbox: &Inbox<Heard>,
    terminal: &mut Terminal,
) -> anyhow::Result<Record> {
    let clock = Clock::start();
    let mut director = Director::new(clock.now(), run.words, run.goal_map);
    let mut record = Record::new(run.name, run.judge.clone());
    let mut board = Board::default();
    let mut look = tokio::time::interval(LOOK_EVERY);
    loop {
        let deeds = tokio::select! {
            heard = inbox.next() => {
                for line in board.hear(&heard) {
                    if is_worth_telling(&heard) {
                        terminal.line(&format!("  {:5.1} s  {line}", record.time_s()));
                    }
                }
                record.hear(&heard);
                director.step(clock.now(), &Input::Heard(&heard))
            }
            _ = look.tick() => {
                fleet.check()?;
                let phase = director.words();
                let state = if phase.is_empty() { board.line() } else { phase };
                terminal.status(&format!("{} {:5.1} s | {state}", run.name, record.time_s()));
                director.step(clock.now(), &Input::Tick)
            }
        };
        for deed in deeds {
            match deed {
                Deed::Say(words) => {
                    put_when_heard(fleet.bus(), &topics::INSTRUCTION, words.into_bytes(), PATIENCE).await?;
                }
                Deed::Go => {
                    give_goal(fleet, run.goal_map).await?;
                    record.start();
                }
                Deed::End(End::Reached) => {
                    record.reached();
                    return Ok(record);
                }
                Deed::End(End::TimeOver) => return Ok(record),
                Deed::End(End::Failed { why, look_at: Some(service) }) => {
                    bail!("{why}\n{}", fleet.log_tail(service))
                }
                Deed::End(End::Failed { why, look_at: None }) => bail!(why),
            }
        }
    }
}

async fn give_goal(fleet: &Fleet, goal_map: Point2) -> anyhow::Result<()> {
    let goal = Goal {
        id: "demo".to_owned(),
        x_m: goal_map.x,
        y_m: goal_map.y,
        tolerance_m: GOAL_TOLERANCE_M,
        cancel: false,
    };
    put_when_heard(fleet.bus(), &topics::GOAL, proto::encode(&goal)?, PATIENCE).await
}

/// Of all that changes, what tells the story: what was said, what came of it, and who is in trouble.
fn is_worth_telling(heard: &Heard) -> bool {
    match heard {
        Heard::Reply(_) | Heard::Health(_) => true,
        Heard::Held(held) => held.message.service == ServiceName::Semantics.as_str(),
        Heard::Peer(peer) => !peer.alive,
        _ => false,
    }
}
