//! Which of its senses a phrase has here.

use crate::draft::Draft;
use crate::item::Item;
use crate::lexicon::Sense;
use crate::quantity::Kind;

/// The sense that the context asks for; none for words to pass over.
pub(super) fn choose(item: &Item, senses: &[Sense], draft: &Draft, next: Option<&Item>) -> Option<Sense> {
    let held = draft.has(Sense::Hold);
    let text = item.text.as_str();
    match text {
        // "take the trash out", "put the cat outside": part of the task.
        "out" | "outside" | "off" | "away" | "back"
            if draft.senses.first() == Some(&Sense::Task) && draft.n_neg == 0 =>
        {
            return None;
        }
        "clear" | "back" if held => return Some(Sense::Away),
        "off" | "off of" if !draft.quantities.is_empty() && draft.quantity(Kind::Distance).is_some() => {
            return Some(Sense::From);
        }
        "about" if draft.has_any(&[Sense::Revoke, Sense::RuleNoun, Sense::Careful, Sense::Same]) => {
            return Some(Sense::ForWhom);
        }
        "speed" | "the speed" => {
            let noun = draft.has_any(&[Sense::Dampen, Sense::Slow, Sense::Make, Sense::Revoke, Sense::Hold])
                || !draft.is_negated();
            return Some(if noun { Sense::SpeedNoun } else { Sense::Fast });
        }
        "who" if draft.senses.is_empty() && draft.names.is_empty() => return Some(Sense::Question),
        "to avoid" => return Some(Sense::Avoid),
        "go around" | "drive around"
            if next.is_some_and(|n| n.is_word() || n.is_any(&[Sense::Det, Sense::Pronoun])) =>
        {
            return Some(Sense::Avoid);
        }
        "leave" if next.is_some_and(|n| matches!(n.sort, crate::item::Sort::Quantity(_))) => {
            return Some(Sense::Hold);
        }
        "leave" => return Some(if draft.is_negated() { Sense::VerbLeave } else { Sense::Hold }),
        "top speed" | "max speed" | "full speed"
            if next.is_some_and(|n| matches!(n.sort, crate::item::Sort::Quantity(_))) =>
        {
            return Some(Sense::SpeedNoun);
        }
        // "top speed near the crib: 0.2 m/s"
        "top speed" | "max speed"
            if draft.senses.is_empty() && draft.n_neg == 0 && draft.names.is_empty() =>
        {
            return Some(Sense::SpeedNoun);
        }
        "wipe" if next.is_some_and(|n| n.is(Sense::AllRules)) => return Some(Sense::Revoke),
        "drop" if next.is_some_and(|n| n.is(Sense::To)) => return Some(Sense::Dampen),
        "out" if draft.has(Sense::VerbWake) => return None,
        "clear" | "drop" | "lift" | "end" | "reset" | "scratch"
            if draft.senses.is_empty() && draft.n_neg == 0 =>
        {
            return Some(Sense::Revoke);
        }
        "use" if draft.is_negated() => return Some(Sense::VerbOn),
        "is" | "are" | "be" | "been" | "must be" | "should be"
            if !draft.names.is_empty() || !draft.regions.is_empty() =>
        {
            return Some(Sense::Copula);
        }
        "be" | "do" | "does" | "did" => {
            return if text == "be" && draft.is_negated() { Some(Sense::Motion) } else { None };
        }
        // "it is my wish that …" asks nothing.
        "is my" | "is the" | "is that" | "is this" | "are the" | "is it" if !draft.names.is_empty() => {
            return Some(Sense::Copula);
        }
        // "the grass here is poisonous"
        "here is" | "here are" if !draft.names.is_empty() => return Some(Sense::Copula),
        "gets" | "get"
            if next.is_some_and(
                |n| matches!(&n.sort, crate::item::Sort::Quantity(q) if q.kind == Kind::Distance),
            ) =>
        {
            return Some(Sense::Hold);
        }
        "gets" if draft.names.iter().any(|name| !name.is_pronoun) => return Some(Sense::Copula),
        "too fast" | "too quickly" | "so fast" | "that fast" if draft.is_negated() => {
            return Some(Sense::Fast);
        }
        "too fast" | "too quickly" | "so fast" | "that fast" => return Some(Sense::Slower),
        "wide" if next.is_some_and(Item::is_word) => return None,
        "too" if next.is_some() => return None,
        _ => {}
    }
    by_rank(senses, draft)
}

/// The sense that outranks the others; fillers last, but before those that only look like orders.
fn by_rank(senses: &[Sense], draft: &Draft) -> Option<Sense> {
    let first_of = |wanted: &[Sense]| wanted.iter().copied().find(|sense| senses.contains(sense));
    first_of(&[Sense::Neg, Sense::Lift, Sense::NormalSpeed, Sense::AsNormal, Sense::History, Sense::MinSpeed])
        .or_else(|| {
            if draft.has(Sense::Copula) {
                first_of(&[
                    Sense::OffLimits,
                    Sense::Closed,
                    Sense::Fragile,
                    Sense::Sleeping,
                    Sense::NeedsSpace,
                    Sense::Fine,
                ])
            } else {
                None
            }
        })
        .or_else(|| {
            if senses.contains(&Sense::Filler)
                && !senses.contains(&Sense::Fine)
                && !senses.iter().any(|s| {
                    matches!(
                        s,
                        Sense::Make
                            | Sense::AsWell
                            | Sense::Motion
                            | Sense::Copula
                            | Sense::Everywhere
                            | Sense::Careful
                    )
                })
            {
                Some(Sense::Filler)
            } else {
                None
            }
        })
        .or_else(|| senses.iter().copied().find(|sense| !matches!(sense, Sense::Filler | Sense::Det)))
        .or(Some(Sense::Filler))
        .map(|sense| match sense {
            // Outside a statement "fine" and "ok" are chatter.
            Sense::Fine
                if senses.contains(&Sense::Filler) && !draft.has(Sense::Copula) && draft.names.is_empty() =>
            {
                Sense::Filler
            }
            other => other,
        })
}
