//! Demands on somebody else: "the kids must stay away from the pool".
//!
//! The robot in the third person is "you" by now (`text::subject`), so whoever else must move, keep or avoid something
//! is told nothing that the robot could heed; a thing that must be avoided (the passive) is another matter. Found here,
//! such a stretch is asked about: it may well mean the robot.

use crate::item::{Item, Sort};
use crate::lexicon::{GOING, Sense};

/// What makes a demand of the verb behind it.
const MODALS: [&str; 22] = [
    "must",
    "should",
    "shall",
    "must not",
    "should not",
    "may not",
    "has to",
    "have to",
    "needs to",
    "need to",
    "ought to",
    "is to",
    "are to",
    "is not to",
    "are not to",
    "is never to",
    "are never to",
    "is allowed to",
    "are not allowed to",
    "is not allowed to",
    "are allowed to",
    "can not",
];
/// Verbs of moving that the lexicon has as parts of longer phrases.
const ACTIVE: [&str; 12] =
    ["stay", "keep", "remain", "avoid", "leave", "slow", "stop", "go", "drive", "enter", "cross", "give"];
/// Verbs by which people tell of what they do themselves.
const HABITS: [&str; 8] = ["keep", "keeps", "stay", "stays", "avoid", "avoids", "slow", "slows"];
/// Whoever these are, the robot is among them.
const INCLUDES_ROBOT: [&str; 14] = [
    "robots",
    "robot",
    "machines",
    "vehicles",
    "agvs",
    "amrs",
    "wheels",
    "you",
    "yourself",
    "everyone",
    "everybody",
    "all",
    "we",
    "speed",
];

/// Whether somebody who is not the robot is told to move, keep or avoid.
#[must_use]
pub fn is_on_others(items: &[Item]) -> bool {
    items.iter().enumerate().any(|(at, item)| {
        // "must stay away", but "must stay closed"
        let stays = ["stay", "remain", "keep"].iter().any(|verb| item.text.ends_with(verb))
            && item.text.contains(' ')
            && items.get(at + 1).is_some_and(|next| {
                next.is_any(&[Sense::Away, Sense::StayOff, Sense::Wide, Sense::From, Sense::PrepOn])
                    || matches!(next.sort, Sort::Quantity(_))
            });
        // "I keep a metre from it myself"
        let own_habit = at > 0
            && HABITS.contains(&item.text.split(' ').next().unwrap_or_default())
            && items
                .get(at - 1)
                .is_some_and(|who| matches!(who.text.as_str(), "i" | "we" | "he" | "she" | "they"));
        own_habit
            || stays && others_before(items, at)
            || MODALS.contains(&item.text.as_str()) && others_before(items, at) && is_active(items, at + 1)
    })
}

/// Whether the subject before the modal is a thing, an animal or a person.
fn others_before(items: &[Item], modal_at: usize) -> bool {
    const N_ITEMS_MAX: usize = 10;
    let before = items.get(modal_at.saturating_sub(N_ITEMS_MAX)..modal_at).unwrap_or_default();
    let names_robot = before
        .iter()
        .any(|item| item.text.split(' ').any(|word| INCLUDES_ROBOT.contains(&word) || word == "your"));
    let subject = before.iter().rev().find(|item| !item.is(Sense::Filler) || item.is(Sense::Pronoun));
    let is_subject = subject.is_some_and(|item| {
        item.is_word()
            || matches!(item.text.as_str(), "it" | "they" | "he" | "she")
            || item.is(Sense::Pronoun)
    });
    // "nobody must", "the lamp, avoid it": what orders before is no subject.
    let orders =
        before.iter().any(|item| item.is_any(&[Sense::Neg, Sense::Avoid, Sense::Hold, Sense::StayOff]));
    is_subject && !names_robot && !orders
}

/// Whether the verb behind a modal does something, rather than having it done.
fn is_active(items: &[Item], at: usize) -> bool {
    let Some(item) = items.iter().skip(at).find(|item| {
        let passes = item.is(Sense::Filler) && !item.is(Sense::Motion)
            || matches!(item.text.as_str(), "not" | "never" | "always" | "ever" | "also" | "only" | "just");
        !passes
    }) else {
        return false;
    };
    let first = item.text.split(' ').next().unwrap_or_default();
    let done_to =
        first == "be" || first.ends_with("ed") || matches!(first, "kept" | "left" | "driven" | "given");
    let acts = item.is_any(&GOING) || item.is_any(&[Sense::Avoid, Sense::Slow]);
    !done_to && (acts || ACTIVE.contains(&first)) && items.len() > at + 1
}
