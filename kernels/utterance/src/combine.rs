//! Joins stretches into clauses: what was said in pieces and means one order.
//!
//! A clause is one order with its condition. Names and places without an order of their own go to
//! the neighbour they belong to; stories are remembered for what they mention and otherwise let be.

mod fragment;

use crate::clause::{
    Clause, Clauses, EXCLUSIONS, TALK, has_strong_order, is_limit, is_order, is_other, is_story,
};
use crate::condition::apply;
use crate::draft::{Draft, Place, Region};
use crate::lexicon::Sense;
use crate::noun::{Name, Nouns};
use crate::quantity::{Bound, Kind};
use crate::segment::Join;
use crate::speech::{Speech, speech};

/// Most names that a pronoun may mean. Chosen: people point back one sentence, not ten.
const N_MENTIONS_MAX: usize = 8;

/// Joins the stretches of one utterance.
#[must_use]
pub fn combine(drafts: Vec<Draft>) -> Clauses {
    let mut joiner = Joiner::default();
    for draft in drafts {
        joiner.take(draft);
    }
    joiner.finish()
}

#[derive(Default)]
struct Joiner {
    out: Clauses,
    mentioned: Vec<Name>,
    mentioned_places: Vec<Name>,
    /// The same, and where things were said to be: what "there" means.
    mentioned_spots: Vec<Name>,
    /// A condition waiting for its order.
    condition: Option<Draft>,
    /// Places or names waiting for their order ("in the kitchen, …").
    waiting_regions: Vec<Region>,
    waiting_names: Vec<Name>,
    waiting_ttl_s: Option<u64>,
    waiting_except: Vec<Name>,
    note: Option<String>,
    /// Names told of together: "the lamp, the mirror and the vase are all glass".
    group: Vec<Name>,
    /// A time that a story told: "it needs 20 minutes to dry".
    told_ttl_s: Option<u64>,
    /// Whether the sentence opened as a question ("why are you | so slow").
    in_question: bool,
    last: Last,
}

/// What the stretch before was, for those that go on from it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Last {
    #[default]
    Nothing,
    Order,
    Reason,
    Other,
    Names,
    Condition,
}

impl Joiner {
    fn take(&mut self, draft: Draft) {
        let goes_on = !matches!(draft.join, Some(Join::Start | Join::Comma | Join::But) | None);
        self.in_question &= goes_on && draft.n_neg == 0;
        let opens_question = draft.senses.first() == Some(&Sense::Question) && draft.n_neg == 0;
        if opens_question || self.in_question {
            self.in_question = true;
            self.out.others.push(draft);
            self.last = Last::Other;
            return;
        }
        match draft.join {
            Some(Join::Because) => return self.reason(draft),
            Some(Join::Until) => return self.until(draft),
            Some(Join::If) if !draft.has_any(&[Sense::Revoke]) => return self.condition(draft),
            _ => {}
        }
        // A statement with nothing to heed in it, or a task: told, not ordered.
        let told = (is_story(&draft) || does_something(&draft)) && !is_order(&draft);
        let mut draft = draft;
        // "1 m/s in the aisle, .4 in the yard": the same unit.
        let after_speed = self.last == Last::Order
            && matches!(draft.join, Some(Join::Comma | Join::And | Join::But))
            && self.out.orders.last().is_some_and(|clause| {
                clause.draft.quantity(Kind::Speed).is_some()
                    && clause.draft.quantity(Kind::Distance).is_none()
            });
        if after_speed && !draft.has_any(&[Sense::Away, Sense::From, Sense::Turn]) {
            for quantity in draft.quantities.iter_mut().filter(|quantity| quantity.kind == Kind::Bare) {
                quantity.kind = Kind::Speed;
            }
        }
        // "5 km/h, no, 3 km/h": which of the two?
        let corrects = ["no ", "sorry ", "i mean ", "rather ", "actually "]
            .iter()
            .any(|word| draft.words.starts_with(word))
            && !draft.quantities.is_empty()
            && draft
                .senses
                .iter()
                .all(|sense| matches!(sense, Sense::Make | Sense::RuleNoun | Sense::SpeedNoun))
            && draft.quantities.iter().all(|quantity| quantity.bound == Bound::Plain)
            && self.last == Last::Order;
        if corrects {
            self.out.leftover.push(draft.words.clone());
        }
        if told && !draft.leftover.is_empty() {
            // "the bathroom door opens outwards": the verb went into the name.
            for name in draft.names.iter_mut().filter(|name| name.n_words > 1) {
                if let Some((rest, _)) = name.obj.rsplit_once(' ').filter(|_| name.reference.ends_with('s')) {
                    name.obj = rest.to_owned();
                    name.reference =
                        name.reference.rsplit_once(' ').map_or_else(String::new, |(rest, _)| rest.to_owned());
                }
            }
        }
        if is_order(&draft)
            && (!draft.has_any(&[Sense::Task, Sense::Chat, Sense::Question]) || has_strong_order(&draft))
        {
            self.order(draft);
        } else if told && !draft.has_any(&[Sense::Chat, Sense::Question, Sense::Task]) {
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
        } else if is_other(&draft) {
            self.mention(&draft);
            // A task may count its own; elsewhere a number must not vanish.
            if !draft.quantities.is_empty() && !draft.has(Sense::Task) {
                self.out.leftover.push(draft.words.clone());
            }
            self.out.others.push(draft);
            self.last = Last::Other;
        } else {
            self.fragment(draft);
        }
    }

    fn mention(&mut self, draft: &Draft) {
        let real = |name: &&Name| !name.is_pronoun;
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

    /// What was said long before is meant by no pronoun; and the work stays linear in the words.
    fn forget_old_mentions(&mut self) {
        for names in [&mut self.mentioned, &mut self.mentioned_places, &mut self.mentioned_spots] {
            names.drain(..names.len().saturating_sub(N_MENTIONS_MAX));
        }
    }

    fn reason(&mut self, draft: Draft) {
        if !draft.quantities.is_empty() {
            self.out.leftover.push(draft.words.clone());
        }
        self.mention(&draft);
        self.out.stories.push(draft);
        self.last = Last::Reason;
    }

    fn until(&mut self, draft: Draft) {
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
    fn lasts(&mut self, ttl_s: u64) {
        match self.out.orders.last_mut() {
            Some(clause) if clause.draft.ttl_s.is_none() => clause.draft.ttl_s = Some(ttl_s),
            Some(_) => self.out.leftover.push(format!("{ttl_s} seconds")),
            None => self.waiting_ttl_s = Some(ttl_s),
        }
    }

    fn note_down(&mut self, words: String) {
        match self.out.orders.last_mut() {
            Some(clause) => clause.notes.push(words),
            None => self.note = Some(words),
        }
    }

    fn condition(&mut self, draft: Draft) {
        let has_target = self.out.orders.last().is_some();
        if draft.has_any(&EXCLUSIONS[..4])
            || is_limit(&draft) && !draft.has(Sense::Sleeping) && !draft.has(Sense::Fast)
        {
            // "when turning slow down" was cut badly, or an order hides in it: keep it as an order.
            return self.order(draft);
        }
        // "they fall over if you breathe on them": part of why.
        if has_target && !draft.is_fresh && self.last == Last::Reason && draft.ttl_s.is_none() {
            self.out.stories.push(draft);
            return;
        }
        if has_target && !draft.is_fresh && self.last == Last::Order {
            self.apply_condition(&draft);
        } else {
            self.condition = Some(draft);
        }
        self.last = Last::Condition;
    }

    /// A condition goes to the latest order: as its place when it names one, else as a note.
    fn apply_condition(&mut self, condition: &Draft) {
        self.mention(condition);
        let Some(clause) = self.out.orders.last_mut() else { return };
        apply(clause, condition);
    }

    fn order(&mut self, mut draft: Draft) {
        // "every rug but not the blue one"
        let lets_off = matches!(draft.join, Some(Join::But))
            && draft.n_neg == 1
            && draft.senses.is_empty()
            && draft.regions.is_empty()
            && draft.quantities.is_empty();
        let last_allows =
            self.out.orders.last().is_some_and(|clause| clause.draft.has_any(&[Sense::Allow, Sense::Fine]));
        if lets_off && last_allows && !draft.names.is_empty() {
            // "you may enter the office but not the server room"
            // "but not the glass one": of the tables.
            let kind = self.out.orders.last().and_then(|clause| clause.draft.all_names().last().cloned());
            for name in draft
                .names
                .iter_mut()
                .filter(|name| name.reference.ends_with(" one") || name.reference.ends_with(" ones"))
            {
                if let Some(kind) = &kind {
                    name.obj.clone_from(&kind.obj);
                    name.reference = format!(
                        "{} {}",
                        name.reference.rsplit_once(' ').map_or("", |(look, _)| look),
                        kind.obj
                    );
                }
            }
            let place = self
                .out
                .orders
                .last()
                .and_then(|clause| clause.draft.regions.first())
                .map_or(Place::On, |r| r.place);
            draft.regions.push(Region { place, names: std::mem::take(&mut draft.names) });
            draft.senses.push(Sense::Motion);
        } else if let (true, Some(clause)) = (lets_off && !draft.names.is_empty(), self.out.orders.last_mut())
        {
            clause.draft.except.append(&mut draft.names);
            return;
        }
        // "keep a metre from the lamp, it falls over easily": why, not a second order.
        let why =
            is_told(&draft)
                && self.last == Last::Order
                && (draft.all_names().all(|name| name.is_pronoun)
                    || self.out.orders.last().is_some_and(|clause| is_same_name(&clause.draft, &draft)))
                && self.out.orders.last().is_some_and(|clause| {
                    !is_told(&clause.draft) && clause.draft.all_names().next().is_some()
                });
        if why {
            self.out.stories.push(draft);
            return;
        }
        self.take_back_reason(&draft);
        let antecedents = self.mentioned.clone();
        let places = self.mentioned_places.clone();
        let spots = self.mentioned_spots.clone();
        self.mention(&draft);
        if draft.regions.is_empty() && draft.names.is_empty() && !draft.has(Sense::Everywhere) {
            draft.regions.append(&mut self.waiting_regions);
            if draft.regions.is_empty() {
                draft.names.append(&mut self.waiting_names);
            }
        } else if (draft.has(Sense::Copula) || draft.has(Sense::Hold) && !draft.quantities.is_empty())
            && matches!(draft.join, Some(Join::And | Join::Or))
            && self.last == Last::Names
        {
            // "the kitchen and the bathroom are off limits": one subject.
            let mut names = std::mem::take(&mut self.waiting_names);
            names.append(&mut draft.names);
            draft.names = names;
        } else if draft.all_names().any(|name| name.is_pronoun) {
            self.waiting_names.clear();
            self.waiting_regions.clear();
        } else if is_limit(&draft) && draft.regions.is_empty() {
            draft.regions.append(&mut self.waiting_regions);
        }
        self.same_place(&mut draft);
        if draft.join == Some(Join::So) && draft.has(Sense::Everywhere) {
            // "visitors on site, so half speed everywhere": why.
            self.waiting_names.clear();
            self.waiting_regions.clear();
        }
        draft.ttl_s = draft.ttl_s.or(self.waiting_ttl_s);
        draft.except.append(&mut self.waiting_except);
        let mut clause = Clause {
            draft,
            antecedents,
            places,
            spots,
            group: self.group.clone(),
            notes: self.note.take().into_iter().collect(),
            is_conditioned: false,
        };
        if let Some(condition) = self.condition.take() {
            clause.is_conditioned = clause.draft.regions.is_empty() && clause.draft.names.is_empty();
            self.mentioned.extend(condition.all_names().filter(|name| !name.is_pronoun).cloned());
            self.forget_old_mentions();
            apply(&mut clause, &condition);
        }
        self.about_the_story(&mut clause);
        // "if you pass the desk, go slow and be quiet": both there.
        let bare = clause.draft.regions.is_empty()
            && clause.draft.names.is_empty()
            && !clause.draft.has(Sense::Everywhere);
        // "slow down near the racks and turn gently": both near the racks.
        let turns = |draft: &Draft| {
            draft.has_any(&[Sense::TurnSlow, Sense::Turn, Sense::TurnFast])
                || draft.quantity(Kind::TurnRate).is_some()
        };
        let other_limit = self.out.orders.last().filter(|last| {
            self.last == Last::Order
                && bare
                && matches!(clause.draft.join, Some(Join::And | Join::Comma | Join::But))
                && is_limit(&last.draft)
                && is_limit(&clause.draft)
                && turns(&last.draft) != turns(&clause.draft)
        });
        if let Some(last) = other_limit {
            clause.draft.regions.clone_from(&last.draft.regions);
            clause.draft.names.clone_from(&last.draft.names);
            let near = last.draft.quantities.iter().filter(|quantity| quantity.kind == Kind::Distance);
            clause.draft.quantities.extend(near.cloned());
        }
        if let (true, Some(last)) = (
            bare && clause.draft.join == Some(Join::And) && is_limit(&clause.draft),
            self.out.orders.last().filter(|last| last.is_conditioned && is_limit(&last.draft)),
        ) {
            clause.draft.regions.clone_from(&last.draft.regions);
        }
        if !self.joined_to_last(&clause) {
            self.out.orders.push(clause);
        }
        self.last = Last::Order;
    }

    /// "you may pass through the hall, but slowly": slowly in the hall.
    fn same_place(&self, draft: &mut Draft) {
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
    fn about_the_story(&self, clause: &mut Clause) {
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
    fn take_back_reason(&mut self, draft: &Draft) {
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

    /// "slow down near the bed, no more than 0.2 m/s": numbers that complete the order before.
    fn joined_to_last(&mut self, clause: &Clause) -> bool {
        let new = &clause.draft;
        let same_sentence =
            matches!(new.join, Some(Join::Comma | Join::And | Join::Bare | Join::So | Join::Start));
        let Some(last) = self.out.orders.last_mut().filter(|_| same_sentence && self.last == Last::Order)
        else {
            return false;
        };
        let old = &mut last.draft;
        let bare_new = new.regions.is_empty()
            && new.names.is_empty()
            && new.ttl_s.is_none()
            && !new.has(Sense::Everywhere)
            && !new.has_any(&TALK);
        let numbers_only = bare_new
            && new.senses.iter().all(|sense| {
                matches!(
                    sense,
                    Sense::SpeedNoun
                        | Sense::Motion
                        | Sense::Away
                        | Sense::Hold
                        | Sense::From
                        | Sense::Turn
                        | Sense::Dampen
                        | Sense::OpenEnded
                )
            })
            && !new.quantities.is_empty();
        let n_distances = new.quantities.iter().filter(|q| q.kind == Kind::Distance).count();
        // "slower still, say 0.2"
        let bare_speed =
            new.quantities.iter().all(|q| q.kind == Kind::Bare) && new.senses.is_empty() && is_limit(old);
        let limits_both = is_limit(old) && (is_limit(new) || bare_speed) && n_distances == 0;
        let distance_for = n_distances == 1
            && new.quantities.len() == 1
            && old.quantity(Kind::Distance).is_none()
            && !is_limit(new);
        let same_slot = old.quantities.iter().any(|q| new.quantities.iter().any(|n| n.kind == q.kind));
        if numbers_only && !same_slot && (limits_both || distance_for) && new.n_neg + old.n_neg.min(1) <= 2 {
            let negated_number = new.is_negated();
            for quantity in &new.quantities {
                let mut quantity = quantity.clone();
                if negated_number && quantity.bound == Bound::Over {
                    quantity.bound = Bound::Upper;
                }
                old.quantities.push(quantity);
            }
            old.words = format!("{} {}", old.words, new.words);
            return true;
        }
        // "drive slowly and turn slowly near the piano": both near the piano.
        let turn = |draft: &Draft| {
            draft.has_any(&[Sense::TurnSlow, Sense::Turn, Sense::TurnFast])
                || draft.quantity(Kind::TurnRate).is_some()
        };
        let bare_old = old.regions.is_empty() && old.names.is_empty() && !old.has(Sense::Everywhere);
        // "slowly and quietly past room 4": one manner.
        const MANNERS: [&str; 12] = [
            "quiet",
            "quietly",
            "gentle",
            "gently",
            "careful",
            "carefully",
            "slow",
            "slowly",
            "steady",
            "calm",
            "calmly",
            "cautiously",
        ];
        let one_manner = bare_old
            && matches!(new.join, Some(Join::And))
            && old.quantities.is_empty()
            && is_limit(old)
            && is_limit(new)
            && new.words.split(' ').next().is_some_and(|word| MANNERS.contains(&word));
        if one_manner {
            old.regions.clone_from(&new.regions);
            old.names.clone_from(&new.names);
            old.ttl_s = old.ttl_s.or(new.ttl_s);
        }
        if bare_old
            && matches!(new.join, Some(Join::And))
            && is_limit(old)
            && is_limit(new)
            && turn(old) != turn(new)
        {
            old.regions.clone_from(&new.regions);
            old.names.clone_from(&new.names);
            old.ttl_s = old.ttl_s.or(new.ttl_s);
        }
        false
    }

    fn finish(mut self) -> Clauses {
        if let Some(ttl_s) = self.told_ttl_s {
            self.out.leftover.push(format!("{ttl_s} seconds"));
        }
        if let Some(condition) = self.condition.take() {
            match self.out.orders.last_mut() {
                Some(clause) => apply(clause, &condition),
                None => self.out.stories.push(condition),
            }
        }
        if let (Some(ttl_s), true) = (
            self.waiting_ttl_s,
            self.out.orders.is_empty() && self.waiting_names.is_empty() && self.waiting_regions.is_empty(),
        ) {
            self.out.orders.push(Clause {
                draft: Draft { ttl_s: Some(ttl_s), ..Draft::default() },
                ..Clause::default()
            });
        }
        // Places said after an order that had none: "go slow. near the sofa".
        let regions = std::mem::take(&mut self.waiting_regions);
        let names = std::mem::take(&mut self.waiting_names);
        match self.out.orders.last_mut() {
            Some(clause)
                if clause.draft.regions.is_empty()
                    && clause.draft.names.is_empty()
                    && !clause.draft.has(Sense::Everywhere) =>
            {
                clause.draft.regions = regions;
                clause.draft.names = names;
            }
            _ => {
                self.out.unclaimed.extend(names);
                self.out.unclaimed.extend(regions.into_iter().flat_map(|region| region.names));
            }
        }
        self.out
    }
}

/// Whether it only says how something is, which is an order when nothing else is said of it.
fn is_told(draft: &Draft) -> bool {
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
            )
        })
}

/// Whether both name the same thing.
fn is_same_name(old: &Draft, new: &Draft) -> bool {
    let nouns = Nouns::get();
    old.all_names().any(|a| !a.is_pronoun && new.all_names().any(|b| nouns.same(&a.obj, &b.obj)))
}

/// "people queue there", "the door opens outwards": a verb that could be a noun gave itself away.
fn does_something(draft: &Draft) -> bool {
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
fn is_cry(draft: &Draft) -> bool {
    draft.n_neg == 0
        && draft.regions.is_empty()
        && draft.names.is_empty()
        && draft.quantities.is_empty()
        && !draft.senses.is_empty()
        && draft.senses.iter().all(|sense| matches!(sense, Sense::Quiet | Sense::Careful | Sense::Attention))
}
