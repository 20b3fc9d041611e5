//! Where the robot may not be: exclusions out of one order.

use rules::{Relation, Rule};

use crate::draft::{Draft, Place, Region};
use crate::lexicon::{GOING, Sense};
use crate::noun::{Name, Nouns};
use crate::quantity::{Bound, Kind};
use crate::resolve::Trouble;
use crate::vague;

/// The exclusions of one order.
///
/// # Errors
/// [`Trouble`] when it is none.
pub fn exclusion(draft: &Draft) -> Result<Vec<Rule>, Trouble> {
    if draft.has(Sense::Fast) || draft.has(Sense::Turn) && draft.is_negated() {
        return Err(Trouble::Ask("Should I turn slowly there, or not be there at all?".into()));
    }
    let orders = draft.has_any(&[
        Sense::Avoid,
        Sense::Away,
        Sense::Wide,
        Sense::StayOff,
        Sense::OffLimits,
        Sense::Closed,
        Sense::NeedsSpace,
        Sense::Wider,
    ]) || draft.has(Sense::From) && draft.quantity(Kind::Distance).is_some()
        || draft
            .quantity(Kind::Distance)
            .is_some_and(|q| draft.has_any(&[Sense::Hold, Sense::ForWhom]) || q.bound == Bound::Lower)
        || draft.has(Sense::VerbPast) && !draft.is_negated() && draft.quantity(Kind::Distance).is_some();
    let close = draft.quantity(Kind::Distance).is_some_and(|q| match q.bound {
        Bound::Upper | Bound::Within => !draft.is_negated(),
        Bound::Over => draft.is_negated(),
        Bound::Plain | Bound::Lower => false,
    });
    if close && orders {
        return Err(Trouble::Ask(
            "I can keep out of places, but not close to one. What should I avoid?".into(),
        ));
    }
    if orders && draft.is_negated() && !negation_agrees(draft) {
        return Err(Trouble::Loosens);
    }
    if draft.has(Sense::VerbLeave) {
        return Err(Trouble::Ask(
            "I can keep out of places, but not inside one. What should I avoid?".into(),
        ));
    }
    let all_but = draft.has(Sense::Everywhere) && draft.has(Sense::Allow) && !draft.except.is_empty();
    if !orders && !draft.is_negated() && !all_but {
        return positive_side(draft);
    }
    let mut rules = Vec::new();
    if draft.has(Sense::Everywhere) && draft.has(Sense::Allow) && !draft.is_negated() {
        // "you can go anywhere but the cellar"
        let but: Vec<Name> = draft.except.clone();
        let open = Draft { except: Vec::new(), ..draft.clone() };
        return Ok(but.iter().map(|name| exclude(&open, Relation::On, name, None, 0.0, true)).collect());
    }
    for name in &draft.names {
        let (relation, buffer_m, said) = loose_relation(draft, name)?;
        rules.push(exclude(draft, relation, name, None, buffer_m, said));
    }
    for region in &draft.regions {
        rules.extend(excluded_region(draft, region)?);
    }
    if rules.is_empty() {
        let question = if draft.has(Sense::Everywhere) {
            "That would be everywhere. What should I avoid?"
        } else {
            "Away from what?"
        };
        return Err(Trouble::Ask(question.into()));
    }
    // Two places in one order ("to the sofa through the hall"): we cannot tell which is meant.
    if !draft.names.is_empty()
        && !draft.regions.is_empty()
        && !draft.has(Sense::Copula)
        && draft.has_any(&[Sense::Avoid, Sense::Away, Sense::Wide, Sense::StayOff])
    {
        return Err(Trouble::Ask(format!("Which place do you mean: {}?", draft.words)));
    }
    Ok(rules)
}

/// "no space for you here" apart: words that say the same as their negation.
fn negation_agrees(draft: &Draft) -> bool {
    // "do not go within 1 m", "no closer than", "not allowed", "never leave less than 1 m".
    let bounded = draft.quantity(Kind::Distance).is_some_and(|q| {
        matches!(q.bound, Bound::Within | Bound::Lower) || q.bound == Bound::Upper && q.said.contains("less")
    });
    let deed = draft.has_any(&GOING);
    bounded
        || (deed && !draft.has_any(&[Sense::Avoid, Sense::Away, Sense::Wide])) && !draft.has(Sense::OffLimits)
}

/// Relation and distance of a name that no place word governs.
fn loose_relation(draft: &Draft, name: &Name) -> Result<(Relation, f64, bool), Trouble> {
    let said = said_distance(draft);
    let at_least = draft.quantity(Kind::Distance).is_some_and(|q| q.bound == Bound::Lower);
    let (relation, default) = if draft.has(Sense::Wide) {
        (Relation::Near, vague::WIDE_M)
    } else if draft.has_any(&[Sense::Away, Sense::NeedsSpace, Sense::From, Sense::Wider]) {
        (Relation::Near, vague::AWAY_M)
    } else if draft.has(Sense::StayOff) {
        (Relation::On, 0.0)
    } else if draft.has(Sense::VerbPast) && !draft.is_negated() && said.is_some() {
        // "pass the vase with half a metre to spare"
        (Relation::Near, vague::AWAY_M)
    } else if draft.has(Sense::VerbPast) {
        (Relation::Beyond, 0.0)
    } else if draft.has(Sense::VerbOn) {
        (Relation::On, 0.0)
    } else if draft.has(Sense::VerbNear) || draft.has(Sense::VerbBlock) {
        (Relation::Near, vague::AWAY_M)
    } else if draft.has_any(&[Sense::VerbTouch, Sense::Avoid]) {
        (Relation::Near, vague::AVOID_M)
    } else if draft.has(Sense::OffLimits) {
        if Nouns::get().is_place(&name.obj) { (Relation::On, 0.0) } else { (Relation::Near, vague::AVOID_M) }
    } else if draft.has(Sense::Closed) && Nouns::get().is_place(&name.obj) {
        (Relation::On, 0.0)
    } else if said.is_some()
        && (draft.has_any(&[Sense::Hold, Sense::ForWhom])
            || at_least
            || draft.is_negated()
                && (draft.has_any(&[Sense::Motion, Sense::SelfRef])
                    || draft.quantity(Kind::Distance).is_some_and(|q| q.bound == Bound::Within)))
    {
        (Relation::Near, vague::AWAY_M)
    } else if draft.is_negated() && Nouns::get().is_place(&name.obj) && !draft.has(Sense::Copula) {
        // "no kitchen, no stairs": a place refused by name.
        (Relation::On, 0.0)
    } else {
        return Err(Trouble::WhatAbout(name.clone()));
    };
    // A place that is avoided by name is stayed out of; by a distance, kept away from.
    Ok((relation, said.unwrap_or(default), said.is_some()))
}

/// The distance that was said, metres.
pub fn said_distance(draft: &Draft) -> Option<f64> {
    draft.quantity(Kind::Distance).map(|quantity| quantity.value)
}

fn excluded_region(draft: &Draft, region: &Region) -> Result<Vec<Rule>, Trouble> {
    if region.names.is_empty() {
        return Err(Trouble::Ask("Where do you mean?".into()));
    }
    let said = said_distance(draft);
    let (relation, default) = match region.place {
        Place::Near => (Relation::Near, if draft.has(Sense::Wide) { vague::WIDE_M } else { vague::AWAY_M }),
        Place::On => (Relation::On, 0.0),
        Place::To if said.is_some() => (Relation::Near, 0.0),
        Place::To if draft.has_any(&[Sense::Wider, Sense::Away, Sense::Wide, Sense::VerbNear]) => {
            (Relation::Near, vague::AWAY_M)
        }
        Place::To => (Relation::On, 0.0),
        // "on your way past the tank leave two feet"
        Place::Past if said.is_some() && !draft.is_negated() => (Relation::Near, 0.0),
        Place::Under => (Relation::Beneath, 0.0),
        Place::Past => (Relation::Beyond, 0.0),
        Place::Front => (Relation::FrontOf, 0.0),
        Place::Behind => (Relation::Behind, 0.0),
        Place::Left => (Relation::LeftOf, 0.0),
        Place::Right => (Relation::RightOf, 0.0),
        Place::Between => return between(draft, region, said),
        Place::ThisSide => return Err(Trouble::Loosens),
    };
    if draft.has(Sense::VerbBlock) && relation == Relation::On {
        return Ok(region
            .names
            .iter()
            .map(|name| exclude(draft, Relation::On, name, None, 0.0, true))
            .collect());
    }
    let has_default = default > 0.0;
    Ok(region
        .names
        .iter()
        .map(|name| {
            exclude(draft, relation, name, None, said.unwrap_or(default), said.is_some() || !has_default)
        })
        .collect())
}

fn between(draft: &Draft, region: &Region, said: Option<f64>) -> Result<Vec<Rule>, Trouble> {
    match region.names.as_slice() {
        [first, second] => {
            Ok(vec![exclude(draft, Relation::Between, first, Some(second), said.unwrap_or(0.0), true)])
        }
        // "between the beds": two of a kind.
        [both] if both.reference.ends_with('s') || both.reference != both.obj => {
            Ok(vec![exclude(draft, Relation::Between, both, Some(both), said.unwrap_or(0.0), true)])
        }
        _ => Err(Trouble::Ask("Between what and what?".into())),
    }
}

/// "stay on the left of the table", "keep this side of the tape".
fn positive_side(draft: &Draft) -> Result<Vec<Rule>, Trouble> {
    let held = draft.has_any(&[Sense::Hold, Sense::Contain, Sense::OpenEnded, Sense::VerbPast]);
    let side = draft.regions.iter().find(|region| {
        matches!(region.place, Place::Left | Place::Right | Place::Behind | Place::Front | Place::ThisSide)
    });
    if let (true, Some(region)) = (held, side) {
        return region
            .names
            .iter()
            .map(|name| {
                let relation = match region.place {
                    Place::Left => Relation::RightOf,
                    Place::Right => Relation::LeftOf,
                    Place::Front => Relation::Behind,
                    Place::Behind if Nouns::get().is_boundary(&name.obj) => Relation::Beyond,
                    Place::Behind => Relation::FrontOf,
                    _ => Relation::Beyond,
                };
                Ok(exclude(draft, relation, name, None, said_distance(draft).unwrap_or(0.0), true))
            })
            .collect();
    }
    if let (true, [name, ..]) = (held, draft.names.as_slice()) {
        // "keep the table on your left": we are then to its right.
        let relation = if draft.has(Sense::SelfLeft)
            || draft.has(Sense::VerbPast) && draft.has(Sense::SideRight)
        {
            Some(Relation::LeftOf)
        } else if draft.has(Sense::SelfRight) || draft.has(Sense::VerbPast) && draft.has(Sense::SideLeft) {
            Some(Relation::RightOf)
        } else {
            None
        };
        if let Some(relation) = relation {
            return Ok(vec![exclude(draft, relation, name, None, 0.0, true)]);
        }
    }
    if draft.has_any(&[Sense::SideLeft, Sense::SideRight]) && held {
        return Err(Trouble::Ask("On which side of what?".into()));
    }
    if draft.has(Sense::Contain) || (draft.has(Sense::Hold) && !draft.regions.is_empty()) {
        return Err(Trouble::Ask(
            "I can keep out of places, but not inside or close to one. What should I avoid?".into(),
        ));
    }
    match draft.names.first().or_else(|| draft.regions.iter().flat_map(|r| r.names.first()).next()) {
        Some(name)
            if !draft.has_any(&[
                Sense::Motion,
                Sense::VerbOn,
                Sense::VerbPast,
                Sense::VerbNear,
                Sense::Task,
            ]) =>
        {
            Err(Trouble::WhatAbout(name.clone()))
        }
        Some(name) if draft.n_neg > 0 => Err(Trouble::WhatAbout(name.clone())),
        Some(_) => Err(Trouble::NotSafety),
        None => Err(Trouble::Ask("What should I heed?".into())),
    }
}

/// One exclusion of a region around a name.
pub fn exclude(
    draft: &Draft,
    relation: Relation,
    name: &Name,
    second: Option<&Name>,
    buffer_m: f64,
    said: bool,
) -> Rule {
    let mut rule = Rule { buffer_m, ..named(Rule::exclusion(relation, ""), name) };
    rule.obj2 = second.map(|name| object(name).0);
    rule.except = draft.except.iter().map(|name| name.reference.clone()).collect();
    if !said && buffer_m > 0.0 {
        rule.defaults.push("buffer_m".into());
    }
    rule
}

/// The rule, about that name.
pub fn named(rule: Rule, name: &Name) -> Rule {
    let (obj, reference) = object(name);
    Rule { obj, reference, ..rule }
}

/// Class noun and phrase of a name; a speaker is a person.
pub fn object(name: &Name) -> (String, String) {
    let obj = match name.obj.as_str() {
        "me" | "myself" | "us" => "person".to_owned(),
        "anyone" | "someone" | "somebody" | "anybody" | "everyone" | "everybody" => "person".to_owned(),
        other => other.to_owned(),
    };
    (obj, name.reference.clone())
}
