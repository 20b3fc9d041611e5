//! Rules of one utterance against each other, and against those in force.

use rules::{Relation, Rule, RuleType};

use crate::noun::Nouns;

/// Whether `new` repeats `old` for the same region, by what the words mean.
pub(super) fn repeats(new: &Rule, old: &Rule) -> bool {
    // A rug and a carpet may both lie there: such near-synonyms are never taken for one region.
    const APART: [&str; 8] = ["rug", "door", "desk", "shelf", "plant", "stairs", "cable", "lawn"];
    let object = Nouns::get().canonical(&new.obj);
    if APART.contains(&object.as_str()) && new.obj != old.obj {
        return false;
    }
    let canonical = |rule: &Rule| {
        let nouns = Nouns::get();
        let phrase =
            if rule.phrase() == rule.obj { nouns.canonical(&rule.obj) } else { rule.phrase().to_owned() };
        Rule {
            obj: nouns.canonical(&rule.obj),
            obj2: rule.obj2.as_deref().map(|name| nouns.canonical(name)),
            reference: phrase,
            ..rule.clone()
        }
    };
    rules::tighten::replaces(&canonical(new), &canonical(old))
}

/// Exclusions of one object in one utterance: the wider holds the narrower; a said distance beats a default.
pub(super) fn settle(rules: Vec<Rule>) -> Vec<Rule> {
    let area = |rule: &Rule| {
        rule.rule_type == RuleType::Exclusion && matches!(rule.relation, Relation::Near | Relation::On)
    };
    let mut out: Vec<Rule> = Vec::with_capacity(rules.len());
    for rule in rules {
        let twin = out.iter_mut().find(|old| {
            area(old)
                && area(&rule)
                && old.obj == rule.obj
                && old.reference == rule.reference
                && old.except == rule.except
                && old.ttl_s == rule.ttl_s
        });
        match twin {
            None => out.push(rule),
            Some(old) => {
                let is_default = |rule: &Rule| rule.defaults.iter().any(|field| field == "buffer_m");
                let said = |rule: &Rule| rule.buffer_m > 0.0 && !is_default(rule);
                let takes =
                    (said(&rule) && !said(old)) || (said(&rule) == said(old) && rule.buffer_m > old.buffer_m);
                if takes {
                    *old = rule;
                }
            }
        }
    }
    out
}
