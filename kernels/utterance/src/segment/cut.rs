//! Where one stretch ends and the next begins.

use super::{Earlier, Join};
use crate::background::is_past;
use crate::item::{Item, Sort};
use crate::lexicon::{GOING, Sense};
use crate::quantity::{Bound, Kind};

/// Senses that begin a new order after a condition ("when you see a dog | slow down").
const ORDERS: [Sense; 15] = [
    Sense::Slow,
    Sense::Crawl,
    Sense::Halt,
    Sense::TurnSlow,
    Sense::Careful,
    Sense::Quiet,
    Sense::Avoid,
    Sense::Hold,
    Sense::WalkPace,
    Sense::Slower,
    Sense::Dampen,
    Sense::SpeedNoun,
    Sense::Wide,
    Sense::StayOff,
    Sense::Contain,
];

/// Whether a cut falls before this item, and whether the item belongs to the new stretch.
pub(super) fn cut_before(
    items: &[Item],
    at: usize,
    open: Join,
    is_first: bool,
    named: bool,
    earlier: Earlier,
) -> Option<(Join, bool)> {
    match cut_by_link(items, at, earlier) {
        Some(decided) => decided,
        None => cut_by_start(items, at, open, is_first, named, earlier),
    }
}

/// A cut that a mark or a connector makes, or forbids; none when the item is neither.
fn cut_by_link(items: &[Item], at: usize, earlier: Earlier) -> Option<Option<(Join, bool)>> {
    let item = &items[at];
    let before = at.checked_sub(1).and_then(|idx| items.get(idx));
    let next = items.get(at + 1);
    if item.text == "," && is_aside(items, at) {
        return Some(None);
    }
    if item.sort == Sort::Mark {
        let join = if matches!(item.text.as_str(), "," | ":" | "-") { Join::Comma } else { Join::Start };
        return Some(Some((join, false)));
    }
    // Inside a name ("the drop off area") nothing cuts.
    if before.is_some_and(|b| b.is(Sense::Det) && !b.is(Sense::Pronoun)) && !item.is(Sense::Neg) {
        return Some(None);
    }
    // "when you pass the pocket watch": nothing follows that it could tell to avoid.
    let has_no_object = next.is_none_or(|n| n.sort == Sort::Mark);
    let wants_one = item.is(Sense::Avoid) || matches!(item.text.as_str(), "handle" | "set");
    if wants_one && has_no_object && !item.text.contains(' ') && before.is_some_and(Item::is_word) {
        return Some(None);
    }
    if item.is(Sense::OpenEnded) || item.is(Sense::TimeWords) || item.is(Sense::Except) {
        return Some(None);
    }
    // "please to avoid the table" orders; "keep back to avoid damage" gives a reason.
    let is_order = item.text == "to avoid" && !earlier.word_or_hold;
    // "replace the rug rule with half a metre around the sofa": what goes, and what comes.
    let swaps = items.get(earlier.start).is_some_and(|first| {
        first.is(Sense::Revoke)
            && matches!(first.text.as_str(), "replace" | "swap" | "swap out" | "substitute")
    });
    let new_number = matches!(next.map(|n| &n.sort), Some(Sort::Quantity(_))) && at + 2 >= items.len();
    if swaps && !new_number && at > earlier.start + 1 && matches!(item.text.as_str(), "with" | "by" | "for") {
        return Some(Some((Join::And, false)));
    }
    if item.is(Sense::Because) && !is_order {
        return Some(Some((Join::Because, false)));
    }
    if item.is(Sense::So) && !item.is(Sense::Filler) {
        return Some(Some((Join::So, false)));
    }
    if item.is(Sense::Until) {
        return Some(Some((Join::Until, false)));
    }
    // "should you see a dog" asks for a case; "never should the robot" does not.
    let plain_should =
        item.text == "should" && before.is_some_and(|b| b.sort != Sort::Mark && !b.is(Sense::And));
    if item.is(Sense::IfWhen)
        && !plain_should
        && !(item.text == "once" && next.is_none_or(|n| n.sort == Sort::Mark))
    {
        return Some(Some((Join::If, false)));
    }
    if item.text == "then" && before.is_some_and(|b| b.is(Sense::Until)) {
        return Some(None);
    }
    if item.is(Sense::And) {
        return Some(Some((Join::And, false)));
    }
    if item.is(Sense::Or) {
        // "avoid the bowl or it spills": what would happen else.
        let happens = next.is_some_and(|n| {
            matches!(
                n.text.as_str(),
                "it" | "they" | "he" | "she" | "i" | "we" | "you" | "someone" | "somebody"
            )
        }) && items.get(at + 2).is_some_and(|n| n.sort != Sort::Mark);
        return Some(Some((if happens { Join::Because } else { Join::Or }, false)));
    }
    if item.is(Sense::But)
        && !(item.text == "just" && next.is_some_and(is_past))
        && !(matches!(item.text.as_str(), "only" | "just")
            && before.is_none_or(|b| {
                b.is_any(&[Sense::Copula, Sense::Subject, Sense::Because, Sense::Pronoun])
                    || matches!(b.text.as_str(), "has" | "have" | "had" | "was" | "were" | "only")
            }))
    {
        let universal_exception = item.text == "but"
            && before.is_some_and(Item::is_word)
            && next.is_some_and(|n| n.is(Sense::Det) || n.is_word())
            && earlier.universal;
        let after_everywhere = item.text == "but"
            && before
                .is_some_and(|b| b.is_any(&[Sense::Everywhere, Sense::AllRules]) || b.text == "anything");
        return Some(if universal_exception || after_everywhere { None } else { Some((Join::But, false)) });
    }
    None
}

/// A cut where the grammar starts anew, with nothing that says so.
fn cut_by_start(
    items: &[Item],
    at: usize,
    open: Join,
    is_first: bool,
    named: bool,
    earlier: Earlier,
) -> Option<(Join, bool)> {
    let item = &items[at];
    let before = at.checked_sub(1).and_then(|idx| items.get(idx));
    let next = items.get(at + 1);
    // "it also splashes"
    if item.text == "also" && before.is_some_and(|b| b.is_any(&[Sense::Pronoun, Sense::Subject])) {
        return None;
    }
    if item.is(Sense::Also) && !item.is(Sense::AsWell) {
        return Some((Join::And, false));
    }
    if item.text == "also" && before.is_some() && next.is_some_and(|n| n.sort != Sort::Mark) {
        return Some((Join::And, false));
    }
    // "there is lego in the corner can you not go over it": no pause, but a new start.
    let asks = item.is(Sense::Filler)
        && [
            "can you",
            "could you",
            "would you",
            "please",
            "you must",
            "you should",
            "you have to",
            "you need to",
        ]
        .iter()
        .any(|start| item.text.starts_with(start))
        || item.is_any(&[Sense::Avoid, Sense::Careful]) && !item.is(Sense::PrepNear)
        || item.is(Sense::StayOff) && ["stay", "keep"].iter().any(|verb| item.text.starts_with(verb))
        || item.is(Sense::Neg) && matches!(item.text.as_str(), "do not" | "never");
    // "get to the dock without touching the crates": a task, and what to heed on the way.
    let besides = item.text == "without" && next.is_some_and(|n| n.is_any(&GOING) || n.is(Sense::VerbWake));
    if besides && named && !earlier.ordered && before.is_some_and(Item::is_word) {
        return Some((Join::And, true));
    }
    let forbids = item.is(Sense::Neg) && matches!(item.text.as_str(), "do not" | "never");
    if earlier.ordered && named && forbids && before.is_some_and(|b| b.is_word() || b.is(Sense::Pronoun)) {
        return Some((Join::And, true));
    }
    if earlier.told
        && named
        && asks
        && before.is_some_and(|b| b.is_word() || b.is_any(&[Sense::Fragile, Sense::Sleeping, Sense::Pronoun]))
    {
        return Some((Join::So, true));
    }
    if (matches!(open, Join::If | Join::Until) || open == Join::Because && is_first)
        && named
        && begins_order(items, at)
    {
        return Some((Join::Bare, true));
    }
    // A new subject after a name opens a reason: "the stove | it is hot".
    let subject = item.is(Sense::Subject)
        || (item.is(Sense::Pronoun)
            && matches!(item.text.as_str(), "it" | "that" | "this" | "those" | "these")
            && next.is_some_and(|n| {
                n.is(Sense::Copula) && !n.is(Sense::Filler)
                    || earlier.told
                        && matches!(n.text.as_str(), "should not" | "must not" | "may not" | "can not")
            }))
        || item.is(Sense::ThereIs);
    if subject && named && before.is_some_and(|b| b.is_word() || b.is(Sense::Pronoun)) {
        return Some((Join::Comma, true));
    }
    None
}

/// Whether the comma opens or closes a filler between commas: "nobody, including you, goes in".
fn is_aside(items: &[Item], at: usize) -> bool {
    const N_ITEMS_MAX: usize = 3;
    let filler =
        |item: &Item| item.is(Sense::Filler) && !item.is_any(&[Sense::Careful, Sense::Fine, Sense::Motion]);
    let ahead = items.iter().skip(at + 1).take(N_ITEMS_MAX).take_while(|item| filler(item)).count();
    let opens = ahead > 0 && items.get(at + 1 + ahead).is_some_and(|item| item.text == ",");
    let behind = items.iter().take(at).rev().take(N_ITEMS_MAX).take_while(|item| filler(item)).count();
    let closes = behind > 0
        && at.checked_sub(behind + 1).and_then(|idx| items.get(idx)).is_some_and(|item| item.text == ",");
    (opens || closes) && at > 0
}

fn begins_order(items: &[Item], at: usize) -> bool {
    let item = &items[at];
    let before = at.checked_sub(1).and_then(|idx| items.get(idx));
    // "when you get close, stop" has its comma; here a verb right after the name opens the order.
    let third_person = item.text.split(' ').next().is_some_and(|verb| verb.ends_with('s') && verb != "pass");
    let motion = item.is(Sense::Motion)
        && !third_person
        && !item.is(Sense::Filler)
        && before.is_some_and(|b| b.is_word() || b.is_any(&[Sense::PrepNear, Sense::Pronoun]))
        && items.get(at + 1).is_some_and(|n| {
            n.is_any(&ORDERS)
                || matches!(&n.sort, Sort::Quantity(q) if matches!(q.kind, Kind::Speed | Kind::Fraction))
                || n.text == "at"
                || n.is(Sense::Turn)
        });
    let told_to = item.is(Sense::Filler)
        && ["you have to", "you must", "you should", "you need to", "you are to", "please"]
            .contains(&item.text.as_str());
    // "till he wanders off"
    let is_particle =
        matches!(item.text.as_str(), "off" | "out" | "out of" | "away" | "back" | "clear" | "over");
    let order =
        told_to || item.is_any(&ORDERS) && !item.is_any(&[Sense::Pronoun, Sense::PrepNear]) && !is_particle;
    let negated = item.is(Sense::Neg)
        && before.is_some_and(|b| b.is_word() || b.is_any(&[Sense::PrepNear, Sense::Pronoun]));
    // "when carrying samples never exceed 0.4 m/s": a cap is no part of the case.
    let caps = matches!(&item.sort, Sort::Quantity(q) if matches!(q.kind, Kind::Speed | Kind::Fraction) && q.bound == Bound::Upper)
        && before.is_some_and(Item::is_word);
    motion || order || negated || caps
}
