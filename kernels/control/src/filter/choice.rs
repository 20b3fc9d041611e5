//! The choice at one tick: which certified plan, or which plan when none is.
//!
//! In falling order: a control chosen by the method among certified plans; the rest of the last plan; the plan
//! of least harm. Where something is broken at the start already, the way back. Not here: what is made of the
//! choice on the way out (`filter`).

use geometry::Twist;

use super::Filter;
use crate::certificate::{Breach, certify};
use crate::config::Method;
use crate::decision::{Action, Certified};
use crate::dynamics::{Control, Limits};
use crate::exit::ExitMap;
use crate::plan::Plan;
use crate::primitives::primitives;
use crate::recovery::{Ranked, least_harm, remaining_controls};
use crate::scene::{Assumptions, Scene, Source};
use crate::score::{Runner, Search, Wanted, search};

/// How long a map of the ways out is used, seconds: a flood takes milliseconds, zones change slowly.
const EXITS_AGE_S_MAX: f64 = 0.5;

/// What was chosen, before it is dressed up as a [`Decision`].
pub(crate) struct Choice {
    pub plan: Plan,
    pub action: Action,
    pub v_safe_m: f64,
    pub v_sent_m: f64,
    pub certified: Certified,
    /// What held the nominal control back.
    pub held_by: Option<(Source, Option<Breach>)>,
}

impl Filter {
    /// Chooses the plan of this tick; `wanted` is the control towards the nominal set-point.
    pub(super) fn choose(&mut self, scene: &mut Scene<'_>, nominal: Twist, wanted: Control) -> Choice {
        let is_broken = scene.spatial.iter().any(|layer| layer.soft || layer.is_too_near(&scene.assumptions));
        if is_broken {
            return self.recover(scene);
        }
        self.exits.age_s = None;
        self.noise_for_this_tick();
        let runner = Runner::start(scene);
        let rate = wanted.yaw_rate_rad_s;
        let goal = Wanted { above_m: 0.0, enough_m: self.config.ample_m };
        let mut best = std::mem::take(&mut self.best);
        // The last solution and the rest of the last plan.
        let warm = [&self.safest, &self.plan].into_iter().flatten().map(remaining_controls);
        search(scene, &self.search, &mut self.noise, runner, (rate, warm), goal, &mut best);
        let choice = match best.value_m {
            Some(v_safe_m) => {
                let safest = self.roll(scene, &best.controls);
                let choice = self.choose_certified(scene, runner, (nominal, wanted), (v_safe_m, &safest));
                let last = self.safest.replace(safest);
                self.room.plans.keep(last);
                choice
            }
            None => None,
        };
        self.best = best;
        let mut choice = choice.or_else(|| self.rest_of_plan(scene)).unwrap_or_else(|| self.broken(scene));
        let frozen = choice.plan.command().speed_m_s <= 1e-3;
        let wants = nominal.speed_m_s > 0.02;
        let stored = self.plan.as_ref();
        if let Some((plan, v_sent_m)) =
            self.unfreeze.step(scene, frozen && wants, stored, &mut self.room.plans)
        {
            self.room.plans.keep(Some(std::mem::replace(&mut choice.plan, plan)));
            (choice.action, choice.v_sent_m) = (Action::Unfreezing, v_sent_m);
        }
        choice
    }

    /// Chooses among certified plans by the configured method; `None` when the full check disagrees.
    fn choose_certified(
        &mut self,
        scene: &Scene<'_>,
        runner: Runner,
        (nominal, wanted): (Twist, Control),
        (v_safe_m, safest): (f64, &Plan),
    ) -> Option<Choice> {
        let config = &self.config;
        let (is_blending, needed_m) = match config.method {
            Method::LeastRestrictive => (false, config.epsilon_m),
            _ => (true, (1.0 - config.gamma_per_s * config.step_s) * v_safe_m.min(config.ample_m)),
        };
        let capped = capped(scene, nominal, config.step_s);
        // The nominal control is the nearest of the primitives; the others are made when it does not pass.
        let mut passed = self.continues(scene, runner, safest, wanted, needed_m).then_some(wanted);
        if passed.is_none() && is_blending {
            let (room, limits) = (std::mem::take(&mut self.room.primitives), &scene.assumptions.limits);
            let all = primitives(wanted, capped, limits, &scene.limits_in_force(), room);
            let mut others = all.iter().copied().skip(1);
            passed = others.find(|&first| self.continues(scene, runner, safest, first, needed_m));
            self.room.primitives = all;
        }
        // A wish that is too fast for a rule in force is held to it, not refused: one that turns too fast would stop
        // the robot for good.
        if passed.is_none() && !is_blending && capped != wanted {
            passed = Some(capped).filter(|&first| self.continues(scene, runner, safest, first, needed_m));
        }
        let (plan, action, v_sent_m) = match passed {
            Some(first) => {
                let mut controls = std::mem::take(&mut self.room.controls);
                controls.clear();
                controls.push(first);
                controls.extend(&self.continued.controls);
                let action = if first == wanted { Action::Passed } else { Action::Blended };
                let plan = self.roll(scene, &controls);
                self.room.controls = controls;
                (plan, action, self.continued.value_m.unwrap_or(v_safe_m))
            }
            None => (self.copied(safest), Action::Backup, v_safe_m),
        };
        // The rollouts skip what cannot matter; the stored plan is checked once more, in full.
        if certify(scene, &plan).is_err() {
            self.room.plans.keep(Some(plan));
            return None;
        }
        let too_fast = scene.limits.iter().find(|layer| layer.braking_from_m_s.is_some());
        if let Some(layer) = too_fast {
            let over_m_s = scene.start.speed_m_s - layer.speed_m_s;
            let certified = Certified::No { why: "too fast for a limit, braking" };
            let held_by = Some((layer.source, Some(Breach::Fast(layer.source, over_m_s))));
            let action = Action::Recovering { rule: None };
            return Some(Choice { plan, action, v_safe_m, v_sent_m, certified, held_by });
        }
        let held_by = (action != Action::Passed).then(|| self.held_by(scene, wanted)).flatten();
        let certified = Certified::Yes;
        Some(Choice { plan, action, v_safe_m, v_sent_m, certified, held_by })
    }

    /// Whether a certified plan begins with a control and keeps at least `needed_m`; left in `continued`.
    fn continues(
        &mut self,
        scene: &Scene<'_>,
        mut runner: Runner,
        safest: &Plan,
        first: Control,
        needed_m: f64,
    ) -> bool {
        // Only what is enough counts: the rest of each rollout is not even looked at.
        let goal = Wanted { above_m: needed_m.next_down().max(0.0), enough_m: needed_m };
        if !runner.step(scene, first, goal.above_m) {
            return false;
        }
        // The last solution, from where the first step ends.
        let after = std::iter::once(safest.controls(1..safest.samples().len() - 1));
        let from = (first.yaw_rate_rad_s, after);
        search(scene, &self.search, &mut self.noise, runner, from, goal, &mut self.continued);
        self.continued.value_m.is_some()
    }

    /// What holds a control back: the first thing that braking right after it would break, else come nearest.
    fn held_by(&mut self, scene: &Scene<'_>, wanted: Control) -> Option<(Source, Option<Breach>)> {
        let plan = self.roll(scene, &[wanted]);
        let certified = certify(scene, &plan);
        self.room.plans.keep(Some(plan));
        match certified {
            Ok((_, source)) => source.map(|source| (source, None)),
            Err(breach) => breach.source().map(|source| (source, Some(breach))),
        }
    }

    /// The rest of the stored plan, when it still passes in this world.
    fn rest_of_plan(&mut self, scene: &Scene<'_>) -> Option<Choice> {
        let plan = self.plan.take()?;
        let certified = certify(scene, &plan).ok().map(|kept| (self.copied(&plan), kept));
        self.plan = Some(plan);
        let (plan, (v_sent_m, source)) = certified?;
        let held_by = source.map(|source| (source, None));
        let certified = Certified::Yes;
        Some(Choice { plan, action: Action::Resting, v_safe_m: v_sent_m, v_sent_m, certified, held_by })
    }

    /// Nothing is certified: the plan of least harm.
    fn broken(&mut self, scene: &Scene<'_>) -> Choice {
        let why = match self.plan.as_ref().map(|plan| certify(scene, plan)) {
            Some(Err(breach)) => breach.source().map(|source| (source, Some(breach))),
            _ => None,
        };
        let ranked = self.least_harm(scene, None);
        let plan = ranked.map_or_else(|| self.roll(scene, &[]), |ranked| ranked.plan);
        let v_sent_m = certify(scene, &plan).map_or(0.0, |(value_m, _)| value_m);
        Choice {
            plan,
            action: Action::LeastHarm,
            v_safe_m: 0.0,
            v_sent_m,
            certified: Certified::No { why: "no plan keeps every margin" },
            held_by: why,
        }
    }

    fn least_harm(&mut self, scene: &Scene<'_>, exits: Option<&ExitMap>) -> Option<Ranked> {
        let samples = self.room.plans.take();
        least_harm(scene, exits, self.plan.as_ref(), &mut self.room.ranking, samples)
    }

    /// A margin is broken at the start: the way back.
    fn recover(&mut self, scene: &mut Scene<'_>) -> Choice {
        let nearest = scene.spatial.iter().find(|layer| layer.soft);
        let rule = nearest.map(|layer| layer.source);
        let source = rule.or(scene.spatial.first().map(|layer| layer.source));
        let in_zone = rule.is_some();
        // Too near by the error of a measurement, and the plan under way passes: it goes on to its rest.
        let is_under_way = self.plan.as_ref().is_some_and(|plan| !plan.is_over());
        if !in_zone
            && is_under_way
            && let Some(choice) = self.rest_of_plan(scene)
        {
            return choice;
        }
        let is_way_out = in_zone && self.look_for_exits(scene);
        let exits = std::mem::take(&mut self.exits);
        let ranked = self.least_harm(scene, is_way_out.then_some(&exits.map));
        self.exits = exits;
        let (plan, spares) = match ranked {
            Some(ranked) => {
                let spares = ranked.spares_obstacles();
                (ranked.plan, spares)
            }
            None => (self.roll(scene, &[]), false),
        };
        // An obstacle that only looks too near must not undo a plan that was certified against it.
        let stored = self.plan.take();
        let kept = stored.as_ref().filter(|kept| !spares && certify(scene, kept).is_ok());
        let plan = match kept {
            Some(kept) => {
                self.room.plans.keep(Some(plan));
                self.copied(kept)
            }
            None => plan,
        };
        self.plan = stored;
        let v_m = scene.spatial.first().map_or(0.0, |layer| layer.start_m);
        let why = match (in_zone, is_way_out) {
            (true, true) => "standing in a zone, leaving",
            (true, false) => "standing in a zone that has no way out",
            (false, _) => "too near, moving clear",
        };
        Choice {
            plan,
            action: Action::Recovering { rule: None },
            v_safe_m: v_m,
            v_sent_m: v_m,
            certified: Certified::No { why },
            held_by: source.map(|source| (source, None)),
        }
    }

    /// Whether there is a way out, as the map of them says; zones that the robot is not in are given up when there is
    /// none around them.
    fn look_for_exits(&mut self, scene: &mut Scene<'_>) -> bool {
        let exits = &mut self.exits;
        let is_fresh = exits.age_s.is_some_and(|age_s| age_s < EXITS_AGE_S_MAX);
        if !is_fresh {
            exits.age_s = Some(0.0);
            exits.is_way_out = exits.map.find(scene);
            exits.through_zones = !exits.is_way_out;
        }
        if exits.through_zones {
            give_up_zones(scene);
            if !is_fresh {
                exits.is_way_out = exits.map.find(scene);
            }
        }
        exits.is_way_out
    }

    /// Begins the noise that all scores of this tick share.
    pub(super) fn noise_for_this_tick(&mut self) {
        let Search { n_samples, n_rounds, n_steps, .. } = self.search;
        // The paper's own filter samples at least one round.
        self.noise.begin(self.config.seed, self.tick, (n_rounds.max(1), n_samples), n_steps);
    }

    fn roll(&mut self, scene: &Scene<'_>, controls: &[Control]) -> Plan {
        let Assumptions { limits, step_s, braking_tail, .. } = scene.assumptions;
        let room = self.room.plans.take();
        Plan::roll_into(room, (scene.start, scene.heading), controls, step_s, &limits, braking_tail)
    }

    fn copied(&mut self, plan: &Plan) -> Plan {
        let room = self.room.plans.take();
        plan.copied_into(room)
    }
}

/// No zone binds any more: there is no way out but through one.
fn give_up_zones(scene: &mut Scene<'_>) {
    for layer in &mut scene.spatial {
        layer.soft |= !layer.is_base();
    }
}

/// The nominal command held to the limits that are in force at the start.
pub(crate) fn capped(scene: &Scene<'_>, nominal: Twist, step_s: f64) -> Control {
    let Limits { speed_m_s_max, yaw_rate_rad_s_max: rate_max, .. } = scene.limits_in_force();
    let held =
        Twist::new(nominal.speed_m_s.min(speed_m_s_max), nominal.yaw_rate_rad_s.clamp(-rate_max, rate_max));
    scene.assumptions.limits.control_towards(scene.start.speed_m_s, held, step_s)
}
