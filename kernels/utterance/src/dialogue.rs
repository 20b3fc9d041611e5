//! Talk about rules already in force: changing, copying and lifting them.

use geometry::Profile;
use rules::{Relation, Rule, RuleType};

use crate::clause::{Clause, is_limit};
use crate::draft::{Draft, Place};
use crate::lexicon::Sense;
use crate::noun::{Name, Nouns};
use crate::quantity::Kind;
use crate::resolve::Trouble;
use crate::update::update;

/// What talk about rules leads to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Change {
    /// Rules to lift.
    pub lifted: Vec<String>,
    /// Rules to add.
    pub added: Vec<Rule>,
    /// Whether it lifts, rather than changes: a reply of its own even when nothing matched.
    pub is_revoke: bool,
}

/// The change a clause asks of the active rules; none when it is an order of its own.
///
/// # Errors
/// [`Trouble`] when it is unclear which rule is meant.
pub fn talk(
    clause: &Clause,
    active: &[Rule],
    fresh: &[Rule],
    profile: &Profile,
) -> Result<Option<Change>, Trouble> {
    let pointed = with_antecedent(clause, active);
    // "replace the rug rule with one metre": its number changes.
    let mut pointed = pointed;
    let renumbers = ["replace", "swap"].iter().any(|verb| pointed.words.starts_with(verb));
    if renumbers && !pointed.quantities.is_empty() {
        for sense in pointed.senses.iter_mut().filter(|sense| **sense == Sense::Revoke) {
            *sense = Sense::Make;
        }
    }
    let draft = &pointed;
    if let Some(word) = draft.leftover.first().filter(|_| {
        draft.has_any(&[Sense::Revoke, Sense::Make, Sense::Same, Sense::Allow, Sense::Fine, Sense::Lift])
    }) {
        return Err(Trouble::Ask(format!("I did not understand \"{word}\". Which rule do you mean?")));
    }
    if draft.has(Sense::StartOver) && draft.n_neg == 0 {
        return Ok(Some(revoked(active.iter().map(|rule| rule.id.clone()).collect())));
    }
    if draft.has_any(&[Sense::NormalSpeed, Sense::AsNormal])
        && !draft.is_negated()
        && draft.quantities.is_empty()
    {
        return Ok(Some(normal_speed(draft, active)));
    }
    if draft.has(Sense::Revoke) && draft.n_neg == 0 {
        return revoke(draft, active).map(Some);
    }
    if allows(draft) {
        return Ok(Some(lift(draft, active)?));
    }
    if is_copy(draft) {
        return copy(draft, active, fresh).map(Some);
    }
    // "wheelchairs need space, give them a metre": about the wheelchairs, not about a rule in force.
    let about_mentioned = draft.has(Sense::Hold)
        && !draft.has(Sense::Make)
        && !clause.antecedents.is_empty()
        && draft.all_names().next().is_some()
        && draft.all_names().all(|name| name.is_pronoun);
    if about_mentioned {
        return Ok(None);
    }
    update(draft, active, fresh, profile)
}

/// "we moved the rug, it's fine now": a pronoun means what was mentioned before, if anything was.
fn with_antecedent(clause: &Clause, active: &[Rule]) -> Draft {
    let mut draft = clause.draft.clone();
    // "I changed my mind about the water, it should be a metre"
    if let Some(name) = clause.antecedents.last().filter(|name| {
        draft.has(Sense::Make)
            && draft.all_names().next().is_none()
            && active.iter().any(|rule| is_on(rule, name))
    }) {
        draft.names.push(name.clone());
    }
    if let Some(name) = clause
        .antecedents
        .last()
        .filter(|_| draft.has_any(&[Sense::Revoke, Sense::Fine, Sense::Allow, Sense::Lift]))
    {
        let places = draft.regions.iter_mut().flat_map(|region| region.names.iter_mut());
        draft
            .names
            .iter_mut()
            .chain(places)
            .filter(|found| found.is_pronoun)
            .for_each(|found| *found = name.clone());
    }
    draft
}

fn allows(draft: &Draft) -> bool {
    if draft.has(Sense::Lift) {
        return true;
    }
    if draft.has(Sense::Everywhere) && !draft.except.is_empty() {
        return false;
    }
    let allowed = draft.has(Sense::Allow)
        || draft.has(Sense::Fine) && (draft.has(Sense::AllRules) || draft.all_names().next().is_some())
        || draft.has(Sense::Again) && draft.has_any(&[Sense::Motion, Sense::VerbOn]);
    allowed
        && draft.n_neg == 0
        && !draft.has_any(&[
            Sense::Slow,
            Sense::Slower,
            Sense::Crawl,
            Sense::Careful,
            Sense::Quiet,
            Sense::Avoid,
            Sense::Away,
            Sense::Closer,
        ])
        && draft.quantities.is_empty()
}

// --- lifting ------------------------------------------------------------------------------------

fn revoked(lifted: Vec<String>) -> Change {
    Change { lifted, is_revoke: true, ..Change::default() }
}

fn normal_speed(draft: &Draft, active: &[Rule]) -> Change {
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

/// Whether the rule is about that name.
#[must_use]
pub fn is_on(rule: &Rule, name: &Name) -> bool {
    let nouns = Nouns::get();
    let object = nouns.same(&rule.obj, &name.obj)
        || rule.obj2.as_deref().is_some_and(|second| nouns.same(second, &name.obj));
    // "the red sofa" is not the blue one: words that both phrases lack must not differ.
    let other_look = name.reference != name.obj
        && rule.phrase() != rule.obj
        && rule.phrase() != name.reference
        && !rule.phrase().contains(&name.reference)
        && !name.reference.contains(rule.phrase());
    object && !other_look
}

fn revoke(draft: &Draft, active: &[Rule]) -> Result<Change, Trouble> {
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
        let kinds =
            found.iter().map(|rule| rule.obj.as_str()).collect::<std::collections::BTreeSet<_>>().len();
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
fn lift(draft: &Draft, active: &[Rule]) -> Result<Change, Trouble> {
    let named: Vec<&Name> = draft.all_names().filter(|name| !name.is_pronoun).collect();
    if named.is_empty() {
        let about_speed = is_limit(draft) || draft.has_any(&[Sense::Fast, Sense::Faster]);
        let chosen: Vec<String> = if about_speed {
            active
                .iter()
                .filter(|rule| rule.vel_max.is_some() && rule.relation == Relation::Global)
                .map(|rule| rule.id.clone())
                .collect()
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

// --- copying ------------------------------------------------------------------------------------

fn is_copy(draft: &Draft) -> bool {
    let only_name = draft.has(Sense::AsWell)
        && draft.senses.iter().all(|sense| matches!(sense, Sense::AsWell | Sense::ForWhom))
        && draft.n_neg == 0
        && draft.quantities.is_empty();
    (draft.has(Sense::Same) || only_name) && draft.all_names().any(|name| !name.is_pronoun)
}

fn copy(draft: &Draft, active: &[Rule], fresh: &[Rule]) -> Result<Change, Trouble> {
    let has_object = |rule: &&Rule| rule.relation != Relation::Global;
    let Some(model) = fresh.last().or(active.iter().rev().find(has_object)).or(active.last()) else {
        return Err(Trouble::Ask("The same as what?".into()));
    };
    let batch: Vec<&Rule> = if fresh.is_empty() {
        active
            .iter()
            .filter(|rule| {
                rule.obj == model.obj && !model.text.is_empty() && rule.text == model.text
                    || rule.id == model.id
            })
            .collect()
    } else {
        fresh.iter().filter(|rule| rule.obj == model.obj).collect()
    };
    let mut change = Change::default();
    for name in draft.all_names().filter(|name| !name.is_pronoun) {
        if Nouns::get().is_empty_name(&name.reference) || name.n_words > 5 || draft.is_crowded {
            return Err(Trouble::Ask(format!("What do you mean by \"{}\"?", name.reference)));
        }
        for rule in &batch {
            if rule.relation == Relation::Global || rule.relation == Relation::Between {
                return Err(Trouble::Ask(format!("What should I heed about the {}?", name.reference)));
            }
            change.added.push(Rule {
                id: String::new(),
                obj: name.obj.clone(),
                reference: name.reference.clone(),
                ttl_s: draft.ttl_s.or(rule.ttl_s),
                ..(*rule).clone()
            });
        }
    }
    Ok(change)
}
