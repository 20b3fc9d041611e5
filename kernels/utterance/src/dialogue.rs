//! Talk about rules already in force: changing, copying and lifting them.

mod lift;

use geometry::Profile;
use rules::{Relation, Rule};

use crate::clause::Clause;
use crate::draft::Draft;
use crate::lexicon::Sense;
use crate::noun::{Name, Nouns};
use crate::resolve::Trouble;
use crate::update::update;
use lift::{lift, normal_speed, revoke};

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
        draft.names.iter_mut().chain(places).filter(|found| found.is_pronoun).for_each(|found| {
            let spot = clause.spots.last().filter(|_| found.reference.contains("there"));
            *found = spot.unwrap_or(name).clone();
        });
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
    // "you can go a little faster now" changes the limit; "… again" lifts it.
    if draft.has(Sense::Faster) && !draft.has(Sense::Again) {
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
