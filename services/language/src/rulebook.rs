//! The rules in force as they are kept: with version, ids given, deadlines, and who said them.
//!
//! Plain data and how it changes. A change makes a new book of the next version; the old one stays in
//! force until the new one is on the disk, which is not this file's business.

use proto::RuleSet;
use rules::Rule;
use serde::{Deserialize, Serialize};

use crate::boot::BootClock;

/// What is durable. A version never goes back and an id is never given twice.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rulebook {
    /// Counts changes; 1 is the empty book of a first start.
    pub version: u64,
    /// How many ids were ever given: the next is `s` and this plus one.
    pub n_ids_given: u64,
    /// The rules in force, oldest first.
    pub kept: Vec<KeptRule>,
    /// When this was written, by a clock that nobody can set; none when the host has no such clock.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub written: Option<BootClock>,
}

/// One rule in force.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeptRule {
    /// The rule.
    pub rule: Rule,
    /// When it ends, milliseconds since the Unix epoch by the host's wall clock; none when it is revoked.
    pub deadline_unix_ms: Option<u64>,
    /// How much of its lifetime was left when this was written, milliseconds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub left_ms: Option<u64>,
    /// Who said it.
    pub speaker: String,
}

impl Default for Rulebook {
    fn default() -> Self {
        Rulebook { version: 1, n_ids_given: 0, kept: Vec::new(), written: None }
    }
}

impl Rulebook {
    /// The rules in force, oldest first.
    #[must_use]
    pub fn active(&self) -> Vec<Rule> {
        self.kept.iter().map(|kept| kept.rule.clone()).collect()
    }

    /// The rules in force, as they go to the network.
    #[must_use]
    pub fn rule_set(&self) -> RuleSet {
        RuleSet { version: self.version, specs: self.active() }
    }

    /// Whether a rule of this id is in force.
    #[must_use]
    pub fn holds(&self, id: &str) -> bool {
        self.kept.iter().any(|kept| kept.rule.id == id)
    }

    /// The next book: without the rules of these ids, and with new ones, which are given ids here.
    #[must_use]
    pub fn changed(&self, revoked: &[String], new: Vec<Rule>, speaker: &str, unix_ms: u64) -> Rulebook {
        let mut next = Rulebook {
            version: self.version + 1,
            n_ids_given: self.n_ids_given,
            kept: self.kept.iter().filter(|kept| !revoked.contains(&kept.rule.id)).cloned().collect(),
            written: None,
        };
        for mut rule in new {
            next.n_ids_given += 1;
            rule.id = format!("s{}", next.n_ids_given);
            let deadline_unix_ms = rule.ttl_s.map(|ttl_s| unix_ms.saturating_add(ttl_s.saturating_mul(1000)));
            let left_ms = rule.ttl_s.map(|ttl_s| ttl_s.saturating_mul(1000));
            next.kept.push(KeptRule { rule, deadline_unix_ms, left_ms, speaker: speaker.to_owned() });
        }
        next
    }

    /// The newest `n` rules.
    #[must_use]
    pub fn newest(&self, n: usize) -> Vec<Rule> {
        let n_older = self.kept.len().saturating_sub(n);
        self.kept.iter().skip(n_older).map(|kept| kept.rule.clone()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rules::Relation;

    #[test]
    fn an_id_is_not_given_again_after_its_rule_is_gone() {
        let rug = || vec![Rule::exclusion(Relation::On, "rug")];
        let one = Rulebook::default().changed(&[], rug(), "ann", 5_000);
        assert!(one.holds("s1"));
        let none = one.changed(&["s1".into()], vec![], "ann", 6_000);
        assert!(none.kept.is_empty());
        let two = none.changed(&[], rug(), "ann", 7_000);
        assert_eq!((two.version, two.newest(1)[0].id.as_str()), (4, "s2"));
    }

    #[test]
    fn a_lifetime_becomes_a_deadline() {
        let rug = Rule { ttl_s: Some(60), ..Rule::exclusion(Relation::On, "rug") };
        let book = Rulebook::default().changed(&[], vec![rug], "ann", 5_000);
        assert_eq!(book.kept[0].deadline_unix_ms, Some(65_000));
        assert_eq!(book.kept[0].speaker, "ann");
    }
}
