//! The rules in force, and how far each service got with them.

use rules::Rule;
use serde::{Deserialize, Serialize};

use crate::codec::{Encoding, Invalid, Message, n_values, within};

/// Most rules that can be in force at once on the wire.
pub const N_RULES_MAX: usize = 256;

/// Every rule in force. Replaces what was held before; a version never goes back.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RuleSet {
    /// Counts changes, durably: it goes on over restarts of the language service.
    pub version: u64,
    /// The rules, oldest first.
    pub specs: Vec<Rule>,
}

impl Message for RuleSet {
    const NAME: &'static str = "RuleSet";
    const ENCODING: Encoding = Encoding::Json;
    const N_BYTES_MAX: usize = 1024 * 1024;

    fn check(&self) -> Result<(), Invalid> {
        if self.specs.len() > N_RULES_MAX {
            return Err(Invalid::new("specs", self.specs.len(), format_args!("at most {N_RULES_MAX}")));
        }
        self.specs.iter().try_for_each(check_rule)
    }
}

/// The numbers of a rule as far as the wire can judge; the profile's own limits come later.
pub(crate) fn check_rule(rule: &Rule) -> Result<(), Invalid> {
    within("buffer_m", rule.buffer_m, 0.0, rules::rule::BUFFER_M_MAX)?;
    within("vel_max", rule.vel_max.unwrap_or(0.0), 0.0, 100.0)?;
    within("ang_vel_max", rule.ang_vel_max.unwrap_or(0.0), 0.0, 100.0)?;
    if let Some(anchor) = rule.anchor {
        n_values("anchor", anchor.iter().filter(|v| v.is_finite()).count(), 3)?;
    }
    for (field, text, n_max) in [
        ("id", rule.id.as_str(), 64),
        ("obj", &rule.obj, rules::rule::NAME_CHARS_MAX),
        ("obj2", rule.obj2.as_deref().unwrap_or(""), rules::rule::NAME_CHARS_MAX),
        ("ref", &rule.reference, 2 * rules::rule::NAME_CHARS_MAX),
    ] {
        let n_chars = text.chars().count();
        if n_chars > n_max {
            let found = format!("{n_chars} characters");
            return Err(Invalid::new(field, found, format_args!("at most {n_max}")));
        }
    }
    if rule.needs_grounding() && rule.obj.is_empty() {
        return Err(Invalid::new("obj", "empty", "named, unless the relation is global"));
    }
    Ok(())
}

/// How far the search for a rule's object got.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Grounding {
    /// Not found yet.
    Searching,
    /// Found; its region is in force.
    Grounded,
    /// Found, but which one is meant cannot be told: all are covered.
    Ambiguous,
    /// Was found; its region cannot be used any more.
    Lost,
    /// Needs no object.
    NotNeeded,
}

impl Grounding {
    /// Whether the rule's region, as published, is to be kept.
    #[must_use]
    pub fn is_usable(self) -> bool {
        matches!(self, Grounding::Grounded | Grounding::Ambiguous | Grounding::NotNeeded)
    }
}

/// One rule, as one service holds it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RuleHeld {
    /// The rule's id.
    pub id: String,
    /// How far its grounding got, as this service sees it.
    pub grounding: Grounding,
}

/// Which rule set a service holds: accepted, enforced and grounded are three visible things.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RulesHeld {
    /// The service.
    pub service: String,
    /// Version of the rule set it acts on.
    pub version: u64,
    /// Each rule of that set.
    pub rules: Vec<RuleHeld>,
}

impl Message for RulesHeld {
    const NAME: &'static str = "RulesHeld";
    const ENCODING: Encoding = Encoding::Json;
    const N_BYTES_MAX: usize = 64 * 1024;

    fn check(&self) -> Result<(), Invalid> {
        if self.rules.len() > N_RULES_MAX {
            return Err(Invalid::new("rules", self.rules.len(), format_args!("at most {N_RULES_MAX}")));
        }
        Ok(())
    }
}
