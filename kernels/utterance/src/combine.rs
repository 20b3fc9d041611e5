//! Joins stretches into clauses: what was said in pieces and means one order.
//!
//! A clause is one order with its condition. Names and places without an order of their own go to
//! the neighbour they belong to; stories are remembered for what they mention and otherwise let be.

mod fragment;
mod join;
mod story;

use crate::clause::{Clause, Clauses, has_strong_order, is_limit, is_order, is_other, is_story};
use crate::condition::apply;
use crate::draft::{Draft, Place, Region};
use crate::lexicon::Sense;
use crate::noun::Name;
use crate::quantity::{Bound, Kind};
use crate::segment::Join;
use story::{does_something, is_cry, is_same_name, is_told};

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
