//! Place words: what they govern, and when they only describe the name before them.

use super::{Before, Scanner};
use crate::draft::{Draft, Place, Region};
use crate::item::{Item, Sort};
use crate::lexicon::Sense;
use crate::noun::{Name, Nouns};
use crate::phrase::noun_phrase;
use crate::quantity::Kind;
use crate::speech::{Speech, speech};

impl Scanner<'_> {
    /// Reads a place word; attaches it to the name before it when it only describes that name.
    pub(super) fn place(&mut self, item: &Item) -> bool {
        let follows_name = matches!(self.before, Before::LooseName | Before::RegionName | Before::ExceptName);
        if self.lets_off(item) {
            self.before = Before::Except;
            return true;
        }
        if follows_name && self.gap_between(item) {
            return true;
        }
        if self.describes(item, follows_name) {
            return true;
        }
        // "don't park outside the theatre": near it, and not off it.
        let outside = matches!(item.text.as_str(), "outside" | "outside of")
            && self.draft.n_neg > 0
            && self.draft.has(Sense::Motion)
            && noun_phrase(self.items, self.at, true).is_some();
        if outside {
            self.before = Before::Place(Place::Near);
            return true;
        }
        let Some(place) = place_of(item) else { return false };
        if place == Place::To && self.purpose(item) {
            return true;
        }
        let name_ahead = noun_phrase(self.items, self.at, true);
        if let (true, Some((name, n_items))) = (follows_name && attaches(item, &self.draft), &name_ahead)
            && !name.is_pronoun
        {
            self.extend_last_name(&item.text, name);
            self.at += n_items;
            return true;
        }
        if place == Place::Near && name_ahead.is_none() && self.nearness(item) {
            return true;
        }
        if item.is(Sense::From)
            && (self.draft.quantity(Kind::Distance).is_some() || self.draft.quantity(Kind::Bare).is_some())
            && place == Place::Near
        {
            self.draft.senses.push(Sense::From);
            self.before = Before::Other;
            return true;
        }
        if place == Place::To && name_ahead.is_none() {
            return true;
        }
        let place = match &name_ahead {
            Some((name, _)) if item.text == "at" && self.draft.senses.last() == Some(&Sense::Halt) => {
                self.stop_at(name)
            }
            _ => place,
        };
        self.before = Before::Place(place);
        if item.is(Sense::VerbOn) || item.is(Sense::Motion) {
            self.draft.senses.push(Sense::Motion);
        }
        true
    }

    /// "the shelf with the vase", "the floor outside bay 3": more about the name before.
    fn describes(&mut self, item: &Item, follows_name: bool) -> bool {
        if let (true, "with", Some((name, n_items))) =
            (follows_name, item.text.as_str(), noun_phrase(self.items, self.at, true))
        {
            self.extend_last_name("with", &name);
            self.at += n_items;
            return true;
        }
        // "the floor outside bay 3": describes the floor.
        if let (Before::LooseName | Before::RegionName, "outside" | "outside of", Some((name, n_items))) =
            (self.before, item.text.as_str(), noun_phrase(self.items, self.at, true))
        {
            self.extend_last_name(&item.text, &name);
            self.at += n_items;
            return true;
        }
        false
    }

    /// Takes a purpose for no place.
    fn purpose(&mut self, item: &Item) -> bool {
        // "time to grow", "stay back to let them pass": a purpose, not a place.
        if self.peek(0).is_some_and(|next| {
            next.is_word() && speech(&next.text) == Speech::Verb
                || next.is_any(&[Sense::Fine, Sense::Statement, Sense::Sleeping])
        }) {
            let verb = self.peek(0).map_or_else(String::new, |next| next.text.clone());
            self.draft.predicate.extend([item.text.clone(), verb]);
            self.at += 1;
            self.before = Before::Told;
            return true;
        }
        false
    }

    /// "people nearby": the names before stand near.
    fn nearness(&mut self, item: &Item) -> bool {
        let number_next = self.peek(0).is_some_and(|next| matches!(next.sort, Sort::Quantity(_)));
        if self.before == Before::LooseName && !number_next && item.text != "at" {
            // "people nearby", "a dog close by": nearness of the robot itself.
            if let Some(name) = self.draft.names.pop() {
                self.draft.regions.push(Region { place: Place::Near, names: vec![name] });
                self.before = Before::RegionName;
                return true;
            }
        }
        if self.before == Before::Copula && !self.draft.names.is_empty() {
            let names = std::mem::take(&mut self.draft.names);
            self.draft.regions.push(Region { place: Place::Near, names });
            self.before = Before::RegionName;
            return true;
        }
        false
    }

    /// "stop at the line" forbids what lies past it; at anything else it may mean anything.
    fn stop_at(&mut self, name: &Name) -> Place {
        if Nouns::get().is_threshold(&name.obj) {
            self.draft.senses.pop();
            self.draft.senses.push(Sense::Hold);
            return Place::ThisSide;
        }
        if !Nouns::get().is_living(&name.obj) {
            self.draft.leftover.push(format!("stop at the {}", name.reference));
        }
        Place::Near
    }

    /// "any room besides the study": here "besides" lets off.
    fn lets_off(&self, item: &Item) -> bool {
        let last = match self.before {
            Before::RegionName => self.draft.regions.last().and_then(|region| region.names.last()),
            Before::LooseName => self.draft.names.last(),
            _ => None,
        };
        let universal = last.is_some_and(|name| name.is_universal)
            || self.draft.has_any(&[Sense::OffLimits, Sense::StayOff])
                && self.draft.all_names().any(|name| name.is_universal);
        item.is(Sense::Except) && universal
    }

    /// "the path between the roses and the fence": the gap, or a thing that stands in it.
    fn gap_between(&mut self, item: &Item) -> bool {
        if !item.is(Sense::PrepBetween) {
            return false;
        }
        let Some((first, n_items)) = noun_phrase(self.items, self.at, true) else { return false };
        self.at += n_items;
        let gap = self.second_of_gap(Place::Between, first);
        let last = match self.before {
            Before::RegionName => self.draft.regions.last().and_then(|region| region.names.last()),
            Before::LooseName => self.draft.names.last(),
            _ => None,
        };
        if last.is_some_and(|name| Nouns::get().is_passage(&name.obj)) {
            match self.before {
                Before::RegionName => drop(self.draft.regions.pop()),
                _ => drop(self.draft.names.pop()),
            }
            self.draft.regions.push(Region { place: Place::Between, names: gap });
            self.before = Before::RegionName;
        } else {
            let both: Vec<&str> = gap.iter().map(|name| name.reference.as_str()).collect();
            let tail = Name { reference: both.join(" and "), ..Name::default() };
            self.extend_last_name(&item.text, &tail);
        }
        true
    }

    fn extend_last_name(&mut self, link: &str, tail: &Name) {
        let name = match self.before {
            Before::ExceptName => self.draft.except.last_mut(),
            Before::RegionName => self.draft.regions.last_mut().and_then(|region| region.names.last_mut()),
            _ => self.draft.names.last_mut(),
        };
        if let Some(name) = name {
            // A meeting cannot be seen; the room it is in can.
            if Nouns::get().is_event(&name.obj) && !tail.obj.is_empty() {
                *name = tail.clone();
                return;
            }
            if Nouns::get().is_place(&tail.obj) {
                self.draft.whereabouts.push(tail.clone());
            }
            // "the area behind the stove" is where, not what.
            let side = place_of_words(link).filter(|_| {
                Nouns::get().is_passage(&name.obj) && !tail.obj.is_empty() && name.obj != "floor"
            });
            if let Some(place) = side {
                let names = vec![tail.clone()];
                match self.before {
                    Before::RegionName => drop(self.draft.regions.pop()),
                    Before::ExceptName => return,
                    _ => drop(self.draft.names.pop()),
                }
                self.draft.regions.push(Region { place, names });
                self.before = Before::RegionName;
                return;
            }
            name.reference = format!("{} {link} {}", name.reference, tail.reference);
            name.is_pronoun = false;
            // "the area around the stove" is about the stove.
            if matches!(
                name.obj.as_str(),
                "area" | "space" | "region" | "zone" | "spot" | "place" | "bit" | "floor area"
            ) && !tail.obj.is_empty()
            {
                name.obj.clone_from(&tail.obj);
            }
        }
    }

    /// "between A and B" takes its second landmark at once.
    pub(super) fn second_of_gap(&mut self, place: Place, first: Name) -> Vec<Name> {
        let mut names = vec![first];
        if place == Place::Between
            && self.peek(0).is_some_and(|item| item.is_any(&[Sense::And, Sense::Or]))
            && let Some((second, n_items)) = noun_phrase(self.items, self.at + 1, true)
        {
            self.at += 1 + n_items;
            names.push(second);
        }
        names
    }
}

/// Which region a place word opens; the first that an item has counts.
const PLACES: [(Sense, Place); 11] = [
    (Sense::PrepBetween, Place::Between),
    (Sense::PrepUnder, Place::Under),
    (Sense::PrepPast, Place::Past),
    (Sense::PrepFront, Place::Front),
    (Sense::PrepBehind, Place::Behind),
    (Sense::PrepLeft, Place::Left),
    (Sense::PrepRight, Place::Right),
    (Sense::ThisSide, Place::ThisSide),
    (Sense::PrepOn, Place::On),
    (Sense::PrepNear, Place::Near),
    (Sense::To, Place::To),
];

pub(super) fn place_of(item: &Item) -> Option<Place> {
    if item.text == "about" {
        return None;
    }
    PLACES.iter().find(|(sense, _)| item.is(*sense)).map(|(_, place)| *place)
}

/// The side that a place word names, where the region is that side.
fn place_of_words(link: &str) -> Option<Place> {
    use Place::{Behind, Front, Left, Past, Right, Under};
    let tokens = crate::text::tokens(link, crate::lexicon::Lexicon::get());
    let (senses, _) = crate::lexicon::Lexicon::get().senses_at(&tokens, 0)?;
    let is_side = |place: &Place| matches!(place, Under | Past | Front | Behind | Left | Right);
    PLACES.iter().find(|(sense, place)| is_side(place) && senses.contains(sense)).map(|(_, place)| *place)
}

/// Whether a place word after a name describes that name, rather than naming another region.
fn attaches(item: &Item, draft: &Draft) -> bool {
    // Words of a path lead on: "to the door through the hall".
    const PATH: [&str; 12] = [
        "through", "across", "over", "into", "onto", "past", "beyond", "up", "down", "along", "crossing",
        "to",
    ];
    if PATH.contains(&item.text.as_str()) {
        return false;
    }
    // "keep the table on your left", "there is a cable under the desk": describes.
    draft.names.last().is_none_or(|name| name.obj != "wheel")
}
