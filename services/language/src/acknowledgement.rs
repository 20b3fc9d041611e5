//! How far each service got with the rules: accepted here, enforced there, grounded in the world.

use std::collections::BTreeMap;
use std::time::Duration;

use geometry::Time;
use proto::{Grounding, RulesHeld};

/// Most services that are kept track of; the table knows two.
const N_SERVICES_MAX: usize = 16;
/// How long a service may stay behind before that is trouble. Chosen: three repetitions of the rule set.
const BEHIND_MAX: Duration = Duration::from_secs(3);

/// How far one service got.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Progress {
    /// The service.
    pub service: String,
    /// Version of the rule set it acts on.
    pub version: u64,
    /// Rules of that set that need no search any more.
    pub n_usable: usize,
    /// Rules of that set.
    pub n_rules: usize,
}

/// The latest word of each service.
#[derive(Clone, Debug, Default)]
pub struct Acknowledgements {
    services: BTreeMap<String, (Progress, Time)>,
}

impl Acknowledgements {
    /// A service was heard, while `version` is in force; its progress, when that changed.
    pub fn hear(&mut self, now: Time, held: &RulesHeld, version: u64) -> Option<Progress> {
        let is_known = self.services.contains_key(&held.service);
        if !is_known && self.services.len() >= N_SERVICES_MAX {
            return None;
        }
        let usable = held.rules.iter().filter(|rule| Grounding::is_usable(rule.grounding));
        let progress = Progress {
            service: held.service.clone(),
            version: held.version,
            n_usable: usable.count(),
            n_rules: held.rules.len(),
        };
        let before = self.services.get(&held.service);
        let changed = before.is_none_or(|(before, _)| *before != progress);
        // Since when it is behind: as long as it is not, that is now.
        let current_at = match before {
            Some((_, at)) if held.version < version => *at,
            _ => now,
        };
        self.services.insert(held.service.clone(), (progress.clone(), current_at));
        changed.then_some(progress)
    }

    /// Which services act on older rules than those in force, and have for a while; empty when none.
    #[must_use]
    pub fn behind(&mut self, now: Time, version: u64) -> String {
        let mut behind = Vec::new();
        for (progress, current_at) in self.services.values_mut() {
            if progress.version >= version {
                *current_at = now;
            } else if now.since(*current_at) > BEHIND_MAX {
                behind.push(format!(
                    "{} holds rules {}, in force are {version}",
                    progress.service, progress.version
                ));
            }
        }
        behind.join("; ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::RuleHeld;

    fn held(version: u64, grounding: Grounding) -> RulesHeld {
        RulesHeld { service: "filter".into(), version, rules: vec![RuleHeld { id: "s1".into(), grounding }] }
    }

    fn s(seconds: u64) -> Time {
        Time::ZERO + Duration::from_secs(seconds)
    }

    #[test]
    fn only_a_change_is_progress() {
        let mut acknowledgements = Acknowledgements::default();
        assert!(acknowledgements.hear(s(0), &held(2, Grounding::Searching), 2).is_some());
        assert_eq!(acknowledgements.hear(s(1), &held(2, Grounding::Searching), 2), None);
        let progress = acknowledgements.hear(s(2), &held(2, Grounding::Grounded), 2).unwrap();
        assert_eq!((progress.n_usable, progress.n_rules), (1, 1));
    }

    #[test]
    fn a_service_that_stays_behind_is_trouble_until_it_is_not() {
        let mut acknowledgements = Acknowledgements::default();
        acknowledgements.hear(s(0), &held(2, Grounding::Grounded), 2);
        assert_eq!(acknowledgements.behind(s(100), 2), "");
        acknowledgements.hear(s(102), &held(2, Grounding::Grounded), 3);
        assert_eq!(acknowledgements.behind(s(103), 3), "");
        let words = acknowledgements.behind(s(104), 3);
        assert!(words.contains("filter") && words.contains('2') && words.contains('3'), "{words}");
        acknowledgements.hear(s(105), &held(3, Grounding::Grounded), 3);
        assert_eq!(acknowledgements.behind(s(105), 3), "");
    }
}
