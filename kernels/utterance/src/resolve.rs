//! What one order means: rules, or why not.
//!
//! Numbers that were not said come from the table of vague words in `vague`.

use geometry::Profile;
use rules::Rule;
use rules::rule::BUFFER_M_MAX;

use crate::clause::{Clause, is_limit};
use crate::doubt;
use crate::draft::{Draft, Place};
use crate::exclusion::exclusion;
use crate::kinematic::{Intent, intent, kinematic};
use crate::lexicon::Sense;
use crate::noun::{Name, Nouns};
use crate::quantity::Kind;

/// Why an order is no rule.
#[derive(Clone, Debug, PartialEq)]
pub enum Trouble {
    /// Something has to be asked.
    Ask(String),
    /// A number without a unit: the number as said.
    Unit(f64),
    /// What to heed near this name: the name alone was said.
    WhatAbout(Name),
    /// It cannot be said in rules.
    Unsupported(String),
    /// It would loosen the base safety.
    Unsafe(String),
    /// It asks for less: to be handled as talk about rules.
    Loosens,
    /// Not an order about safety.
    NotSafety,
}

/// The rules of one order.
///
/// # Errors
/// [`Trouble`] when it is no rule.
pub fn resolve(clause: &Clause, active: &[Rule], profile: &Profile) -> Result<Vec<Rule>, Trouble> {
    let draft = with_referents(clause, active)?;
    check_words(&draft)?;
    let mut rules = if draft.has(Sense::VerbWake) && draft.is_negated()
        || (draft.has_any(&[Sense::Quiet, Sense::Sleeping]) && !draft.has_any(&[Sense::Avoid, Sense::Away]))
    {
        intent(&draft, profile, Intent::Quiet)?
    } else if draft.has_any(&[Sense::Careful, Sense::Fragile])
        && !draft.is_negated()
        && !draft.has_any(&[Sense::Away, Sense::Avoid, Sense::StayOff, Sense::Wide])
    {
        intent(&draft, profile, Intent::Careful)?
    } else if is_limit(&draft) {
        kinematic(&draft, profile)?
    } else {
        exclusion(&draft)?
    };
    for rule in &mut rules {
        rule.ttl_s = draft.ttl_s;
    }
    if let Some(question) = doubt::of_order(&draft, &rules) {
        return Err(Trouble::Ask(question));
    }
    Ok(rules)
}

fn check_words(draft: &Draft) -> Result<(), Trouble> {
    if draft.has(Sense::History) {
        return Err(Trouble::Unsupported("count or remember what I did before".into()));
    }
    let in_a_place = !draft.regions.is_empty() || !draft.names.is_empty();
    if draft.has(Sense::MinSpeed) && in_a_place && draft.quantities.is_empty() {
        return Err(Trouble::Ask("I cannot promise to keep moving. What should I heed there?".into()));
    }
    if draft.has(Sense::MinSpeed) {
        return Err(Trouble::Unsupported("promise a minimum speed".into()));
    }
    if let Some(word) = draft.leftover.first() {
        return Err(Trouble::Ask(format!("I did not understand \"{word}\". What should I heed?")));
    }
    // "painters finished the door it should not be touched": a story and an order in one breath; what is the order about?
    let told_and_forbidden = draft.has(Sense::Statement)
        && draft.is_negated()
        && !draft.predicate.is_empty()
        && draft.regions.is_empty()
        && draft.has(Sense::VerbTouch);
    if told_and_forbidden {
        return Err(Trouble::Ask("What should I not touch?".into()));
    }
    let excludes = draft.has_any(&[Sense::Avoid, Sense::Away, Sense::StayOff, Sense::Wide]);
    let limits =
        draft.has_any(&[Sense::Fast, Sense::Faster, Sense::Slow, Sense::Crawl, Sense::Halt, Sense::TurnSlow]);
    if draft.is_crowded || excludes && limits {
        return Err(Trouble::Ask(format!(
            "I did not understand \"{}\". Please say it as one rule.",
            draft.words
        )));
    }
    for name in draft.all_names() {
        if Nouns::get().is_empty_name(&name.reference) || name.n_words > 5 {
            return Err(Trouble::Ask(format!("What do you mean by \"{}\"?", name.reference)));
        }
    }
    if let Some(number) = draft.quantity(Kind::Bare) {
        let compares = ["faster", "slower", "quicker"].iter().any(|word| number.said.contains(word));
        let speed = (compares || draft.has_any(&[Sense::SpeedNoun, Sense::Slow, Sense::Slower]))
            && draft.quantity(Kind::Distance).is_none();
        if !speed {
            return Err(Trouble::Unit(number.value));
        }
    }
    match draft.quantity(Kind::Distance) {
        Some(far) if far.value > BUFFER_M_MAX || far.value <= 0.0 => Err(Trouble::Ask(format!(
            "{} is out of my range of 0 to {BUFFER_M_MAX} m. How far should it be?",
            far.said
        ))),
        _ => Ok(()),
    }
}

/// Pronouns become what was mentioned before, else the newest active rule's object.
fn with_referents(clause: &Clause, active: &[Rule]) -> Result<Draft, Trouble> {
    let mut draft = clause.draft.clone();
    let pronoun =
        clause.draft.all_names().find(|name| name.is_pronoun).map_or("", |name| name.reference.as_str());
    let earlier: Option<Name> = meant_by(pronoun, &clause.antecedents).cloned().or_else(|| {
        active.iter().rev().find(|rule| !rule.obj.is_empty()).map(|rule| Name {
            obj: rule.obj.clone(),
            reference: rule.phrase().to_owned(),
            n_words: 1,
            ..Name::default()
        })
    });
    // "the gap between the two is tight, do not go there": no name alone says where.
    let points = |name: &Name| {
        name.is_pronoun
            && matches!(
                name.reference.as_str(),
                "it" | "there" | "in there" | "that" | "through there" | "over there"
            )
    };
    if clause.follows_side && draft.all_names().any(points) && !draft.all_names().any(|name| !name.is_pronoun)
    {
        return Err(Trouble::Ask("Which place do you mean?".into()));
    }
    let mut own: Option<Name> = None;
    let place = clause.places.last().cloned();
    let onto = draft
        .regions
        .iter_mut()
        .filter(|region| matches!(region.place, Place::On | Place::Under))
        .flat_map(|region| region.names.iter_mut());
    for name in onto.filter(|name| name.is_pronoun) {
        // "there is lego in the corner, don't go over it": over the lego; "a cat on the rug": off the rug.
        let subject = clause
            .antecedents
            .last()
            .filter(|subject| !name.reference.contains("there") && !Nouns::get().is_living(&subject.obj));
        let spot = clause.spots.last().filter(|_| name.reference.contains("there"));
        if let Some(meant) = subject.filter(|_| name.reference == "it").or(spot).or(place.as_ref()) {
            *name = meant.clone();
        }
    }
    let places = draft.regions.iter_mut().flat_map(|region| region.names.iter_mut());
    for name in draft.names.iter_mut().chain(places) {
        if !name.is_pronoun {
            own = Some(name.clone());
            continue;
        }
        let there = clause.spots.last().filter(|_| name.reference.ends_with("there")).cloned();
        let own = own.clone().filter(|own| name.reference != "it" || !is_plural(own));
        match own.or(there).or_else(|| earlier.clone()) {
            Some(referent) => *name = referent,
            None => return Err(Trouble::Ask(format!("What do you mean by \"{}\"?", name.reference))),
        }
    }
    spread_over_group(clause, &mut draft);
    dedup(&mut draft.names);
    let targetless = draft.names.is_empty() && draft.regions.is_empty();
    // "be quiet nearby"
    let nearby = draft.has(Sense::PrepNear);
    if targetless && nearby && clause.antecedents.is_empty() {
        return Err(Trouble::Ask("Near what?".into()));
    }
    if targetless
        && (nearby || !is_limit(&draft))
        && !draft.has_any(&[Sense::History, Sense::MinSpeed])
        && let Some(name) = clause.antecedents.last()
    {
        // "mom is ill in the bedroom, so don't go in": into where she is.
        let enters = draft.has_any(&[Sense::VerbOn, Sense::StayOff])
            || [" in", " inside"].iter().any(|end| draft.words.ends_with(end));
        let spot = clause.spots.last().or(clause.places.last());
        let place = spot.filter(|_| enters && Nouns::get().is_living(&name.obj));
        draft.names.push(place.unwrap_or(name).clone());
    }
    Ok(draft)
}

/// "both", "each of them": every name that was told of together.
fn spread_over_group(clause: &Clause, draft: &mut Draft) {
    let group = &clause.group;
    let plural = clause.draft.all_names().any(|name| {
        name.is_pronoun
            && matches!(
                name.reference.as_str(),
                "them"
                    | "both"
                    | "those"
                    | "these"
                    | "they"
                    | "each of them"
                    | "all of them"
                    | "all of those"
                    | "all of these"
                    | "all those"
                    | "each of those"
                    | "each of these"
                    | "both of them"
                    | "either of them"
                    | "any of them"
            )
    });
    if plural && group.len() > 1 {
        let meant = |name: &Name| group.last().is_some_and(|last| last == name);
        for region in &mut draft.regions {
            if region.names.iter().any(meant) {
                region.names.clone_from(group);
            }
        }
        if draft.names.iter().any(meant) {
            draft.names.clone_from(group);
        }
    }
}

/// Whether the pronoun can mean that name: "it" is nobody and not many, "him" is someone.
pub fn agrees(pronoun: &str, name: &Name) -> bool {
    let nouns = Nouns::get();
    match pronoun {
        "it" | "that" | "this" | "there" | "here" => !nouns.is_someone(&name.obj),
        // Anyone may have a name that we do not know; a table has none.
        "him" | "her" => {
            nouns.is_living(&name.obj) || !nouns.knows(name.obj.rsplit(' ').next().unwrap_or_default())
        }
        "them" | "those" | "these" | "they" => is_plural(name) || nouns.is_living(&name.obj),
        _ => true,
    }
}

/// The names that the pronoun can point at, the earliest first; those that agree in number when there are any.
pub fn candidates<'a>(pronoun: &str, names: &'a [Name]) -> Vec<&'a Name> {
    let in_number = |name: &&&Name| match pronoun {
        "it" => !is_plural(name),
        "them" | "those" | "these" | "they" => is_plural(name),
        _ => true,
    };
    let agreeing: Vec<&Name> = names.iter().filter(|name| agrees(pronoun, name)).collect();
    let exact: Vec<&Name> = agreeing.iter().filter(in_number).copied().collect();
    if exact.is_empty() { agreeing } else { exact }
}

/// The likeliest of the names that the pronoun can point at.
fn meant_by<'a>(pronoun: &str, names: &'a [Name]) -> Option<&'a Name> {
    let nouns = Nouns::get();
    if matches!(pronoun, "him" | "her")
        && let Some(someone) = names.iter().rev().find(|name| nouns.is_living(&name.obj))
    {
        return Some(someone);
    }
    let any = !matches!(pronoun, "it" | "him" | "her");
    candidates(pronoun, names).pop().or_else(|| names.last().filter(|_| any))
}

/// Whether it was said of several.
fn is_plural(name: &Name) -> bool {
    let head = name.obj.split_whitespace().last().unwrap_or_default();
    !head.is_empty() && !name.reference.split_whitespace().any(|word| word == head)
}

fn dedup(names: &mut Vec<Name>) {
    let mut seen = std::collections::HashSet::new();
    names.retain(|name| seen.insert(name.reference.clone()));
}
