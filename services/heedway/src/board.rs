//! What is known of a robot at this moment, in words: a status line, and a line for each change.
//!
//! Decides only what to say; reading the network and writing to the terminal are others' work.

use std::collections::BTreeMap;

use geometry::{Pose2, Twist};
use proto::{FilterStatus, Grounding, Health, NavigatorStatus, RobotStatus, RuleSet, RulesHeld};
use rules::Rule;

use crate::hearing::Heard;

/// What is known of a robot.
#[derive(Debug, Default)]
pub struct Board {
    map_from_base: Option<Pose2>,
    twist: Option<Twist>,
    filter: Option<FilterStatus>,
    navigator: Option<NavigatorStatus>,
    robot: Option<RobotStatus>,
    rules: Option<RuleSet>,
    held: BTreeMap<String, RulesHeld>,
    alive: BTreeMap<String, bool>,
    troubles: BTreeMap<String, String>,
    n_rejected: BTreeMap<String, u64>,
}

impl Board {
    /// Takes in what was heard; gives a line for each change of state.
    pub fn hear(&mut self, heard: &Heard) -> Vec<String> {
        match heard {
            Heard::Peer(peer) => {
                let before = self.alive.insert(peer.service.clone(), peer.alive);
                let word = if peer.alive { "came" } else { "has gone" };
                told(before != Some(peer.alive), || format!("{} {word}", peer.service))
            }
            Heard::Odometry(odometry) => {
                self.twist = Some(odometry.message.twist);
                Vec::new()
            }
            Heard::Filter(status) => self.hear_filter(&status.message),
            Heard::Navigator(status) => {
                let status = &status.message;
                let changed = self.navigator.as_ref().map(|old| &old.state) != Some(&status.state);
                self.navigator = Some(status.clone());
                told(changed, || with_words("navigator", &status.state, &status.words))
            }
            Heard::Robot(status) => {
                let status = &status.message;
                let state = |s: &RobotStatus| (s.stopped, without_numbers(&s.reason));
                let changed = self.robot.as_ref().map(state) != Some(state(status));
                self.robot = Some(status.clone());
                let word = if status.stopped { "holds the robot" } else { "lets the robot go" };
                told(changed, || with_words("last guard", word, &status.reason))
            }
            Heard::Rules(set) => self.hear_rules(&set.message),
            Heard::Held(held) => self.hear_held(&held.message),
            Heard::Health(health) => self.hear_health(&health.message),
            Heard::Reply(reply) => {
                let reply = &reply.message;
                vec![format!("{:?}: {}", reply.text, reply.reply.say)]
            }
            Heard::BaseMap(_) | Heard::ObjectMap(_) | Heard::Truth(_) => Vec::new(),
        }
    }

    fn hear_filter(&mut self, status: &FilterStatus) -> Vec<String> {
        let state = |s: &FilterStatus| {
            let words = if s.stop_reason.is_empty() { &s.words } else { &s.stop_reason };
            (s.action.clone(), without_numbers(words))
        };
        let changed = self.filter.as_ref().map(state) != Some(state(status));
        if let Some(pose) = status.map_from_base {
            self.map_from_base = Some(pose);
        }
        self.filter = Some(status.clone());
        told(changed, || format!("filter: {}", filter_words(status)))
    }

    fn hear_rules(&mut self, set: &RuleSet) -> Vec<String> {
        let changed = self.rules.as_ref() != Some(set);
        self.rules = Some(set.clone());
        told(changed, || {
            let list: Vec<String> = set.specs.iter().map(rules::english::status).collect();
            let list = if list.is_empty() { "none".to_owned() } else { list.join("; ") };
            format!("rules, version {}: {list}", set.version)
        })
    }

    fn hear_held(&mut self, held: &RulesHeld) -> Vec<String> {
        let before = self.held.insert(held.service.clone(), held.clone());
        let lines = held.rules.iter().filter_map(|rule| {
            let old = before.as_ref().and_then(|b| b.rules.iter().find(|r| r.id == rule.id));
            let changed = old.map(|r| r.grounding) != Some(rule.grounding);
            changed.then(|| {
                let name = self.rule(&rule.id).map_or_else(|| rule.id.clone(), rules::english::status);
                format!("{}: {name}: {}", held.service, grounding_word(rule.grounding))
            })
        });
        lines.collect()
    }

    fn hear_health(&mut self, health: &Health) -> Vec<String> {
        let name = &health.service;
        let mut lines = Vec::new();
        let trouble = without_numbers(&health.trouble);
        if self.troubles.insert(name.clone(), trouble.clone()).unwrap_or_default() != trouble {
            let words = if health.trouble.is_empty() { "well again" } else { &health.trouble };
            lines.push(format!("{name}: {words}"));
        }
        let n_rejected = health.rejected.iter().map(|r| r.count).sum();
        if self.n_rejected.insert(name.clone(), n_rejected).unwrap_or_default() < n_rejected {
            let last = health.rejected.iter().max_by_key(|r| r.count);
            let words = last.map(|r| format!("{}: {}", r.key, r.last_reason)).unwrap_or_default();
            lines.push(format!("{name}: {n_rejected} messages rejected ({words})"));
        }
        lines
    }

    /// The rule with this id, if it is in force.
    #[must_use]
    pub fn rule(&self, id: &str) -> Option<&Rule> {
        self.rules.as_ref()?.specs.iter().find(|rule| rule.id == id)
    }

    /// The rules in force, once they are known.
    #[must_use]
    pub fn rules(&self) -> Option<&RuleSet> {
        self.rules.as_ref()
    }

    /// How far each service got with the rules.
    #[must_use]
    pub fn held(&self) -> &BTreeMap<String, RulesHeld> {
        &self.held
    }

    /// Whether a service is alive, as far as is known.
    #[must_use]
    pub fn is_alive(&self, service: &str) -> bool {
        self.alive.get(service).copied().unwrap_or(false)
    }

    /// What the filter last said.
    #[must_use]
    pub fn filter(&self) -> Option<&FilterStatus> {
        self.filter.as_ref()
    }

    /// How far a rule's object is found, as told by semantics, else by the filter.
    #[must_use]
    pub fn grounding(&self, rule_id: &str) -> Option<Grounding> {
        let held_by = |service: &str| {
            let held = self.held.get(service)?;
            Some(held.rules.iter().find(|rule| rule.id == rule_id)?.grounding)
        };
        held_by("semantics").or_else(|| held_by("filter"))
    }

    /// Pose, speed, rules, and what the filter does and why, in one line.
    #[must_use]
    pub fn line(&self) -> String {
        let mut parts = vec![match self.map_from_base {
            Some(pose) => {
                format!("({:5.2}, {:5.2}) m {:4.0}°", pose.x_m, pose.y_m, pose.yaw_rad.to_degrees())
            }
            None => "pose unknown".to_owned(),
        }];
        if let Some(twist) = self.twist {
            // A robot at rest has no sign.
            parts.push(format!(
                "{:4.2} m/s",
                if twist.speed_m_s.abs() < 0.005 { 0.0 } else { twist.speed_m_s }
            ));
        }
        match &self.rules {
            Some(set) => parts.extend(set.specs.iter().map(|rule| {
                let found = self.grounding(&rule.id).map_or("not held yet", grounding_word);
                format!("{} [{found}]", rules::english::status(rule))
            })),
            None => parts.push("rules unknown".to_owned()),
        }
        parts.push(match &self.filter {
            Some(status) => filter_words(status),
            None => "filter silent".to_owned(),
        });
        let gone: Vec<&str> =
            self.alive.iter().filter(|(_, alive)| !**alive).map(|(n, _)| n.as_str()).collect();
        if !gone.is_empty() {
            parts.push(format!("gone: {}", gone.join(", ")));
        }
        parts.join(" | ")
    }
}

/// How far the search for an object got, as a person says it.
#[must_use]
pub fn grounding_word(grounding: Grounding) -> &'static str {
    match grounding {
        Grounding::Searching => "looking for it",
        Grounding::Grounded => "found",
        Grounding::Ambiguous => "found several",
        Grounding::Lost => "lost",
        Grounding::NotNeeded => "in force",
    }
}

/// What the filter does and why, in one phrase.
#[must_use]
pub fn filter_words(status: &FilterStatus) -> String {
    match (status.words.is_empty(), status.stop_reason.is_empty()) {
        (true, true) => status.action.clone(),
        (true, false) => format!("{}: {}", status.action, status.stop_reason),
        (false, true) => status.words.clone(),
        (false, false) if status.words.contains(&status.stop_reason) => status.words.clone(),
        (false, false) => format!("{} ({})", status.words, status.stop_reason),
    }
}

fn with_words(who: &str, state: &str, words: &str) -> String {
    if words.is_empty() { format!("{who}: {state}") } else { format!("{who}: {state}: {words}") }
}

fn told(changed: bool, line: impl FnOnce() -> String) -> Vec<String> {
    if changed { vec![line()] } else { Vec::new() }
}

/// The words without their numbers: an age that grows is no change of state.
fn without_numbers(words: &str) -> String {
    words.chars().filter(|c| !c.is_ascii_digit() && *c != '.').collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::Time;
    use proto::RuleHeld;
    use rules::Relation;
    use service::{PeerChange, Received};

    fn received<M>(message: M) -> Received<M> {
        Received { message, at: Time::ZERO, instance: String::new() }
    }

    fn filter(action: &str, words: &str, stop_reason: &str) -> Heard {
        let text = serde_json::json!({
            "tick": 1, "action": action, "words": words, "stop_reason": stop_reason,
            "map_from_base": { "x_m": 1.0, "y_m": 2.0, "yaw_rad": 0.0 }, "nominal": null,
            "sent": { "speed_m_s": 0.0, "yaw_rate_rad_s": 0.0 }, "v_safe_m": null, "v_sent_m": null,
            "binding": null, "certified": true, "uncertified_reason": "", "deviation": 0.0,
            "rules_version": null, "rules": [], "used_us": 1, "n_late": 0, "ages_ms": []
        });
        Heard::Filter(received(serde_json::from_value(text).unwrap()))
    }

    fn rule_set() -> Heard {
        let rule = Rule { id: "s1".into(), ..Rule::exclusion(Relation::Beneath, "standing desk") };
        Heard::Rules(received(RuleSet { version: 2, specs: vec![rule] }))
    }

    fn held(service: &str, grounding: Grounding) -> Heard {
        let rules = vec![RuleHeld { id: "s1".into(), grounding }];
        Heard::Held(received(RulesHeld { service: service.into(), version: 2, rules }))
    }

    #[test]
    fn a_change_is_told_once_and_a_growing_number_is_no_change() {
        let mut board = Board::default();
        assert_eq!(board.hear(&filter("blended", "slowed: 0.4 m from the crib", "")).len(), 1);
        assert_eq!(board.hear(&filter("blended", "slowed: 0.3 m from the crib", "")), [""; 0]);
        let stopped = filter("stopped", "", "scan 312 ms old, at most 300 ms");
        assert_eq!(board.hear(&stopped), ["filter: stopped: scan 312 ms old, at most 300 ms"]);
        let older = filter("stopped", "", "scan 362 ms old, at most 300 ms");
        assert_eq!(board.hear(&older), [""; 0]);
    }

    #[test]
    fn a_service_that_goes_is_named_until_it_is_back() {
        let mut board = Board::default();
        let peer = |alive| Heard::Peer(PeerChange { service: "filter".into(), alive });
        assert_eq!(board.hear(&peer(true)), ["filter came"]);
        assert_eq!(board.hear(&peer(false)), ["filter has gone"]);
        assert!(board.line().contains("gone: filter"), "{}", board.line());
        assert_eq!(board.hear(&peer(true)), ["filter came"]);
        assert!(!board.line().contains("gone"), "{}", board.line());
    }

    #[test]
    fn a_rule_is_shown_with_how_far_its_object_is_found() {
        let mut board = Board::default();
        board.hear(&rule_set());
        assert!(board.line().contains("standing desk [not held yet]"), "{}", board.line());
        let told = board.hear(&held("filter", Grounding::Searching));
        assert!(told.len() == 1 && told[0].contains("looking for it"), "{told:?}");
        assert_eq!(board.hear(&held("filter", Grounding::Searching)), [""; 0]);
        board.hear(&held("semantics", Grounding::Grounded));
        assert!(board.line().contains("standing desk [found]"), "{}", board.line());
    }
}
