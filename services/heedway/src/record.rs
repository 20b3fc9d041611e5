//! `heedway record`: what a robot sees, finds and does, into an MCAP file.

use std::fs::File;
use std::io::BufWriter;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, bail};
use clap::Args;
use geometry::Profile;
use proto::topics;
use proto::{
    BaseMap, DepthObstacles, FilterStatus, InstructionReply, NavigatorStatus, ObjectMap, Odometry,
    PoseEstimate, RgbdFrame, RuleSet, Scan,
};
use service::{Bus, Clock, Inbox};

use crate::connection::{PATIENCE, Reach};
use crate::recording::{Heard, Recorder};

/// Arguments of `heedway record`.
#[derive(Args, Debug)]
pub struct Arguments {
    #[command(flatten)]
    reach: Reach,
    /// The file, usually ending in `.mcap`.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// The robot's profile; the simulated robot's when not given.
    #[arg(long, value_name = "FILE")]
    profile: Option<PathBuf>,
    /// Ends after so many seconds; else with Ctrl-C.
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
}

/// One message from the network.
enum Message {
    Frame(RgbdFrame),
    Scan(Scan),
    Odometry(Odometry),
    Pose(PoseEstimate),
    BaseMap(BaseMap),
    DepthObstacles(DepthObstacles),
    ObjectMap(ObjectMap),
    Navigator(NavigatorStatus),
    Rules(RuleSet),
    Reply(InstructionReply),
    Filter(FilterStatus),
}

impl Message {
    fn heard(&self) -> Heard<'_> {
        match self {
            Message::Frame(m) => Heard::Frame(m),
            Message::Scan(m) => Heard::Scan(m),
            Message::Odometry(m) => Heard::Odometry(m),
            Message::Pose(m) => Heard::Pose(m),
            Message::BaseMap(m) => Heard::BaseMap(m),
            Message::DepthObstacles(m) => Heard::DepthObstacles(m),
            Message::ObjectMap(m) => Heard::ObjectMap(m),
            Message::Navigator(m) => Heard::Navigator(m),
            Message::Rules(m) => Heard::Rules(m),
            Message::Reply(m) => Heard::Reply(m),
            Message::Filter(m) => Heard::Filter(m),
        }
    }
}

/// Records until Ctrl-C or the time is over; the file is whole in either case.
///
/// # Errors
/// When nobody is reached, nothing is heard for [`PATIENCE`], or the file cannot be written.
pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let profile = read_profile(&arguments)?;
    let seconds = match arguments.seconds {
        Some(s) if !(s > 0.0 && s <= 1e6) => bail!("--seconds is {s}, must be above 0 and at most 1000000"),
        seconds => seconds,
    };
    let bus = arguments.reach.open().await?;
    let inbox = Inbox::new();
    listen(&bus, &inbox).await?;
    let Ok(first) = tokio::time::timeout(PATIENCE, inbox.next()).await else {
        bail!("nothing heard of robot {:?} within {} s", arguments.reach.robot, PATIENCE.as_secs());
    };
    let file = File::create(&arguments.out)
        .with_context(|| format!("create {} (--out)", arguments.out.display()))?;
    let mut recorder = Recorder::new(BufWriter::new(file), &profile)?;
    let clock = Clock::start();
    recorder.hear(clock.stamp_ns(), first.heard())?;
    let mut n_messages = 1_u64;
    let over = async {
        match seconds {
            Some(s) => tokio::time::sleep(Duration::from_secs_f64(s)).await,
            None => std::future::pending().await,
        }
    };
    tokio::pin!(over);
    loop {
        tokio::select! {
            message = inbox.next() => {
                recorder.hear(clock.stamp_ns(), message.heard())?;
                n_messages += 1;
            }
            () = &mut over => break,
            end = tokio::signal::ctrl_c() => { end?; break }
        }
    }
    recorder.finish()?;
    eprintln!("{n_messages} messages in {}", arguments.out.display());
    Ok(ExitCode::SUCCESS)
}

fn read_profile(arguments: &Arguments) -> anyhow::Result<Profile> {
    let Some(file) = &arguments.profile else { return Ok(crate::fleet::profile()) };
    let named = || format!("profile {}", file.display());
    let text = std::fs::read_to_string(file).with_context(named)?;
    let profile: Profile = toml::from_str(&text).with_context(named)?;
    profile.checked().with_context(named)
}

async fn listen(bus: &Bus, inbox: &Inbox<Message>) -> anyhow::Result<()> {
    bus.subscribe(&topics::RGBD, inbox, 2, |r| Message::Frame(r.message)).await?;
    bus.subscribe(&topics::SCAN, inbox, 8, |r| Message::Scan(r.message)).await?;
    bus.subscribe(&topics::ODOMETRY, inbox, 64, |r| Message::Odometry(r.message)).await?;
    bus.subscribe(&topics::POSE, inbox, 16, |r| Message::Pose(r.message)).await?;
    bus.subscribe(&topics::BASE_MAP, inbox, 2, |r| Message::BaseMap(r.message)).await?;
    bus.subscribe(&topics::DEPTH_OBSTACLES, inbox, 2, |r| Message::DepthObstacles(r.message)).await?;
    bus.subscribe(&topics::OBJECT_MAP, inbox, 32, |r| Message::ObjectMap(r.message)).await?;
    bus.subscribe(&topics::NAVIGATOR_STATUS, inbox, 4, |r| Message::Navigator(r.message)).await?;
    bus.subscribe(&topics::RULES, inbox, 4, |r| Message::Rules(r.message)).await?;
    bus.subscribe(&topics::REPLY, inbox, 16, |r| Message::Reply(r.message)).await?;
    bus.subscribe(&topics::FILTER_STATUS, inbox, 64, |r| Message::Filter(r.message)).await
}
