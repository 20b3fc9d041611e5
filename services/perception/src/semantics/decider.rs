//! What semantics makes of frames, poses, rules, and the answers of its models and maps.

use std::sync::Arc;
use std::time::Duration;

use geometry::Time;
use mapping::{Grid, Occupancy};
use proto::{
    BaseMap, DepthObstacles, Header, ObjectMap, Odometry, PoseEstimate, RgbdFrame, RuleSet, RulesHeld,
    Segment, SemanticsBeat,
};
use rules::Rule;

use super::config::Settings;
use super::frame::Frame;
use super::frame_door::{Change, FrameDoor};
use super::groundings::Groundings;
use super::keyframes::Keyframes;
use super::models::{Answer, Ask};
use super::object_maps::{Done, Job, Task, View, phrases_of};
use super::places::Places;
use super::questions::Questions;
use super::report::Report;
use crate::wire::base_grid;

/// Regions of rules that are grounded are cut anew this often: twice a second is what is told.
const REVIEW_PERIOD: Duration = Duration::from_millis(400);
/// Work on one frame that takes longer than this is told.
const WORK_MAX: Duration = Duration::from_secs(3);
/// A frame shows something new when the base has moved this far, metres …
const MOVED_M: f64 = 0.03;
/// … or turned this far, radians: about ten pixels.
const TURNED_RAD: f64 = 0.02;
/// What reaches semantics.
#[derive(Clone, Debug)]
pub enum Input {
    /// Where the wheels say the base is.
    Odometry(Odometry),
    /// Where odometry lies in the map.
    Pose(PoseEstimate),
    /// What the LiDAR knows of the floor.
    BaseMap(BaseMap),
    /// What the camera sees.
    Frame(Box<RgbdFrame>),
    /// A frame that knows where it was taken, from a recording.
    Placed(Box<Frame>),
    /// The rules in force.
    Rules(RuleSet),
    /// The named places.
    Places(proto::Places),
    /// What the models said, or why they did not.
    Answer {
        /// Which question it answers.
        ask_id: u64,
        /// What they said.
        answer: Result<Box<Answer>, String>,
    },
    /// What came of the work.
    Done(Box<Done>),
    /// Time has passed.
    Tick,
}

/// What semantics does.
#[derive(Clone, Debug, PartialEq)]
pub enum Output {
    /// Ask the models; answer with [`Input::Answer`].
    Ask(Ask),
    /// Work on the maps; answer with [`Input::Done`].
    Work(Job),
    /// Publish the region of a rule.
    ObjectMap(ObjectMap),
    /// A rule ended: its map is published no more.
    RuleEnded(String),
    /// Publish the obstacles.
    DepthObstacles(DepthObstacles),
    /// Publish the beat.
    Beat(SemanticsBeat),
    /// Publish the rules held.
    RulesHeld(RulesHeld),
    /// Say what is wrong; empty when nothing is.
    Trouble(String),
}

/// Semantics, without the world around it.
pub struct Decider {
    settings: Settings,
    door: FrameDoor,
    keyframes: Keyframes,
    questions: Questions,
    groundings: Groundings,
    rules: Arc<[Rule]>,
    places: Arc<Places>,
    rules_version: Option<u64>,
    /// The LiDAR's map, and its epoch.
    base: Option<(u64, Arc<Grid<Occupancy>>)>,
    /// The newest frame that waits to be looked at for obstacles.
    to_look: Option<Arc<Frame>>,
    /// The newest frame that waits for the models.
    to_ask: Option<Arc<Frame>>,
    /// A question and its answer that wait to be taken in.
    to_fuse: Option<(Ask, Box<Answer>)>,
    to_review: bool,
    working: Option<Time>,
    was_fusing: bool,
    last_shown: Option<Arc<Frame>>,
    reviewed: Time,
    report: Report,
    counts: Counts,
}

#[derive(Default)]
struct Counts {
    n_frames: u64,
    n_frames_dropped: u64,
    n_obstacles: u64,
}

impl Decider {
    /// Semantics at its start: it holds no rules and has seen nothing.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Decider {
            door: FrameDoor::new(settings.door()),
            keyframes: Keyframes::new(settings.keyframes()),
            questions: Questions::new(settings.model_patience()),
            settings,
            groundings: Groundings::default(),
            rules: Arc::new([]),
            places: Arc::default(),
            rules_version: None,
            base: None,
            to_look: None,
            to_ask: None,
            to_fuse: None,
            to_review: false,
            working: None,
            was_fusing: false,
            last_shown: None,
            reviewed: Time::ZERO,
            report: Report::default(),
            counts: Counts::default(),
        }
    }

    /// Takes in one input.
    pub fn step(&mut self, now: Time, input: Input) -> Vec<Output> {
        let mut outputs = Vec::new();
        match input {
            Input::Odometry(odometry) => {
                let change = self.door.odometry(&odometry);
                self.begin_anew(change);
            }
            Input::Pose(pose) => {
                let change = self.door.pose(pose);
                self.begin_anew(change);
            }
            Input::BaseMap(map) => self.know_floor(&map),
            Input::Frame(frame) => self.door.frame(now, frame),
            Input::Placed(frame) => self.show(Arc::from(frame)),
            Input::Rules(rule_set) => self.take_over(rule_set, &mut outputs),
            Input::Places(told) => self.know_places(Places::of(&told, self.settings.resolution_m)),
            Input::Answer { ask_id, answer } => self.hear(ask_id, answer),
            Input::Done(done) => self.take_back(*done, &mut outputs),
            Input::Tick => {
                if self.questions.give_up_overdue(now) {
                    self.report.troubles.models = "models: a question was lost".to_owned();
                }
            }
        }
        if let Some(frame) = self.door.take(now) {
            self.show(Arc::new(frame));
        }
        self.ask_next(now, &mut outputs);
        self.work_next(now, &mut outputs);
        self.tell(now, &mut outputs);
        outputs
    }

    fn begin_anew(&mut self, change: Change) {
        match change {
            Change::None => return,
            // Frames know where they are in `odom`: they are placed anew, and asked about anew.
            Change::Map => {}
            Change::Odometry => {
                self.keyframes.clear();
                (self.to_look, self.to_ask, self.last_shown) = (None, None, None);
            }
        }
        self.to_fuse = None;
        self.questions.restart();
        if change == Change::Map {
            self.groundings.restart();
        }
    }

    fn take_over(&mut self, rule_set: RuleSet, outputs: &mut Vec<Output>) {
        // Latched: it may come again, and an older one may come late.
        if self.rules_version.is_some_and(|version| rule_set.version <= version) {
            return;
        }
        self.rules_version = Some(rule_set.version);
        let (good, odd): (Vec<Rule>, Vec<Rule>) =
            rule_set.specs.into_iter().partition(|rule| Segment::new(&rule.id).is_ok());
        self.rules = good.into();
        self.look_for(odd.len());
        let ended = self.groundings.set_rules(&self.rules);
        outputs.extend(ended.into_iter().map(Output::RuleEnded));
        self.to_review = true;
    }

    /// A map that cannot be read is none: without it regions end at what was seen.
    fn know_floor(&mut self, map: &BaseMap) {
        self.base = base_grid(map).ok().map(|grid| (map.map_epoch, Arc::new(grid)));
    }

    /// Takes over the named places: what they name is not searched for any more.
    pub fn know_places(&mut self, places: Places) {
        self.places = Arc::new(places);
        self.look_for(0);
        self.to_review = true;
    }

    /// Sets what is searched for: what the rules name and no place is.
    fn look_for(&mut self, n_odd: usize) {
        let phrases = phrases_of(&self.rules, &self.places, self.settings.n_phrases_max);
        let places = Arc::clone(&self.places);
        let is_left_out = |rule: &&Rule| {
            let searched = |phrase: &&str| !places.holds(rule, phrase);
            super::regions::phrases(rule).into_iter().filter(searched).any(|phrase| !phrases.contains(phrase))
        };
        let n_left_out = self.rules.iter().filter(is_left_out).count() + n_odd;
        self.report.troubles.rules = if n_left_out == 0 {
            String::new()
        } else {
            let n_phrases_max = self.settings.n_phrases_max;
            format!("{n_left_out} rules are not looked for: odd ids, or more than {n_phrases_max} phrases")
        };
        self.questions.searches.set_phrases(&phrases);
        if self.questions.searches.is_empty() {
            self.report.troubles.models.clear();
        }
    }

    /// A frame has its pose: keeps it for rules to come, and lets it wait for obstacles and models.
    fn show(&mut self, frame: Arc<Frame>) {
        self.keyframes.offer(&frame);
        let is_new = self.last_shown.as_ref().is_none_or(|last| {
            let (moved_m, turned_rad) = frame.moved_since(last);
            let since = Duration::from_nanos(frame.stamp_ns.saturating_sub(last.stamp_ns));
            moved_m >= MOVED_M || turned_rad >= TURNED_RAD || since >= self.settings.idle_period()
        });
        let mut n_gave_way = 0;
        if is_new {
            n_gave_way += u64::from(self.to_look.replace(Arc::clone(&frame)).is_some());
            self.last_shown = Some(Arc::clone(&frame));
        }
        if !self.questions.searches.is_empty() && (is_new || self.groundings.is_searching()) {
            n_gave_way += u64::from(self.to_ask.replace(frame).is_some());
        }
        self.counts.n_frames_dropped += n_gave_way.min(1);
    }

    fn ask_next(&mut self, now: Time, outputs: &mut Vec<Output>) {
        // A second answer would have to wait for the first one to be taken in.
        if self.questions.is_asking() || self.to_fuse.is_some() {
            return;
        }
        let probe = self.to_ask.as_ref().or_else(|| self.keyframes.iter().next());
        if probe.is_none_or(|frame| self.door.map_from_base(frame).is_err()) {
            return;
        }
        outputs.extend(self.questions.ask(now, &mut self.to_ask, &self.keyframes).map(Output::Ask));
    }

    fn hear(&mut self, ask_id: u64, answer: Result<Box<Answer>, String>) {
        match self.questions.hear(ask_id, answer) {
            Ok(None) => {}
            Ok(Some(good)) => {
                self.report.troubles.models.clear();
                self.to_fuse = Some(good);
            }
            Err(reason) => self.report.troubles.models = format!("models: {reason}"),
        }
    }

    fn work_next(&mut self, now: Time, outputs: &mut Vec<Output>) {
        if self.working.is_some() {
            return;
        }
        let Some(map_epoch) = self.door.map_epoch() else {
            "no pose from localisation".clone_into(&mut self.report.troubles.place);
            return;
        };
        let Some(task) = self.next_task(now) else { return };
        self.was_fusing = matches!(task, Task::Fuse { .. });
        self.working = Some(now);
        let rules_version = self.rules_version.unwrap_or(0);
        let (rules, places) = (Arc::clone(&self.rules), Arc::clone(&self.places));
        let base =
            self.base.as_ref().filter(|(epoch, _)| *epoch == map_epoch).map(|(_, map)| Arc::clone(map));
        outputs.push(Output::Work(Job { map_epoch, rules_version, rules, places, base, task }));
    }

    /// New rules first, then answers and looks in turn.
    fn next_task(&mut self, now: Time) -> Option<Task> {
        if std::mem::take(&mut self.to_review) {
            self.reviewed = now;
            return Some(Task::Review);
        }
        if self.to_fuse.is_some() && (self.to_look.is_none() || !self.was_fusing) {
            let (ask, answer) = self.to_fuse.take()?;
            let view = self.placed(ask.frame)?;
            let is_due = now.since(self.reviewed) >= REVIEW_PERIOD;
            let is_reviewed = is_due || self.groundings.is_searching();
            if is_reviewed {
                self.reviewed = now;
            }
            return Some(Task::Fuse { view, phrases: ask.phrases, answer, is_reviewed });
        }
        let frame = self.to_look.take()?;
        self.placed(frame).map(Task::Look)
    }

    fn placed(&mut self, frame: Arc<Frame>) -> Option<View> {
        match self.door.map_from_base(&frame) {
            Ok(map_from_base) => {
                self.report.troubles.place.clear();
                Some(View { frame, map_from_base })
            }
            Err(reason) => {
                self.report.troubles.place = reason;
                None
            }
        }
    }

    fn take_back(&mut self, done: Done, outputs: &mut Vec<Output>) {
        self.working = None;
        self.counts.n_frames += u64::from(done.obstacles.is_some());
        // A map frame that is gone: what was found in it must not be told.
        if self.door.map_epoch() != Some(done.map_epoch) {
            return;
        }
        let troubles = &mut self.report.troubles;
        match (self.was_fusing, done.failure) {
            (true, failure) => troubles.fusing = failure.unwrap_or_default(),
            (false, Some(reason)) => troubles.looking = reason,
            (false, None) if done.obstacles.is_some() => troubles.looking.clear(),
            (false, None) => {}
        }
        if let Some(obstacles) = done.obstacles {
            self.counts.n_obstacles += 1;
            let (seq, echo) = (self.counts.n_obstacles, self.door.echo());
            outputs.push(Output::DepthObstacles(DepthObstacles {
                header: Header { seq, stamp_ns: obstacles.stamp_ns, echo },
                map_epoch: done.map_epoch,
                cells: obstacles.cells,
            }));
        }
        // A rule may have been changed under its id: then its region is being cut anew.
        if let Some(findings) = done.findings.filter(|_| self.rules_version == Some(done.rules_version)) {
            self.groundings.apply(findings);
        }
    }

    /// Tells what is due: maps, rules held, the beat, trouble.
    fn tell(&mut self, now: Time, outputs: &mut Vec<Output>) {
        let echo = self.door.echo();
        if let Some(map_epoch) = self.door.map_epoch() {
            outputs.extend(self.groundings.due(now, map_epoch, echo).into_iter().map(Output::ObjectMap));
        }
        if let Some(version) = self.rules_version {
            let held = RulesHeld { service: "semantics".to_owned(), version, rules: self.groundings.held() };
            outputs.extend(self.report.held(now, held).map(Output::RulesHeld));
        }
        let is_overdue = self.working.is_some_and(|since| now.since(since) > WORK_MAX);
        self.report.troubles.overdue = if is_overdue {
            format!("a frame takes longer than {} s", WORK_MAX.as_secs())
        } else {
            String::new()
        };
        self.report.troubles.door = self.door.trouble(now);
        let beat = SemanticsBeat {
            header: Header { seq: 0, stamp_ns: self.door.newest_ns(), echo },
            rules_version: self.rules_version.unwrap_or(0),
            n_frames: self.counts.n_frames,
            n_frames_dropped: self.counts.n_frames_dropped + self.door.n_left_out(),
            is_blind: false,
            trouble: String::new(),
        };
        outputs.extend(self.report.beat(now, beat).map(Output::Beat));
        outputs.extend(self.report.news(now).map(Output::Trouble));
    }
}
