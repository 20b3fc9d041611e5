//! What is told rather than ordered: stories, preambles, and the tails that say which one is meant.

use super::{Before, ORDERS, Scanner, place_of};
use crate::item::{Item, Sort};
use crate::lexicon::{GOING, Sense};
use crate::phrase::noun_phrase;
use crate::quantity::Kind;
use crate::segment::Join;
use crate::speech::{Speech, speech};

/// What someone may be said to be.
const STATES: [Sense; 6] =
    [Sense::Fragile, Sense::Closed, Sense::Sleeping, Sense::NeedsSpace, Sense::Fine, Sense::Hold];

/// Items of "the safety officer says you have to", before an order begins; none when there are none.
///
/// Only words of telling go: no negation, number, place or order stands among them.
pub(super) fn preamble(items: &[Item]) -> Option<usize> {
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

impl Scanner<'_> {
    /// The verb of a story, and the words behind it: "the vase belonged to …", "it also splashes".
    pub(super) fn told_word(&mut self) -> bool {
        let Some(item) = self.items.get(self.at) else { return false };
        if self.before == Before::Told {
            // "I am not comfortable", "they have gone off", "it breaks easily": told all the same.
            let of_people =
                ["i ", "we ", "he ", "she ", "they "].iter().any(|who| self.draft.words.starts_with(who));
            let plain = match item.text.as_str() {
                "not" | "no" | "off" | "out" | "away" | "back" | "up" | "down" | "easy" | "easily"
                | "slow" | "slowly" | "fast" | "over" | "room" | "space" | "twice" | "once" => true,
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
    pub(super) fn opens_story(&self, item: &Item) -> bool {
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
        let verb = self.is_verb(item);
        // "you clipped the lamp": told of the robot.
        let did = matches!(self.items.get(self.at.wrapping_sub(1)), Some(before) if before.text == "you")
            && self.at == 1
            && item.is_word()
            && (speech(&item.text) == Speech::Verb
                || speech(&item.text) == Speech::Participle && item.text.ends_with("ed"));
        if did {
            return true;
        }
        let after_subject = self.draft.senses.last() == Some(&Sense::Subject) && self.draft.names.is_empty();
        let last_is_pronoun = self.draft.names.last().is_some_and(|name| name.is_pronoun);
        let helps = matches!(
            item.text.as_str(),
            "will" | "would" | "might" | "could" | "can" | "has" | "had" | "have" | "does" | "did" | "may"
        );
        let done_by_it = self.is_done_by_name(item);
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

    /// Whether the word is a finite verb here.
    fn is_verb(&self, item: &Item) -> bool {
        let next_is_word = self.peek(1).is_some_and(Item::is_word);
        item.is_word()
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
            }
    }

    /// Whether what is done here is done by the thing before it, not by the robot.
    fn is_done_by_name(&self, item: &Item) -> bool {
        // "the vibrations stress the fish", "chairs get pulled out": done by the thing, not by the robot.
        self.join != Some(Join::If)
            && (item.is_any(&GOING) || item.is_any(&[Sense::VerbWake, Sense::VerbLeave, Sense::Task]))
            && !item.is(Sense::PrepNear)
            && !item.is(Sense::Copula)
            && !item.text.ends_with("ing")
            && self.draft.names.last().is_some_and(|name| !name.is_pronoun)
            && self.peek(1).is_some_and(|next| !next.is_any(&ORDERS))
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
    pub(super) fn tail(&mut self) {
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

    /// A word after "is" with no meaning for us: told, not ordered.
    pub(super) fn predicate_word(&mut self, item: &Item) -> bool {
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
            // "someone's left a ladder there": what was left is told of too.
            if item.is(Sense::Statement) {
                self.before = Before::Told;
            }
            return true;
        }
        false
    }
}
