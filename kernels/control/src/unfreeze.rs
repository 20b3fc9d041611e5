//! Turn and drive when stuck: at rest, the choice stays at rest, and the nominal command wants to go.

use crate::certificate::certify;
use crate::dynamics::Control;
use crate::manoeuvres::{TurnAndDrive, headings};
use crate::plan::{Plan, Spares};
use crate::scene::Scene;

/// How long the robot must be stuck, seconds: ten ticks of the paper's 20 Hz.
const STUCK_S: f64 = 0.5;
/// Slowest turn that is a way out, rad/s: half a turn takes half a minute.
const TURN_RATE_RAD_S_MIN: f64 = 0.1;
/// Share of the top speed while driving out.
const SPEED_SHARE: f64 = 0.3;
/// Time of driving after the turn, seconds.
const DRIVING_S: f64 = 1.0;

/// How long the robot has been stuck, and what is left of the way out.
#[derive(Clone, Debug, Default)]
pub(crate) struct Unfreeze {
    stuck_s: f64,
    left_s: f64,
    passed_s: f64,
    /// Room for a motion under trial.
    controls: Vec<Control>,
}

impl Unfreeze {
    /// Lets time pass.
    pub(crate) fn advance(&mut self, seconds: f64) {
        self.passed_s += seconds;
    }

    /// Begins anew.
    pub(crate) fn forget(&mut self) {
        (self.stuck_s, self.left_s, self.passed_s) = (0.0, 0.0, 0.0);
    }

    /// The plan to follow instead, with the margin it keeps; `None` when not stuck. `stored` is the plan
    /// behind the last command: while unfreezing, the way out itself. Plans are written in the room of others.
    pub(crate) fn step(
        &mut self,
        scene: &Scene<'_>,
        frozen: bool,
        stored: Option<&Plan>,
        plans: &mut Spares,
    ) -> Option<(Plan, f64)> {
        let passed_s = std::mem::take(&mut self.passed_s);
        if self.left_s > 0.0 {
            self.left_s -= passed_s;
            let plan = stored.filter(|plan| self.left_s > 0.0 && !plan.is_over())?;
            return certify(scene, plan).ok().map(|(value_m, _)| (plan.copied_into(plans.take()), value_m));
        }
        let at_rest = scene.start.speed_m_s <= 0.01;
        self.stuck_s = if frozen && at_rest { self.stuck_s + passed_s } else { 0.0 };
        if self.stuck_s < STUCK_S {
            return None;
        }
        self.stuck_s = 0.0;
        let found = way_out(scene, plans, &mut self.controls);
        if let Some((plan, _)) = &found {
            // To its end: forty ticks would end most of the turns before the drive has begun.
            self.left_s = plan.samples().len() as f64 * plan.step_s();
        }
        found
    }
}

/// The certified turn-and-drive plan with the largest margin at its end.
fn way_out(scene: &Scene<'_>, plans: &mut Spares, controls: &mut Vec<Control>) -> Option<(Plan, f64)> {
    let (limits, step_s) = (scene.limits_in_force(), scene.assumptions.step_s);
    if limits.yaw_rate_rad_s_max < TURN_RATE_RAD_S_MIN {
        return None;
    }
    let mut best: Option<(Plan, f64, f64)> = None;
    for heading_rad in headings(scene.start) {
        for share in [1.0, 0.3] {
            let driving_m_s =
                (SPEED_SHARE * share * scene.assumptions.limits.speed_m_s_max).min(limits.speed_m_s_max);
            let motion = TurnAndDrive { heading_rad, turning_m_s: 0.0, driving_m_s, driving_s: DRIVING_S };
            motion.write(scene.start, &limits, step_s, controls);
            let start = (scene.start, scene.heading);
            let plan = Plan::roll_into(plans.take(), start, controls, step_s, &limits, true);
            let certified = certify(scene, &plan);
            let end = plan.samples()[plan.samples().len() - 1].state;
            let (end_m, _) = scene.nearest(end.position(), 0.0);
            let is_best = best.as_ref().is_none_or(|(_, _, best_m)| end_m > *best_m);
            let unused = match certified {
                Ok((value_m, _)) if is_best => best.replace((plan, value_m, end_m)).map(|(plan, ..)| plan),
                _ => Some(plan),
            };
            plans.keep(unused);
        }
    }
    best.map(|(plan, value_m, _)| (plan, value_m))
}
