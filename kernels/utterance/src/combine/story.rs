//! What was told beside an order: reasons, conditions, and what a pronoun may later mean.

use super::{Joiner, Last, N_MENTIONS_MAX};
use crate::clause::{Clause, EXCLUSIONS, is_limit, is_order, is_story};
use crate::condition::apply;
use crate::draft::{Draft, Place, Region};
use crate::lexicon::Sense;
use crate::noun::{Name, Nouns};
use crate::quantity::{Bound, Kind};
use crate::segment::Join;
use crate::speech::{Speech, speech};

impl Joiner {
    pub(super) fn mention(&mut self, draft: &Draft) {
        let real = |name: &&Name| !name.is_pronoun;
        let is_sided = |region: &Region| {
            !matches!(region.place, Place::Near | Place::On | Place::To)
                && region.names.iter().any(|name| !name.is_pronoun)
        };
        self.is_side_mentioned =
            draft.regions.iter().any(is_sided) && !draft.names.iter().any(|name| !name.is_pronoun);
        let governed: Vec<Name> =
            draft.regions.iter().flat_map(|region| &region.names).filter(real).cloned().collect();
        self.mentioned_places.extend(governed.iter().cloned());
        self.mentioned_spots.extend(governed.iter().chain(&draft.whereabouts).cloned());
        // "the dog, he sleeps on his bed": what he is about stays the likelier.
        let goes_on = is_story(draft)
            && (draft.has(Sense::Subject) || draft.names.iter().any(|name| name.is_pronoun))
            && !draft.names.iter().any(|name| !name.is_pronoun);
        if goes_on {
            self.mentioned.splice(0..0, governed);
        } else {
            self.mentioned.extend(governed);
        }
        // What a story is about stands first in it: "water ruins the circuits, avoid it".
        let mut loose: Vec<Name> = draft.names.iter().filter(real).cloned().collect();
        if is_story(draft) || !is_order(draft) {
            loose.reverse();
        }
        // "someone left a ladder there, mind it" is about the ladder; "the vase belonged to gran" about the vase.
        let by_someone = loose.iter().all(|name| Nouns::get().is_someone(&name.obj));
        if by_someone {
            self.mentioned.extend(loose);
            self.mentioned.extend(draft.told.iter().cloned());
        } else {
            let at = self.mentioned.len();
            self.mentioned.splice(at..at, draft.told.iter().cloned());
            self.mentioned.extend(loose);
        }
        self.forget_old_mentions();
    }

    /// A story: what it is about may be meant later, and its numbers must not vanish.
    pub(super) fn tells(&mut self, draft: Draft) {
        self.mention(&draft);
        if !draft.quantities.is_empty() {
            self.out.leftover.push(draft.words.clone());
        }
        // "careful! there is lego on the rug": about the lego.
        if draft.has(Sense::ThereIs)
            && self.last == Last::Order
            && let Some(clause) = self.out.orders.last_mut().filter(|clause| is_cry(&clause.draft))
        {
            clause.draft.names.extend(draft.names.iter().filter(|name| !name.is_pronoun).cloned());
        }
        self.told_ttl_s = draft.ttl_s.or(self.told_ttl_s);
        let subjects: Vec<Name> = draft.names.iter().filter(|name| !name.is_pronoun).cloned().collect();
        if matches!(draft.join, Some(Join::And | Join::Comma)) && !subjects.is_empty() {
            if self.last == Last::Names {
                self.group.append(&mut self.waiting_names);
            }
            self.group.extend(subjects);
            self.group.truncate(N_MENTIONS_MAX);
        } else {
            self.group = subjects;
        }
        self.out.stories.push(draft);
        self.last = Last::Reason;
    }

    /// Bare numbers after a speed take its unit.
    pub(super) fn same_unit(&self, draft: &mut Draft) {
        // "1 m/s in the aisle, .4 in the yard": the same unit.
        let after_speed = self.last == Last::Order
            && matches!(draft.join, Some(Join::Comma | Join::And | Join::But))
            && self.out.orders.last().is_some_and(|clause| {
                clause.draft.quantity(Kind::Speed).is_some_and(|speed| {
                    ["m/s", "metre", "meter"].iter().any(|unit| speed.said.contains(unit))
                }) && clause.draft.quantity(Kind::Distance).is_none()
            });
        if after_speed && !draft.has_any(&[Sense::Away, Sense::From, Sense::Turn]) {
            for quantity in draft.quantities.iter_mut().filter(|quantity| quantity.kind == Kind::Bare) {
                quantity.kind = Kind::Speed;
            }
        }
    }

    /// Whether it puts right a number that was just said.
    pub(super) fn corrects(&self, draft: &Draft) -> bool {
        // "5 km/h, no, 3 km/h": which of the two?
        ["no ", "sorry ", "i mean ", "rather ", "actually "].iter().any(|word| draft.words.starts_with(word))
            && !draft.quantities.is_empty()
            && draft
                .senses
                .iter()
                .all(|sense| matches!(sense, Sense::Make | Sense::RuleNoun | Sense::SpeedNoun))
            && draft.quantities.iter().all(|quantity| quantity.bound == Bound::Plain)
            && self.last == Last::Order
    }

    /// What was said long before is meant by no pronoun; and the work stays linear in the words.
    pub(super) fn forget_old_mentions(&mut self) {
        for names in [&mut self.mentioned, &mut self.mentioned_places, &mut self.mentioned_spots] {
            names.drain(..names.len().saturating_sub(N_MENTIONS_MAX));
        }
    }

    pub(super) fn reason(&mut self, draft: Draft) {
        if !draft.quantities.is_empty() {
            self.out.leftover.push(draft.words.clone());
        }
        self.mention(&draft);
        self.out.stories.push(draft);
        self.last = Last::Reason;
    }

    pub(super) fn until(&mut self, draft: Draft) {
        let words = draft.words.clone();
        if let Some(ttl_s) = draft.ttl_s.filter(|_| words.ends_with("from now") || words.ends_with("later")) {
            return self.lasts(ttl_s);
        }
        // "the floor needs 20 minutes to dry, keep off it till then"
        if words == "then"
            && let Some(ttl_s) = self.told_ttl_s.take()
        {
            return self.lasts(ttl_s);
        }
        if !draft.quantities.is_empty() || draft.ttl_s.is_some() {
            self.out.leftover.push(words.clone());
        }
        self.note_down(format!("until {words}"));
        self.last = Last::Reason;
    }

    /// A lifetime for the latest order, or for the next one.
    pub(super) fn lasts(&mut self, ttl_s: u64) {
        match self.out.orders.last_mut() {
            Some(clause) if clause.draft.ttl_s.is_none() => clause.draft.ttl_s = Some(ttl_s),
            Some(_) => self.out.leftover.push(format!("{ttl_s} seconds")),
            None => self.waiting_ttl_s = Some(ttl_s),
        }
    }

    pub(super) fn note_down(&mut self, words: String) {
        match self.out.orders.last_mut() {
            Some(clause) => clause.notes.push(words),
            None => self.note = Some(words),
        }
    }

    pub(super) fn condition(&mut self, draft: Draft) {
        let has_target = self.out.orders.last().is_some();
        let keeps_off =
            draft.has_any(&[Sense::Hold, Sense::From]) && draft.quantity(Kind::Distance).is_some();
        if keeps_off && draft.has_any(&[Sense::Hold, Sense::Away]) && draft.lead.contains("as long as")
            || draft.has_any(&EXCLUSIONS[..4])
            || is_limit(&draft) && !draft.has(Sense::Sleeping) && !draft.has(Sense::Fast)
        {
            // "when turning slow down" was cut badly, or an order hides in it: keep it as an order.
            return self.order(draft);
        }
        // "it tips if it is nudged": what may happen to the thing, and nothing of the robot.
        let of_thing =
            draft.names.first().is_some_and(|name| matches!(name.reference.as_str(), "it" | "they"))
                && draft.has(Sense::Copula)
                && draft.regions.is_empty();
        if of_thing && !draft.is_fresh && self.last == Last::Reason && draft.ttl_s.is_none() {
            self.out.stories.push(draft);
            return;
        }
        // "they fall over if you breathe on them": part of why.
        if has_target && !draft.is_fresh && self.last == Last::Reason && draft.ttl_s.is_none() {
            self.out.stories.push(draft);
            return;
        }
        // "gravel sprays about. when near the beds, …": what waited is not what the order is about.
        if self.last == Last::Names && draft.regions.iter().any(|region| !region.names.is_empty()) {
            self.out.unclaimed.append(&mut self.waiting_names);
        }
        if has_target && !draft.is_fresh && self.last == Last::Order {
            self.apply_condition(&draft);
        } else {
            self.condition = Some(draft);
        }
        self.last = Last::Condition;
    }

    /// A condition goes to the latest order: as its place when it names one, else as a note.
    pub(super) fn apply_condition(&mut self, condition: &Draft) {
        self.mention(condition);
        let Some(clause) = self.out.orders.last_mut() else { return };
        apply(clause, condition);
    }

    /// "you may pass through the hall, but slowly": slowly in the hall.
    pub(super) fn same_place(&self, draft: &mut Draft) {
        let bare = draft.regions.is_empty() && draft.names.is_empty() && !draft.has(Sense::Everywhere);
        if draft.join != Some(Join::But) || !bare || !is_limit(draft) {
            return;
        }
        let before = match self.last {
            Last::Order => self
                .out
                .orders
                .last()
                .map(|clause| &clause.draft)
                .filter(|old| old.has_any(&[Sense::Allow, Sense::Fine, Sense::Lift])),
            Last::Other => self.out.others.last(),
            _ => None,
        };
        let Some(before) = before else { return };
        let held = before.regions.iter().find(|region| !matches!(region.place, Place::To | Place::ThisSide));
        if let Some(region) = held {
            draft.regions.push(region.clone());
        } else if before.has_any(&[Sense::VerbOn, Sense::VerbPast, Sense::VerbNear])
            && !before.names.is_empty()
        {
            let place = if before.has(Sense::VerbOn) { Place::On } else { Place::Near };
            draft.regions.push(Region { place, names: before.names.clone() });
        }
    }

    /// "a dog is in the yard, be careful": careful about the dog.
    pub(super) fn about_the_story(&self, clause: &mut Clause) {
        let draft = &clause.draft;
        let bare = draft.regions.is_empty()
            && draft.names.is_empty()
            && !draft.has_any(&[Sense::Everywhere, Sense::PrepNear])
            && (draft.n_neg == 0 || draft.has(Sense::VerbWake));
        let Some(story) = self.out.stories.last().filter(|_| bare && self.last == Last::Reason) else {
            return;
        };
        let Some(name) = clause.antecedents.last() else { return };
        let nouns = Nouns::get();
        // "the battery is low, go slow" is about no battery; "the floor is wet, go slow" is about the floor.
        let limit_of_it = draft.has_any(&[Sense::Slow, Sense::Crawl, Sense::Halt])
            && draft.quantities.is_empty()
            && (story.has(Sense::ThereIs) || nouns.is_place(&name.obj) || nouns.is_living(&name.obj));
        if draft.has_any(&[Sense::Careful, Sense::Quiet, Sense::VerbWake]) || limit_of_it {
            clause.draft.names.push(name.clone());
        }
    }

    /// "the lamp wobbles, so keep back": the statement is why, not a second order.
    pub(super) fn take_back_reason(&mut self, draft: &Draft) {
        let points_back =
            draft.all_names().all(|name| name.is_pronoun) && !draft.has_any(&[Sense::Everywhere]);
        let told = is_told;
        // "shh, the baby is asleep": a cry, and then what it is about.
        if told(draft)
            && draft.has_any(&[Sense::Sleeping, Sense::Fragile])
            && self.out.orders.last().is_some_and(|clause| is_cry(&clause.draft))
        {
            self.out.orders.pop();
            return;
        }
        let gives_why = |old: &Draft| {
            points_back || draft.join == Some(Join::So) || old.has(Sense::Sleeping) && draft.has(Sense::Quiet)
        };
        let about_it = |old: &Draft| is_same_name(old, draft) && (draft.n_neg > 0 || !told(draft));
        if self.out.orders.last().is_some_and(|clause| {
            told(&clause.draft) && (gives_why(&clause.draft) || about_it(&clause.draft))
        }) && let Some(clause) = self.out.orders.pop()
        {
            self.last = Last::Reason;
            self.out.stories.push(clause.draft);
        }
    }
}

/// Whether it only says how something is, which is an order when nothing else is said of it.
pub(super) fn is_told(draft: &Draft) -> bool {
    draft.n_neg == 0
        && draft.quantities.is_empty()
        && draft.has_any(&[
            Sense::Copula,
            Sense::Fragile,
            Sense::Closed,
            Sense::Sleeping,
            Sense::NeedsSpace,
            Sense::ThereIs,
        ])
        && draft.senses.iter().all(|sense| {
            matches!(
                sense,
                Sense::Copula
                    | Sense::Fragile
                    | Sense::Closed
                    | Sense::Sleeping
                    | Sense::NeedsSpace
                    | Sense::ThereIs
                    | Sense::Statement
                    | Sense::Subject
                    | Sense::SelfRef
            )
        })
}

/// Whether both name the same thing.
pub(super) fn is_same_name(old: &Draft, new: &Draft) -> bool {
    let nouns = Nouns::get();
    old.all_names().any(|a| !a.is_pronoun && new.all_names().any(|b| nouns.same(&a.obj, &b.obj)))
}

/// "people queue there", "the door opens outwards": a verb that could be a noun gave itself away.
pub(super) fn does_something(draft: &Draft) -> bool {
    let names = draft.names.iter().position(|name| name.is_pronoun).is_some_and(|at| at > 0)
        && matches!(draft.join, Some(Join::Start | Join::Comma | Join::Because | Join::But) | None);
    let manner = !draft.leftover.is_empty()
        && draft
            .leftover
            .iter()
            .all(|word| matches!(speech(word), Speech::Adverb | Speech::Verb | Speech::Participle));
    draft.n_neg == 0
        && draft.senses.iter().all(|sense| matches!(sense, Sense::Statement | Sense::Subject | Sense::Copula))
        && draft.quantities.is_empty()
        && draft.ttl_s.is_none()
        && !draft.names.is_empty()
        && (names || manner)
}

/// "shh!", "careful!": a manner, and nothing said of where.
pub(super) fn is_cry(draft: &Draft) -> bool {
    draft.n_neg == 0
        && draft.regions.is_empty()
        && draft.names.is_empty()
        && draft.quantities.is_empty()
        && !draft.senses.is_empty()
        && draft.senses.iter().all(|sense| matches!(sense, Sense::Quiet | Sense::Careful | Sense::Attention))
}

/// A verb that could be a noun, out of the names that it was read into.
pub(super) fn verb_out_of_names(draft: &mut Draft) {
    // "the bathroom door opens outwards": the verb went into the name.
    for name in draft.names.iter_mut().filter(|name| name.n_words > 1) {
        if let Some((rest, _)) = name.obj.rsplit_once(' ').filter(|_| name.reference.ends_with('s')) {
            name.obj = rest.to_owned();
            name.reference =
                name.reference.rsplit_once(' ').map_or_else(String::new, |(rest, _)| rest.to_owned());
        }
    }
}
