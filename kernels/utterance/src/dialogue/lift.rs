//! Which rules are lifted: by name, by kind, all, or the newest.

use std::collections::BTreeSet;

use rules::{Relation, Rule, RuleType};

use super::{Change, is_on, revoked};
use crate::clause::is_limit;
use crate::draft::{Draft, Place};
use crate::lexicon::Sense;
use crate::noun::Name;
use crate::quantity::Kind;
use crate::resolve::Trouble;

pub(super) fn revoke(draft: &Draft, active: &[Rule]) -> Result<Change, Trouble> {
    if draft.has(Sense::OneOf) {
        return Err(which(active));
    }
    if let Some(quantity) = draft.quantities.iter().find(|quantity| quantity.kind != Kind::Bare) {
        return Err(Trouble::Ask(format!("Should I forget a rule, or change it to {}?", quantity.said)));
    }
    if draft.has(Sense::AllRules) || draft.has(Sense::Everywhere) || draft.words.ends_with(" all") {
        let keep = |rule: &Rule| draft.except.iter().any(|name| is_on(rule, name));
        return Ok(revoked(active.iter().filter(|rule| !keep(rule)).map(|rule| rule.id.clone()).collect()));
    }
    let named: Vec<&Name> = draft.all_names().filter(|name| !name.is_pronoun).collect();
    // "rule 2", "s2": the handle; any other number or an ordinal could mean several.
    let number = draft.quantities.first().map(|quantity| format!("s{}", quantity.value));
    let handle = number.clone().or_else(|| {
        named
            .iter()
            .map(|name| name.reference.clone())
            .find(|word| active.iter().any(|rule| rule.id == *word))
    });
    if let Some(rule) = active.iter().find(|rule| Some(&rule.id) == handle.as_ref()) {
        return Ok(revoked(vec![rule.id.clone()]));
    }
    let ordinal = named.iter().any(|name| {
        matches!(name.reference.as_str(), "first" | "second" | "third" | "other" | "oldest" | "fourth")
    });
    if number.is_some() || ordinal {
        return Err(which(active));
    }
    if !named.is_empty() {
        let wanted = |rule: &&Rule| named.iter().any(|name| is_on(rule, name)) && fits_kind(rule, draft);
        // "wipe the table", "replace the bulb": a task, unless a rule is about it.
        let may_be_task =
            ["wipe", "clear", "drop", "lift", "remove", "replace", "swap", "discard", "strike", "scratch"]
                .iter()
                .any(|verb| draft.words.starts_with(verb));
        if may_be_task && !draft.has(Sense::RuleNoun) && !active.iter().any(|rule| wanted(&rule)) {
            return Err(Trouble::NotSafety);
        }
        // "ignore the bell" is no talk about rules unless one is about it.
        if draft.words.starts_with("ignore") && !active.iter().any(|rule| wanted(&rule)) {
            return Err(Trouble::Ask("Which rule do you mean?".into()));
        }
        let found: Vec<&Rule> = active.iter().filter(wanted).collect();
        // "drop the rack one", of a server rack and a pallet rack.
        let one = named.iter().all(|name| name.reference != name.obj || !name.reference.ends_with('s'))
            && !named.iter().any(|name| name.is_universal);
        let kinds = found.iter().map(|rule| rule.obj.as_str()).collect::<BTreeSet<_>>().len();
        if one
            && named.len() == 1
            && kinds > 1
            && !named.iter().any(|name| found.iter().any(|rule| rule.obj == name.obj))
        {
            return Err(which(active));
        }
        return Ok(revoked(found.iter().map(|rule| rule.id.clone()).collect()));
    }
    if draft.has_any(&[Sense::SpeedNoun, Sense::Slow]) {
        return Ok(revoked(
            active
                .iter()
                .filter(|rule| rule.vel_max.is_some() && rule.relation == Relation::Global)
                .map(|rule| rule.id.clone())
                .collect(),
        ));
    }
    Ok(revoked(active.last().map(|rule| rule.id.clone()).into_iter().collect()))
}

/// "forget the speed limit near the bed" leaves an exclusion of the bed alone.
fn fits_kind(rule: &Rule, draft: &Draft) -> bool {
    !draft.has_any(&[Sense::SpeedNoun, Sense::Slow]) || rule.rule_type == RuleType::Kinematic
}

fn which(active: &[Rule]) -> Trouble {
    match active.len() {
        0 => Trouble::Ask("There are no rules in force. What should I heed?".into()),
        _ => Trouble::Ask("Which rule do you mean?".into()),
    }
}

/// "you can go under the table again", "the kitchen is open".
pub(super) fn lift(draft: &Draft, active: &[Rule]) -> Result<Change, Trouble> {
    let named: Vec<&Name> = draft.all_names().filter(|name| !name.is_pronoun).collect();
    if named.is_empty() {
        let about_speed = is_limit(draft) || draft.has_any(&[Sense::Fast, Sense::Faster]);
        let chosen: Vec<String> = if about_speed {
            let global = active
                .iter()
                .filter(|rule| rule.vel_max.is_some() && rule.relation == Relation::Global)
                .map(|rule| rule.id.clone())
                .collect::<Vec<_>>();
            // "you need not be quiet any more": the one limit there is.
            let limits: Vec<&Rule> =
                active.iter().filter(|rule| rule.rule_type == RuleType::Kinematic).collect();
            match limits.as_slice() {
                [only] if global.is_empty() => vec![only.id.clone()],
                _ => global,
            }
        } else if draft.has(Sense::AllRules) {
            active.iter().map(|rule| rule.id.clone()).collect()
        } else if draft.has(Sense::Everywhere) {
            active
                .iter()
                .filter(|rule| rule.rule_type == RuleType::Exclusion)
                .map(|rule| rule.id.clone())
                .collect()
        } else if draft.all_names().any(|name| name.is_pronoun)
            || draft.has_any(&[Sense::Motion, Sense::VerbOn, Sense::Again])
        {
            active.last().map(|rule| rule.id.clone()).into_iter().collect()
        } else {
            return Err(Trouble::Ask("What may I do again?".into()));
        };
        return Ok(revoked(chosen));
    }
    let on_it: Vec<&Rule> = active.iter().filter(|rule| named.iter().any(|name| is_on(rule, name))).collect();
    let about_limits = is_limit(draft) || draft.has_any(&[Sense::Fast, Sense::Faster]);
    let about_going = draft.has_any(&[Sense::Motion, Sense::VerbOn, Sense::VerbNear, Sense::VerbPast])
        || !draft.regions.is_empty();
    let kinds: Vec<&Rule> = on_it
        .iter()
        .copied()
        .filter(|rule| {
            if about_limits {
                rule.rule_type == RuleType::Kinematic
            } else {
                !about_going || rule.rule_type == RuleType::Exclusion
            }
        })
        .collect();
    // Coming near is not yet driving over: a rule that forbids more than was allowed stays.
    let near_only = draft.regions.iter().all(|region| region.place == Place::Near)
        && (!draft.regions.is_empty() || draft.has(Sense::VerbNear));
    let chosen: Vec<&Rule> = kinds
        .iter()
        .copied()
        .filter(|rule| {
            !(near_only && about_going && !matches!(rule.relation, Relation::Near | Relation::Beyond))
        })
        .collect();
    Ok(revoked(chosen.iter().map(|rule| rule.id.clone()).collect()))
}

pub(super) fn normal_speed(draft: &Draft, active: &[Rule]) -> Change {
    let named: Vec<&Name> = draft.all_names().filter(|name| !name.is_pronoun).collect();
    let speed_rules =
        active.iter().filter(|rule| rule.rule_type == RuleType::Kinematic && rule.vel_max.is_some());
    let chosen = speed_rules.filter(|rule| {
        if named.is_empty() {
            rule.relation == Relation::Global
        } else {
            named.iter().any(|name| is_on(rule, name))
        }
    });
    revoked(chosen.map(|rule| rule.id.clone()).collect())
}
