//! "when you see a dog, …": conditions become the place where an order holds, or a note.

use crate::clause::{Clause, is_limit};
use crate::draft::{Draft, Place, Region};
use crate::lexicon::Sense;
use crate::noun::{Name, Nouns};
use crate::quantity::Kind;
use crate::resolve::agrees;

/// Puts a condition into a clause.
pub fn apply(clause: &mut Clause, condition: &Draft) {
    let order = &mut clause.draft;
    // "you may walk on the grass, but if you step in the lava you will die": an order of its own in disguise.
    if order.has_any(&[Sense::Allow, Sense::Fine, Sense::Lift])
        && condition.has_any(&[Sense::VerbOn, Sense::VerbTouch, Sense::VerbNear, Sense::Motion])
    {
        order.leftover.push(condition.words.clone());
        return;
    }
    let targetless = order.regions.is_empty() && order.names.is_empty();
    // What was touched before is history, which no rule can hold.
    let is_thing_touched = condition.has(Sense::Copula) && condition.names.iter().any(|name| name.is_pronoun);
    if is_thing_touched && condition.has(Sense::VerbTouch) {
        order.leftover.push(condition.words.clone());
    } else if condition.has(Sense::VerbTouch) {
        order.senses.push(Sense::History);
    }
    let unknown_state = !condition.predicate.is_empty()
        || condition.has_any(&[Sense::Task, Sense::Sleeping, Sense::Fragile, Sense::Statement, Sense::Fine])
        || condition.n_neg > 0;
    let pronouns_only = order.all_names().all(|name| name.is_pronoun);
    if !condition.leftover.is_empty() || condition.ttl_s.is_some() {
        order.leftover.extend(condition.leftover.iter().cloned());
        order.leftover.extend(condition.ttl_s.map(|s| format!("{s} seconds")));
    }
    let regions = findable_regions(condition, unknown_state);
    let distance = condition.quantities.iter().filter(|q| q.kind == Kind::Distance).cloned();
    let others = condition.quantities.iter().any(|q| q.kind != Kind::Distance);
    if others {
        order.leftover.push(condition.words.clone());
    }
    let meant_by_pronoun = |name: &Name| order.all_names().all(|pronoun| agrees(&pronoun.reference, name));
    // "if the door is open, stay out": out of what?
    let out_of_thing = unknown_state
        && targetless
        && order.has(Sense::StayOff)
        && !regions.iter().flat_map(|region| &region.names).all(|name| Nouns::get().is_place(&name.obj));
    // "when someone is in the kitchen, stay out of it": of the kitchen, and not of the someone.
    let of_other = pronouns_only
        && !targetless
        && !regions.iter().flat_map(|region| &region.names).all(meant_by_pronoun);
    if out_of_thing || of_other && !regions.is_empty() {
        order.leftover.push(condition.words.clone());
        return;
    }
    if (targetless || pronouns_only && !order.has(Sense::Revoke)) && !regions.is_empty() {
        if is_limit(order) || order.has(Sense::Halt) {
            order.regions = regions;
            order.names.clear();
        } else {
            let (near, placed): (Vec<Region>, Vec<Region>) =
                regions.into_iter().partition(|region| region.place == Place::Near);
            if pronouns_only {
                // "when people watch the tv, never cross in front of it": in front of which?
                let is_sided = |region: &Region| !matches!(region.place, Place::Near | Place::On | Place::To);
                if order.regions.iter().any(is_sided) {
                    order.leftover.push(condition.words.clone());
                }
                order.names.clear();
                order.regions.clear();
            }
            order.names.extend(near.into_iter().flat_map(|region| region.names));
            order.regions.extend(placed);
        }
        order.quantities.extend(distance);
        if unknown_state {
            clause.notes.push(format!("when {}", condition.words));
        }
    } else if condition.has(Sense::Turn) && is_limit(order) {
        order.senses.push(Sense::Turn);
    } else {
        if distance.count() > 0 {
            order.leftover.push(condition.words.clone());
        }
        clause.notes.push(format!("when {}", condition.words));
    }
}

/// Where a condition says something is; nothing when it names nothing that can be found.
fn findable_regions(condition: &Draft, unknown_state: bool) -> Vec<Region> {
    // "when it is dark", "when the alarm rings": nothing that can be found.
    let sees = ["there", "see", "spot", "notice", "detect", "meet", "encounter", "find"]
        .iter()
        .any(|word| condition.lead.contains(word));
    let comes = condition.has_any(&[
        Sense::Motion,
        Sense::VerbOn,
        Sense::VerbPast,
        Sense::VerbNear,
        Sense::VerbBlock,
        Sense::Copula,
        Sense::ThereIs,
        Sense::PrepNear,
        Sense::Turn,
        Sense::Statement,
    ]) || !condition.quantities.is_empty();
    // "when transporting samples": what the robot does then, and no place.
    let is_deed = |name: &Name| {
        condition.senses.is_empty()
            && condition.regions.is_empty()
            && name.n_words > 1
            && name.reference.split(' ').next().is_some_and(|word| word.ends_with("ing"))
    };
    let findable = |name: &&Name| {
        (sees || !is_deed(name)) && !is_self(name) && (sees || comes) && !(name.is_pronoun && unknown_state)
    };
    let names: Vec<Name> = condition.names.iter().filter(findable).cloned().collect();
    let mut regions: Vec<Region> = condition
        .regions
        .iter()
        .filter(|region| region.names.iter().any(|name| !is_self(name)))
        .cloned()
        .collect();
    if condition.has(Sense::Copula) && names.iter().any(|name| !name.is_pronoun) && !regions.is_empty() {
        // "if someone is on crutches": about the someone.
        regions.clear();
    }
    if regions.is_empty() && !names.is_empty() {
        let place = if condition.has(Sense::VerbOn) { Place::On } else { Place::Near };
        regions = vec![Region { place, names }];
    }
    regions
}

fn is_self(name: &Name) -> bool {
    matches!(name.obj.as_str(), "you" | "robot")
}
