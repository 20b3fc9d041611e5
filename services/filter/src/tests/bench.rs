//! A toy robot in an empty room, and everything that would talk to the filter there.
//!
//! Time goes in milliseconds. The plant is integrated here and shares nothing with the filter's rollout.

use std::collections::{BTreeMap, VecDeque};

use geometry::{Point2, Pose2, Profile, Time, Twist};
use proto::{
    BaseMap, CellSet, FilterStatus, GridLayout, Grounding, Header, Invalid, NominalCommand, ObjectMap,
    Odometry, PoseEstimate, PoseQuality, RuleSet, RulesHeld, Scan, SemanticsBeat,
};
use rules::Rule;

use crate::fields::{FieldJob, Fields};
use crate::{FilterDecider, FilterSettings, Heard, Input, Note, Output};

/// Wall clock at the start of the bench.
pub const WALL_NS: u64 = 1_700_000_000_000_000_000;
const MS: u64 = 1_000_000;
/// Where odometry began, in the map.
pub const MAP_FROM_ODOM: Pose2 = Pose2 { x_m: 0.7, y_m: -0.4, yaw_rad: 0.5 };

/// What can be silenced.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Feed {
    Odometry,
    Scan,
    Pose,
    Nominal,
    Beat,
    /// Whether the base takes up commands.
    Uptake,
}

pub struct Bench {
    pub profile: Profile,
    pub decider: FilterDecider,
    pub now_ms: u64,
    pub map_from_base: Pose2,
    pub speed_m_s: f64,
    /// What the nominal policy asks for.
    pub wish: Twist,
    pub map_epoch: u64,
    pub quality: PoseQuality,
    pub status: Option<FilterStatus>,
    pub sent: Twist,
    pub held: Vec<RulesHeld>,
    pub notes: Vec<Note>,
    pub rejected: Vec<(&'static str, Invalid)>,
    /// Jobs that are kept back, to come late.
    pub keep_fields_back: bool,
    pub kept_back: Vec<FieldJob>,
    pub fields: Fields,
    /// Whether semantics says that it cannot look.
    pub blind: bool,
    silent: BTreeMap<Feed, ()>,
    pub last_ms: BTreeMap<Feed, u64>,
    seqs: BTreeMap<&'static str, u64>,
    on_the_way: VecDeque<(u64, Twist)>,
    motors: Twist,
    taken: u64,
    taken_at_ms: u64,
}

pub fn settings(profile: &Profile) -> FilterSettings {
    FilterSettings { n_samples: 10, n_rounds: 1, ..FilterSettings::for_profile(profile) }
}

impl Bench {
    /// A robot that has said nothing yet.
    pub fn silent() -> Self {
        let profile = Profile::sim();
        Bench {
            decider: FilterDecider::new(&settings(&profile), &profile).unwrap(),
            profile,
            now_ms: 1000,
            map_from_base: Pose2::IDENTITY,
            speed_m_s: 0.0,
            wish: Twist::new(0.5, 0.0),
            map_epoch: 1,
            quality: PoseQuality::Good,
            status: None,
            sent: Twist::ZERO,
            held: Vec::new(),
            notes: Vec::new(),
            rejected: Vec::new(),
            keep_fields_back: false,
            kept_back: Vec::new(),
            fields: Fields::default(),
            blind: false,
            silent: BTreeMap::new(),
            last_ms: BTreeMap::new(),
            seqs: BTreeMap::new(),
            on_the_way: VecDeque::new(),
            motors: Twist::ZERO,
            taken: 0,
            taken_at_ms: 0,
        }
    }

    /// A robot that drives through an empty room under an empty rule set.
    pub fn driving() -> Self {
        let mut bench = Bench::silent();
        bench.rules(1, vec![]);
        bench.base_map();
        bench.run(1000);
        assert!(bench.speed_m_s > 0.4, "{:?}", bench.status);
        bench
    }

    pub fn time(&self) -> Time {
        Time::from_nanos(self.now_ms * MS)
    }

    pub fn wall_ns(&self) -> u64 {
        WALL_NS + self.now_ms * MS
    }

    pub fn heard<M>(&self, message: M) -> Heard<M> {
        Heard { message, at: self.time(), wall_ns: self.wall_ns() }
    }

    pub fn header(&mut self, key: &'static str, echo: u64) -> Header {
        let seq = self.seqs.entry(key).or_default();
        *seq += 1;
        Header { seq: *seq, stamp_ns: self.wall_ns(), echo }
    }

    /// The publisher of a key starts over: it counts from 1 again.
    pub fn restart(&mut self, key: &'static str) {
        self.seqs.insert(key, 0);
    }

    /// A new filter, which has heard nothing of all this.
    pub fn start_the_filter_over(&mut self) {
        self.decider = FilterDecider::new(&settings(&self.profile), &self.profile).unwrap();
    }

    pub fn silence(&mut self, feed: Feed) {
        self.silent.insert(feed, ());
    }

    pub fn unsilence(&mut self, feed: Feed) {
        self.silent.remove(&feed);
    }

    pub fn odometry_seq(&self) -> u64 {
        self.seqs.get("odometry").copied().unwrap_or(0)
    }

    pub fn status(&self) -> &FilterStatus {
        self.status.as_ref().unwrap()
    }

    pub fn give(&mut self, input: Input) {
        let mut waiting = VecDeque::from([input]);
        while let Some(input) = waiting.pop_front() {
            for output in self.decider.step(self.time(), input) {
                match output {
                    Output::Command(command) => {
                        assert!(command.twist.is_finite());
                        self.sent = command.twist;
                        if !self.silent.contains_key(&Feed::Uptake) {
                            self.taken = command.header.seq;
                            self.taken_at_ms = self.now_ms;
                            self.on_the_way.push_back((self.now_ms + 20, command.twist));
                        }
                    }
                    Output::Status(status) => self.status = Some(*status),
                    Output::Held(held) => self.held.push(held),
                    Output::ComputeField(job) if self.keep_fields_back => self.kept_back.push(job),
                    Output::ComputeField(job) => {
                        waiting.push_back(Input::FieldReady(self.fields.compute(job)));
                    }
                    Output::Rejected { key, reason } => self.rejected.push((key, reason)),
                    Output::Note(note) => self.notes.push(note),
                }
            }
        }
    }

    pub fn rules(&mut self, version: u64, specs: Vec<Rule>) {
        self.give(Input::Rules(RuleSet { version, specs }));
    }

    /// The room: 12 m square, free, walls all around.
    pub fn base_map(&mut self) {
        let n = 120;
        let is_wall = |i: usize| {
            let (col, row) = (i % n, i / n);
            col == 0 || row == 0 || col == n - 1 || row == n - 1
        };
        let cells = (0..n * n).map(|i| if is_wall(i) { 2 } else { 1 }).collect();
        self.base_map_of(cells);
    }

    pub fn base_map_of(&mut self, cells: Vec<u8>) {
        let layout =
            GridLayout { origin_map: Point2::new(-6.0, -6.0), resolution_m: 0.1, n_cols: 120, n_rows: 120 };
        let header = self.header("base_map", 0);
        let map = BaseMap { header, map_epoch: self.map_epoch, layout, cells };
        let input = Input::BaseMap(self.heard(map));
        self.give(input);
    }

    /// The region of a rule: the square around a place with this half side; none when it is negative.
    pub fn object(&mut self, rule_id: &str, grounding: Grounding, centre: [f64; 2], half_m: f64) {
        let header = self.header("object", 0);
        let region = (half_m >= 0.0).then(|| square(centre, half_m));
        let map = ObjectMap {
            header,
            map_epoch: self.map_epoch,
            rule_id: rule_id.to_owned(),
            grounding,
            region,
            remark: String::new(),
        };
        let input = Input::ObjectMap(self.heard(map));
        self.give(input);
    }

    /// Lets time pass; ticks come each 50 ms, exactly when due.
    pub fn run(&mut self, ms: u64) {
        for _ in 0..ms {
            self.now_ms += 1;
            self.feed();
            if self.now_ms.is_multiple_of(50) {
                self.tick();
            }
        }
    }

    /// One tick, now.
    pub fn tick(&mut self) {
        let input = Input::Tick { due: self.time(), wall_ns: self.wall_ns() };
        self.give(input);
    }

    /// One millisecond of the world, and who talks in it.
    pub fn feed(&mut self) {
        self.move_base();
        let due = |every_ms: u64| self.now_ms.is_multiple_of(every_ms);
        let (fast, turn, command, beat) = (due(20), due(100), due(50), due(300));
        if fast && self.speaks(Feed::Odometry) {
            let odometry = self.odometry();
            let input = Input::Odometry(self.heard(odometry));
            self.give(input);
        }
        if turn && self.speaks(Feed::Scan) {
            let scan = self.scan();
            let input = Input::Scan(self.heard(scan));
            self.give(input);
        }
        if turn && self.speaks(Feed::Pose) {
            let pose = self.pose();
            let input = Input::Pose(self.heard(pose));
            self.give(input);
        }
        if command && self.speaks(Feed::Nominal) {
            let header = self.header("nominal", self.odometry_seq());
            let input = Input::Nominal(self.heard(NominalCommand { header, twist: self.wish }));
            self.give(input);
        }
        if beat && self.speaks(Feed::Beat) {
            let header = self.header("beat", self.odometry_seq());
            let beat = SemanticsBeat {
                header,
                rules_version: 1,
                n_frames: 1,
                n_frames_dropped: 0,
                is_blind: self.blind,
                trouble: String::new(),
            };
            let input = Input::SemanticsBeat(self.heard(beat));
            self.give(input);
        }
    }

    fn speaks(&mut self, feed: Feed) -> bool {
        if self.silent.contains_key(&feed) {
            return false;
        }
        self.last_ms.insert(feed, self.now_ms);
        true
    }

    pub fn odometry(&mut self) -> Odometry {
        let echo = self.taken;
        let header = self.header("odometry", echo);
        let twist = Twist::new(self.speed_m_s, self.motors.yaw_rate_rad_s);
        let odom_from_base = MAP_FROM_ODOM.inverse() * self.map_from_base;
        Odometry { header, odom_from_base, twist, fault: None }
    }

    pub fn scan(&mut self) -> Scan {
        Scan {
            header: self.header("scan", 0),
            angle_min_rad: 0.0,
            angle_step_rad: 0.1,
            duration_s: 0.0,
            range_m_min: 0.1,
            range_m_max: 10.0,
            ranges_m: vec![f32::INFINITY; 60],
        }
    }

    pub fn pose(&mut self) -> PoseEstimate {
        // A localisation that began anew and is lost knows no last good pose.
        let is_lost = self.quality == PoseQuality::Lost;
        PoseEstimate {
            header: self.header("pose", 0),
            map_epoch: self.map_epoch,
            map_from_odom: if is_lost { Pose2::IDENTITY } else { MAP_FROM_ODOM },
            quality: self.quality,
        }
    }

    fn move_base(&mut self) {
        while self.on_the_way.front().is_some_and(|(at_ms, _)| *at_ms <= self.now_ms) {
            self.motors = self.on_the_way.pop_front().map_or(Twist::ZERO, |(_, twist)| twist);
        }
        // The guard before the motors: a command holds for 150 ms.
        if self.now_ms - self.taken_at_ms > 150 {
            self.motors = Twist::ZERO;
        }
        let step_m_s = self.profile.accel_m_s2_max * 1e-3;
        self.speed_m_s += (self.motors.speed_m_s - self.speed_m_s).clamp(-step_m_s, step_m_s);
        self.map_from_base = self.map_from_base.along_arc(self.speed_m_s, self.motors.yaw_rate_rad_s, 1e-3);
    }
}

/// Every cell that a square touches.
pub fn square(centre: [f64; 2], half_m: f64) -> CellSet {
    let layout =
        GridLayout { origin_map: Point2::new(-5.0, -5.0), resolution_m: 0.05, n_cols: 200, n_rows: 200 };
    let cells: Vec<bool> = (0..40_000)
        .map(|i| {
            let (x, y) = (-4.975 + 0.05 * (i % 200) as f64, -4.975 + 0.05 * (i / 200) as f64);
            let reach_m = half_m + 0.025;
            (x - centre[0]).abs() < reach_m && (y - centre[1]).abs() < reach_m
        })
        .collect();
    CellSet::pack(layout, &cells)
}
