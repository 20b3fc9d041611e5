//! Cuts an utterance into stretches that say one thing each.
//!
//! Cuts are cheap and often wrong ("the rug and | the sofa"); joining what belongs together is the
//! business of `combine`, which knows what each stretch holds.

mod cut;

use std::ops::Range;

use crate::background::is_past;
use crate::item::Item;
use crate::lexicon::Sense;
use cut::cut_before;

/// How a stretch is tied to the one before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Join {
    /// First of its sentence.
    Start,
    /// Comma, colon or dash.
    Comma,
    /// "and", "plus", "also".
    And,
    /// "or", "nor".
    Or,
    /// "but", "however".
    But,
    /// "so", "therefore".
    So,
    /// "because", "otherwise": a reason.
    Because,
    /// "if", "when", "while".
    If,
    /// "until", "unless".
    Until,
    /// Nothing said: the grammar starts anew.
    Bare,
}

/// One stretch of items.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// How it is tied to the one before.
    pub join: Join,
    /// Whether a connector or a mark stood before its own ("and if …", not "… if …").
    pub is_fresh: bool,
    /// The connector's own words: "when you see".
    pub lead: String,
    /// Its items.
    pub range: Range<usize>,
}

/// The stretches of an utterance, in order, none empty.
#[must_use]
pub fn segments(items: &[Item]) -> Vec<Segment> {
    let mut out = Vec::new();
    let mut open = Segment { join: Join::Start, is_fresh: true, lead: String::new(), range: 0..0 };
    // "between the sofa and the tv": the next "and" is inside.
    let mut and_is_inside = false;
    let mut named = false;
    let mut earlier = Earlier::default();
    for (at, item) in items.iter().enumerate() {
        if item.is(Sense::PrepBetween) {
            and_is_inside = true;
        }
        if and_is_inside && item.is_any(&[Sense::And, Sense::Or]) {
            and_is_inside = false;
            continue;
        }
        let cut = cut_before(items, at, open.join, out.is_empty(), named, earlier);
        earlier.see(item);
        if let Some((join, keeps_item)) = cut {
            open.range.end = at;
            push(&mut out, &open);
            let start = if keeps_item { at } else { at + 1 };
            // Two connectors in a row: the telling one stays.
            let is_fresh = open.range.is_empty() || !matches!(join, Join::If | Join::Until | Join::Because);
            let join = if open.range.is_empty() { stronger(open.join, join) } else { join };
            let lead = if keeps_item { String::new() } else { item.text.clone() };
            open = Segment { join, is_fresh, lead, range: start..start };
            earlier.start = start;
            earlier.told = false;
            earlier.ordered = false;
            named = false;
        }
        if cut.is_none_or(|(_, keeps_item)| keeps_item) {
            named |= item.is_word() || item.is(Sense::Pronoun) || item.is(Sense::PrepNear);
        }
    }
    open.range.end = items.len();
    push(&mut out, &open);
    out
}

/// What stood anywhere before an item; kept along the way, so that nothing is read twice.
#[derive(Clone, Copy, Default)]
struct Earlier {
    /// Where the open stretch starts.
    start: usize,
    word_or_hold: bool,
    universal: bool,
    /// Whether the open stretch orders.
    ordered: bool,
    /// Whether the open stretch tells how something is.
    told: bool,
}

impl Earlier {
    fn see(&mut self, item: &Item) {
        self.ordered |= item.is_any(&[
            Sense::Avoid,
            Sense::StayOff,
            Sense::Neg,
            Sense::Slow,
            Sense::Careful,
            Sense::Quiet,
        ]);
        self.told |= is_past(item)
            || item.is_any(&[Sense::Copula, Sense::ThereIs, Sense::Statement, Sense::Revoke])
                && !item.is(Sense::Filler);
        self.word_or_hold |= item.is_word() || item.is(Sense::Hold);
        self.universal |= item.is(Sense::Det)
            && matches!(item.text.as_str(), "all" | "every" | "any" | "all the" | "all of the");
    }
}

fn push(out: &mut Vec<Segment>, segment: &Segment) {
    if !segment.range.is_empty() {
        out.push(segment.clone());
    }
}

fn stronger(a: Join, b: Join) -> Join {
    match (a, b) {
        (Join::Start, Join::Comma | Join::And | Join::So | Join::But) => Join::Start,
        (_, Join::Comma | Join::Bare) => a,
        _ => b,
    }
}
