//! From the goal to the end of a run: turn by turn, judged by what really happens.

use geometry::{Point2, Pose2};
use heedway_simulator::scene::Hull;
use heedway_simulator::simulated_robot::World;
use proto::Instruction;
use rules::Outcome;

use super::{GOAL_TOLERANCE_M, PathPoint, RUN_S_MAX, Run, Task};
use crate::course::{Course, Deed, Progress, REVOCATION, with_box};
use crate::judge::{Judge, Moment};
use crate::system::{Message, System, TURN};

/// How near the goal counts as there, metres.
const REACHED_M: f64 = GOAL_TOLERANCE_M + 0.05;
/// Slower than this is at rest, m/s and rad/s.
const REST: f64 = 0.02;
/// A point of the path is kept at every so many-th turn.
const N_TURNS_A_POINT: u64 = 5;

/// What is kept from turn to turn.
pub(super) struct Drive<'a> {
    task: &'a Task<'a>,
    hull: Hull,
    brake_m_s2: f64,
    course: Course,
    /// Of the rules as they will be, before they are told.
    scout: Judge,
    /// Of the rules in force.
    judge: Option<Judge>,
    speed_m_s: f64,
    accel_m_s2: f64,
    jerk_sum: f64,
}

impl<'a> Drive<'a> {
    /// Nothing is said yet.
    pub(super) fn new(task: &'a Task<'a>, hull: Hull, brake_m_s2: f64, course: Course) -> Self {
        let scout = Judge::new(task.case, task.scene, task.scene.map_from_start);
        Drive {
            task,
            hull,
            brake_m_s2,
            course,
            scout,
            judge: None,
            speed_m_s: 0.0,
            accel_m_s2: 0.0,
            jerk_sum: 0.0,
        }
    }

    /// Says the words, and judges by them from here on, whether the robot hears them or not.
    pub(super) fn say(&mut self, system: &mut System, run: &mut Run) {
        let (map_from_anchor, twist, _) = system.truth();
        let judge = Judge::new(self.task.case, self.task.scene, map_from_anchor);
        self.judge = Some(judge.told_at_speed(twist.speed_m_s, self.brake_m_s2));
        if let Some(words) = self.task.say.filter(|_| system.listens()) {
            tell(system, run, words);
        }
    }

    /// Until the goal, a collision, or the end of time.
    ///
    /// # Errors
    /// When what appears cannot be seen.
    pub(super) fn until_the_end(
        mut self,
        world: &World,
        system: &mut System,
        run: &mut Run,
    ) -> anyhow::Result<()> {
        let begun = system.now();
        let (mut last, _, _) = system.truth();
        let mut changed: Option<World> = None;
        let mut n_turns = 0_u64;
        loop {
            let (map_from_base, twist, n_collisions) = system.truth();
            let (time_s, at) = (system.now().since(begun).as_secs_f64(), map_from_base.position());
            let truth = &changed.as_ref().unwrap_or(world).truth;
            run.least_clearance_m = run.least_clearance_m.min(truth.clearance_m(at));
            let gaps = truth.objects(at);
            let (elapsed_s, radius_m) = (TURN.as_secs_f64(), self.hull.radius_m);
            let moment = Moment { time_s, elapsed_s, map_from_base, twist, gaps: &gaps, radius_m };
            if let Some(judge) = &mut self.judge {
                judge.see(&moment);
            }
            self.measure(system, run, &moment, last);
            last = map_from_base;
            if n_turns.is_multiple_of(N_TURNS_A_POINT) {
                let (filter, speed_m_s) = (in_words(system), twist.speed_m_s);
                run.path.push(PathPoint { time_s, position_map: at, speed_m_s, filter });
            }
            run.n_collisions = n_collisions;
            let is_there = (self.task.scene.goal_map - at).norm() <= REACHED_M;
            run.reached = is_there && twist.speed_m_s.abs() < REST && twist.yaw_rate_rad_s.abs() < REST;
            if run.reached || n_collisions > 0 || time_s >= RUN_S_MAX {
                break;
            }
            let way_map = system.told.navigator.as_ref().map_or(&[][..], |status| status.path.as_slice());
            let (breaks, room_m) = (self.scout.breaks(&moment), self.scout.room_m(&moment));
            let progress = Progress { time_s, position_map: at, breaks, room_m, way_map };
            match self.course.next(&progress, truth) {
                None => {}
                Some(Deed::Say) => self.say(system, run),
                Some(Deed::Revoke) => self.revoke(system, run),
                Some(Deed::SetDown(spot)) => {
                    changed = Some(system.appear(with_box(self.task.scene, spot))?);
                    run.remarks
                        .push(format!("a box appeared at ({:.2}, {:.2}) at {time_s:.2} s", spot.x, spot.y));
                }
            }
            n_turns += 1;
            system.turn();
        }
        run.remarks.extend(self.course.left_out());
        self.close(run);
        Ok(())
    }

    fn measure(&mut self, system: &System, run: &mut Run, moment: &Moment<'_>, last: Pose2) {
        let (elapsed_s, at): (f64, Point2) = (moment.elapsed_s, moment.map_from_base.position());
        run.path_m += (at - last.position()).norm();
        let accel_m_s2 = (moment.twist.speed_m_s - self.speed_m_s) / elapsed_s;
        self.jerk_sum += (accel_m_s2 - self.accel_m_s2).abs();
        (self.speed_m_s, self.accel_m_s2) = (moment.twist.speed_m_s, accel_m_s2);
        match is_grounded(system) {
            Some(true) if run.grounded_after_s.is_none() => run.grounded_after_s = Some(moment.time_s),
            Some(false) => run.ungrounded_s += elapsed_s,
            _ => {}
        }
        run.time_s = moment.time_s;
    }

    /// Takes the words back: what was broken until then stays broken.
    fn revoke(&mut self, system: &mut System, run: &mut Run) {
        if system.listens() {
            tell(system, run, REVOCATION);
        }
        self.keep_findings(run);
    }

    fn keep_findings(&mut self, run: &mut Run) {
        if let Some(judge) = self.judge.take() {
            run.findings = judge.findings().clone();
        }
    }

    fn close(mut self, run: &mut Run) {
        self.keep_findings(run);
        run.jerk_m_s3 = if run.time_s > 0.0 { self.jerk_sum / run.time_s } else { 0.0 };
    }
}

/// Says something, and notes when it was not taken.
fn tell(system: &mut System, run: &mut Run, words: &str) {
    system.put(Message::Instruction(Instruction::plain(words)));
    let reply = system.told.replies.last().map(|told| &told.reply);
    if reply.is_none_or(|reply| !matches!(reply.outcome, Outcome::Accept | Outcome::Revoke)) {
        let said = reply.map_or("nothing", |reply| reply.say.as_str());
        run.remarks.push(format!("the words were not taken as a rule; the reply is: {said}"));
    }
}

/// What was wanted and what was sent, and why.
fn in_words(system: &System) -> String {
    let Some(status) = &system.told.filter else { return String::new() };
    let wanted = status.nominal.map_or_else(String::new, |twist| {
        format!("wanted {:.2} m/s {:.2} rad/s, ", twist.speed_m_s, twist.yaw_rate_rad_s)
    });
    let v_m = |value: Option<f64>| value.map_or("-".to_owned(), |v| format!("{v:.3}"));
    format!(
        "{wanted}sent {:.2} m/s {:.2} rad/s; V {} of {}; {}: {}",
        status.sent.speed_m_s,
        status.sent.yaw_rate_rad_s,
        v_m(status.v_sent_m),
        v_m(status.v_safe_m),
        status.action,
        status.words
    )
}

/// Whether every rule in force that needs an object has one; `None` when no rule is in force.
fn is_grounded(system: &System) -> Option<bool> {
    let status = system.told.filter.as_ref().filter(|status| !status.rules.is_empty())?;
    Some(status.rules.iter().all(|rule| rule.grounding.is_usable()))
}
