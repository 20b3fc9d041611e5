//! What happens when in one run: wait until the robot could move, say the words, give the goal, end.
//!
//! Decides only; listening, putting and killing are the stage's work.

use std::time::Duration;

use geometry::{Point2, Time};
use proto::Truth;
use rules::{Outcome, Reply};

use crate::carry::ServiceName;
use crate::hearing::Heard;

/// Longest time until the robot could move, from when all services are alive.
const READY_MAX: Duration = Duration::from_secs(30);
/// Longest time to the reply.
const REPLY_MAX: Duration = Duration::from_secs(5);
/// Longest time to the goal, of the simulation.
pub const RUN_S_MAX: f64 = 35.0;
/// Longest silence of the truth.
const TRUTH_SILENCE_MAX: Duration = Duration::from_secs(3);
/// How near the goal counts as there, metres: what the navigator is asked for, and a little.
pub const GOAL_TOLERANCE_M: f64 = 0.25;
const REACHED_M: f64 = GOAL_TOLERANCE_M + 0.05;
/// Slower than this is at rest, m/s and rad/s.
const REST: f64 = 0.02;

/// What the stage has to do.
#[derive(Clone, Debug, PartialEq)]
pub enum Deed {
    /// Put these words on the instruction key, as plain text.
    Say(String),
    /// Give the goal.
    Go,
    /// The run is over.
    End(End),
}

/// How a run ended.
#[derive(Clone, Debug, PartialEq)]
pub enum End {
    /// At the goal and at rest.
    Reached,
    /// The goal was not reached in time.
    TimeOver,
    /// It could not go on.
    Failed {
        /// Why.
        why: String,
        /// Whose log may tell more.
        look_at: Option<ServiceName>,
    },
}

/// What the director hears.
pub enum Input<'a> {
    /// A message.
    Heard(&'a Heard),
    /// Time has passed.
    Tick,
}

/// Decides what happens when.
#[derive(Debug)]
pub struct Director {
    words: Option<String>,
    goal_map: Point2,
    phase: Phase,
    /// What the filter waits for, as last told.
    waits_for: String,
    /// Simulated time of the goal, seconds.
    start_s: Option<f64>,
    truth_at: Time,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    Readying { since: Time },
    Asking { since: Time },
    Driving,
    Over,
}

impl Director {
    /// Begins a run at `now`, when all services are alive.
    #[must_use]
    pub fn new(now: Time, words: Option<&str>, goal_map: Point2) -> Self {
        Director {
            words: words.map(|words| words.trim().to_owned()),
            goal_map,
            phase: Phase::Readying { since: now },
            waits_for: "the filter is silent".to_owned(),
            start_s: None,
            truth_at: now,
        }
    }

    /// What is going on, in words; empty while driving.
    #[must_use]
    pub fn words(&self) -> String {
        match self.phase {
            Phase::Readying { .. } => format!("getting ready ({})", self.waits_for),
            Phase::Asking { .. } => "listening".to_owned(),
            Phase::Driving | Phase::Over => String::new(),
        }
    }

    /// What to do now.
    pub fn step(&mut self, now: Time, input: &Input<'_>) -> Vec<Deed> {
        if let Input::Heard(Heard::Truth(_)) = input {
            self.truth_at = now;
        }
        let deeds = match self.phase {
            Phase::Readying { since } => self.ready(now, since, input),
            Phase::Asking { since } => self.ask(now, since, input),
            Phase::Driving => self.drive(now, input),
            Phase::Over => Vec::new(),
        };
        if deeds.iter().any(|deed| matches!(deed, Deed::End(_))) {
            self.phase = Phase::Over;
        }
        deeds
    }

    fn ready(&mut self, now: Time, since: Time, input: &Input<'_>) -> Vec<Deed> {
        if let Input::Heard(Heard::Filter(status)) = input {
            let status = &status.message;
            status.stop_reason.clone_into(&mut self.waits_for);
            if status.stop_reason.is_empty() {
                let Some(words) = &self.words else { return self.go(now) };
                self.phase = Phase::Asking { since: now };
                return vec![Deed::Say(words.clone())];
            }
        }
        if now.since(since) > READY_MAX {
            let why = format!("not ready within {} s: {}", READY_MAX.as_secs(), self.waits_for);
            return failed(why, Some(ServiceName::Filter));
        }
        Vec::new()
    }

    fn ask(&mut self, now: Time, since: Time, input: &Input<'_>) -> Vec<Deed> {
        if let Input::Heard(Heard::Reply(reply)) = input
            && Some(reply.message.text.trim()) == self.words.as_deref()
        {
            let Reply { outcome, say, .. } = &reply.message.reply;
            if *outcome != Outcome::Accept {
                return failed(format!("the robot did not take the words as a rule: {say}"), None);
            }
            return self.go(now);
        }
        if now.since(since) > REPLY_MAX {
            let why = format!("no reply to the words within {} s", REPLY_MAX.as_secs());
            return failed(why, Some(ServiceName::Language));
        }
        Vec::new()
    }

    fn go(&mut self, now: Time) -> Vec<Deed> {
        self.phase = Phase::Driving;
        self.truth_at = now;
        vec![Deed::Go]
    }

    fn drive(&mut self, now: Time, input: &Input<'_>) -> Vec<Deed> {
        if let Input::Heard(Heard::Truth(truth)) = input {
            let truth = &truth.message;
            let start_s = *self.start_s.get_or_insert(truth.time_s);
            if self.is_there(truth) {
                return vec![Deed::End(End::Reached)];
            }
            if truth.time_s - start_s > RUN_S_MAX {
                return vec![Deed::End(End::TimeOver)];
            }
        }
        if now.since(self.truth_at) > TRUTH_SILENCE_MAX {
            let why = format!("the simulator has been silent for {} s", TRUTH_SILENCE_MAX.as_secs());
            return failed(why, Some(ServiceName::Simulator));
        }
        Vec::new()
    }

    fn is_there(&self, truth: &Truth) -> bool {
        let gap_m = (truth.map_from_base.position() - self.goal_map).norm();
        let at_rest = truth.twist.speed_m_s.abs() < REST && truth.twist.yaw_rate_rad_s.abs() < REST;
        gap_m <= REACHED_M && at_rest
    }
}

fn failed(why: String, look_at: Option<ServiceName>) -> Vec<Deed> {
    vec![Deed::End(End::Failed { why, look_at })]
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::{Pose2, Twist};
    use proto::{FilterStatus, InstructionReply};
    use service::Received;

    const WORDS: &str = "stay off the rug";

    fn at(seconds: f64) -> Time {
        Time::from_secs_f64(seconds)
    }

    fn heard<M>(message: M, wrap: fn(Received<M>) -> Heard) -> Heard {
        wrap(Received { message, at: Time::ZERO, instance: String::new() })
    }

    fn filter(stop_reason: &str) -> Heard {
        let text = serde_json::json!({
            "tick": 1, "action": "passed", "words": "", "stop_reason": stop_reason, "map_from_base": null,
            "nominal": null, "sent": { "speed_m_s": 0.0, "yaw_rate_rad_s": 0.0 }, "v_safe_m": null,
            "v_sent_m": null, "binding": null, "certified": true, "uncertified_reason": "", "deviation": 0.0,
            "rules_version": null, "rules": [], "used_us": 1, "n_late": 0, "ages_ms": []
        });
        heard(serde_json::from_value::<FilterStatus>(text).unwrap(), Heard::Filter)
    }

    fn reply(text: &str, outcome: Outcome) -> Heard {
        let reply = Reply { say: "Which rug?".into(), ..Reply::of(outcome) };
        let reply = InstructionReply {
            id: "1".into(),
            speaker: String::new(),
            text: text.into(),
            reply,
            rules_version: 1,
        };
        heard(reply, Heard::Reply)
    }

    fn truth(time_s: f64, x_m: f64, speed_m_s: f64) -> Heard {
        let truth = Truth {
            time_s,
            map_from_base: Pose2::new(x_m, 0.0, 0.0),
            twist: Twist::new(speed_m_s, 0.0),
            clearance_m: 1.0,
            n_collisions: 0,
            objects: vec![],
        };
        heard(truth, Heard::Truth)
    }

    /// A run to (5, 0), told one thing after the other; the deeds are those of the last.
    #[track_caller]
    fn check(words: Option<&str>, story: &[(f64, Heard)], wanted: &[Deed]) {
        let mut director = Director::new(at(0.0), words, Point2::new(5.0, 0.0));
        let mut deeds = Vec::new();
        for (seconds, heard) in story {
            deeds = director.step(at(*seconds), &Input::Heard(heard));
        }
        assert_eq!(deeds, wanted);
    }

    #[test]
    fn nothing_is_said_before_the_robot_could_move() {
        check(Some(WORDS), &[(1.0, filter("no base map since the start"))], &[]);
        check(Some(WORDS), &[(1.0, filter(""))], &[Deed::Say(WORDS.into())]);
        check(None, &[(1.0, filter(""))], &[Deed::Go]);
    }

    #[test]
    fn the_goal_is_given_once_the_words_are_a_rule() {
        let asked = || (1.0, filter(""));
        check(Some(WORDS), &[asked(), (2.0, reply("other words", Outcome::Accept))], &[]);
        check(Some(WORDS), &[asked(), (2.0, reply(WORDS, Outcome::Accept))], &[Deed::Go]);
        let why = "the robot did not take the words as a rule: Which rug?";
        let end = Deed::End(End::Failed { why: why.into(), look_at: None });
        check(Some(WORDS), &[asked(), (2.0, reply(WORDS, Outcome::Clarify))], &[end]);
    }

    #[test]
    fn a_run_ends_at_the_goal_at_rest_and_not_before() {
        let driving = || (1.0, filter(""));
        check(None, &[driving(), (2.0, truth(7.0, 4.9, 0.3))], &[]);
        check(None, &[driving(), (2.0, truth(7.0, 4.6, 0.0))], &[]);
        check(None, &[driving(), (2.0, truth(7.0, 4.8, 0.0))], &[Deed::End(End::Reached)]);
    }

    #[test]
    fn a_run_ends_when_its_time_is_over() {
        let story = |end_s| [(1.0, filter("")), (2.0, truth(7.0, 0.0, 0.1)), (3.0, truth(end_s, 0.0, 0.1))];
        check(None, &story(42.0), &[]);
        check(None, &story(42.1), &[Deed::End(End::TimeOver)]);
    }

    #[test]
    fn silence_ends_a_run_with_its_reason() {
        let end_of = |words: Option<&str>, story: &[(f64, Heard)], tick_s: f64| {
            let mut director = Director::new(at(0.0), words, Point2::new(5.0, 0.0));
            for (seconds, heard) in story {
                director.step(at(*seconds), &Input::Heard(heard));
            }
            match director.step(at(tick_s), &Input::Tick).as_slice() {
                [Deed::End(End::Failed { why, .. })] => why.clone(),
                other => format!("{other:?}"),
            }
        };
        assert_eq!(end_of(None, &[], 30.0), "[]");
        assert_eq!(end_of(None, &[(1.0, filter("no scan yet"))], 31.0), "not ready within 30 s: no scan yet");
        assert_eq!(end_of(Some(WORDS), &[(1.0, filter(""))], 6.5), "no reply to the words within 5 s");
        assert_eq!(end_of(None, &[(1.0, filter(""))], 4.5), "the simulator has been silent for 3 s");
    }
}
