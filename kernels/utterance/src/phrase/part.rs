//! Which words may be part of a name.

use crate::item::{Item, Sort};
use crate::lexicon::Sense;
use crate::noun::Nouns;
use crate::speech::{Speech, speech};

/// Senses that may also be a word in a name: "the stop sign", "the play mat".
const NOUNABLE: [Sense; 29] = [
    Sense::Task,
    Sense::Halt,
    Sense::Motion,
    Sense::Turn,
    Sense::TurnFast,
    Sense::Dampen,
    Sense::Revoke,
    Sense::Statement,
    Sense::Fast,
    Sense::Hold,
    Sense::StayOff,
    Sense::Away,
    Sense::SideLeft,
    Sense::SideRight,
    Sense::Fragile,
    Sense::Closed,
    Sense::Sleeping,
    Sense::OffLimits,
    Sense::Fine,
    Sense::Quiet,
    Sense::SelfRef,
    Sense::Slow,
    Sense::Crawl,
    Sense::Chat,
    Sense::VerbOn,
    Sense::VerbTouch,
    Sense::Wide,
    Sense::Attention,
    Sense::VerbLeave,
];

/// Senses of words that hold a sentence together or compare: they never open a name.
const NEVER: [Sense; 16] = [
    Sense::Pronoun,
    Sense::Det,
    Sense::Neg,
    Sense::Everywhere,
    Sense::AllRules,
    Sense::Last,
    Sense::OneOf,
    Sense::RuleNoun,
    Sense::SpeedNoun,
    Sense::NormalSpeed,
    Sense::PrepNear,
    Sense::PrepBehind,
    Sense::Slower,
    Sense::Faster,
    Sense::Wider,
    Sense::Closer,
];

/// Senses of words that are no name by themselves, article or not: "on the left", "the same".
const NEVER_ALONE: [Sense; 10] = [
    Sense::And,
    Sense::Or,
    Sense::Of,
    Sense::From,
    Sense::Copula,
    Sense::Except,
    Sense::Same,
    Sense::SideLeft,
    Sense::SideRight,
    Sense::SelfRef,
];

/// Whether a word without a sense belongs to the name: verbs end it, participles need a noun after them.
pub(super) fn word_fits(items: &[Item], at: usize, words_start: usize) -> bool {
    let Some(item) = items.get(at) else { return false };
    // Never part of a name, whatever follows.
    if matches!(
        item.text.as_str(),
        "than" | "else" | "ago" | "per" | "via" | "despite" | "versus" | "unlike" | "lot" | "sake"
    ) {
        return false;
    }
    // "cables thicker than 2 cm": a measure of the thing, which no rule holds.
    let compared = item.text.ends_with("er")
        && items.get(at + 1).is_some_and(|next| {
            matches!(&next.sort, Sort::Quantity(quantity) if quantity.said.starts_with("than "))
                || next.text == "than"
        });
    if compared {
        return false;
    }
    // "water damages the floor": two names need something between them, so this is the verb.
    let article_next = items.get(at + 1).is_some_and(|next| next.is(Sense::Det) && !next.is(Sense::Pronoun));
    if at > words_start && article_next && item.text.ends_with('s') {
        return false;
    }
    // "the floor takes 20 minutes to dry"
    let number_next = items.get(at + 1).is_some_and(|next| matches!(next.sort, Sort::Quantity(_)));
    if at > words_start
        && number_next
        && matches!(
            item.text.as_str(),
            "takes"
                | "take"
                | "needs"
                | "need"
                | "lasts"
                | "costs"
                | "holds"
                | "weighs"
                | "carries"
                | "contains"
                | "measures"
                | "reaches"
                | "has"
                | "have"
        )
    {
        return false;
    }
    let next_is_name = items.get(at + 1).is_some_and(|next| {
        next.is_word() && speech(&next.text) != Speech::Verb
            || matches!(next.text.as_str(), "room" | "rooms" | "left" | "right" | "stand" | "space")
    });
    match speech(&item.text) {
        Speech::MayName | Speech::Adjective => true,
        Speech::Verb => false,
        Speech::Adverb => next_is_name,
        Speech::Participle => {
            // "people walking dogs": of the people, not of the dogs.
            let before = items.get(at.wrapping_sub(1)).filter(|_| at > words_start);
            let tells = item.text.ends_with("ing")
                && before.is_some_and(|b| {
                    b.is_word() && (b.text.ends_with('s') || Nouns::get().is_living(&b.text))
                });
            let is_gerund = at == words_start
                && item.text.ends_with("ing")
                && at.checked_sub(1).and_then(|idx| items.get(idx)).is_none_or(|b| b.is(Sense::Det));
            let kind_of_room = items.get(at + 1).is_some_and(|next| {
                Nouns::get().is_place(&next.text) || matches!(next.text.as_str(), "room" | "rooms")
            });
            next_is_name && (!tells || kind_of_room) || is_gerund
        }
    }
}

/// Whether a word with another sense may open a name here.
pub(super) fn nounable(items: &[Item], at: usize, determined: bool) -> bool {
    let Some(item) = items.get(at) else { return false };
    if item.is_word() {
        return true;
    }
    let numbered = items
        .get(at + 1)
        .is_some_and(|next| next.is_word() && next.text.starts_with(|c: char| c.is_ascii_digit()));
    if numbered && matches!(item.text.as_str(), "room" | "rooms" | "dock" | "exit" | "line" | "stop") {
        return true;
    }
    let ok_sense = item.is_any(&NOUNABLE) && !item.is_any(&NEVER);
    let other_robot = item.is(Sense::SelfRef)
        && at.checked_sub(1).and_then(|idx| items.get(idx)).is_some_and(|det| det.text.ends_with("other"));
    if other_robot || determined && matches!(item.text.as_str(), "room" | "rooms" | "exit") {
        return true;
    }
    let single = !item.text.contains(' ');
    let next_is_word = items.get(at + 1).is_some_and(|next| {
        next.is_word() || matches!(next.text.as_str(), "room" | "rooms" | "exit" | "space")
    });
    // "the lift", "the drop": a lone sense word needs its article; "stop signs" needs a noun after.
    let alone = determined
        && item.is_any(&[Sense::Task, Sense::Revoke, Sense::Motion, Sense::Statement, Sense::Chat])
        && !item.is_any(&[Sense::Halt]);
    determined && ok_sense && single && (next_is_word || alone)
}

/// Senses of verbs that want an object, and so are no verbs where none follows.
const HEADS: [Sense; 9] = [
    Sense::VerbTouch,
    Sense::VerbOn,
    Sense::VerbNear,
    Sense::VerbBlock,
    Sense::VerbWake,
    Sense::Hold,
    Sense::Fast,
    Sense::Avoid,
    Sense::Allow,
];

/// Articles that need a name behind them.
pub(crate) const ARTICLES: [&str; 13] =
    ["the", "a", "an", "my", "your", "our", "his", "her", "their", "every", "each", "any", "another"];

/// Whether a word with another sense is the name behind an article: "the barrel", "my old watch", "a boy". The grammar
/// wants a name (`expected`, or because something "is"), and nothing else there could be it.
pub(super) fn is_all_of_a_name(items: &[Item], at: usize, words_start: usize, expected: bool) -> bool {
    let (Some(item), Some(words)) = (items.get(at), items.get(words_start..at)) else { return false };
    let article = words_start.checked_sub(1).and_then(|idx| items.get(idx));
    let nouns = Nouns::get();
    let looks =
        words.iter().all(|word| nouns.is_adjective(&word.text) || speech(&word.text) == Speech::Adjective);
    let next = items.get(at + 1);
    let ends = next.is_none_or(|next| !next.is_word() && !next.is(Sense::Det));
    let is_subject = next.is_some_and(|next| next.is(Sense::Copula) || next.text.starts_with("must"));
    // "around the" is one phrase.
    article.and_then(|item| item.text.split(' ').next_back()).is_some_and(|word| ARTICLES.contains(&word))
        && looks
        && ends
        && (expected || is_subject)
        && !item.text.contains(' ')
        && !item.is_any(&NEVER)
        && (!item.is_any(&NEVER_ALONE) || item.text == "vehicle")
        && (!item.is_any(&[Sense::Away, Sense::Wide, Sense::NeedsSpace]) || item.text == "bubble")
        && speech(&item.text) == Speech::MayName
}

/// Whether a word with another sense continues a name: "hospital waiting room".
pub(super) fn inside(items: &[Item], at: usize) -> bool {
    let Some(item) = items.get(at) else { return false };
    let next_is_word = items.get(at + 1).is_some_and(Item::is_word);
    // "tv stand", "dog run": a verb by itself cannot end an order that has a name before it.
    let ends = items.get(at + 1).is_none_or(|next| {
        next.is_any(&[Sense::Copula, Sense::And, Sense::Or, Sense::PrepOn, Sense::PrepNear])
            || next.sort == Sort::Mark
    });
    let before = at.checked_sub(1).and_then(|idx| items.get(idx));
    if item.text == "can" && before.is_some_and(|word| Nouns::get().has_can(&word.text)) {
        return true;
    }
    // "the cellar steps", but "when the boy steps on the mat"
    let stops = items.get(at + 1).is_none_or(|next| {
        next.is_any(&[Sense::Copula, Sense::And, Sense::Or, Sense::IfWhen, Sense::Because, Sense::Until])
            || next.sort == Sort::Mark
    });
    if item.text == "steps" && stops && before.is_some_and(|word| !Nouns::get().is_living(&word.text)) {
        return true;
    }
    // These are nouns whenever a word stands before them.
    if matches!(item.text.as_str(), "room" | "rooms" | "dock" | "exit" | "space" | "spaces") {
        return true;
    }
    if ends
        && matches!(
            item.text.as_str(),
            "stand"
                | "run"
                | "drive"
                | "park"
                | "lift"
                | "feed"
                | "water"
                | "ride"
                | "drop"
                | "guard"
                | "call"
                | "order"
                | "visit"
                | "brake"
                | "brakes"
                | "watch"
                | "hold"
                | "press"
                | "reach"
                | "cross"
                | "limit"
                | "limits"
                | "space"
                | "clear"
                | "cap"
        )
    {
        return true;
    }
    // "the car wheel", "a fire alarm": a verb behind one thing, with nothing to do it to, is the thing itself.
    let nouns = Nouns::get();
    let of_a_thing = before.is_some_and(|word| {
        let is_one = word.text.ends_with("'s") || nouns.singular(&word.text) == word.text;
        word.is_word() && is_one && !nouns.is_living(&word.text)
    });
    let wants_an_object = item.is_any(&HEADS)
        && !item.is_any(&NEVER)
        && !item.text.contains(' ')
        && !item.text.ends_with('s')
        && !matches!(item.text.as_str(), "fast" | "quick")
        && speech(&item.text) == Speech::MayName;
    let is_head = wants_an_object
        || matches!(
            item.text.as_str(),
            "wheel" | "wheels" | "roll" | "rolls" | "set" | "sets" | "head" | "heads" | "vehicle" | "agent"
        );
    // "the car wheel must not", but "the car | touch nothing".
    let has_no_object = items.get(at + 1).is_none_or(|next| {
        !next.is_word() && !next.is_any(&[Sense::Det, Sense::Pronoun]) && !next.text.starts_with("no")
    });
    if of_a_thing && has_no_object && is_head {
        return true;
    }
    item.is_any(&NOUNABLE)
        && !item.text.contains(' ')
        && next_is_word
        && (item.text.ends_with("ing")
            || matches!(
                item.text.as_str(),
                "stop"
                    | "play"
                    | "charge"
                    | "turn"
                    | "walk"
                    | "step"
                    | "run"
                    | "wheel"
                    | "order"
                    | "water"
                    | "dry"
                    | "feed"
                    | "call"
                    | "wash"
            ))
        && !item.is_any(&[Sense::PrepNear, Sense::PrepOn])
}
