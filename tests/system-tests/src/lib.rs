//! A stage for process tests: the whole system as real processes, and eyes on what it publishes.
//!
//! The machine's speed is not ours: a test waits for a condition (`until`), never for a while. The only
//! times that are judged are the system's own, as it reports them.

use std::path::PathBuf;
use std::sync::OnceLock;
use std::time::Duration;

use anyhow::{Context, bail};
use geometry::Point2;
use heedway_cli::carry::ServiceName;
use heedway_cli::connection::put_when_heard;
use heedway_cli::fleet::{Fleet, FleetOptions, OFFICE_SCENE};
use proto::{
    FilterStatus, Goal, Health, Instruction, InstructionReply, ObjectMap, RobotStatus, RuleSet, RulesHeld,
    Truth, topics,
};
use service::{Inbox, Received};
use tokio::sync::{Mutex, MutexGuard};

/// Longest wait for any condition. Generous: it is reached only when something is broken.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// What a stage sees.
#[derive(Clone, Debug)]
pub enum Seen {
    /// What the filter does.
    Filter(FilterStatus),
    /// What the last guard does.
    Robot(RobotStatus),
    /// Where the robot truly is.
    Truth(Truth),
    /// Rules in force.
    Rules(RuleSet),
    /// Which rules a service holds.
    Held(RulesHeld),
    /// A region.
    Object(ObjectMap),
    /// An answer to an instruction.
    Reply(InstructionReply),
    /// A service's health.
    Health(Health),
}

/// One running system with eyes on it. One at a time on a machine: they would starve each other.
pub struct Stage {
    /// The processes.
    pub fleet: Fleet,
    seen: Inbox<Seen>,
    _alone: MutexGuard<'static, ()>,
}

/// The `heedway` binary beside the test's own: `cargo test --workspace` builds both.
///
/// # Errors
/// When it is not there.
pub fn program() -> anyhow::Result<PathBuf> {
    let own = std::env::current_exe().context("path of the test")?;
    let folder = own.parent().and_then(|deps| deps.parent()).context("folder of the binaries")?;
    let program = folder.join("heedway");
    if !program.is_file() {
        bail!("{} is not there: run `cargo test --workspace`, which builds it", program.display());
    }
    Ok(program)
}

/// Where the office scene asks the robot to go.
#[must_use]
pub fn office_goal_map() -> Point2 {
    let scene: serde_json::Value = serde_json::from_str(OFFICE_SCENE).unwrap_or_default();
    let along = |idx: usize| scene["goal"][idx].as_f64().unwrap_or(f64::NAN);
    Point2::new(along(0), along(1))
}

/// Held by whoever runs a whole system: two at a time on a machine would starve each other.
pub fn alone() -> &'static Mutex<()> {
    static ALONE: OnceLock<Mutex<()>> = OnceLock::new();
    ALONE.get_or_init(Mutex::default)
}

impl Stage {
    /// Starts every service over the office scene and waits until all are alive.
    ///
    /// # Errors
    /// When one does not start; its log is in the message.
    pub async fn open() -> anyhow::Result<Stage> {
        Stage::open_with(|_| {}).await
    }

    /// As [`Stage::open`], with other options.
    ///
    /// # Errors
    /// When a service does not start; its log is in the message.
    pub async fn open_with(change: impl FnOnce(&mut FleetOptions)) -> anyhow::Result<Stage> {
        let alone = alone().lock().await;
        let mut options = FleetOptions::office(program()?);
        change(&mut options);
        let mut fleet = Fleet::launch(options).await?;
        fleet.wait_until_alive(PATIENCE).await?;
        let (seen, bus) = (Inbox::new(), fleet.bus().clone());
        bus.subscribe(&topics::FILTER_STATUS, &seen, 64, |r: Received<_>| Seen::Filter(r.message)).await?;
        bus.subscribe(&topics::ROBOT_STATUS, &seen, 64, |r: Received<_>| Seen::Robot(r.message)).await?;
        bus.subscribe(&topics::TRUTH, &seen, 64, |r: Received<_>| Seen::Truth(r.message)).await?;
        bus.subscribe(&topics::RULES, &seen, 64, |r: Received<_>| Seen::Rules(r.message)).await?;
        bus.subscribe(&topics::RULES_HELD, &seen, 64, |r: Received<_>| Seen::Held(r.message)).await?;
        bus.subscribe(&topics::OBJECT_MAP, &seen, 64, |r: Received<_>| Seen::Object(r.message)).await?;
        bus.subscribe(&topics::REPLY, &seen, 64, |r: Received<_>| Seen::Reply(r.message)).await?;
        bus.subscribe(&topics::HEALTH, &seen, 64, |r: Received<_>| Seen::Health(r.message)).await?;
        Ok(Stage { fleet, seen, _alone: alone })
    }

    /// Watches until `condition` holds of something seen; gives what it made of it.
    ///
    /// # Errors
    /// When it does not within [`PATIENCE`], or a service dies that was not told to.
    pub async fn until<T>(
        &mut self,
        what: &str,
        mut condition: impl FnMut(&Seen) -> Option<T>,
    ) -> anyhow::Result<T> {
        let mut last_words = String::new();
        let watching = async {
            loop {
                let seen = self.seen.next().await;
                if let Seen::Filter(status) = &seen {
                    last_words = format!("{} / {}", status.words, status.stop_reason);
                    self.fleet.check()?;
                }
                if let Some(found) = condition(&seen) {
                    return anyhow::Ok(found);
                }
            }
        };
        match tokio::time::timeout(PATIENCE, watching).await {
            Ok(end) => end.with_context(|| format!("until {what}")),
            Err(_) => bail!(
                "not within {} s: {what}; the filter last said {last_words:?}\n{}",
                PATIENCE.as_secs(),
                ServiceName::ALL.iter().map(|s| self.fleet.log_tail(*s)).collect::<Vec<_>>().join("\n")
            ),
        }
    }

    /// Forgets what was seen so far.
    pub fn forget(&mut self) {
        while self.seen.try_next().is_some() {}
    }

    /// Sends the robot somewhere and waits until it moves.
    ///
    /// # Errors
    /// When it does not.
    pub async fn go(&mut self, goal_map: Point2) -> anyhow::Result<()> {
        self.send_to(goal_map).await?;
        self.until_moving().await
    }

    /// Sends the robot somewhere.
    ///
    /// # Errors
    /// When nobody listens.
    pub async fn send_to(&self, goal_map: Point2) -> anyhow::Result<()> {
        let Point2 { coords } = goal_map;
        let goal = Goal { id: "test".into(), x_m: coords.x, y_m: coords.y, tolerance_m: 0.2, cancel: false };
        put_when_heard(self.fleet.bus(), &topics::GOAL, proto::encode(&goal)?, PATIENCE).await
    }

    /// Waits until the robot moves.
    ///
    /// # Errors
    /// When it does not.
    pub async fn until_moving(&mut self) -> anyhow::Result<()> {
        self.forget();
        self.until("the robot moves", |seen| match seen {
            Seen::Truth(truth) if truth.twist.speed_m_s > 0.1 => Some(()),
            _ => None,
        })
        .await
    }

    /// Waits until a restarted service hears what is said.
    ///
    /// # Errors
    /// When it does not come.
    pub async fn until_alive(&mut self, service: ServiceName) -> anyhow::Result<()> {
        self.forget();
        self.until(&format!("{service} tells its health"), |seen| match seen {
            Seen::Health(health) => (health.service == service.as_str()).then_some(()),
            _ => None,
        })
        .await?;
        self.fleet.wait_until_alive(PATIENCE).await
    }

    /// Waits until the robot is truly at rest.
    ///
    /// # Errors
    /// When it goes on.
    pub async fn until_at_rest(&mut self) -> anyhow::Result<Truth> {
        self.until("the robot is at rest", |seen| match seen {
            Seen::Truth(truth)
                if truth.twist.speed_m_s.abs() < 1e-3 && truth.twist.yaw_rate_rad_s.abs() < 1e-2 =>
            {
                Some(truth.clone())
            }
            _ => None,
        })
        .await
    }

    /// Waits until the filter has stopped the robot for a reason that holds all of `words`.
    ///
    /// # Errors
    /// When it does not.
    pub async fn until_stopped_for(&mut self, words: &[&str]) -> anyhow::Result<FilterStatus> {
        self.until(&format!("the filter stops and names {words:?}"), |seen| match seen {
            Seen::Filter(status) if words.iter().all(|word| status.stop_reason.contains(word)) => {
                (!status.stop_reason.is_empty()).then(|| status.clone())
            }
            _ => None,
        })
        .await
    }

    /// Says something as any zenoh client would: plain text on the instruction key.
    ///
    /// # Errors
    /// When no answer comes.
    pub async fn say(&mut self, words: &str) -> anyhow::Result<InstructionReply> {
        put_when_heard(self.fleet.bus(), &topics::INSTRUCTION, words.into(), PATIENCE).await?;
        self.reply_to(words).await
    }

    /// Says something with a handle and a speaker: JSON on the instruction key.
    ///
    /// # Errors
    /// When no answer comes.
    pub async fn say_as(&mut self, instruction: &Instruction) -> anyhow::Result<InstructionReply> {
        let payload = proto::encode(instruction)?;
        put_when_heard(self.fleet.bus(), &topics::INSTRUCTION, payload, PATIENCE).await?;
        self.reply_to(&instruction.text).await
    }

    /// Waits for the reply to some words.
    ///
    /// # Errors
    /// When no answer comes.
    pub async fn reply_to(&mut self, words: &str) -> anyhow::Result<InstructionReply> {
        self.until(&format!("a reply to {words:?}"), |seen| match seen {
            Seen::Reply(reply) if reply.text == words => Some(reply.clone()),
            _ => None,
        })
        .await
    }

    /// Waits until the filter keeps a rule's region.
    ///
    /// # Errors
    /// When it is not grounded.
    pub async fn until_kept(&mut self, rule_id: &str) -> anyhow::Result<()> {
        self.until(&format!("the filter keeps the region of {rule_id}"), |seen| match seen {
            Seen::Filter(status) => {
                status.rules.iter().any(|r| r.id == rule_id && r.grounding.is_usable()).then_some(())
            }
            _ => None,
        })
        .await
    }
}
