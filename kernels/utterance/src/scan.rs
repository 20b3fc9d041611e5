//! Fills the slots of a draft from one stretch of items, left to right.

mod choose;

use crate::draft::{Draft, Place, Region};
use crate::item::{Item, Sort};
use crate::lexicon::Sense;
use crate::noun::{Name, Nouns};
use crate::phrase::noun_phrase;
use crate::quantity::{Bound, Kind, Quantity};
use crate::segment::Join;
use crate::speech::{Speech, speech};
use choose::choose;

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
    scanner.finish()
}

/// Items of "the safety officer says you have to", before an order begins; none when there are none.
///
/// Only words of telling go: no negation, number, place or order stands among them.
fn preamble(items: &[Item]) -> Option<usize> {
    const N_ITEMS_MAX: usize = 12;
    const TELLS: [&str; 24] = [
        "says",
        "said",
        "asked",
        "asks",
        "wants",
        "insists",
        "insisted",
        "told",
        "tells",
        "requires",
        "demands",
        "prefers",
        "requested",
        "requests",
        "like",
        "love",
        "prefer",
        "want",
        "need",
        "expects",
        "expect",
        "ask",
        "recommends",
        "suggests",
    ];
    let opens = items.iter().take(N_ITEMS_MAX).position(|item| {
        item.is_any(&[
            Sense::Neg,
            Sense::Avoid,
            Sense::Hold,
            Sense::Slow,
            Sense::Crawl,
            Sense::Careful,
            Sense::Quiet,
        ]) || item.is(Sense::StayOff) && item.text.contains(' ')
            || item.is(Sense::Halt)
    })?;
    let lead = &items[..opens];
    let last = lead.last()?.text.split(' ').next_back().unwrap_or_default();
    let turns = matches!(last, "you" | "to" | "that" | "robots" | "robot")
        || lead.last().is_some_and(|item| item.is(Sense::Filler) && item.text.starts_with("you "));
    let tells = lead.iter().any(|item| item.text.split(' ').any(|word| TELLS.contains(&word)));
    let plain = lead.iter().all(|item| {
        matches!(item.sort, Sort::Word | Sort::Phrase(_))
            && !item.is_any(&ORDERS)
            && !item.is_any(&[Sense::Allow, Sense::Lift, Sense::Again])
    });
    (turns && tells && plain && opens > 1).then_some(opens)
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

    /// The verb of a story, and the words behind it: "the vase belonged to …", "it also splashes".
    fn told_word(&mut self) -> bool {
        let Some(item) = self.items.get(self.at) else { return false };
        if self.before == Before::Told {
            // "I am not comfortable", "they have gone off", "it breaks easily": told all the same.
            let of_people =
                ["i ", "we ", "he ", "she ", "they "].iter().any(|who| self.draft.words.starts_with(who));
            let plain = match item.text.as_str() {
                "not" | "no" | "off" | "out" | "away" | "back" | "up" | "down" | "easy" | "easily"
                | "slow" | "slowly" | "fast" | "over" | "room" | "space" => true,
                _ => of_people && item.is_any(&STATES),
            };
            let outside = matches!(item.text.as_str(), "outside" | "outside of");
            let passes =
                item.is_word() || plain || outside || !item.is_any(&ORDERS) && place_of(item).is_none();
            if passes {
                match noun_phrase(self.items, self.at, false) {
                    Some((name, n_items)) if !name.is_pronoun => {
                        self.draft.told.push(name);
                        self.at += n_items;
                    }
                    _ => {
                        self.draft.predicate.push(item.text.clone());
                        self.at += 1;
                    }
                }
            }
            return passes;
        }
        if !self.opens_story(item) {
            return false;
        }
        self.draft.senses.push(Sense::Statement);
        self.draft.predicate.push(item.text.clone());
        self.at += 1;
        self.before = Before::Told;
        true
    }

    /// Whether this is the verb of a sentence that began with what it is about.
    fn opens_story(&self, item: &Item) -> bool {
        let only_subject = self.draft.n_neg == 0
            && self
                .draft
                .senses
                .iter()
                .all(|sense| matches!(sense, Sense::Subject | Sense::Copula | Sense::SelfRef));
        if !only_subject
            || !self.draft.quantities.is_empty()
            || !self.draft.regions.is_empty() && self.before != Before::RegionName
        {
            return false;
        }
        let next_is_word = self.peek(1).is_some_and(Item::is_word);
        let verb = item.is_word()
            && match speech(&item.text) {
                Speech::Verb => true,
                Speech::Participle => !item.text.ends_with("ing") && !next_is_word,
                // "water damages the floor"
                Speech::MayName => {
                    self.before == Before::LooseName
                        && item.text.ends_with('s')
                        && self.peek(1).is_some_and(|next| next.is(Sense::Det) && !next.is(Sense::Pronoun))
                }
                _ => false,
            };
        // "you clipped the lamp": told of the robot.
        let did = matches!(self.items.get(self.at.wrapping_sub(1)), Some(before) if before.text == "you")
            && self.at == 1
            && item.is_word()
            && speech(&item.text) == Speech::Participle
            && item.text.ends_with("ed");
        if did {
            return true;
        }
        let after_subject = self.draft.senses.last() == Some(&Sense::Subject) && self.draft.names.is_empty();
        let last_is_pronoun = self.draft.names.last().is_some_and(|name| name.is_pronoun);
        let helps = matches!(
            item.text.as_str(),
            "will" | "would" | "might" | "could" | "can" | "has" | "had" | "have" | "does" | "did" | "may"
        );
        // "the vibrations stress the fish", "chairs get pulled out": done by the thing, not by the robot.
        let deeds = [
            Sense::Motion,
            Sense::VerbOn,
            Sense::VerbNear,
            Sense::VerbTouch,
            Sense::VerbPast,
            Sense::VerbBlock,
            Sense::VerbWake,
            Sense::VerbLeave,
            Sense::Task,
        ];
        let done_by_it = self.join != Some(Join::If)
            && item.is_any(&deeds)
            && !item.is(Sense::PrepNear)
            && !item.is(Sense::Copula)
            && !item.text.ends_with("ing")
            && self.draft.names.last().is_some_and(|name| !name.is_pronoun)
            && self.peek(1).is_some_and(|next| !next.is_any(&ORDERS));
        let takes_time = matches!(item.text.as_str(), "needs" | "need" | "takes" | "take")
            && matches!(self.peek(1).map(|next| &next.sort), Some(Sort::Quantity(q)) if q.kind == Kind::Duration);
        match self.before {
            // "visitors keep leaving bags there"
            Before::LooseName
                if matches!(item.text.as_str(), "keep" | "keeps" | "kept")
                    && self.peek(1).is_some_and(|next| next.text.ends_with("ing")) =>
            {
                true
            }
            Before::LooseName if done_by_it || takes_time => true,
            Before::LooseName if last_is_pronoun => {
                verb || helps || item.is_word() && item.text.ends_with('s') || item.is(Sense::Hold)
            }
            // "to" and a verb behind a place: "on the way to reach".
            Before::LooseName | Before::RegionName => !self.draft.names.is_empty() && (verb || helps),
            _ if after_subject => {
                // "I keep tripping over you" orders nothing.
                let third = self.words_so_far_start_with_subject();
                let be = self.subject();
                let has_verb = be.is_some_and(|subject| subject.text.contains(' '));
                third
                    && (item.is_word()
                        || item.is(Sense::Hold)
                        || helps
                        || has_verb
                            && !item.is(Sense::Filler)
                            && (item.text == "not" || item.is_any(&STATES)))
            }
            _ => false,
        }
    }

    /// Whether someone other than the robot is the subject.
    fn words_so_far_start_with_subject(&self) -> bool {
        self.subject().is_some_and(|item| {
            let first = item.text.split(' ').next().unwrap_or_default();
            matches!(first, "i" | "we" | "he" | "she" | "they" | "who") && item.is(Sense::Subject)
        })
    }

    /// The subject that opened the stretch; looked for among its first items only.
    fn subject(&self) -> Option<&Item> {
        const N_ITEMS_MAX: usize = 4;
        self.items.iter().take(self.at.min(N_ITEMS_MAX)).find(|item| item.is(Sense::Subject))
    }

    /// "toys lying on the floor", "cables running along the wall": tells which ones.
    fn tail(&mut self) {
        let Some(first) = self.peek(0) else { return };
        let single = !first.text.contains(' ');
        let participle = if first.is_word() {
            speech(&first.text) == Speech::Participle
        } else {
            first.text.ends_with("ing")
                && first.is_any(&[
                    Sense::Motion,
                    Sense::Statement,
                    Sense::VerbOn,
                    Sense::VerbPast,
                    Sense::VerbBlock,
                    Sense::Sleeping,
                    Sense::Task,
                ])
                && !first.is_any(&[Sense::PrepOn, Sense::PrepNear])
        };
        let orders = self.draft.senses.iter().any(|sense| !matches!(sense, Sense::Subject | Sense::Copula))
            || self.draft.n_neg > 0;
        // "when it is me standing in the hallway": where, not which.
        let orders = orders && !(self.draft.join == Some(Join::If) && self.draft.has(Sense::Copula));
        let more = self.peek(1).is_some_and(|next| !next.is_any(&ORDERS) && !next.is(Sense::Copula));
        if !(single && participle && orders && more) {
            return;
        }
        let mut words: Vec<String> = Vec::new();
        while let Some(item) = self.peek(0) {
            let ends = matches!(item.sort, Sort::Quantity(_) | Sort::Mark)
                || item.is_any(&ORDERS)
                || item.is_any(&[
                    Sense::Copula,
                    Sense::And,
                    Sense::Or,
                    Sense::Except,
                    Sense::TimeWords,
                    Sense::OpenEnded,
                    Sense::ForWhom,
                ]);
            if ends {
                break;
            }
            if !item.is(Sense::Det) {
                words.push(item.text.clone());
            }
            self.at += 1;
        }
        let name = match self.before {
            Before::ExceptName => self.draft.except.last_mut(),
            Before::RegionName => self.draft.regions.last_mut().and_then(|region| region.names.last_mut()),
            _ => self.draft.names.last_mut(),
        };
        if let Some(name) = name {
            name.reference = format!("{} {}", name.reference, words.join(" "));
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
        // "an hour instead of ten minutes": the old number.
        if matches!(lead, "instead of" | "rather than") {
            return;
        }
        self.draft.quantities.push(quantity);
        if self.before != Before::Copula {
            self.before = Before::Other;
        }
    }

    /// A word after "is" with no meaning for us: told, not ordered.
    fn predicate_word(&mut self, item: &Item) -> bool {
        let told = item.is_any(&[Sense::Det, Sense::Statement, Sense::Motion, Sense::Task]);
        let means = item.is_any(&[
            Sense::VerbOn,
            Sense::OffLimits,
            Sense::Closed,
            Sense::Fragile,
            Sense::Sleeping,
            Sense::NeedsSpace,
            Sense::Fine,
            Sense::Pronoun,
        ]);
        let particle = matches!(
            item.text.as_str(),
            "out" | "off" | "away" | "back" | "up" | "down" | "over" | "outside"
        ) && self
            .peek(1)
            .is_none_or(|next| !next.is(Sense::Det) && !next.is_word() || next.sort == Sort::Mark);
        if item.is_word() || particle || told && !means {
            self.draft.predicate.push(item.text.clone());
            self.at += 1;
            return true;
        }
        false
    }

    /// Reads a name here, if one starts, and puts it where it belongs.
    fn name(&mut self) -> bool {
        let expects = matches!(self.before, Before::Place(_) | Before::Except)
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

    /// "between A and B" takes its second landmark at once.
    fn second_of_gap(&mut self, place: Place, first: Name) -> Vec<Name> {
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

    /// Reads a place word; attaches it to the name before it when it only describes that name.
    fn place(&mut self, item: &Item) -> bool {
        let follows_name = matches!(self.before, Before::LooseName | Before::RegionName | Before::ExceptName);
        if self.lets_off(item) {
            self.before = Before::Except;
            return true;
        }
        if follows_name && self.gap_between(item) {
            return true;
        }
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
        let Some(place) = place_of(item) else { return false };
        // "time to grow", "stay back to let them pass": a purpose, not a place.
        if place == Place::To
            && self.peek(0).is_some_and(|next| {
                next.is_word() && speech(&next.text) == Speech::Verb
                    || next.is_any(&[Sense::Fine, Sense::Statement, Sense::Sleeping])
            })
        {
            let verb = self.peek(0).map_or_else(String::new, |next| next.text.clone());
            self.draft.predicate.extend([item.text.clone(), verb]);
            self.at += 1;
            self.before = Before::Told;
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
        let number_next = self.peek(0).is_some_and(|next| matches!(next.sort, Sort::Quantity(_)));
        if place == Place::Near
            && name_ahead.is_none()
            && self.before == Before::LooseName
            && !number_next
            && item.text != "at"
        {
            // "people nearby", "a dog close by": nearness of the robot itself.
            if let Some(name) = self.draft.names.pop() {
                self.draft.regions.push(Region { place: Place::Near, names: vec![name] });
                self.before = Before::RegionName;
                return true;
            }
        }
        if self.before == Before::Copula
            && place == Place::Near
            && name_ahead.is_none()
            && !self.draft.names.is_empty()
        {
            let names = std::mem::take(&mut self.draft.names);
            self.draft.regions.push(Region { place: Place::Near, names });
            self.before = Before::RegionName;
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

    fn sense(&mut self, item: &Item) {
        let Sort::Phrase(senses) = item.sort else { return };
        let next_is_deed = self.peek(0).is_some_and(|next| {
            next.is_any(&[
                Sense::Motion,
                Sense::VerbOn,
                Sense::VerbNear,
                Sense::VerbTouch,
                Sense::VerbPast,
                Sense::VerbBlock,
                Sense::VerbWake,
                Sense::TurnFast,
                Sense::Turn,
                Sense::Fast,
                Sense::VerbLeave,
            ])
        });
        // "avoid going under", "stop bumping into": a negation.
        let gerund_next = next_is_deed
            && self.peek(0).is_some_and(|next| {
                next.text.split(' ').any(|word| word.ends_with("ing"))
                    || (item.is(Sense::Avoid) && next.is_any(&[Sense::TurnFast, Sense::Fast]))
            });
        if (item.is(Sense::Avoid) && item.text.starts_with("avoid")
            || item.text == "stop"
            || item.is(Sense::Away) && item.text == "away from")
            && gerund_next
        {
            self.draft.n_neg += 1;
            self.before = Before::Other;
            return;
        }
        // "it also splashes"
        if item.text == "also" && self.before == Before::LooseName {
            return;
        }
        // "the cat does not move": told of the cat.
        if self.before == Before::LooseName
            && matches!(item.text.as_str(), "does not" | "did not")
            && self.draft.senses.is_empty()
        {
            self.draft.senses.push(Sense::Statement);
            self.before = Before::Told;
            return;
        }
        // "you cannot swim": a deed that we do not know, told.
        if matches!(item.text.as_str(), "can not" | "could not")
            && self.draft.names.is_empty()
            && self.peek(0).is_some_and(Item::is_word)
            && self.peek(1).is_none()
        {
            self.draft.senses.push(Sense::Statement);
            self.before = Before::Told;
            return;
        }
        // "give me a metre": from me.
        let space_next = self.peek(0).is_some_and(|next| {
            matches!(&next.sort, Sort::Quantity(q) if q.kind == Kind::Distance)
                || next.is_any(&[Sense::Away, Sense::Wide])
        });
        if item.text == "give me" && space_next {
            self.draft.senses.push(Sense::Hold);
            let me = Name { obj: "me".into(), reference: "me".into(), n_words: 1, ..Name::default() };
            self.draft.names.push(me);
            self.before = Before::Other;
            return;
        }
        let chosen = choose(item, senses, &self.draft, self.peek(0));
        match chosen {
            // "never, never": said twice, meant once.
            Some(Sense::Neg) if self.follows_negation() => {}
            Some(Sense::Neg) => self.draft.n_neg += 1,
            Some(Sense::TimeWords) => self.draft.unobservable = Some(item.text.clone()),
            Some(Sense::Except | Sense::But) => {
                self.before = Before::Except;
                return;
            }
            Some(Sense::Copula) => {
                self.draft.senses.push(Sense::Copula);
                self.before = Before::Copula;
                return;
            }
            Some(Sense::Filler | Sense::Det) | None => {
                // Fillers leave the grammar as it was: "slow, um, down".
                if self.before == Before::Copula {
                    return;
                }
                if !matches!(self.before, Before::Place(_) | Before::Except) && !self.draft.names.is_empty() {
                    self.before = Before::Other;
                }
                return;
            }
            Some(Sense::Statement) if !self.draft.names.is_empty() || self.draft.has(Sense::Subject) => {
                self.draft.senses.push(Sense::Statement);
                self.before = Before::Told;
                return;
            }
            Some(Sense::Careful) if item.text.ends_with("made of") => {
                // "like it is made of glass": of what is no matter.
                self.draft.senses.push(Sense::Careful);
                self.at = self.items.len();
            }
            Some(Sense::AsWell) if self.before == Before::LooseName && item.text == "also" => return,
            Some(sense) => self.draft.senses.push(sense),
        }
        self.before = Before::Other;
    }

    /// Whether the item before the one just read was a negation too.
    fn follows_negation(&self) -> bool {
        let before = self.at.checked_sub(2).and_then(|idx| self.items.get(idx));
        before.is_some_and(|item| item.is(Sense::Neg)) && self.draft.n_neg > 0
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

/// What someone may be said to be.
const STATES: [Sense; 6] =
    [Sense::Fragile, Sense::Closed, Sense::Sleeping, Sense::NeedsSpace, Sense::Fine, Sense::Hold];

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

fn place_of(item: &Item) -> Option<Place> {
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
    if item.text == "about" {
        return None;
    }
    PLACES.iter().find(|(sense, _)| item.is(*sense)).map(|(_, place)| *place)
}

/// The side that a place word names, where the region is that side.
fn place_of_words(link: &str) -> Option<Place> {
    let tokens = crate::text::tokens(link, crate::lexicon::Lexicon::get());
    let (senses, _) = crate::lexicon::Lexicon::get().senses_at(&tokens, 0)?;
    [
        (Sense::PrepUnder, Place::Under),
        (Sense::PrepPast, Place::Past),
        (Sense::PrepFront, Place::Front),
        (Sense::PrepBehind, Place::Behind),
        (Sense::PrepLeft, Place::Left),
        (Sense::PrepRight, Place::Right),
    ]
    .iter()
    .find(|(sense, _)| senses.contains(sense))
    .map(|(_, place)| *place)
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
    let is_self = draft.names.last().is_some_and(|name| name.obj == "wheel");
    !is_self
}
