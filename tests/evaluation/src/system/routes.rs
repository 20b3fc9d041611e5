//! Who hears what, and how long slow work takes: what the network and the threads are otherwise.

use std::time::Duration;

use heedway_cli::recording::Heard as Noted;
use heedway_filter::{Heard, Input as FilterInput, Output as FilterOutput};
use heedway_language::decider::{Input as LanguageInput, Output as LanguageOutput, Recorded};
use heedway_navigator::{Input as NavigatorInput, Output as NavigatorOutput, plan};
use heedway_perception::{localisation, semantics};
use proto::{
    BaseMap, DepthObstacles, Goal, Instruction, NominalCommand, ObjectMap, Odometry, PoseEstimate, RgbdFrame,
    RuleSet, RulesHeld, SafeCommand, Scan, SemanticsBeat, topics,
};
use rules::{Relation, RuleType};

use super::System;
use crate::condition::Method;

/// How long work takes, as measured on two cores in November 2026 and rounded up: a turn of the LiDAR, …
pub(super) const SCAN_TIME: Duration = Duration::from_millis(10);
/// … a frame of 640 × 480, …
pub(super) const FRAME_TIME: Duration = Duration::from_millis(60);
/// … an answer of the models, beyond the delay that the settings give them, …
const ANSWER_TIME: Duration = Duration::from_millis(30);
/// … a look or a fusion, …
const WORK_TIME: Duration = Duration::from_millis(30);
/// … a distance field, …
const FIELD_TIME: Duration = Duration::from_millis(10);
/// … and a plan.
const PLAN_TIME: Duration = Duration::from_millis(40);
/// Most troubles kept.
const N_TROUBLES_MAX: usize = 50;

/// What travels between the parts; the last five are answers to one of them only.
#[derive(Debug)]
pub enum Message {
    /// Base feedback.
    Odometry(Odometry),
    /// A turn of the LiDAR.
    Scan(Scan),
    /// An image.
    Frame(Box<RgbdFrame>),
    /// Where `odom` lies in `map`.
    Pose(PoseEstimate),
    /// The grid from the LiDAR.
    BaseMap(BaseMap),
    /// What the camera saw within the robot's height.
    DepthObstacles(DepthObstacles),
    /// The region of a rule.
    ObjectMap(ObjectMap),
    /// Proof that semantics looks.
    SemanticsBeat(SemanticsBeat),
    /// The rules in force.
    Rules(RuleSet),
    /// Which rules a service holds.
    RulesHeld(RulesHeld),
    /// What the navigator wants.
    Nominal(NominalCommand),
    /// What the motors may have.
    Safe(SafeCommand),
    /// Where to go.
    Goal(Goal),
    /// Words.
    Instruction(Instruction),
    /// Work that is done, for semantics.
    ToSemantics(Box<semantics::Input>),
    /// A field, for the filter.
    ToFilter(Box<FilterInput>),
    /// A plan, for the navigator.
    ToNavigator(Box<NavigatorInput>),
    /// What is stored, for language.
    ToLanguage(Box<LanguageInput>),
}

impl System {
    pub(super) fn put_later(&mut self, after: Duration, message: Message) {
        self.n_later += 1;
        self.later.insert((self.now + after, self.n_later), message);
    }

    /// Hands out messages until none is left.
    pub(super) fn pump(&mut self) {
        while let Some(message) = self.queue.pop_front() {
            self.deliver(message);
        }
    }

    fn heard<M>(&self, message: M) -> Heard<M> {
        Heard { message, at: self.now, wall_ns: self.wall_ns() }
    }

    fn deliver(&mut self, message: Message) {
        match message {
            Message::Odometry(m) => {
                self.note(Noted::Odometry(&m));
                self.tell_localisation(localisation::Input::Odometry(m.clone()));
                self.tell_semantics(semantics::Input::Odometry(m.clone()));
                self.tell_language(LanguageInput::Odometry(m.clone()));
                self.tell_navigator(NavigatorInput::Odometry(m.clone(), self.now));
                self.tell_filter(FilterInput::Odometry(self.heard(m)));
            }
            Message::Scan(m) => {
                self.note(Noted::Scan(&m));
                self.tell_localisation(localisation::Input::Scan(m.clone()));
                self.tell_filter(FilterInput::Scan(self.heard(m)));
            }
            Message::Frame(m) => {
                self.note(Noted::Frame(&m));
                self.tell_semantics(semantics::Input::Frame(m));
            }
            Message::Pose(m) => {
                self.note(Noted::Pose(&m));
                self.tell_semantics(semantics::Input::Pose(m.clone()));
                self.tell_language(LanguageInput::Pose(m.clone()));
                self.tell_navigator(NavigatorInput::Pose(m.clone(), self.now));
                self.tell_filter(FilterInput::Pose(self.heard(m)));
            }
            Message::BaseMap(m) => {
                self.note(Noted::BaseMap(&m));
                self.tell_navigator(NavigatorInput::BaseMap(m.clone()));
                // Its boxes are all that Safe-Lang knows of things: nothing is added behind them.
                if self.condition.method != Method::SafeLang {
                    self.tell_semantics(semantics::Input::BaseMap(m.clone()));
                }
                self.told.base_map = Some(m.clone());
                self.tell_filter(FilterInput::BaseMap(self.heard(m)));
            }
            Message::DepthObstacles(m) => {
                self.note(Noted::DepthObstacles(&m));
                self.tell_navigator(NavigatorInput::DepthObstacles(m.clone()));
                self.tell_filter(FilterInput::DepthObstacles(self.heard(m)));
            }
            Message::ObjectMap(m) => {
                self.note(Noted::ObjectMap(&m));
                self.tell_navigator(NavigatorInput::ObjectMap(m.clone()));
                self.told.regions.insert(m.rule_id.clone(), m.clone());
                self.tell_filter(FilterInput::ObjectMap(self.heard(m)));
            }
            Message::SemanticsBeat(m) => self.tell_filter(FilterInput::SemanticsBeat(self.heard(m))),
            Message::Rules(m) => {
                let m = self.as_the_method_takes_them(m);
                self.note(Noted::Rules(&m));
                self.tell_semantics(semantics::Input::Rules(m.clone()));
                self.tell_navigator(NavigatorInput::Rules(m.clone()));
                self.tell_filter(FilterInput::Rules(m));
            }
            Message::RulesHeld(m) => self.tell_language(LanguageInput::Held(m)),
            Message::Nominal(m) => {
                if self.condition.filter_off {
                    self.deliver(Message::Safe(SafeCommand { header: m.header, twist: m.twist }));
                }
                self.tell_filter(FilterInput::Nominal(self.heard(m)));
            }
            Message::Safe(m) => {
                if let Err(e) = self.keeper.take(&m, self.now, self.wall_ns()) {
                    self.refuse(topics::SAFE.key, e.to_string());
                }
            }
            Message::Goal(m) => self.tell_navigator(NavigatorInput::Goal(m)),
            Message::Instruction(m) => self.tell_language(LanguageInput::Said(m)),
            Message::ToSemantics(input) => self.tell_semantics(*input),
            Message::ToFilter(input) => self.tell_filter(*input),
            Message::ToNavigator(input) => self.tell_navigator(*input),
            Message::ToLanguage(input) => self.tell_language(*input),
        }
    }

    /// Safe-Lang keeps a distance from things and knows nothing else: no relations, no speeds.
    fn as_the_method_takes_them(&self, mut rules: RuleSet) -> RuleSet {
        if self.condition.method == Method::SafeLang {
            rules.specs.retain(|rule| rule.rule_type == RuleType::Exclusion && rule.needs_grounding());
            for rule in &mut rules.specs {
                rule.relation = Relation::Near;
                rule.obj2 = None;
            }
        }
        rules
    }

    fn refuse(&mut self, key: &'static str, reason: String) {
        let (count, last) = self.told.refused.entry(key).or_default();
        *count += 1;
        *last = reason;
    }

    fn trouble(&mut self, who: &str, words: &str) {
        if !words.is_empty() && self.told.troubles.len() < N_TROUBLES_MAX {
            self.told.troubles.push(format!("{:.2} s {who}: {words}", self.now.as_secs_f64()));
        }
    }

    pub(super) fn tell_language(&mut self, input: LanguageInput) {
        for output in self.language.step(self.now, input) {
            match output {
                LanguageOutput::PublishRules(m) => self.queue.push_back(Message::Rules(m)),
                LanguageOutput::PublishReply(m) => {
                    self.note(Noted::Reply(&m));
                    self.told.replies.push(m);
                }
                // A disk that keeps everything: the journal is not what is evaluated.
                LanguageOutput::Record(_) => {
                    let recorded = Recorded { stored: Ok(()), audited: Ok(()) };
                    self.queue.push_back(Message::ToLanguage(Box::new(LanguageInput::Recorded(recorded))));
                }
                LanguageOutput::AskModel(_) => self.trouble("language", "asks a model that is not there"),
                LanguageOutput::Progress(_) => {}
                LanguageOutput::Trouble(words) => self.trouble("language", &words),
            }
        }
    }

    pub(super) fn tell_localisation(&mut self, input: localisation::Input) {
        for output in self.localisation.step(self.now, input) {
            match output {
                localisation::Output::Pose(m) => self.queue.push_back(Message::Pose(m)),
                localisation::Output::BaseMap(m) => self.queue.push_back(Message::BaseMap(m)),
                localisation::Output::Trouble(words) => self.trouble("localisation", &words),
            }
        }
    }

    pub(super) fn tell_semantics(&mut self, input: semantics::Input) {
        for output in self.semantics.step(self.now, input) {
            match output {
                semantics::Output::Ask(ask) => {
                    let answer =
                        semantics::Input::Answer { ask_id: ask.id, answer: self.models.answer(&ask) };
                    let delay = Duration::from_secs_f64(self.setup.simulator.models.delay_s.max(0.0));
                    self.put_later(ANSWER_TIME + delay, Message::ToSemantics(Box::new(answer)));
                }
                semantics::Output::Work(job) => {
                    let done = semantics::Input::Done(Box::new(self.maps.perform(&job)));
                    self.put_later(WORK_TIME, Message::ToSemantics(Box::new(done)));
                }
                semantics::Output::ObjectMap(m) => self.queue.push_back(Message::ObjectMap(m)),
                semantics::Output::RuleEnded(id) => drop(self.told.regions.remove(&id)),
                semantics::Output::DepthObstacles(m) => self.queue.push_back(Message::DepthObstacles(m)),
                semantics::Output::Beat(m) => self.queue.push_back(Message::SemanticsBeat(m)),
                semantics::Output::RulesHeld(m) => self.queue.push_back(Message::RulesHeld(m)),
                semantics::Output::Trouble(words) => self.trouble("semantics", &words),
            }
        }
    }

    pub(super) fn tell_filter(&mut self, input: FilterInput) {
        for output in self.filter.step(self.now, input) {
            match output {
                FilterOutput::Command(m) if !self.condition.filter_off => {
                    self.queue.push_back(Message::Safe(m));
                }
                FilterOutput::Command(_) => {}
                FilterOutput::Status(status) => {
                    let has_changed = status.nominal.is_some_and(|nominal| nominal != status.sent);
                    self.told.n_interventions += u64::from(has_changed);
                    self.note(Noted::Filter(&status));
                    self.told.filter = Some(*status);
                }
                FilterOutput::Held(m) => self.queue.push_back(Message::RulesHeld(m)),
                FilterOutput::ComputeField(job) => {
                    let ready = FilterInput::FieldReady(self.fields.compute(job));
                    self.put_later(FIELD_TIME, Message::ToFilter(Box::new(ready)));
                }
                FilterOutput::Rejected { key, reason } => self.refuse(key, reason.to_string()),
                FilterOutput::Note(_) => {}
            }
        }
    }

    pub(super) fn tell_navigator(&mut self, input: NavigatorInput) {
        for output in self.navigator.step(self.now, input) {
            match output {
                NavigatorOutput::Command(m) => self.queue.push_back(Message::Nominal(m)),
                NavigatorOutput::Status(status) => {
                    self.note(Noted::Navigator(&status));
                    self.told.navigator = Some(status);
                }
                NavigatorOutput::Plan(job) => {
                    let ready = NavigatorInput::PlanReady(plan::make(&job, &self.setup.profile));
                    self.put_later(PLAN_TIME, Message::ToNavigator(Box::new(ready)));
                }
                NavigatorOutput::Changed { .. } => {}
            }
        }
    }
}
