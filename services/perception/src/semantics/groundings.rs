//! How far each rule got: searching, grounded, ambiguous, lost; and when that is told.

use std::collections::BTreeMap;
use std::time::Duration;

use geometry::Time;
use proto::{CellSet, Grounding, Header, ObjectMap, RuleHeld};
use rules::Rule;

use super::regions::{Finding, Missing};

/// Every map is repeated this often.
const REPEAT_PERIOD: Duration = Duration::from_millis(500);
/// A map that changes is told at most this often, unless its grounding changes.
const CHANGE_PERIOD: Duration = Duration::from_millis(200);
/// Longest remark.
const REMARK_CHARS_MAX: usize = 400;

/// What is known of each rule.
#[derive(Clone, Debug, Default)]
pub struct Groundings {
    standings: BTreeMap<String, Standing>,
    /// Ids in the order of the rule set.
    order: Vec<String>,
}

#[derive(Clone, Debug)]
struct Standing {
    rule: Rule,
    grounding: Grounding,
    region: Option<CellSet>,
    remark: String,
    stamp_ns: u64,
    n_sent: u64,
    sent: Option<Time>,
    is_changed: bool,
    /// The grounding itself has changed since it was told.
    is_urgent: bool,
}

impl Standing {
    fn new(rule: &Rule) -> Self {
        let needs = rule.needs_grounding();
        Standing {
            rule: rule.clone(),
            grounding: if needs { Grounding::Searching } else { Grounding::NotNeeded },
            region: None,
            remark: String::new(),
            stamp_ns: 0,
            n_sent: 0,
            sent: None,
            is_changed: true,
            is_urgent: true,
        }
    }

    fn set(&mut self, grounding: Grounding, region: Option<CellSet>, remark: &str) {
        let remark: String = remark.chars().take(REMARK_CHARS_MAX).collect();
        self.is_urgent |= grounding != self.grounding;
        self.is_changed |= self.is_urgent || region != self.region || remark != self.remark;
        (self.grounding, self.region, self.remark) = (grounding, region, remark);
    }
}

/// Whether two rules speak of the same region.
fn same_region(a: &Rule, b: &Rule) -> bool {
    (a.relation, &a.obj, &a.obj2, a.phrase(), &a.except, a.anchor)
        == (b.relation, &b.obj, &b.obj2, b.phrase(), &b.except, b.anchor)
}

impl Groundings {
    /// Takes over a rule set; returns the ids of rules that ended.
    pub fn set_rules(&mut self, rules: &[Rule]) -> Vec<String> {
        self.order = rules.iter().map(|rule| rule.id.clone()).collect();
        let ended: Vec<String> =
            self.standings.keys().filter(|id| !self.order.contains(id)).cloned().collect();
        self.standings.retain(|id, _| !ended.contains(id));
        for rule in rules {
            let standing = self.standings.entry(rule.id.clone()).or_insert_with(|| Standing::new(rule));
            if !same_region(&standing.rule, rule) {
                // The count goes on: it is the key's, not the region's.
                *standing = Standing { n_sent: standing.n_sent, ..Standing::new(rule) };
            }
            standing.rule = rule.clone();
        }
        ended
    }

    /// Begins anew: nothing that was found can be used in the new map.
    pub fn restart(&mut self) {
        for standing in self.standings.values_mut().filter(|s| s.rule.needs_grounding()) {
            standing.set(Grounding::Searching, None, "the map has changed, looking again");
            standing.stamp_ns = 0;
        }
    }

    /// Whether any object is not found yet.
    #[must_use]
    pub fn is_searching(&self) -> bool {
        self.standings.values().any(|s| !s.grounding.is_usable())
    }

    /// Takes in what is known of the rules now.
    pub fn apply(&mut self, findings: Vec<Finding>) {
        for finding in findings {
            let Some(standing) = self.standings.get_mut(&finding.rule_id) else { continue };
            standing.stamp_ns = finding.stamp_ns;
            match finding.region {
                Ok(region) => {
                    let grounding =
                        if region.is_ambiguous { Grounding::Ambiguous } else { Grounding::Grounded };
                    standing.set(grounding, Some(region.cells), &region.remark);
                }
                // What was found and is there no more was carried off.
                Err(Missing::NotSeen(reason)) if standing.grounding == Grounding::Searching => {
                    standing.set(Grounding::Searching, None, &reason);
                }
                Err(Missing::NotSeen(reason)) => standing.set(Grounding::Lost, None, &reason),
                // What was found stays in force while the new region cannot be told.
                Err(Missing::CannotTell(reason)) => {
                    let (grounding, region) = (standing.grounding, standing.region.take());
                    standing.region.clone_from(&region);
                    standing.set(grounding, region, &reason);
                }
            }
        }
    }

    /// The maps that are to be told now.
    pub fn due(&mut self, now: Time, map_epoch: u64, echo: u64) -> Vec<ObjectMap> {
        let mut maps = Vec::new();
        for (rule_id, standing) in &mut self.standings {
            let since = standing.sent.map(|sent| now.since(sent));
            let is_due = match since {
                None => true,
                Some(since) => {
                    standing.is_urgent
                        || since >= REPEAT_PERIOD
                        || (standing.is_changed && since >= CHANGE_PERIOD)
                }
            };
            if !is_due || !standing.rule.needs_grounding() {
                continue;
            }
            standing.n_sent += 1;
            standing.sent = Some(now);
            (standing.is_changed, standing.is_urgent) = (false, false);
            maps.push(ObjectMap {
                header: Header { seq: standing.n_sent, stamp_ns: standing.stamp_ns, echo },
                map_epoch,
                rule_id: rule_id.clone(),
                grounding: standing.grounding,
                region: standing.region.clone(),
                remark: standing.remark.clone(),
            });
        }
        maps
    }

    /// Each rule and how far it got, in the order of the rule set.
    #[must_use]
    pub fn held(&self) -> Vec<RuleHeld> {
        let standings = self.order.iter().filter_map(|id| self.standings.get(id));
        standings.map(|s| RuleHeld { id: s.rule.id.clone(), grounding: s.grounding }).collect()
    }
}
