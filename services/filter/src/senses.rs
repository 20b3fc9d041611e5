//! What was heard of the robot and its surroundings, how old it is, and what it says together.
//!
//! Base maps are taken as they come, in order: unknown cells are obstacles, so the emptier map of a
//! restarted localisation closes room and never opens it. What the camera saw is kept over a restart of
//! perception until the new run has seen about as much.

use std::collections::VecDeque;
use std::time::Duration;

use control::{BaseLayer, State, World};
use geometry::{Point2, Pose2, Profile, Time, Twist};
use proto::{
    BaseMap, CellSet, DepthObstacles, GridLayout, Grounding, InputAge, Invalid, NominalCommand, Odometry,
    PoseEstimate, PoseQuality, Scan, SemanticsBeat,
};

use crate::ages::AgeLimits;
use crate::fields::{FieldCells, FieldJob, FieldReady, FieldTag, LayerId, Zone};
use crate::gate::{BaseMapState, Facts, Reason};
use crate::heard::{Heard, Order, Thread};
use crate::motion::Motion;
use crate::rule_layers::Kept;

/// Commands remembered until the base has taken them up: 50 s at 20 Hz.
const N_COMMANDS_KEPT: usize = 1024;

/// The hits of the last turn of the LiDAR, in `odom`.
#[derive(Debug)]
struct Hits {
    at: Time,
    stamp_ns: u64,
    points_odom: Vec<Point2>,
}

/// Everything heard but the rules.
pub(crate) struct Senses {
    profile: Profile,
    limits: AgeLimits,
    /// Farthest that any plan goes, metres.
    reach_m: f64,
    motion: Motion,
    hits: Option<Hits>,
    nominal: Option<Heard<NominalCommand>>,
    pose: Option<Heard<PoseEstimate>>,
    beat: Option<Heard<SemanticsBeat>>,
    base: Option<(u64, Zone)>,
    depth: Option<Kept>,
    n_depth_runs: u64,
    threads: Threads,
    /// Commands that the base has not taken up yet, oldest first.
    sent: VecDeque<(u64, Time)>,
    last_sent: u64,
}

#[derive(Debug, Default)]
struct Threads {
    scan: Thread,
    nominal: Thread,
    pose: Thread,
    base_map: Thread,
    depth: Thread,
    beat: Thread,
}

impl Senses {
    /// Nothing heard yet.
    pub(crate) fn new(profile: &Profile, limits: AgeLimits, reach_m: f64) -> Self {
        Senses {
            profile: profile.clone(),
            limits,
            reach_m,
            motion: Motion::default(),
            hits: None,
            nominal: None,
            pose: None,
            beat: None,
            base: None,
            depth: None,
            n_depth_runs: 0,
            threads: Threads::default(),
            sent: VecDeque::new(),
            last_sent: 0,
        }
    }

    // What follows takes one message in: it answers with the field to compute, or with why it is refused.

    pub(crate) fn odometry(&mut self, heard: Heard<Odometry>) -> Result<Option<FieldJob>, Invalid> {
        let had_any = self.motion.newest().is_some();
        let (at, echo) = (heard.at, heard.message.header.echo);
        match self.motion.take(heard) {
            Order::Old => return Ok(None),
            Order::NewRun if had_any => {
                // The odometry frame may have moved: what was told in it is void.
                self.hits = None;
                self.pose = None;
                self.nominal = None;
            }
            Order::NewRun | Order::Next => {}
        }
        // An echo above the last command is of a filter before this one.
        if echo <= self.last_sent {
            while self.sent.front().is_some_and(|(seq, sent_at)| *seq <= echo && *sent_at <= at) {
                self.sent.pop_front();
            }
        }
        Ok(None)
    }

    pub(crate) fn scan(&mut self, heard: Heard<Scan>) -> Result<Option<FieldJob>, Invalid> {
        let points_odom = self.motion.hits_odom(&heard.message, &self.profile.lidar)?;
        if self.threads.scan.follow(heard.message.header, heard.at) != Order::Old {
            let taken_ns = Duration::from_secs_f64(heard.message.duration_s).as_nanos() as u64;
            let stamp_ns = heard.message.header.stamp_ns.saturating_add(taken_ns);
            self.hits = Some(Hits { at: heard.at, stamp_ns, points_odom });
        }
        Ok(None)
    }

    pub(crate) fn nominal(&mut self, heard: Heard<NominalCommand>) -> Result<Option<FieldJob>, Invalid> {
        if self.threads.nominal.follow(heard.message.header, heard.at) != Order::Old {
            self.nominal = Some(heard);
        }
        Ok(None)
    }

    pub(crate) fn pose(&mut self, mut heard: Heard<PoseEstimate>) -> Result<Option<FieldJob>, Invalid> {
        let stamp_ns = heard.message.header.stamp_ns;
        match self.motion.oldest_stamp_ns() {
            // A pose from before this run of the odometry speaks of another `odom`.
            Some(first_ns) if stamp_ns < first_ns => {
                return Err(Invalid::new("stamp_ns", stamp_ns, format_args!("{first_ns} or later")));
            }
            None => return Err(Invalid::new("stamp_ns", stamp_ns, "within the odometry that was heard")),
            Some(_) => {}
        }
        let is_old = self.threads.pose.follow(heard.message.header, heard.at) == Order::Old;
        // In doubt it goes by odometry from the last good pose, until that is too old.
        if !is_old && heard.message.quality != PoseQuality::Uncertain {
            // Where a lost robot brakes is where the last good pose says.
            if let Some(last) = &self.pose
                && heard.message.quality == PoseQuality::Lost
            {
                heard.message.map_from_odom = last.message.map_from_odom;
            }
            self.pose = Some(heard);
        }
        Ok(None)
    }

    pub(crate) fn base_map(&mut self, heard: Heard<BaseMap>) -> Result<Option<FieldJob>, Invalid> {
        if self.threads.base_map.follow(heard.message.header, heard.at) == Order::Old {
            return Ok(None);
        }
        let tag = tag(LayerId::Base, heard.message.map_epoch, 0);
        let job = FieldJob { tag, cells: FieldCells::Base(heard.message), room_m: 0.0 };
        Ok(Some(job))
    }

    pub(crate) fn depth_obstacles(
        &mut self,
        heard: Heard<DepthObstacles>,
    ) -> Result<Option<FieldJob>, Invalid> {
        let order = self.threads.depth.follow(heard.message.header, heard.at);
        if order == Order::Old {
            return Ok(None);
        }
        self.n_depth_runs += u64::from(order == Order::NewRun);
        let tag = tag(LayerId::Depth, heard.message.map_epoch, self.n_depth_runs);
        // An empty set goes the same way: it must not overtake a field still being computed.
        let cells = heard.message.cells.unwrap_or_else(empty_set);
        Ok(Some(FieldJob { tag, cells: FieldCells::Set(cells), room_m: self.reach_m + 2.0 }))
    }

    pub(crate) fn semantics_beat(
        &mut self,
        heard: Heard<SemanticsBeat>,
    ) -> Result<Option<FieldJob>, Invalid> {
        let order = self.threads.beat.follow(heard.message.header, heard.at);
        // Who beats and cannot look proves nothing: the last beat of one who could grows old.
        if order != Order::Old && !heard.message.is_blind {
            self.beat = Some(heard);
        }
        Ok(None)
    }

    pub(crate) fn base_ready(&mut self, ready: FieldReady) -> Result<(), Invalid> {
        let zone = ready.zone.map_err(|e| Invalid::new("layout", e, "a grid that can be"))?;
        if let Some(zone) = zone {
            self.base = Some((ready.tag.map_epoch, zone));
        }
        Ok(())
    }

    pub(crate) fn depth_ready(&mut self, ready: FieldReady) -> Result<(), Invalid> {
        let zone = ready.zone.map_err(|e| Invalid::new("layout", e, "a grid that can be"))?;
        self.depth = match (self.depth.take(), zone) {
            (kept, Some(zone)) => Some(Kept::after(kept, &ready.tag, zone)),
            // Nothing seen: the same run has looked and cleared it; another run has not looked yet.
            (kept, None) => kept.and_then(|kept| kept.after_nothing(&ready.tag)),
        };
        Ok(())
    }

    /// What is asked of the filter: the nominal command, or its ramp to zero once it is stale, and why.
    pub(crate) fn wanted(&self, now: Time) -> (Twist, Option<Reason>) {
        let limit = self.limits.nominal;
        let age = self.nominal_age(now);
        let stale = Reason::of_age("nominal command", age, limit);
        let twist = self.nominal.as_ref().map_or(Twist::ZERO, |heard| heard.message.twist);
        let (Some(_), Some(age)) = (&stale, age) else {
            return (if stale.is_some() { Twist::ZERO } else { twist }, stale);
        };
        let ramping_s = age.saturating_sub(limit).as_secs_f64();
        let left_m_s = twist.speed_m_s.abs() - self.profile.accel_m_s2_max * ramping_s;
        if left_m_s <= 0.0 {
            return (Twist::ZERO, stale);
        }
        let share = left_m_s / twist.speed_m_s.abs();
        (Twist::new(twist.speed_m_s * share, twist.yaw_rate_rad_s * share), stale)
    }

    /// Age of the wish: since its receipt, and since the odometry it was made from, if it names one.
    fn nominal_age(&self, now: Time) -> Option<Duration> {
        let heard = self.nominal.as_ref()?;
        let received = now.since(heard.at);
        // Made without odometry, by hand say, there is only its receipt.
        let thought = self.motion.age_of_echo(heard.message.header.echo, now).unwrap_or_default();
        Some(received.max(thought))
    }

    /// Age of the semantics' beat, zero while no rule speaks of an object.
    fn semantics_age(&self, now: Time, objects_since: Option<Time>) -> Duration {
        let Some(since) = objects_since else { return Duration::ZERO };
        let Some(heard) = &self.beat else { return now.since(since) };
        let thought = self.motion.age_of_echo(heard.message.header.echo, now).unwrap_or_default();
        // Rules that have just come give semantics time to beat for them.
        now.since(heard.at).max(thought).min(now.since(since))
    }

    /// What the gate judges. `objects_since` is the time since when rules speak of objects.
    pub(crate) fn facts(&self, now: Time, objects_since: Option<Time>, has_rules: bool) -> Facts {
        let odometry = self.motion.newest();
        let by_stamp = |at: Time, stamp_ns: u64| now.since(at).max(self.motion.age_by_stamp(stamp_ns, now));
        let pose = self.pose.as_ref();
        Facts {
            odometry: odometry.map(|(_, at)| now.since(at)),
            fault: odometry.and_then(|(odometry, _)| odometry.fault),
            round_trip: self.sent.front().map_or(Duration::ZERO, |(_, at)| now.since(*at)),
            scan: self.hits.as_ref().map(|hits| by_stamp(hits.at, hits.stamp_ns)),
            pose: pose.map(|heard| by_stamp(heard.at, heard.message.header.stamp_ns)),
            is_lost: pose.is_some_and(|heard| heard.message.quality == PoseQuality::Lost),
            base_map: match (&self.base, self.map_epoch()) {
                (None, _) => BaseMapState::Missing,
                (Some((map, _)), Some(pose)) if *map != pose => BaseMapState::OtherEpoch { map: *map, pose },
                (Some(_), _) => BaseMapState::Usable,
            },
            has_rules,
            semantics: self.semantics_age(now, objects_since),
        }
    }

    pub(crate) fn map_epoch(&self) -> Option<u64> {
        self.pose.as_ref().map(|heard| heard.message.map_epoch)
    }

    /// The state now, and where `odom` lies in `map`.
    pub(crate) fn state(&self, now: Time) -> Option<(State, Pose2)> {
        let map_from_odom = self.pose.as_ref()?.message.map_from_odom;
        let (odometry, _) = self.motion.newest()?;
        let map_from_base = map_from_odom * self.motion.odom_from_base_now(now)?;
        Some((State::new(map_from_base, odometry.twist.speed_m_s), map_from_odom))
    }

    /// Obstacles around a place.
    pub(crate) fn world(&self, place: Point2, map_from_odom: Pose2) -> World {
        let layer = |name: &str, zone: &Zone| BaseLayer { name: name.to_owned(), field: zone.field.clone() };
        let mut base: Vec<BaseLayer> =
            self.base.iter().map(|(_, zone)| layer("a wall or something unknown", zone)).collect();
        let depth = self.depth.iter().filter(|kept| Some(kept.map_epoch) == self.map_epoch());
        for zone in depth.flat_map(Kept::zones).filter(|zone| zone.is_within_reach(place)) {
            base.push(layer("something seen in depth", zone));
        }
        let points_odom = self.hits.iter().flat_map(|hits| &hits.points_odom);
        let points = points_odom
            .map(|hit_odom| map_from_odom.transform(*hit_odom))
            .filter(|hit| (hit - place).norm() <= self.reach_m)
            .collect();
        World { base, points, rules: Vec::new() }
    }

    /// What was asked for last.
    pub(crate) fn nominal_twist(&self) -> Option<Twist> {
        self.nominal.as_ref().map(|heard| heard.message.twist)
    }

    /// The ages of all inputs, for the status.
    pub(crate) fn ages_ms(&self, now: Time, facts: &Facts) -> Vec<InputAge> {
        let age = |input: &str, age: Option<Duration>| InputAge {
            input: input.to_owned(),
            age_ms: age.map(|age| u64::try_from(age.as_millis()).unwrap_or(u64::MAX)),
        };
        vec![
            age("odometry", facts.odometry),
            age("scan", facts.scan),
            age("pose", facts.pose),
            age("nominal command", self.nominal_age(now)),
            age("semantics", self.beat.as_ref().map(|heard| now.since(heard.at))),
            age("command not taken up", Some(facts.round_trip)),
        ]
    }

    /// Notes that a command leaves now; gives the number of the odometry that it answers, 0 for none.
    pub(crate) fn command_sent(&mut self, seq: u64, now: Time) -> u64 {
        if self.sent.len() == N_COMMANDS_KEPT {
            self.sent.pop_front();
        }
        self.sent.push_back((seq, now));
        self.last_sent = seq;
        self.motion.newest().map_or(0, |(odometry, _)| odometry.header.seq)
    }
}

fn tag(layer: LayerId, map_epoch: u64, run: u64) -> FieldTag {
    FieldTag { layer, map_epoch, run, grounding: Grounding::NotNeeded }
}

fn empty_set() -> CellSet {
    let layout = GridLayout { origin_map: Point2::origin(), resolution_m: 0.1, n_cols: 1, n_rows: 1 };
    CellSet::pack(layout, &[false])
}
