//! How rules meet: the lowest limit wins, and a repeated rule takes the place of the older one.
//!
//! Rules only ever tighten each other, so two of them never contradict. What is loosened is
//! loosened by the person lifting a rule, which is not decided here.

use crate::{Relation, Rule, RuleType};

/// The limits that hold where several kinematic rules overlap.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Limits {
    /// Lowest speed limit, m/s; none when nobody limits it.
    pub vel_max: Option<f64>,
    /// Lowest turn rate limit, rad/s; none when nobody limits it.
    pub ang_vel_max: Option<f64>,
}

impl Limits {
    /// These limits and those of one more rule; exclusions limit nothing.
    #[must_use]
    pub fn and(self, rule: &Rule) -> Limits {
        if rule.rule_type == RuleType::Exclusion {
            return self;
        }
        Limits {
            vel_max: lowest(self.vel_max, rule.vel_max),
            ang_vel_max: lowest(self.ang_vel_max, rule.ang_vel_max),
        }
    }
}

/// The lowest limits among `rules`, all taken as holding at once.
#[must_use]
pub fn tightest<'a>(rules: impl IntoIterator<Item = &'a Rule>) -> Limits {
    rules.into_iter().fold(Limits::default(), Limits::and)
}

fn lowest(a: Option<f64>, b: Option<f64>) -> Option<f64> {
    match (a, b) {
        (Some(a), Some(b)) => Some(a.min(b)),
        (one, other) => one.or(other),
    }
}

/// Whether both speak of the same kind of rule, relation and object (in either order for a gap).
///
/// The object counts with its whole phrase: a rule on the red sofa is not one on the blue sofa.
#[must_use]
pub fn same_region(a: &Rule, b: &Rule) -> bool {
    if a.rule_type != b.rule_type || a.relation != b.relation || a.except != b.except {
        return false;
    }
    if a.relation == Relation::Between {
        let first = (a.obj.as_str(), a.obj2.as_deref().unwrap_or_default());
        let second = (b.obj.as_str(), b.obj2.as_deref().unwrap_or_default());
        return first == second || first == (second.1, second.0);
    }
    a.relation == Relation::Global || (a.obj == b.obj && a.phrase() == b.phrase())
}

/// Whether accepting `new` puts `old` out of force: a rule repeated for the same region.
///
/// A kinematic rule with a smaller activation distance does not replace a wider one, nor one that
/// limits something it leaves free: both then hold, and the lower limit wins where they overlap.
#[must_use]
pub fn replaces(new: &Rule, old: &Rule) -> bool {
    if !same_region(new, old) {
        return false;
    }
    match new.rule_type {
        RuleType::Exclusion => true,
        RuleType::Kinematic => {
            new.buffer_m >= old.buffer_m
                && (old.vel_max.is_none() || new.vel_max.is_some())
                && (old.ang_vel_max.is_none() || new.ang_vel_max.is_some())
        }
    }
}

/// The ids of the active rules that `new` takes the place of, in their order.
#[must_use]
pub fn replaced(active: &[Rule], new: &[Rule]) -> Vec<String> {
    active.iter().filter(|old| new.iter().any(|rule| replaces(rule, old))).map(|old| old.id.clone()).collect()
}

/// Rules of one utterance, with speed and turn limits of one region joined and repeats dropped.
///
/// Order is that of first mention. Joined limits are the lowest, joined distances the largest.
#[must_use]
pub fn join(rules: Vec<Rule>) -> Vec<Rule> {
    let mut joined: Vec<Rule> = Vec::with_capacity(rules.len());
    for rule in rules {
        let twin = joined.iter_mut().find(|old| {
            same_region(old, &rule)
                && old.ttl_s == rule.ttl_s
                && (old.rule_type == RuleType::Exclusion || old.buffer_m == rule.buffer_m)
        });
        match twin {
            Some(old) => join_into(old, rule),
            None => joined.push(rule),
        }
    }
    joined
}

fn join_into(old: &mut Rule, new: Rule) {
    let limits = Limits { vel_max: old.vel_max, ang_vel_max: old.ang_vel_max }.and(&new);
    // A field counts as filled in only when its surviving value was.
    let was_default = |rule: &Rule, field: &str| rule.defaults.iter().any(|name| name == field);
    let buffer_m = old.buffer_m.max(new.buffer_m);
    let survivors = [
        ("buffer_m", buffer_m, Some(old.buffer_m), Some(new.buffer_m)),
        ("vel_max", limits.vel_max.unwrap_or_default(), old.vel_max, new.vel_max),
        ("ang_vel_max", limits.ang_vel_max.unwrap_or_default(), old.ang_vel_max, new.ang_vel_max),
    ];
    let defaults = survivors
        .iter()
        .filter(|(field, value, mine, theirs)| {
            let said = (*mine == Some(*value) && !was_default(old, field))
                || (*theirs == Some(*value) && !was_default(&new, field));
            !said && (was_default(old, field) || was_default(&new, field))
        })
        .map(|(field, ..)| (*field).to_owned())
        .collect();
    old.defaults = defaults;
    old.buffer_m = buffer_m;
    old.vel_max = limits.vel_max;
    old.ang_vel_max = limits.ang_vel_max;
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn near(speed: Option<f64>, rate: Option<f64>, buffer_m: f64) -> Rule {
        Rule { vel_max: speed, ang_vel_max: rate, buffer_m, ..Rule::kinematic(Relation::Near, "bed") }
    }

    #[test]
    fn speed_and_turn_limit_of_one_region_become_one_rule() {
        let joined = join(vec![near(Some(0.5), None, 1.0), near(None, Some(0.4), 1.0)]);
        assert_eq!(joined, vec![near(Some(0.5), Some(0.4), 1.0)]);
    }

    #[test]
    fn a_repeated_exclusion_replaces_the_older_one_and_another_relation_does_not() {
        let old = Rule { id: "s1".into(), buffer_m: 0.3, ..Rule::exclusion(Relation::Near, "rug") };
        let new = Rule { buffer_m: 1.0, ..Rule::exclusion(Relation::Near, "rug") };
        assert_eq!(replaced(std::slice::from_ref(&old), &[new]), ["s1"]);
        assert!(!replaces(&Rule::exclusion(Relation::Beneath, "rug"), &old));
    }

    #[test]
    fn a_limit_closer_in_leaves_the_wider_one_in_force() {
        assert!(!replaces(&near(Some(0.2), None, 0.5), &near(Some(0.5), None, 1.0)));
        assert!(replaces(&near(Some(0.2), None, 1.0), &near(Some(0.5), None, 1.0)));
        assert!(!replaces(&near(None, Some(0.2), 1.0), &near(Some(0.5), None, 1.0)));
    }

    #[test]
    fn a_gap_is_the_same_from_either_end() {
        let gap = |a: &str, b: &str| Rule { obj2: Some(b.into()), ..Rule::exclusion(Relation::Between, a) };
        assert!(same_region(&gap("sofa", "tv"), &gap("tv", "sofa")));
        assert!(!same_region(&gap("sofa", "tv"), &gap("sofa", "lamp")));
    }

    #[test]
    fn a_number_that_was_said_is_not_a_default_after_joining() {
        let filled = Rule { defaults: vec!["vel_max".into()], ..near(Some(0.5), None, 1.0) };
        let said = near(Some(0.3), None, 1.0);
        assert!(join(vec![filled.clone(), said]).iter().all(|rule| rule.defaults.is_empty()));
        assert_eq!(join(vec![filled, near(Some(0.9), None, 1.0)])[0].defaults, ["vel_max"]);
    }

    proptest! {
        #[test]
        fn joining_never_loosens(limits in proptest::collection::vec(proptest::option::of(0.0..1.5f64), 1..6)) {
            let rules: Vec<Rule> = limits.iter().map(|v| near(*v, Some(0.4), 1.0)).collect();
            prop_assert_eq!(tightest(&join(rules.clone())), tightest(&rules));
        }

        #[test]
        fn more_rules_never_raise_a_limit(speeds in proptest::collection::vec(0.0..1.5f64, 1..6)) {
            let rules: Vec<Rule> = speeds.iter().map(|v| near(Some(*v), None, 1.0)).collect();
            let some = tightest(&rules[1..]).vel_max.unwrap_or(f64::INFINITY);
            prop_assert!(tightest(&rules).vel_max.unwrap() <= some);
        }
    }
}
