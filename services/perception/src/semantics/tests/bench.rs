//! Semantics on a bench: its decider and its maps, a scene, models, and a clock that the test owns.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use geometry::{Pose2, Profile, Time, Twist};
use proto::{
    CellSet, DepthObstacles, Grounding, Header, ObjectMap, Odometry, PoseEstimate, PoseQuality, RuleSet,
    RulesHeld, SemanticsBeat,
};
use rules::{Relation, Rule};

use super::scene::{Object, answer, frame};
use crate::semantics::models::{Answer, Ask};
use crate::semantics::object_maps::ObjectMaps;
use crate::semantics::{Decider, Input, Output, Settings};

/// How the models answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Models {
    Good,
    /// They say that there is no answer.
    Refuse,
    /// Nothing ever comes back.
    Vanish,
    /// A good answer that is kept back.
    Late,
    /// They answer with an image of another size.
    WrongSize,
    /// They answer for another frame.
    WrongFrame,
    /// One heat map too few.
    TooFew,
}

/// Shares of cells: of the truth that is covered, and of truth and region together that both hold.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fit {
    pub covered: f64,
    pub iou: f64,
}

pub(super) struct Bench {
    pub scene: Vec<Object>,
    pub models: Models,
    pub decider: Decider,
    maps: ObjectMaps,
    settings: Settings,
    pub now: Time,
    /// What is silent.
    pub camera_is_silent: bool,
    pub odometry_is_silent: bool,
    pub pose_is_silent: bool,
    /// Where odometry lies in the world, and where localisation says that it lies in the map.
    pub world_from_odom: Pose2,
    pub map_from_odom: Pose2,
    pub map_epoch: u64,
    pub quality: PoseQuality,
    pub world_from_base: Pose2,
    n_odometry: u64,
    n_frames: u64,
    pub n_asked: u64,
    /// Answers that were kept back.
    pub late: Vec<Input>,
    pub object_maps: BTreeMap<String, ObjectMap>,
    pub n_object_maps: BTreeMap<String, u64>,
    /// The epoch and the grounding of each map told, and whether it had a region.
    pub told: Vec<(u64, Grounding, bool)>,
    pub obstacles: Option<DepthObstacles>,
    pub beats: Vec<SemanticsBeat>,
    pub held: Option<RulesHeld>,
    pub ended: Vec<String>,
}

pub(super) const START_NS: u64 = 1_700_000_000_000_000_000;

impl Bench {
    pub(super) fn new(scene: Vec<Object>) -> Self {
        Bench::with(Settings::default(), scene)
    }

    pub(super) fn with(settings: Settings, scene: Vec<Object>) -> Self {
        let profile = Profile::sim();
        Bench {
            scene,
            models: Models::Good,
            decider: Decider::new(settings.clone()),
            maps: ObjectMaps::new(settings.maps(&profile), &profile).unwrap(),
            settings,
            now: Time::ZERO,
            camera_is_silent: false,
            odometry_is_silent: false,
            pose_is_silent: false,
            world_from_odom: Pose2::IDENTITY,
            map_from_odom: Pose2::IDENTITY,
            map_epoch: 1,
            quality: PoseQuality::Good,
            world_from_base: Pose2::IDENTITY,
            n_odometry: 0,
            n_frames: 0,
            n_asked: 0,
            late: Vec::new(),
            object_maps: BTreeMap::new(),
            n_object_maps: BTreeMap::new(),
            told: Vec::new(),
            obstacles: None,
            beats: Vec::new(),
            held: None,
            ended: Vec::new(),
        }
    }

    /// The process dies and is started again; the world goes on.
    pub(super) fn restart(&mut self) {
        let profile = Profile::sim();
        self.decider = Decider::new(self.settings.clone());
        self.maps = ObjectMaps::new(self.settings.maps(&profile), &profile).unwrap();
        self.object_maps.clear();
    }

    /// The base begins anew: its count, and its `odom` frame where it stands.
    pub(super) fn restart_base(&mut self) {
        self.n_odometry = 0;
        self.world_from_odom = self.world_from_base;
        self.map_from_odom = self.world_from_base;
    }

    pub(super) fn stamp_ns(&self) -> u64 {
        START_NS + self.now.as_nanos()
    }

    /// Lets time pass while the base goes straight to a pose and turns on the way.
    pub(super) fn drive(&mut self, to: Pose2, seconds: f64) {
        let from = self.world_from_base;
        let n_steps = (seconds * 50.0).round() as u64;
        for step in 1..=n_steps {
            let share = step as f64 / n_steps as f64;
            self.world_from_base = from.towards(&to, share);
            self.advance();
        }
    }

    pub(super) fn wait(&mut self, seconds: f64) {
        self.drive(self.world_from_base, seconds);
    }

    /// A fiftieth of a second.
    fn advance(&mut self) {
        self.now = self.now + Duration::from_millis(20);
        let step = self.now.as_nanos() / 20_000_000;
        let (stamp_ns, odom_from_base) =
            (self.stamp_ns(), self.world_from_odom.inverse() * self.world_from_base);
        if step.is_multiple_of(10) && !self.camera_is_silent {
            // A camera is late: its frame is of the moment before last.
            self.n_frames += 1;
            let rgbd = frame(&self.scene, self.world_from_base, self.n_frames, stamp_ns);
            self.input(Input::Frame(Box::new(rgbd)));
        }
        if !self.odometry_is_silent {
            self.n_odometry += 1;
            let header = Header { seq: self.n_odometry, stamp_ns, echo: 0 };
            self.input(Input::Odometry(Odometry {
                header,
                odom_from_base,
                twist: Twist::default(),
                fault: None,
            }));
        }
        if step.is_multiple_of(5) && !self.pose_is_silent {
            self.tell_pose();
        }
        self.input(Input::Tick);
    }

    pub(super) fn tell_pose(&mut self) {
        let header = Header { seq: self.now.as_nanos(), stamp_ns: self.stamp_ns(), echo: 0 };
        let (map_epoch, map_from_odom, quality) = (self.map_epoch, self.map_from_odom, self.quality);
        self.input(Input::Pose(PoseEstimate { header, map_epoch, map_from_odom, quality }));
    }

    pub(super) fn tell_places(&mut self, places: proto::Places) {
        self.input(Input::Places(places));
    }

    pub(super) fn tell_rules(&mut self, version: u64, rules: &[Rule]) {
        self.input(Input::Rules(RuleSet { version, specs: rules.to_vec() }));
    }

    /// Gives the decider an input, and performs what it wants, and so on.
    pub(super) fn input(&mut self, input: Input) {
        let mut inputs = VecDeque::from([input]);
        while let Some(input) = inputs.pop_front() {
            let outputs = self.decider.step(self.now, input);
            let n_asks = outputs.iter().filter(|o| matches!(o, Output::Ask(_))).count();
            let n_jobs = outputs.iter().filter(|o| matches!(o, Output::Work(_))).count();
            assert!(n_asks <= 1 && n_jobs <= 1, "one question and one job at a time");
            for output in outputs {
                match output {
                    Output::Ask(ask) => inputs.extend(self.answer(&ask)),
                    Output::Work(job) => inputs.push_back(Input::Done(Box::new(self.maps.perform(&job)))),
                    Output::ObjectMap(map) => {
                        self.told.push((map.map_epoch, map.grounding, map.region.is_some()));
                        *self.n_object_maps.entry(map.rule_id.clone()).or_default() += 1;
                        self.object_maps.insert(map.rule_id.clone(), map);
                    }
                    Output::RuleEnded(id) => self.ended.push(id),
                    Output::DepthObstacles(obstacles) => self.obstacles = Some(obstacles),
                    Output::Beat(beat) => self.beats.push(beat),
                    Output::RulesHeld(held) => self.held = Some(held),
                    Output::Trouble(_) => {}
                }
            }
        }
    }

    fn answer(&mut self, ask: &Ask) -> Option<Input> {
        self.n_asked += 1;
        let mut said = answer(&self.scene, ask);
        match self.models {
            Models::Good => {}
            Models::Vanish => return None,
            Models::Late => {
                self.late.push(Input::Answer { ask_id: ask.id, answer: Ok(Box::new(said)) });
                return None;
            }
            Models::Refuse => {
                let answer = Err("ask models/segments: no answer within 2000 ms".to_owned());
                return Some(Input::Answer { ask_id: ask.id, answer });
            }
            Models::WrongSize => {
                said.segments.width = CAMERA_HALF;
                said.segments.labels_le.truncate(2 * (CAMERA_HALF * said.segments.height) as usize);
            }
            Models::WrongFrame => said.heat_maps.seq += 1,
            Models::TooFew => said.heat_maps.n_phrases -= 1,
        }
        let answer: Result<Box<Answer>, String> = Ok(Box::new(said));
        Some(Input::Answer { ask_id: ask.id, answer })
    }

    pub(super) fn grounding(&self, rule_id: &str) -> Grounding {
        self.object_maps.get(rule_id).expect("told").grounding
    }

    pub(super) fn trouble(&self) -> &str {
        &self.beats.last().expect("beats").trouble
    }

    /// How well a rule's region agrees with boxes on the floor, as (low x, low y, high x, high y).
    pub(super) fn fit(&self, rule_id: &str, truth: &[[f64; 4]]) -> Fit {
        let map = self.object_maps.get(rule_id).expect("told");
        fit(map.region.as_ref().expect("found"), truth)
    }
}

const CAMERA_HALF: u32 = super::scene::CAMERA.width / 2;

pub(super) fn fit(cells: &CellSet, truth: &[[f64; 4]]) -> Fit {
    let layout = cells.layout;
    let bits = cells.unpack();
    let is_set = |x: f64, y: f64| {
        let col = ((x - layout.origin_map.x) / layout.resolution_m).floor();
        let row = ((y - layout.origin_map.y) / layout.resolution_m).floor();
        let inside =
            col >= 0.0 && row >= 0.0 && col < f64::from(layout.n_cols) && row < f64::from(layout.n_rows);
        inside && bits[row as usize * layout.n_cols as usize + col as usize]
    };
    let (mut n_truth, mut n_region, mut n_both) = (0.0, 0.0, 0.0);
    for i in -700..700 {
        for j in -700..700 {
            let (x, y) = (f64::from(i) * 0.01 + 0.005, f64::from(j) * 0.01 + 0.005);
            let is_true = truth.iter().any(|b| x >= b[0] && y >= b[1] && x <= b[2] && y <= b[3]);
            let is_found = is_set(x, y);
            n_truth += f64::from(u8::from(is_true));
            n_region += f64::from(u8::from(is_found));
            n_both += f64::from(u8::from(is_true && is_found));
        }
    }
    Fit { covered: n_both / n_truth, iou: n_both / (n_truth + n_region - n_both) }
}

pub(super) fn rule(id: &str, relation: Relation, obj: &str) -> Rule {
    Rule { id: id.to_owned(), ..Rule::exclusion(relation, obj) }
}
