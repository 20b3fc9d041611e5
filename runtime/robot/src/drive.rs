//! The loop that drives a robot: bus → keeper → motors, and senses → bus, a hundred times a second.

use std::time::Duration;

use anyhow::Context;
use envelope::{Envelope, EnvelopeLimits};
use geometry::{Profile, Time, Twist};
use proto::{Header, Invalid, Odometry, RgbdFrame, RobotStatus, SafeCommand, Scan, topics};
use serde::{Deserialize, Serialize};
use service::{Counters, Inbox, Life, Publisher, Received, Slot};

use crate::keeper::{Keeper, Kept};
use crate::robot::{Robot, Senses};

/// How fast the loop turns.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DriveSettings {
    /// Turns of the loop per second: the motors get a set-point at each.
    pub turn_rate_hz: f64,
}

impl DriveSettings {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`Invalid`] names the key, the value and the limit.
    pub fn check(&self) -> Result<(), Invalid> {
        proto::codec::within("drive.turn_rate_hz", self.turn_rate_hz, 20.0, 1000.0)
    }
}

/// The envelope of a robot: its profile's limits, and the age limit of the topic table.
///
/// # Errors
/// When the profile's limits are none.
pub fn envelope_of(profile: &Profile) -> anyhow::Result<Envelope> {
    Envelope::new(EnvelopeLimits {
        speed_m_s_max: profile.speed_m_s_max,
        // Reverse is never planned; a bounded reverse after a bump is a robot's own affair.
        reverse_m_s_max: 0.0,
        yaw_rate_rad_s_max: profile.yaw_rate_rad_s_max,
        // The base limits its own turning; the profile knows no limit.
        yaw_accel_rad_s2_max: f64::INFINITY,
        accel_m_s2_max: profile.accel_m_s2_max,
        command_age_max: topics::SAFE.age_max.context("the safe command has an age limit")?,
    })
    .map_err(|e| anyhow::anyhow!("{e}"))
}

/// Drives a robot until the process is asked to stop; then, and on any error, the motors get zero.
///
/// # Errors
/// When the bus cannot be reached or the robot cannot be brought to rest.
pub async fn drive<R: Robot>(life: &Life, mut robot: R, settings: DriveSettings) -> anyhow::Result<()> {
    let end = turn_until_stopped(life, &mut robot, settings).await;
    robot.actuate(life.clock.now(), Twist::ZERO).context("bring the robot to rest")?;
    end
}

async fn turn_until_stopped<R: Robot>(
    life: &Life,
    robot: &mut R,
    settings: DriveSettings,
) -> anyhow::Result<()> {
    let inbox: Inbox<Received<SafeCommand>> = Inbox::new();
    life.bus.subscribe(&topics::SAFE, &inbox, 4, |command| command).await?;
    let mut outlets = Outlets::open(life).await?;
    let mut keeper = Keeper::new(envelope_of(&life.profile)?);
    let mut turns = tokio::time::interval(Duration::from_secs_f64(1.0 / settings.turn_rate_hz));
    turns.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Skip);
    let mut fault = None;
    loop {
        tokio::select! {
            biased;
            () = life.stopped() => return Ok(()),
            _ = turns.tick() => {}
        }
        while let Some(received) = inbox.try_next() {
            if let Err(e) = keeper.take(&received.message, received.at, life.clock.stamp_ns()) {
                life.counters.rejected(topics::SAFE.key, &e.to_string());
            }
        }
        let now = life.clock.now();
        let kept = match robot.sense(now) {
            Ok(senses) => {
                // A fault lasts until the base says that it is over.
                fault = senses.base.map_or(fault, |base| base.fault);
                outlets.publish(senses, &mut keeper, now)?;
                keeper.motors(now, fault)
            }
            Err(e) => unanswered(&format!("robot does not answer: {e:#}")),
        };
        let kept = match robot.actuate(now, kept.command) {
            Ok(()) => kept,
            Err(e) => unanswered(&format!("motors do not answer: {e:#}")),
        };
        outlets.report(now, &kept)?;
    }
}

fn unanswered(reason: &str) -> Kept {
    Kept { command: Twist::ZERO, reason: reason.to_owned(), stopped: true }
}

/// Where the loop publishes to.
struct Outlets {
    odometry: Publisher<Odometry>,
    scan: Publisher<Scan>,
    status: Publisher<RobotStatus>,
    frames: Slot<RgbdFrame>,
    counters: Counters,
    odometry_seq: u64,
    scan_seq: u64,
    frame_seq: u64,
    reported: Option<(Time, String)>,
    n_interventions: u64,
}

/// Longest time between two reports of the guard.
const REPORT_PERIOD: Duration = Duration::from_millis(200);

impl Outlets {
    async fn open(life: &Life) -> anyhow::Result<Self> {
        // Images are encoded on a task of their own: the motors do not wait for a megabyte.
        let waiting: Inbox<RgbdFrame> = Inbox::new();
        let frames = waiting.slot(1);
        let publisher = life.bus.publisher::<RgbdFrame>(&topics::RGBD).await?;
        tokio::spawn(async move {
            loop {
                let frame = waiting.next().await;
                if let Err(e) = publisher.put(&frame) {
                    tracing::warn!(error = format!("{e:#}"), "frame not published");
                }
            }
        });
        Ok(Outlets {
            odometry: life.bus.publisher(&topics::ODOMETRY).await?,
            scan: life.bus.publisher(&topics::SCAN).await?,
            status: life.bus.publisher(&topics::ROBOT_STATUS).await?,
            frames,
            counters: life.counters.clone(),
            odometry_seq: 0,
            scan_seq: 0,
            frame_seq: 0,
            reported: None,
            n_interventions: 0,
        })
    }

    fn publish(&mut self, senses: Senses, keeper: &mut Keeper, now: Time) -> anyhow::Result<()> {
        let echo = keeper.last_seq();
        if let Some(base) = senses.base {
            self.odometry_seq += 1;
            self.odometry.put(&Odometry {
                header: Header { seq: self.odometry_seq, stamp_ns: base.stamp_ns, echo },
                odom_from_base: base.odom_from_base,
                twist: base.twist,
                fault: base.fault,
            })?;
            keeper.odometry_sent(self.odometry_seq, now);
        }
        for mut scan in senses.scans {
            self.scan_seq += 1;
            scan.header = Header { seq: self.scan_seq, echo, ..scan.header };
            self.scan.put(&scan)?;
        }
        for mut frame in senses.frames {
            // A frame keeps a sequence number of its own robot: model hosts know it by that.
            self.frame_seq = frame.header.seq.max(self.frame_seq + 1);
            frame.header = Header { seq: self.frame_seq, echo, ..frame.header };
            if self.frames.push(frame) {
                self.counters.dropped(topics::RGBD.key);
            }
        }
        Ok(())
    }

    /// Publishes what the guard does: at each change, and a few times a second.
    fn report(&mut self, now: Time, kept: &Kept) -> anyhow::Result<()> {
        // Digits are left out of the comparison: an age that grows is no change.
        let gist: String = kept.reason.chars().filter(|c| !c.is_ascii_digit()).collect();
        let changed = self.reported.as_ref().is_none_or(|(_, last)| *last != gist);
        if changed {
            if kept.reason.is_empty() {
                tracing::info!("guard lets commands pass");
            } else {
                self.n_interventions += 1;
                tracing::info!(reason = kept.reason, stopped = kept.stopped, "guard steps in");
            }
        }
        if !changed && self.reported.as_ref().is_some_and(|(at, _)| now.since(*at) < REPORT_PERIOD) {
            return Ok(());
        }
        self.reported = Some((now, gist));
        self.status.put(&RobotStatus {
            applied: kept.command,
            stopped: kept.stopped,
            reason: kept.reason.clone(),
            n_interventions: self.n_interventions,
        })
    }
}
