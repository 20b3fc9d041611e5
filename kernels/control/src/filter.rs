//! The safety filter: a nominal command in, a command with a certified plan behind it out.
//!
//! [`Filter::step`] reads like the method: predict the state, see what the world demands there, find the
//! safest certified motion, then choose the command closest to the nominal one that keeps enough of it. When
//! nothing new is certified the rest of the last plan is sent; when even that is broken, the plan of least
//! harm. No command leaves that is not finite. Not here: ages of inputs, clocks, the bus (the service).

use std::collections::HashMap;
use std::time::Duration;

use geometry::{Profile, Twist};

use crate::config::{ConfigError, FilterConfig, Method};
use crate::decision::{Action, Certified, Decision, Texts, binding, braking_words, recovered_rule, words};
use crate::dynamics::{Control, Limits, State};
use crate::exit::ExitMap;
use crate::fast::Isa;
use crate::latency::OnTheWay;
use crate::margin::{Demand, World};
use crate::noise::Noise;
use crate::paper_literal::PaperLiteral;
use crate::plan::{Plan, Spares};
use crate::points::PointIndex;
use crate::primitives::deviation;
use crate::recovery;
use crate::scene::{Assumptions, Scene, Spare};
use crate::score::{Best, Search};
use crate::unfreeze::Unfreeze;

mod choice;

pub(crate) use choice::Choice;
#[cfg(test)]
pub(crate) use choice::capped;

/// Farthest place on any map, metres.
const PLACE_M_MAX: f64 = 1e5;
/// Largest unwrapped heading, radians: sixteen thousand turns, still exact to a nanoradian.
const YAW_RAD_MAX: f64 = 1e5;
/// A margin to nothing at all is reported as this, metres: infinity is no number to publish.
const FAR_M: f64 = 1000.0;
/// Most rules remembered for "was in it when told".
const N_RULES_REMEMBERED: usize = 1000;

/// The filter of one robot.
#[derive(Debug)]
pub struct Filter {
    config: FilterConfig,
    assumptions: Assumptions,
    search: Search,
    tick: u64,
    /// The plan behind the last command.
    plan: Option<Plan>,
    /// The last solution of the score: its warm start.
    safest: Option<Plan>,
    on_the_way: OnTheWay,
    last_command: Twist,
    /// Rules with a limit of 0 in a zone: whether the robot stood in it when first told.
    told_inside: HashMap<String, bool>,
    exits: Exits,
    unfreeze: Unfreeze,
    literal: PaperLiteral,
    noise: Noise,
    best: Best,
    continued: Best,
    room: Room,
}

/// What one tick leaves to the next, so that nothing is allocated.
#[derive(Debug, Default)]
struct Room {
    scene: Spare,
    texts: Texts,
    plans: Spares,
    controls: Vec<Control>,
    primitives: Vec<Control>,
    ranking: recovery::Room,
}

/// The ways out of the zones that the robot stands in, kept for some ticks; their room for good.
#[derive(Debug, Default)]
struct Exits {
    /// How old they are, seconds; `None` when the robot stood in no zone since.
    age_s: Option<f64>,
    is_way_out: bool,
    /// Whether the only way out leads through zones that the robot is not in.
    through_zones: bool,
    map: ExitMap,
}

impl Filter {
    /// A filter for a robot.
    ///
    /// # Errors
    /// [`ConfigError`] names the first number outside the range that the profile leaves it.
    pub fn new(config: FilterConfig, profile: &Profile) -> Result<Filter, ConfigError> {
        let config = config.checked(profile)?;
        let assumptions = Assumptions::of(&config, profile);
        let sigma =
            Control { yaw_rate_rad_s: config.sigma_yaw_rate_rad_s, accel_m_s2: config.sigma_accel_m_s2 };
        let FilterConfig { n_samples, n_rounds, n_steps, .. } = config;
        let filter = Filter {
            literal: PaperLiteral::new(config.method == Method::PaperLiteralBlending),
            config,
            assumptions,
            search: Search { n_samples, n_rounds, n_steps, sigma },
            tick: 0,
            plan: None,
            safest: None,
            on_the_way: OnTheWay::default(),
            last_command: Twist::ZERO,
            told_inside: HashMap::new(),
            exits: Exits::default(),
            unfreeze: Unfreeze::default(),
            noise: Noise::default(),
            best: Best::default(),
            continued: Best::default(),
            room: Room::default(),
        };
        Ok(filter.on(Isa::detect()))
    }

    /// The same filter on these instructions instead of the widest that the processor has, to compare them: what
    /// it decides is the same.
    #[must_use]
    pub fn on(mut self, isa: Isa) -> Filter {
        self.noise = Noise::on(isa);
        self.room.scene.points = vec![PointIndex::on(isa)];
        // The room that every tick needs is there before the first.
        self.noise_for_this_tick();
        self
    }

    /// The configuration in force.
    #[must_use]
    pub fn config(&self) -> &FilterConfig {
        &self.config
    }

    /// The plan behind the last command, for display.
    #[must_use]
    pub fn plan(&self) -> Option<&Plan> {
        self.plan.as_ref()
    }

    /// Filters one nominal command.
    ///
    /// `elapsed` is the time since the previous call of any method, by which plans are shifted; `state` is
    /// measured now, in the frame of the world's fields; `nominal` is a set-point.
    pub fn step(&mut self, elapsed: Duration, state: State, nominal: Twist, world: &World) -> Decision {
        self.pass_time(elapsed);
        let limits = self.assumptions.limits;
        if !nominal.is_finite() {
            return self.braking(elapsed, "the nominal command is not finite");
        }
        if !is_plausible(state, &limits) {
            return self.braking(elapsed, "the state is not finite or impossible");
        }
        let measured = State { speed_m_s: state.speed_m_s.max(0.0), ..state };
        let start = self.on_the_way.predict(measured, self.config.latency_s, &limits);
        self.remember_where_told(world, start);
        let told_inside = std::mem::take(&mut self.told_inside);
        let stands_still = |id: &str| told_inside.get(id).copied().unwrap_or(false);
        let mut scene = Scene::with(world, start, self.assumptions, &stands_still, &mut self.room.scene);
        let wanted = limits.control_towards(start.speed_m_s, nominal, self.config.step_s);

        let choice = match self.config.method {
            Method::PaperLiteral | Method::PaperLiteralBlending => {
                self.noise_for_this_tick();
                self.noise.draw(self.search.n_rounds.max(1));
                self.literal.choose(world, &scene, wanted, &self.noise, &self.search, &self.config)
            }
            _ => self.choose(&mut scene, nominal, wanted),
        };
        self.told_inside = told_inside;
        scene.leave(&mut self.room.scene);
        self.decide(choice, world, start, nominal, wanted)
    }

    /// Takes a decision back that nobody reads any more: the next one is written in its room, and ticks
    /// like those before then allocate nothing.
    pub fn take_back(&mut self, decision: Decision) {
        self.room.texts.take_back(decision);
    }

    /// What is left of the stored plan: sent when no decision can be made in time.
    pub fn rest(&mut self, elapsed: Duration) -> Twist {
        self.pass_time(elapsed);
        let command = match &self.plan {
            Some(plan) => plan.command(),
            None => self.ramped_down(elapsed),
        };
        self.send(command)
    }

    /// Full braking from the present command, along the present arc: sent when an input is stale.
    ///
    /// The stored plan is given up.
    pub fn brake(&mut self, elapsed: Duration, state: Option<State>) -> Twist {
        self.pass_time(elapsed);
        let mut command = self.ramped_down(elapsed);
        if let Some(speed_m_s) = state.map(|s| s.speed_m_s).filter(|v| v.is_finite()) {
            // A base that is slower than its command must not be sped up by braking.
            let slower_m_s = command.speed_m_s.min(speed_m_s.max(0.0));
            command = scaled(command, slower_m_s);
        }
        self.forget_plans();
        self.send(command)
    }

    fn decide(
        &mut self,
        choice: Choice,
        world: &World,
        start: State,
        nominal: Twist,
        wanted: Control,
    ) -> Decision {
        let Choice { plan, mut action, v_safe_m, v_sent_m, certified, held_by } = choice;
        let limits = self.assumptions.limits;
        let mut command = plan.command();
        let sent = plan.control_at(0.0);
        let reaches = (nominal.speed_m_s - start.speed_m_s).abs()
            <= limits.accel_m_s2_max * self.config.step_s + 1e-9
            && (0.0..=limits.speed_m_s_max).contains(&nominal.speed_m_s)
            && nominal.yaw_rate_rad_s.abs() <= limits.yaw_rate_rad_s_max;
        if action == Action::Passed && reaches {
            command = nominal;
        }
        let held_by = held_by.and_then(|(source, breach)| {
            let radius_m = self.assumptions.radius_m;
            binding(&mut self.room.texts, world, source, breach, start.position(), radius_m)
        });
        if let (Action::Recovering { rule }, Some(held_by)) = (&mut action, &held_by) {
            *rule = recovered_rule(&mut self.room.texts, held_by);
        }
        let deviation = if action == Action::Passed { 0.0 } else { deviation(sent, wanted, &limits) };
        let words = words(&mut self.room.texts, &action, command, nominal, held_by.as_ref());
        let last = self.plan.replace(plan);
        self.room.plans.keep(last);
        let command = self.send(command);
        let (v_safe_m, v_sent_m) = (v_safe_m.clamp(-FAR_M, FAR_M), v_sent_m.clamp(-FAR_M, FAR_M));
        Decision { command, action, v_safe_m, v_sent_m, binding: held_by, certified, deviation, words }
    }

    /// A braking decision, for an input that cannot be used.
    fn braking(&mut self, elapsed: Duration, why: &'static str) -> Decision {
        let command = scaled(self.last_command, self.ramped_down(elapsed).speed_m_s);
        self.forget_plans();
        let command = self.send(command);
        Decision {
            command,
            action: Action::Braking,
            v_safe_m: 0.0,
            v_sent_m: 0.0,
            binding: None,
            certified: Certified::No { why },
            deviation: 0.0,
            words: braking_words(&mut self.room.texts, why),
        }
    }

    fn forget_plans(&mut self) {
        self.room.plans.keep(self.plan.take());
        self.room.plans.keep(self.safest.take());
        self.unfreeze.forget();
    }

    /// The last command after braking for `elapsed`, along its own arc.
    fn ramped_down(&self, elapsed: Duration) -> Twist {
        let lost_m_s = self.assumptions.limits.accel_m_s2_max * elapsed.as_secs_f64();
        let left_m_s = self.last_command.speed_m_s - lost_m_s;
        // What rounding leaves of a ramp is rest.
        scaled(self.last_command, if left_m_s > 1e-9 { left_m_s } else { 0.0 })
    }

    /// The last line: nothing leaves that is not a number or beyond the limits, which the envelope would refuse.
    fn send(&mut self, command: Twist) -> Twist {
        let Limits { speed_m_s_max, yaw_rate_rad_s_max, .. } = self.assumptions.limits;
        let command = if command.is_finite() { command } else { Twist::ZERO };
        let command = Twist {
            speed_m_s: command.speed_m_s.clamp(0.0, speed_m_s_max),
            yaw_rate_rad_s: command.yaw_rate_rad_s.clamp(-yaw_rate_rad_s_max, yaw_rate_rad_s_max),
        };
        self.last_command = command;
        self.on_the_way.push(command);
        command
    }

    fn pass_time(&mut self, elapsed: Duration) {
        let seconds = elapsed.as_secs_f64();
        self.tick = self.tick.wrapping_add(1);
        self.on_the_way.advance(seconds);
        self.unfreeze.advance(seconds);
        for plan in [&mut self.plan, &mut self.safest].into_iter().flatten() {
            plan.advance(seconds);
        }
        if let Some(age_s) = &mut self.exits.age_s {
            *age_s += seconds;
        }
    }

    /// Notes for each rule with a limit of 0 in a zone whether the robot stood in it when first told.
    fn remember_where_told(&mut self, world: &World, start: State) {
        for rule in &world.rules {
            let Demand::Limit { zone: Some(zone), buffer_m, speed_m_s_max: Some(limit), .. } = &rule.demand
            else {
                continue;
            };
            let is_new = *limit <= 0.0 && !self.told_inside.contains_key(&rule.id);
            if is_new && self.told_inside.len() < N_RULES_REMEMBERED {
                let margin_m = zone.sample(start.position()) - self.assumptions.radius_m - buffer_m;
                self.told_inside.insert(rule.id.clone(), margin_m <= 0.0);
            }
        }
        if self.told_inside.len() == N_RULES_REMEMBERED {
            self.told_inside.retain(|id, _| world.rules.iter().any(|rule| rule.id == *id));
        }
    }
}

/// Whether a state can be true of this base: finite, on a map, and no faster than twice the top speed, beyond
/// which the bound between samples would not hold.
fn is_plausible(state: State, limits: &Limits) -> bool {
    state.is_finite()
        && state.x_m.abs().max(state.y_m.abs()) <= PLACE_M_MAX
        && state.yaw_rad.abs() <= YAW_RAD_MAX
        && state.speed_m_s.abs() <= 2.0 * limits.speed_m_s_max
}

/// A command at another speed along the same arc.
fn scaled(command: Twist, speed_m_s: f64) -> Twist {
    if command.speed_m_s <= 0.0 || speed_m_s <= 0.0 {
        return Twist::ZERO;
    }
    let share = (speed_m_s / command.speed_m_s).min(1.0);
    Twist::new(command.speed_m_s * share, command.yaw_rate_rad_s * share)
}
