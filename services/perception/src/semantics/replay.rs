//! Semantics over a recording: the same decider and maps as on the robot, in one thread, by the recording's
//! clock, with models that answer at once.
//!
//! Frames come with their place; what the bus, the cameras and the clock do on the robot is done here by the
//! caller. Deliberately not here: files, and anything that decides.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use geometry::{Pose2, Profile, Time};
use mapping::{FusedMask, fuse};
use proto::{Header, ObjectMap, PoseEstimate, PoseQuality, RuleSet};
use rules::Rule;

use super::config::Settings;
use super::decider::{Decider, Input, Output};
use super::frame::Frame;
use super::models::Answer;
use super::object_maps::{Job, MapConfig, ObjectMaps, Task, segments_of};

/// The map of a recording is never another one.
const MAP_EPOCH: u64 = 1;
/// Steps after the last frame in which what was found is told.
const N_STEPS_LAST: usize = 4;

/// What was found in one frame.
#[derive(Clone, Debug)]
pub struct Found {
    /// The phrase.
    pub phrase: String,
    /// Its mask; `None` when it is not in view.
    pub mask: Option<FusedMask>,
}

/// What came of one frame.
#[derive(Clone, Debug, Default)]
pub struct Looked {
    /// What was found; empty when the models were not asked.
    pub found: Vec<Found>,
    /// What went wrong; empty when nothing did.
    pub trouble: String,
}

/// Semantics, fed by hand.
pub struct Replay<M> {
    decider: Decider,
    maps: ObjectMaps,
    config: MapConfig,
    models: M,
    now: Time,
    stamp_ns: u64,
    object_maps: BTreeMap<String, ObjectMap>,
}

impl<M: Fn(&Frame, &[String]) -> anyhow::Result<Answer>> Replay<M> {
    /// Semantics that holds these rules and has seen nothing.
    ///
    /// # Errors
    /// When the configuration cannot work.
    pub fn new(settings: &Settings, profile: &Profile, rules: Vec<Rule>, models: M) -> anyhow::Result<Self> {
        let config = settings.maps(profile);
        let maps = ObjectMaps::new(config, profile)?;
        let decider = Decider::new(settings.clone());
        let object_maps = BTreeMap::new();
        let mut replay = Replay { decider, maps, config, models, now: Time::ZERO, stamp_ns: 0, object_maps };
        replay.feed(Input::Rules(RuleSet { version: 1, specs: rules }));
        Ok(replay)
    }

    /// Takes in one frame, its `odom_from_base` in the map; stamps must go up.
    pub fn show(&mut self, frame: Frame) -> Looked {
        let step = Duration::from_nanos(frame.stamp_ns.saturating_sub(self.stamp_ns));
        self.now = self.now + step;
        self.stamp_ns = frame.stamp_ns;
        let mut looked = self.feed(Input::Pose(PoseEstimate {
            header: Header { seq: 1, stamp_ns: frame.stamp_ns, echo: 0 },
            map_epoch: MAP_EPOCH,
            map_from_odom: Pose2::IDENTITY,
            quality: PoseQuality::Good,
        }));
        let after = self.feed(Input::Placed(Box::new(frame)));
        looked.found.extend(after.found);
        if looked.trouble.is_empty() {
            looked.trouble = after.trouble;
        }
        looked
    }

    /// The map of each rule that needs an object, as last told, by the rule's id.
    pub fn told(&mut self) -> &BTreeMap<String, ObjectMap> {
        for _ in 0..N_STEPS_LAST {
            self.now = self.now + Duration::from_secs(1);
            self.feed(Input::Tick);
        }
        &self.object_maps
    }

    fn feed(&mut self, input: Input) -> Looked {
        let mut looked = Looked::default();
        let mut inputs = VecDeque::from([input]);
        while let Some(input) = inputs.pop_front() {
            for output in self.decider.step(self.now, input) {
                match output {
                    Output::Ask(ask) => {
                        let answer = (self.models)(&ask.frame, &ask.phrases);
                        let answer = answer.map(Box::new).map_err(|e| format!("{e:#}"));
                        if let Err(reason) = &answer {
                            looked.trouble.clone_from(reason);
                        }
                        inputs.push_back(Input::Answer { ask_id: ask.id, answer });
                    }
                    Output::Work(job) => {
                        looked.found.extend(self.found(&job));
                        let done = self.maps.perform(&job);
                        if let Some(reason) = &done.failure {
                            looked.trouble.clone_from(reason);
                        }
                        inputs.push_back(Input::Done(Box::new(done)));
                    }
                    Output::ObjectMap(map) => drop(self.object_maps.insert(map.rule_id.clone(), map)),
                    Output::RuleEnded(_)
                    | Output::DepthObstacles(_)
                    | Output::Beat(_)
                    | Output::RulesHeld(_)
                    | Output::Trouble(_) => {}
                }
            }
        }
        looked
    }

    /// The masks that a job is about to take in: the same function of the same values.
    fn found(&self, job: &Job) -> Vec<Found> {
        let Task::Fuse { view, phrases, answer, .. } = &job.task else { return Vec::new() };
        let Ok(segments) = segments_of(answer, &view.frame) else { return Vec::new() };
        let mask =
            |idx| answer.heat_map(idx).ok().and_then(|heat| fuse(&heat, &segments, self.config.fusion));
        phrases
            .iter()
            .enumerate()
            .map(|(idx, phrase)| Found { phrase: phrase.clone(), mask: mask(idx) })
            .collect()
    }
}
