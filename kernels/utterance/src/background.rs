//! What is only told beside a rule: "the boards are new and creak a bit, keep off them".
//!
//! Asked only when the plain reading ends in a question. A stretch is background when it declares how some third
//! thing is, and neither forbids, allows, limits, measures nor speaks to the robot; its verb need not be known. What
//! it names stays what "it" and "there" may mean. It never decides whether there is a rule.

use std::collections::HashSet;

use crate::clause::is_limit;
use crate::draft::Draft;
use crate::item::{Item, Sort};
use crate::lexicon::{Lexicon, Sense};
use crate::noun::{Name, Nouns};
use crate::quantity::{Bound, Kind};
use crate::resolve::candidates;
use crate::segment::Join;
use crate::speech::{Speech, speech};

/// Senses that make a stretch more than background, whatever stands around them.
const TELLING: [Sense; 22] = [
    Sense::Avoid,
    Sense::Wide,
    Sense::Contain,
    Sense::Slow,
    Sense::Slower,
    Sense::Faster,
    Sense::Wider,
    Sense::Closer,
    Sense::Crawl,
    Sense::WalkPace,
    Sense::Halt,
    Sense::TurnSlow,
    Sense::SpeedNoun,
    Sense::OffLimits,
    Sense::Careful,
    Sense::Quiet,
    Sense::Revoke,
    Sense::Fine,
    Sense::Question,
    Sense::Except,
    Sense::RuleNoun,
    Sense::Lift,
];

/// Most items of a stretch that is only told. Chosen: more is no sentence, and the work stays linear.
const N_ITEMS_MAX: usize = 40;

/// What a thing is said to be, and what by itself asks for care: told only when an order speaks of it too.
const STATES: [Sense; 4] = [Sense::Fragile, Sense::Sleeping, Sense::NeedsSpace, Sense::Closed];

/// The drafts with those that are only background made stories; none when that changes nothing, or leaves in doubt
/// what an order is about.
#[must_use]
pub fn told(drafts: Vec<(Draft, &[Item])>) -> Option<Vec<Draft>> {
    let mut after_story = false;
    let mut sorted: Vec<(Draft, bool)> = Vec::with_capacity(drafts.len());
    let joins: Vec<_> = drafts.iter().skip(1).map(|(draft, _)| (draft.join, draft.is_fresh)).collect();
    for (at, (draft, items)) in drafts.into_iter().enumerate() {
        // "the high chair tips | if it is nudged"
        let before_if = joins.get(at) == Some(&(Some(Join::If), false))
            && (items.len() > 1 || after_story)
            && items.last().is_some_and(|item| item.is_word() && item.text.ends_with('s'));
        let is_tied = !matches!(draft.join, Some(Join::And | Join::But));
        let goes_on = after_story
            && (matches!(draft.join, Some(Join::And | Join::But | Join::Comma))
                || !draft.is_fresh && matches!(draft.join, Some(Join::If | Join::Because | Join::Until)));
        // "only the rug is ok to drive on" lets off, and so is more than told.
        let lets_off =
            matches!(draft.lead.as_str(), "only" | "just") && draft.has_any(&[Sense::Fine, Sense::Allow]);
        after_story = !lets_off
            && is_background(items, goes_on, is_tied || before_if, before_if)
            && (goes_on || may_open(&draft));
        sorted.push((draft, after_story));
    }
    // "water | and electronics do not mix"
    for at in 1..sorted.len() {
        let (before, rest) = sorted.split_at_mut(at);
        if let (Some((draft, is_story)), Some((next, true))) = (before.last_mut(), rest.first())
            && matches!(next.join, Some(Join::And | Join::Or))
            && is_bare_name(draft)
        {
            *is_story = true;
        }
    }
    let (stories, orders): (Vec<_>, Vec<_>) = sorted.iter().partition(|(_, is_story)| *is_story);
    let (stories, orders): (Vec<&Draft>, Vec<&Draft>) =
        (stories.iter().map(|(draft, _)| draft).collect(), orders.iter().map(|(draft, _)| draft).collect());
    if stories.is_empty() || is_ambiguous(&stories, &orders) || loses_a_state(&stories, &orders) {
        return None;
    }
    Some(sorted.into_iter().map(|(draft, is_story)| if is_story { as_story(draft) } else { draft }).collect())
}

fn is_bare_name(draft: &Draft) -> bool {
    !draft.names.is_empty()
        && draft.join == Some(Join::Start)
        && draft.n_neg == 0
        && draft.senses.is_empty()
        && draft.regions.is_empty()
        && draft.quantities.is_empty()
        && draft.leftover.is_empty()
}

/// "the painters finished the door, keep off it": which of the two?
fn is_ambiguous(stories: &[&Draft], orders: &[&Draft]) -> bool {
    let named: Vec<Name> = stories
        .iter()
        .flat_map(|story| story.names.iter().chain(&story.told))
        .filter(|name| !name.is_pronoun)
        .cloned()
        .collect();
    orders.iter().any(|order| {
        // What is said of nothing is meant of what was told.
        let is_bare = order.all_names().next().is_none() && !order.senses.is_empty() && !is_limit(order);
        let pronouns = order.all_names().filter(|name| name.is_pronoun).map(|name| name.reference.as_str());
        pronouns.chain(is_bare.then_some("it")).any(|pronoun| {
            let meant: HashSet<&str> =
                candidates(pronoun, &named).into_iter().map(|name| name.obj.as_str()).collect();
            meant.len() > 1
        })
    })
}

/// "the vase is fragile; stay off the rug": two rules, and not a reason and a rule.
fn loses_a_state(stories: &[&Draft], orders: &[&Draft]) -> bool {
    let speaks_of = |story: &Draft| {
        orders.iter().any(|order| {
            order.all_names().any(|name| name.is_pronoun)
                || order.all_names().next().is_none()
                || order
                    .all_names()
                    .any(|name| story.all_names().any(|told| Nouns::get().same(&name.obj, &told.obj)))
        })
    };
    stories.iter().any(|story| story.has_any(&STATES) && !speaks_of(story))
}

fn may_open(draft: &Draft) -> bool {
    matches!(
        draft.join,
        None | Some(Join::Start | Join::Comma | Join::Because | Join::And | Join::But | Join::Or | Join::So)
    )
}

fn is_background(items: &[Item], goes_on: bool, is_tied: bool, declares_last: bool) -> bool {
    let plain = |item: &Item| item.is(Sense::Filler);
    let Some(first_at) = items.iter().position(|item| !plain(item) || item.is(Sense::Copula)) else {
        return goes_on && is_tied;
    };
    let items = items.get(first_at..).unwrap_or_default();
    if items.len() > N_ITEMS_MAX {
        return false;
    }
    let Some(first) = items.first() else { return false };
    let of_robot = first.text == "you" || first.text.starts_with("you ");
    // "you scared the cat", "you can hear it": what it did, and what anyone can.
    let robot_told = of_robot
        && (first.is(Sense::Subject) && first.text != "you"
            || items.get(1).is_some_and(|item| is_past(item) || item.is(Sense::Statement))
            || items.get(1).is_some_and(|item| matches!(item.text.as_str(), "can" | "could"))
                && items.get(2).is_some_and(|item| PERCEIVES.contains(&item.text.as_str())));
    let opens = robot_told
        || !of_robot
            && (first.is_any(&[
                Sense::Det,
                Sense::Pronoun,
                Sense::Subject,
                Sense::ThereIs,
                Sense::Statement,
            ]) || first.is_word() && speech(&first.text) != Speech::Verb);
    let declares = |item: &Item| {
        item.is_any(&[Sense::Copula, Sense::ThereIs, Sense::Statement])
            || item.is_word() && matches!(speech(&item.text), Speech::Verb | Speech::Participle)
            || is_past(item)
    };
    let n_told = (1..items.len())
        .filter(|at| {
            items.get(*at).is_some_and(|item| {
                let is_denied =
                    matches!(item.text.as_str(), "do not" | "does not" | "did not" | "can not" | "will not");
                declares(item) || (holds(item) || is_denied) && is_done_by_others(items, *at)
            })
        })
        .count();
    let by_pronoun = first.is_any(&[Sense::Subject, Sense::ThereIs])
        || first.is(Sense::Pronoun)
            && items.get(1).is_some_and(|item| item.is_word() && item.text.ends_with('s'))
        || does_with_s(items)
        || declares_last;
    let harmless = (0..items.len()).all(|at| is_harmless(items, at, opens || goes_on));
    let goes_on = goes_on && (is_tied || items.iter().any(declares));
    harmless && (goes_on || opens && (n_told > 0 || by_pronoun))
}

/// The drafts with those that tell what the robot did made stories: "you frightened the life out of me".
#[must_use]
pub fn of_the_past(drafts: Vec<(Draft, &[Item])>) -> Vec<(Draft, &[Item])> {
    let did = |items: &[Item]| {
        items.first().is_some_and(|item| item.text == "you")
            && items
                .get(1)
                .is_some_and(|item| is_past(item) || item.is(Sense::Statement) && item.text.ends_with("ed"))
            && is_background(items, false, true, false)
    };
    drafts
        .into_iter()
        .map(
            |(draft, items)| {
                if may_open(&draft) && did(items) { (as_story(draft), items) } else { (draft, items) }
            },
        )
        .collect()
}

/// What one does with eyes and ears.
const PERCEIVES: [&str; 6] = ["feel", "see", "hear", "smell", "tell", "imagine"];

/// Words by which someone wants something of someone.
const DEMANDS: [&str; 27] = [
    "must",
    "should",
    "shall",
    "ought",
    "needs",
    "need",
    "please",
    "let",
    "allowed",
    "forbidden",
    "banned",
    "prohibited",
    "permitted",
    "only",
    "want",
    "prefer",
    "rather",
    "require",
    "requires",
    "required",
    "reserved",
    "avoid",
    "remain",
    "supposed",
    "exclude",
    "may",
    "belongs",
];

/// A verb in the past: "went", "mopped".
pub fn is_past(item: &Item) -> bool {
    let word = item.text.as_str();
    !word.contains(' ')
        && (Lexicon::get().is_past(word)
            || word.ends_with("ed") && item.is_word() && speech(word) != Speech::MayName)
}

/// "sparky bites things", "gravel sprays everywhere": a verb that could be a noun.
fn does_with_s(items: &[Item]) -> bool {
    items.windows(2).skip(usize::from(items.first().is_some_and(|item| item.is(Sense::Det)))).any(|pair| {
        let [verb, next] = pair else { return false };
        verb.is_word()
            && verb.text.ends_with('s')
            && (next.is_any(&[Sense::Det, Sense::Pronoun, Sense::Everywhere, Sense::PrepOn]) || is_past(verb))
    })
}

/// Whether the item can be part of a story.
fn is_harmless(items: &[Item], at: usize, has_subject: bool) -> bool {
    let Some(item) = items.get(at) else { return true };
    let before = at.checked_sub(1).and_then(|idx| items.get(idx));
    let next = items.get(at + 1);
    if let Sort::Quantity(quantity) = &item.sort {
        let follows = next.map_or("", |next| next.text.as_str());
        return match quantity.kind {
            Kind::Bare => quantity.bound == Bound::Plain,
            Kind::Duration => matches!(follows, "ago" | "old"),
            Kind::Distance => {
                matches!(follows, "deep" | "long" | "wide" | "high" | "tall" | "thick" | "across" | "down")
                    || before.is_some_and(|before| before.is(Sense::Of))
            }
            Kind::TurnRate => quantity.said.ends_with("degrees"),
            Kind::Speed | Kind::Fraction => false,
        };
    }
    let words = || item.text.split(' ');
    if words().any(|word| DEMANDS.contains(&word)) && !item.is_word()
        || item.is_word() && DEMANDS.contains(&item.text.as_str())
    {
        return false;
    }
    let by_others = is_done_by_others(items, at);
    if holds(item) {
        return by_others && has_subject;
    }
    if item.is(Sense::Neg) {
        let is_told = matches!(
            item.text.as_str(),
            "not"
                | "no"
                | "does not"
                | "did not"
                | "could not"
                | "would not"
                | "can not"
                | "will not"
                | "nobody"
                | "without"
        ) || item.text == "do not" && by_others
            || item.text == "never" && by_others
            || item.text == "never" && items.first().is_some_and(|item| item.text == "you had");
        let of_robot = items.iter().any(|item| item.is(Sense::SelfRef) || words_of_robot(item));
        let consequence = items.first().is_some_and(|item| {
            matches!(item.text.as_str(), "you had" | "you would" | "you might" | "you could")
        });
        return is_told && at > 0 && has_subject && (!of_robot || consequence);
    }
    // "it fell off", "the life out of me": behind its verb a particle orders nothing.
    if item.is_any(&[Sense::StayOff, Sense::Away]) {
        let single =
            matches!(item.text.as_str(), "off" | "out" | "out of" | "away" | "back" | "away from" | "off of");
        let has_copula = items.iter().take(at).any(|item| item.is(Sense::Copula));
        return single && has_subject && at > 1 && (!has_copula || items.iter().take(at).any(is_past));
    }
    if item.is(Sense::Allow) {
        return !items.first().is_some_and(words_of_robot)
            || next.is_some_and(|next| PERCEIVES.contains(&next.text.as_str()));
    }
    // "the lift is broken": a noun behind its article.
    let is_noun = before.is_some_and(|before| before.is(Sense::Det) && !before.is(Sense::Pronoun));
    is_noun || !item.is_any(&TELLING)
}

/// "keep", "stand back": an order, unless others do it.
fn holds(item: &Item) -> bool {
    let verb = item.text.split(' ').next().unwrap_or_default();
    matches!(verb, "keep" | "keeps" | "stay" | "stays" | "stand" | "stands")
        && item.is_any(&[Sense::Hold, Sense::StayOff, Sense::Away])
}

/// "we keep the dressings there", "visitors stand back": what others do, when nothing is told before it.
fn is_done_by_others(items: &[Item], at: usize) -> bool {
    at.checked_sub(1).and_then(|idx| items.get(idx)).is_some_and(|before| {
        before.is(Sense::Subject) && !before.text.starts_with("you")
            || before.is_word()
                && !items
                    .iter()
                    .take(at)
                    .any(|item| item.is_any(&[Sense::Copula, Sense::Statement]) || is_past(item))
    })
}

fn words_of_robot(item: &Item) -> bool {
    item.text.split(' ').any(|word| matches!(word, "you" | "your" | "yourself"))
}

/// Only what it names, and that it tells.
fn as_story(draft: Draft) -> Draft {
    let governed = draft.regions.into_iter().flat_map(|region| region.names);
    Draft {
        join: draft
            .join
            .map(|join| if matches!(join, Join::If | Join::Until) { Join::Because } else { join }),
        is_fresh: draft.is_fresh,
        senses: draft
            .senses
            .iter()
            .copied()
            .filter(|sense| *sense == Sense::ThereIs)
            .chain([Sense::Statement])
            .collect(),
        names: draft.names,
        told: draft.told,
        whereabouts: draft.whereabouts.into_iter().chain(governed).collect(),
        words: draft.words,
        ..Draft::default()
    }
}
