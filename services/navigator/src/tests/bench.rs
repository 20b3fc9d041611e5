//! A toy robot that does at once what the navigator wants, within its acceleration, in a room of boxes.

use std::collections::VecDeque;

use geometry::{Point2, Pose2, Profile, Time, Twist};
use proto::{
    BaseMap, CellSet, Goal, GridLayout, Grounding, Header, NavigatorStatus, NominalCommand, ObjectMap,
    Odometry, PoseEstimate, PoseQuality, RuleSet,
};
use rules::Rule;

use crate::config::{NavigatorSettings, Planner};
use crate::plan::{PlanJob, make};
use crate::{Input, NavigatorDecider, Output};

pub const WALL_NS: u64 = 1_700_000_000_000_000_000;
const SIDE_M: f64 = 0.05;
const N_SIDE: usize = 160;

pub struct Bench {
    pub profile: Profile,
    pub decider: NavigatorDecider,
    pub now_ms: u64,
    pub map_from_base: Pose2,
    pub speed_m_s: f64,
    pub command: Option<NominalCommand>,
    pub n_commands: u64,
    pub status: Option<NavigatorStatus>,
    pub quality: PoseQuality,
    pub map_epoch: u64,
    pub odometry_speaks: bool,
    pub pose_speaks: bool,
    pub keep_plans_back: bool,
    pub kept_back: Vec<PlanJob>,
    /// Commands are not followed while false.
    pub obeys: bool,
    seq: u64,
}

/// An axis-aligned box: low corner, high corner.
pub type Box2 = ([f64; 2], [f64; 2]);

pub fn centre_of(i: usize) -> [f64; 2] {
    let at = |k: usize| -4.0 + SIDE_M * (k as f64 + 0.5);
    [at(i % N_SIDE), at(i / N_SIDE)]
}

fn layout() -> GridLayout {
    let n = N_SIDE as u32;
    GridLayout { origin_map: Point2::new(-4.0, -4.0), resolution_m: SIDE_M, n_cols: n, n_rows: n }
}

fn is_in((low, high): &Box2, [x, y]: [f64; 2]) -> bool {
    (low[0]..=high[0]).contains(&x) && (low[1]..=high[1]).contains(&y)
}

/// Distance from a place to a box, metres.
pub fn away_m((low, high): &Box2, place: Point2) -> f64 {
    let beyond = |v: f64, low: f64, high: f64| (low - v).max(v - high).max(0.0);
    beyond(place.x, low[0], high[0]).hypot(beyond(place.y, low[1], high[1]))
}

impl Bench {
    pub fn new(planner: Planner) -> Self {
        let profile = Profile::sim();
        let settings = NavigatorSettings { planner, ..NavigatorSettings::default() };
        Bench {
            decider: NavigatorDecider::new(&settings, &profile),
            profile,
            now_ms: 1000,
            map_from_base: Pose2::new(-3.0, 0.0, 0.0),
            speed_m_s: 0.0,
            command: None,
            n_commands: 0,
            status: None,
            quality: PoseQuality::Good,
            map_epoch: 1,
            odometry_speaks: true,
            pose_speaks: true,
            keep_plans_back: false,
            kept_back: Vec::new(),
            obeys: true,
            seq: 0,
        }
    }

    pub fn time(&self) -> Time {
        Time::from_nanos(self.now_ms * 1_000_000)
    }

    pub fn header(&mut self) -> Header {
        self.seq += 1;
        Header { seq: self.seq, stamp_ns: WALL_NS + self.now_ms * 1_000_000, echo: 0 }
    }

    pub fn give(&mut self, input: Input) {
        let mut waiting = VecDeque::from([input]);
        while let Some(input) = waiting.pop_front() {
            for output in self.decider.step(self.time(), input) {
                match output {
                    Output::Command(command) => {
                        assert!(command.twist.is_finite());
                        self.command = Some(command);
                        self.n_commands += 1;
                    }
                    Output::Status(status) => self.status = Some(status),
                    Output::Plan(job) if self.keep_plans_back => self.kept_back.push(*job),
                    Output::Plan(job) => waiting.push_back(Input::PlanReady(make(&job, &self.profile))),
                    Output::Changed { .. } => {}
                }
            }
        }
    }

    pub fn room(&mut self, boxes: &[Box2]) {
        let wall = |i: usize| {
            let (col, row) = (i % N_SIDE, i / N_SIDE);
            col == 0 || row == 0 || col == N_SIDE - 1 || row == N_SIDE - 1
        };
        let is_solid = |i: usize| wall(i) || boxes.iter().any(|b| is_in(b, centre_of(i)));
        let cells = (0..N_SIDE * N_SIDE).map(|i| if is_solid(i) { 2 } else { 1 }).collect();
        let header = self.header();
        self.give(Input::BaseMap(BaseMap { header, map_epoch: self.map_epoch, layout: layout(), cells }));
    }

    pub fn cells(region: &Box2) -> CellSet {
        let cells: Vec<bool> = (0..N_SIDE * N_SIDE).map(|i| is_in(region, centre_of(i))).collect();
        CellSet::pack(layout(), &cells)
    }

    pub fn rule(&mut self, rule: Rule, region: &Box2) {
        let header = self.header();
        let map = ObjectMap {
            header,
            map_epoch: self.map_epoch,
            rule_id: rule.id.clone(),
            grounding: Grounding::Grounded,
            region: Some(Self::cells(region)),
            remark: String::new(),
        };
        self.give(Input::Rules(RuleSet { version: 1, specs: vec![rule] }));
        self.give(Input::ObjectMap(map));
    }

    pub fn goal(&mut self, x_m: f64, y_m: f64) {
        self.give(Input::Goal(Goal { id: String::new(), x_m, y_m, tolerance_m: 0.2, cancel: false }));
    }

    pub fn state(&self) -> &str {
        &self.status.as_ref().unwrap().state
    }

    /// Lets time pass; returns the least distance of the hull to each box on the way.
    pub fn run(&mut self, ms: u64, boxes: &[Box2]) -> Vec<f64> {
        let mut nearest_m = vec![f64::INFINITY; boxes.len()];
        for _ in 0..ms {
            self.now_ms += 1;
            self.move_base();
            let place = self.map_from_base.position();
            for (nearest_m, b) in nearest_m.iter_mut().zip(boxes) {
                *nearest_m = nearest_m.min(away_m(b, place) - self.profile.radius_m);
            }
            self.tell();
        }
        nearest_m
    }

    fn move_base(&mut self) {
        let wanted = self.command.as_ref().filter(|_| self.obeys).map_or(Twist::ZERO, |c| c.twist);
        let step_m_s = self.profile.accel_m_s2_max * 1e-3;
        self.speed_m_s += (wanted.speed_m_s - self.speed_m_s).clamp(-step_m_s, step_m_s);
        self.map_from_base = self.map_from_base.along_arc(self.speed_m_s, wanted.yaw_rate_rad_s, 1e-3);
    }

    fn tell(&mut self) {
        let due = |every_ms: u64| self.now_ms.is_multiple_of(every_ms);
        let (fast, turn, track, plan) = (due(20), due(100), due(50), due(500));
        if fast && self.odometry_speaks {
            let header = self.header();
            let twist = Twist::new(self.speed_m_s, 0.0);
            let odometry = Odometry { header, odom_from_base: self.map_from_base, twist, fault: None };
            self.give(Input::Odometry(odometry, self.time()));
        }
        if turn && self.pose_speaks {
            let pose = PoseEstimate {
                header: self.header(),
                map_epoch: self.map_epoch,
                map_from_odom: Pose2::IDENTITY,
                quality: self.quality,
            };
            self.give(Input::Pose(pose, self.time()));
        }
        if plan {
            self.give(Input::PlanTick);
        }
        if track {
            self.give(Input::TrackTick { wall_ns: WALL_NS + self.now_ms * 1_000_000 });
        }
    }
}
