//! Fills the slots of a draft from one stretch of items, left to right.

mod choose;
mod place;
mod sense;
mod told;

use crate::demand::is_on_others;
use crate::draft::{Draft, Place, Region};
use crate::item::{Item, Sort};
use crate::lexicon::Sense;
use crate::phrase::noun_phrase;
use crate::quantity::{Bound, Kind, Quantity};
use crate::segment::Join;
use crate::speech::{Speech, speech};
use place::place_of;
use told::preamble;

/// Most slots that one stretch may fill.
const N_SLOTS_MAX: usize = 48;

/// Fills the slots from one stretch of items.
#[must_use]
pub fn scan(items: &[Item], join: Join) -> Draft {
    let words = items.iter().map(|item| item.text.as_str()).collect::<Vec<_>>().join(" ");
    let mut scanner = Scanner {
        items,
        at: 0,
        join: Some(join),
        draft: Draft { join: Some(join), words, ..Draft::default() },
        before: Before::Nothing,
    };
    if let Some(n_items) = preamble(items) {
        scanner.at = n_items;
    }
    while let Some(item) = items.get(scanner.at) {
        let draft = &mut scanner.draft;
        if draft.senses.len() + draft.names.len() + draft.regions.len() > N_SLOTS_MAX {
            // No stretch of speech holds so much: it is asked about, and the work stays linear.
            draft.leftover.push(item.text.clone());
            break;
        }
        scanner.step();
    }
    let mut draft = scanner.finish();
    if is_on_others(items) {
        draft.leftover.push(draft.words.clone());
    }
    draft
}

/// What was read last, for deciding what a place word attaches to.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Before {
    Nothing,
    Place(Place),
    Except,
    ExceptName,
    LooseName,
    RegionName,
    Copula,
    /// Behind the verb of a story: what follows is told.
    Told,
    Other,
}

struct Scanner<'a> {
    items: &'a [Item],
    at: usize,
    join: Option<Join>,
    draft: Draft,
    before: Before,
}

impl Scanner<'_> {
    fn peek(&self, offset: usize) -> Option<&Item> {
        self.items.get(self.at + offset)
    }

    fn step(&mut self) {
        let Some(item) = self.items.get(self.at) else { return };
        if let Sort::Quantity(quantity) = &item.sort {
            self.quantity(quantity.clone());
            return;
        }
        if self.before == Before::Copula && self.predicate_word(item) {
            return;
        }
        // "do not be swinging about": a deed that we do not know.
        let deed = item.is_word()
            && item.text.ends_with("ing")
            && self
                .at
                .checked_sub(1)
                .and_then(|idx| self.items.get(idx))
                .is_some_and(|b| matches!(b.text.as_str(), "be" | "being"));
        if deed && self.before != Before::Copula && self.before != Before::Told {
            self.draft.leftover.push(item.text.clone());
            self.at += 1;
            return;
        }
        if self.told_word() || self.name() {
            return;
        }
        let item = self.items[self.at].clone();
        self.at += 1;
        if item.sort == Sort::Mark {
            return;
        }
        if item.is_word() {
            // "recently", "completely": how, not what.
            let manner = speech(&item.text) == Speech::Adverb
                && item.text.ends_with("ly")
                && !RESTRICTING.contains(&item.text.as_str());
            if !manner {
                self.draft.leftover.push(item.text);
            }
        } else if !self.place(&item) {
            self.sense(&item);
        }
    }

    fn quantity(&mut self, quantity: Quantity) {
        self.at += 1;
        let lead =
            self.at.checked_sub(2).and_then(|idx| self.items.get(idx)).map_or("", |item| item.text.as_str());
        if quantity.kind == Kind::Duration && matches!(lead, "instead of" | "rather than") {
            return;
        }
        if quantity.kind == Kind::Duration {
            // "in ten minutes" and "every hour" are no lifetimes; left over, they become a question.
            if matches!(lead, "in" | "after" | "every") || quantity.bound == Bound::Within || quantity.by {
                self.draft.leftover.push(quantity.said);
            } else {
                self.draft.ttl_s = Some(quantity.value.round() as u64);
                if matches!(self.before, Before::Place(_)) {
                    self.before = Before::Other;
                }
            }
            return;
        }
        // "they can crush a foot": part of a story, and of a body.
        if self.before == Before::Told && matches!(quantity.said.as_str(), "a foot" | "a hand") {
            self.draft.predicate.push(quantity.said);
            return;
        }
        // "the door is 90 cm wide": a measure of the thing, and no distance to keep.
        let measures = quantity.kind == Kind::Distance
            && self.peek(0).is_some_and(|next| {
                matches!(
                    next.text.as_str(),
                    "wide"
                        | "deep"
                        | "long"
                        | "tall"
                        | "high"
                        | "thick"
                        | "across"
                        | "in diameter"
                        | "in length"
                )
            });
        if measures {
            self.at += 1;
            if self.draft.has(Sense::Copula) {
                self.draft.predicate.push(quantity.said);
            } else {
                self.draft.leftover.push(quantity.said);
            }
            return;
        }
        // "an hour instead of ten minutes": the old number.
        if matches!(lead, "instead of" | "rather than") {
            return;
        }
        self.draft.quantities.push(quantity);
        if self.before != Before::Copula {
            self.before = Before::Other;
        }
    }

    /// Reads a name here, if one starts, and puts it where it belongs.
    fn name(&mut self) -> bool {
        // "keep away from the barrel", "near the rug | or the barrel"
        let leads_on = match self.at.checked_sub(1).and_then(|idx| self.items.get(idx)) {
            Some(item) => {
                item.text.ends_with(" from")
                    || item.is_any(&[Sense::And, Sense::Or, Sense::ThereIs])
                    || matches!(item.text.as_str(), "give" | "leave" | "keep" | "mind" | "pass" | "treat")
            }
            None => matches!(self.join, Some(Join::And | Join::Or | Join::Comma)),
        };
        let expects = matches!(self.before, Before::Place(_) | Before::Except)
            || leads_on
            || self.draft.senses.last().is_some_and(|s| TRANSITIVE.contains(s))
                && self.before == Before::Other;
        let Some((name, n_items)) = noun_phrase(self.items, self.at, expects) else { return false };
        self.at += n_items;
        match self.before {
            Before::Place(place) => {
                let names = self.second_of_gap(place, name);
                self.draft.regions.push(Region { place, names });
                self.before = Before::RegionName;
            }
            Before::Except => {
                self.draft.except.push(name);
                self.before = Before::ExceptName;
            }
            _ => {
                self.draft.names.push(name);
                self.before = Before::LooseName;
            }
        }
        self.tail();
        true
    }

    fn finish(mut self) -> Draft {
        let loose = self.draft.names.iter().filter(|name| !name.is_pronoun).count();
        self.draft.is_crowded = loose > 1
            && !self.draft.has_any(&[Sense::Copula, Sense::ThereIs, Sense::Subject, Sense::Statement]);
        // "do not move": the whole of it.
        if self.draft.n_neg == 1
            && self.draft.senses == [Sense::Motion]
            && self.draft.words.ends_with(" move")
            && self.before == Before::Other
        {
            self.draft.n_neg = 0;
            self.draft.senses = vec![Sense::Halt];
        }
        // A place word without a name: nearness said of nobody, or a dangling word.
        if let Before::Place(place) = self.before {
            let stranded = self.draft.n_neg > 0
                && self.draft.regions.is_empty()
                && matches!(place, Place::On | Place::Under | Place::Near)
                && self.draft.names.iter().any(|name| !name.is_pronoun);
            if stranded {
                // "the rug is not something to walk across"
                let names = std::mem::take(&mut self.draft.names);
                self.draft.regions.push(Region { place, names });
            } else if place == Place::Near {
                self.draft.senses.push(Sense::PrepNear);
            } else {
                self.draft.regions.push(Region { place, names: Vec::new() });
            }
        }
        self.draft
    }
}

/// Adverbs that take something away from an order, or give it a time.
const RESTRICTING: [&str; 16] = [
    "hardly",
    "barely",
    "scarcely",
    "rarely",
    "hourly",
    "nightly",
    "temporarily",
    "briefly",
    "shortly",
    "occasionally",
    "partly",
    "partially",
    "nearly",
    "formerly",
    "seldomly",
    "previously",
];

/// Senses that order something: no story and no description goes on over them.
const ORDERS: [Sense; 31] = [
    Sense::Neg,
    Sense::Avoid,
    Sense::Away,
    Sense::Wide,
    Sense::StayOff,
    Sense::Hold,
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
    Sense::Careful,
    Sense::Quiet,
    Sense::SpeedNoun,
    Sense::OffLimits,
    Sense::Closed,
    Sense::Fragile,
    Sense::NeedsSpace,
    Sense::Sleeping,
    Sense::Revoke,
    Sense::Make,
    Sense::Same,
    Sense::NormalSpeed,
    Sense::History,
    Sense::MinSpeed,
    Sense::Fine,
];

/// Senses whose next name is their object.
const TRANSITIVE: [Sense; 12] = [
    Sense::Avoid,
    Sense::VerbOn,
    Sense::VerbNear,
    Sense::VerbTouch,
    Sense::VerbPast,
    Sense::VerbBlock,
    Sense::VerbWake,
    Sense::From,
    Sense::Of,
    Sense::ForWhom,
    Sense::StayOff,
    Sense::Careful,
];
