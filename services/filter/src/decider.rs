//! What the filter sends, tick by tick: everything heard comes in here, one command a tick goes out.
//!
//! Plain data in, plain data out. Distance fields leave as [`Output::ComputeField`] and come back as
//! [`Input::FieldReady`]; nothing is waited for. Whether the robot may move at all is [`crate::gate`]'s
//! judgement, how it may move is the kernel's.

use std::collections::BTreeSet;
use std::time::Duration;

use control::{Decision, Demand, Filter, RuleLayer, State};
use geometry::{Pose2, Profile, Time, Twist};
use proto::rule_set::N_RULES_MAX;
use proto::{FilterStatus, Header, Invalid, Message, RuleSet, RulesHeld, SafeCommand, Topic, topics};

use crate::ages::AgeLimits;
use crate::config::FilterSettings;
use crate::fields::{Computing, FieldJob, FieldReady, LayerId};
use crate::gate::{Facts, Reason, Verdict, judge};
use crate::heard::{Heard, not_from_the_future};
pub use crate::inputs::{Input, Note, Output};
use crate::rule_layers::{Asked, RuleLayers};
use crate::senses::Senses;
use crate::status::{self, Around};

/// Which state the log was told last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Told {
    Going,
    Slowed(&'static str),
    Stopped(&'static str),
}

/// The filter of one robot, as a service.
pub struct FilterDecider {
    profile: Profile,
    limits: AgeLimits,
    period: Duration,
    /// Farthest that any plan goes, metres.
    reach_m: f64,
    filter: Filter,
    senses: Senses,
    rules: RuleLayers,
    computing: Computing,
    gone: BTreeSet<String>,
    tick: u64,
    last_tick: Option<(Time, Time)>,
    n_late: u64,
    told: Option<Told>,
    held: Option<(Time, RulesHeld)>,
}

impl FilterDecider {
    /// The decider of a robot that has heard nothing yet.
    ///
    /// # Errors
    /// When a number of the settings is outside the range that the profile leaves it.
    pub fn new(settings: &FilterSettings, profile: &Profile) -> Result<Self, control::ConfigError> {
        let config = settings.filter_config(profile);
        let horizon_s = config.n_steps as f64 * config.step_s;
        // Drive for a horizon, turn half round, brake: no plan goes farther.
        let plan_s = horizon_s
            + std::f64::consts::PI / profile.yaw_rate_rad_s_max
            + profile.speed_m_s_max / profile.accel_m_s2_max;
        let reach_m = (profile.speed_m_s_max * plan_s).min(20.0) + profile.radius_m;
        let limits = AgeLimits::of(settings);
        Ok(FilterDecider {
            filter: Filter::new(config, profile)?,
            senses: Senses::new(profile, limits, reach_m),
            profile: profile.clone(),
            limits,
            period: Duration::from_secs_f64(1.0 / settings.rate_hz),
            reach_m,
            rules: RuleLayers::default(),
            computing: Computing::default(),
            gone: BTreeSet::new(),
            tick: 0,
            last_tick: None,
            n_late: 0,
            told: None,
            held: None,
        })
    }

    /// Takes one input in, and says what to do.
    pub fn step(&mut self, now: Time, input: Input) -> Vec<Output> {
        match input {
            Input::Odometry(heard) => self.hear(&topics::ODOMETRY, heard, |me, m| me.senses.odometry(m)),
            Input::Scan(heard) => self.hear(&topics::SCAN, heard, |me, m| me.senses.scan(m)),
            Input::Nominal(heard) => self.hear(&topics::NOMINAL, heard, |me, m| me.senses.nominal(m)),
            Input::Pose(heard) => self.hear(&topics::POSE, heard, |me, m| me.senses.pose(m)),
            Input::BaseMap(heard) => self.hear(&topics::BASE_MAP, heard, |me, m| me.senses.base_map(m)),
            Input::DepthObstacles(heard) => {
                self.hear(&topics::DEPTH_OBSTACLES, heard, |me, m| me.senses.depth_obstacles(m))
            }
            Input::ObjectMap(heard) => {
                self.hear(&topics::OBJECT_MAP, heard, |me, m| Ok(me.rules.hear(m, me.reach_m)))
            }
            Input::SemanticsBeat(heard) => {
                self.hear(&topics::SEMANTICS_BEAT, heard, |me, m| me.senses.semantics_beat(m))
            }
            Input::Rules(set) => self.hear_rules(now, set),
            Input::Peer { service, alive } => {
                if alive {
                    self.gone.remove(&service);
                } else if self.gone.len() < N_RULES_MAX {
                    self.gone.insert(service);
                }
                Vec::new()
            }
            Input::FieldReady(ready) => self.field_ready(ready),
            Input::Tick { due, wall_ns } => self.tick(now, due, wall_ns),
        }
    }

    /// Takes a message in, unless its stamp lies in the future or its taker refuses it.
    fn hear<M: Message>(
        &mut self,
        topic: &Topic,
        heard: Heard<M>,
        take: impl FnOnce(&mut Self, Heard<M>) -> Result<Option<FieldJob>, Invalid>,
    ) -> Vec<Output> {
        let key = topic.key;
        let header = heard.message.header().copied().unwrap_or_default();
        match not_from_the_future(&header, heard.wall_ns).and_then(|()| take(self, heard)) {
            Ok(job) => {
                let job = job.and_then(|job| self.computing.submit(job));
                job.into_iter().map(Output::ComputeField).collect()
            }
            Err(reason) => vec![Output::Rejected { key, reason }],
        }
    }

    fn hear_rules(&mut self, now: Time, set: RuleSet) -> Vec<Output> {
        let (version, n_rules) = (set.version, set.specs.len());
        match self.rules.take(set, now) {
            Ok(true) => vec![Output::Note(Note::Rules { version, n_rules })],
            Ok(false) => Vec::new(),
            Err(reason) => vec![Output::Rejected { key: topics::RULES.key, reason }],
        }
    }

    fn field_ready(&mut self, ready: FieldReady) -> Vec<Output> {
        let next = self.computing.done(&ready.tag.layer);
        let mut outputs: Vec<Output> = next.into_iter().map(Output::ComputeField).collect();
        let (key, taken) = match ready.tag.layer.clone() {
            LayerId::Base => (topics::BASE_MAP.key, self.senses.base_ready(ready)),
            LayerId::Depth => (topics::DEPTH_OBSTACLES.key, self.senses.depth_ready(ready)),
            LayerId::Rule(id) => (topics::OBJECT_MAP.key, self.rules.ready(&id, ready)),
        };
        if let Err(reason) = taken {
            outputs.push(Output::Rejected { key, reason });
        }
        outputs
    }

    fn tick(&mut self, now: Time, due: Time, wall_ns: u64) -> Vec<Output> {
        self.tick += 1;
        let (elapsed, late) = self.pass_time(now, due);
        let facts = self.senses.facts(now, self.rules.objects_since(), self.rules.version().is_some());
        let verdict = judge(&facts, &self.limits);
        let around = self.around(now, &facts);
        let mut outputs = self.told(now, &verdict);
        let state = self.senses.state(now);
        let status = match (&verdict, state) {
            (Verdict::Go | Verdict::Slow(_), Some(_)) if late > self.period / 2 => {
                status::rested(around, self.filter.rest(elapsed), late.as_millis())
            }
            (Verdict::Go | Verdict::Slow(_), Some((state, map_from_odom))) => {
                self.decide(now, elapsed, (state, map_from_odom), &verdict, around)
            }
            (Verdict::Stop(reason), state) => {
                let sent = self.filter.brake(elapsed, state.map(|(state, _)| state));
                status::stopped(around, sent, &self.with_the_gone(reason))
            }
            (Verdict::Zero(reason), _) => {
                self.filter.brake(elapsed, None);
                status::stopped(around, Twist::ZERO, &self.with_the_gone(reason))
            }
            // The gate lets nothing pass without a state; should it ever, nothing moves.
            (Verdict::Go | Verdict::Slow(_), None) => {
                self.filter.brake(elapsed, None);
                status::stopped(around, Twist::ZERO, "the state is not known")
            }
        };
        let echo = self.senses.command_sent(self.tick, now);
        let header = Header { seq: self.tick, stamp_ns: wall_ns, echo };
        outputs.insert(0, Output::Command(SafeCommand { header, twist: status.sent }));
        outputs.extend(self.held(now, &status));
        outputs.push(Output::Status(Box::new(status)));
        outputs
    }

    /// Time since the last tick, and how late this one is; skipped ticks count as late.
    fn pass_time(&mut self, now: Time, due: Time) -> (Duration, Duration) {
        let late = now.since(due);
        let mut elapsed = self.period;
        if let Some((last_now, last_due)) = self.last_tick {
            elapsed = now.since(last_now);
            let n_periods = due.since(last_due).as_secs_f64() / self.period.as_secs_f64();
            self.n_late += (n_periods.round() as u64).saturating_sub(1);
        }
        self.n_late += u64::from(late > self.period / 2);
        self.last_tick = Some((now, due));
        (elapsed, late)
    }

    fn decide(
        &mut self,
        now: Time,
        elapsed: Duration,
        (state, map_from_odom): (State, Pose2),
        verdict: &Verdict,
        around: Around,
    ) -> FilterStatus {
        let (wanted, stale) = self.senses.wanted(now);
        let Asked { layers, mut notes } =
            self.rules.asked(state.position(), self.senses.map_epoch(), &self.profile);
        let mut world = self.senses.world(state.position(), map_from_odom);
        world.rules = layers;
        if let Verdict::Slow(reason) = verdict {
            world.rules.push(RuleLayer {
                id: reason.input.to_owned(),
                label: "what semantics would see".to_owned(),
                demand: Demand::SpeedCap { speed_m_s_max: self.profile.ungrounded_speed_m_s },
            });
            notes.push(format!("going slowly: {}", self.with_the_gone(reason)));
        }
        let decision: Decision = self.filter.step(elapsed, state, wanted, &world);
        let mut status = status::decided(around, &decision, &notes);
        if let Some(reason) = stale {
            status.stop_reason = self.with_the_gone(&reason);
            let verb = if decision.command == Twist::ZERO { "stopped" } else { "ramping to zero" };
            status.words = format!("{verb}: {}", status.stop_reason);
            if decision.command == Twist::ZERO && status.action == "passed" {
                status.action = "stopped".to_owned();
            }
        }
        self.filter.take_back(decision);
        status
    }

    fn around(&self, now: Time, facts: &Facts) -> Around {
        Around {
            tick: self.tick,
            map_from_base: self.senses.state(now).map(|(state, _)| state.pose()),
            nominal: self.senses.nominal_twist(),
            rules_version: self.rules.version(),
            rules: self.rules.held(self.senses.map_epoch()),
            n_late: self.n_late,
            ages_ms: self.senses.ages_ms(now, facts),
        }
    }

    /// Which rules are held: at each change, and as often as the topic table says.
    fn held(&mut self, now: Time, status: &FilterStatus) -> Vec<Output> {
        let Some(version) = status.rules_version else { return Vec::new() };
        let held = RulesHeld { service: "filter".to_owned(), version, rules: status.rules.clone() };
        let period = Duration::from_secs_f64(1.0 / topics::RULES_HELD.rate_hz);
        let mut outputs = Vec::new();
        if let Some((at, last)) = &self.held {
            if *last == held && now.since(*at) < period {
                return outputs;
            }
            let changed = held.rules.iter().filter(|rule| !last.rules.contains(rule));
            outputs.extend(changed.map(|rule| {
                Output::Note(Note::Grounding { rule_id: rule.id.clone(), grounding: rule.grounding })
            }));
        }
        self.held = Some((now, held.clone()));
        outputs.push(Output::Held(held));
        outputs
    }

    /// What the log is told, when the state is another one.
    fn told(&mut self, now: Time, verdict: &Verdict) -> Vec<Output> {
        let stale = self.senses.wanted(now).1;
        let (told, note) = match (verdict, stale) {
            (Verdict::Stop(reason) | Verdict::Zero(reason), _) => {
                (Told::Stopped(reason.input), Note::Stopped(reason.clone()))
            }
            (_, Some(reason)) => (Told::Stopped(reason.input), Note::Stopped(reason)),
            (Verdict::Slow(reason), None) => (Told::Slowed(reason.input), Note::Slowed(reason.clone())),
            (Verdict::Go, None) => (Told::Going, Note::Going),
        };
        if self.told.replace(told) == Some(told) {
            return Vec::new();
        }
        vec![Output::Note(note)]
    }

    /// The reason's words, and which service is gone that publishes the input.
    fn with_the_gone(&self, reason: &Reason) -> String {
        let publisher = match reason.input {
            "nominal command" => topics::NOMINAL.publisher,
            "pose" | "base map" => topics::POSE.publisher,
            "semantics" => topics::SEMANTICS_BEAT.publisher,
            "rules" => topics::RULES.publisher,
            _ => topics::ODOMETRY.publisher,
        };
        // Whoever publishes for the robot is named after what it drives: the bridge, the simulator.
        let gone = self.gone.iter().find(|service| {
            let is_robot = publisher == topics::ODOMETRY.publisher;
            *service == publisher || (is_robot && ["bridge", "simulator"].contains(&service.as_str()))
        });
        gone.map_or_else(|| reason.words.clone(), |gone| format!("{} ({gone} is gone)", reason.words))
    }
}
