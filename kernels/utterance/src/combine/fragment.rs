//! Stretches without an order of their own: names, places, numbers and times that belong to a neighbour.

use super::{Joiner, Last, N_MENTIONS_MAX};
use crate::clause::{Clause, is_limit};
use crate::draft::{Draft, Place};
use crate::lexicon::Sense;
use crate::noun::{Name, Nouns};
use crate::quantity::Kind;
use crate::segment::Join;

impl Joiner {
    /// A stretch without an order, task or story.
    pub(super) fn fragment(&mut self, mut draft: Draft) {
        if self.gives_reason(&draft) {
            self.out.stories.push(draft);
            return;
        }
        if self.goes_on_with_task(&draft) {
            self.out.others.push(draft);
            return;
        }
        self.out.leftover.append(&mut draft.leftover);
        // "…, so please don't": what, is not said.
        if draft.n_neg > 0 && draft.senses.is_empty() && draft.all_names().next().is_none() {
            self.out.leftover.push(draft.words.clone());
        }
        if draft.is_crowded {
            self.out.leftover.push(draft.words.clone());
        }
        if let Some(when) = draft.unobservable.take() {
            self.note_down(when);
        }
        if draft.words.is_empty() {
            return;
        }
        let goes_on = matches!(draft.join, Some(Join::And | Join::Or | Join::Comma | Join::Bare | Join::But));
        if draft.ttl_s.is_some() && draft.names.is_empty() && draft.regions.is_empty() {
            match self.out.orders.last_mut().filter(|_| goes_on || self.last == Last::Order) {
                Some(clause) if clause.draft.ttl_s.is_none() => clause.draft.ttl_s = draft.ttl_s,
                Some(_) => self.out.leftover.push(draft.words.clone()),
                None => self.waiting_ttl_s = draft.ttl_s,
            }
            return;
        }
        if self.last == Last::Order
            && !draft.quantities.is_empty()
            && draft.names.is_empty()
            && draft.regions.is_empty()
        {
            let clause = Clause { draft, ..Clause::default() };
            if !self.joined_to_last(&clause) {
                self.order(clause.draft);
            }
            return;
        }
        if let Some(clause) = self.again_with(&draft).filter(|_| goes_on) {
            self.out.orders.push(clause);
            return;
        }
        if draft.has(Sense::AsWell) && !draft.names.is_empty() && self.last != Last::Order {
            return self.order(draft);
        }
        if !draft.quantities.is_empty()
            || draft.has_any(&[
                Sense::Last,
                Sense::AllRules,
                Sense::OneOf,
                Sense::RuleNoun,
                Sense::Everywhere,
                Sense::AsWell,
            ]) && draft.names.is_empty()
        {
            let empty =
                draft.quantities.is_empty() && draft.has(Sense::Everywhere) && self.last == Last::Order;
            if empty {
                return;
            }
            return self.order(draft);
        }
        self.names_or_places(draft, goes_on);
    }

    /// Whether it says why, after an order: "loads of wires there".
    fn gives_reason(&self, draft: &Draft) -> bool {
        // "don't go behind the tv, loads of wires": why.
        const MANY: [&str; 10] = [
            "loads ",
            "lots ",
            "plenty ",
            "tons ",
            "heaps ",
            "masses ",
            "too many ",
            "too much ",
            "so many ",
            "full ",
        ];
        self.last == Last::Order
            && matches!(draft.join, Some(Join::Comma | Join::Start))
            && draft.senses.is_empty()
            && draft.quantities.is_empty()
            && MANY.iter().any(|many| draft.words.starts_with(many))
    }

    /// Whether it is more of the task before it.
    fn goes_on_with_task(&self, draft: &Draft) -> bool {
        // "play hide and seek", "bring tea and biscuits": more of the task.
        self.last == Last::Other
            && (matches!(draft.join, Some(Join::And | Join::Or))
                || draft.join == Some(Join::Comma)
                    && !draft.words.starts_with("the ")
                    && self.out.others.last().is_some_and(|other| other.has(Sense::Task)))
            && draft.quantities.is_empty()
            && draft.leftover.is_empty()
            && draft.senses.is_empty()
    }

    /// The order before it with another name and number, if it is that.
    fn again_with(&self, draft: &Draft) -> Option<Clause> {
        // "give cyclists 1.5 m and pedestrians 1 m": the same order with another name and number.
        let one_number = draft.quantities.len() == 1 && draft.senses.is_empty() && draft.n_neg == 0;
        let kind = draft.quantities.first().map(|quantity| quantity.kind);
        let model = self.out.orders.last().filter(|clause| {
            clause.draft.quantity(Kind::Distance).is_some()
                && !is_limit(&clause.draft)
                && clause.draft.regions.len() <= 1
        })?;
        let fits = self.last == Last::Order
            && one_number
            && !draft.names.is_empty()
            && draft.regions.is_empty()
            && kind == Some(Kind::Distance);
        if !fits {
            return None;
        }
        let mut again = model.clone();
        match again.draft.regions.last_mut() {
            Some(region) if again.draft.names.is_empty() => region.names.clone_from(&draft.names),
            _ => again.draft.names.clone_from(&draft.names),
        }
        again.draft.quantities.clone_from(&draft.quantities);
        again.draft.ttl_s = draft.ttl_s.or(again.draft.ttl_s);
        Some(again)
    }

    fn names_or_places(&mut self, mut draft: Draft, goes_on: bool) {
        // What is named stands before where it is: "a crew on floor 2, keep back from them".
        let placed = draft.regions.iter().flat_map(|region| &region.names);
        self.mentioned.extend(placed.chain(draft.names.iter()).filter(|name| !name.is_pronoun).cloned());
        self.forget_old_mentions();
        self.is_side_mentioned = draft.regions.iter().any(|region| region.place == Place::Between);
        if draft.names.is_empty() && draft.regions.is_empty() && draft.except.is_empty() {
            return;
        }
        if goes_on && self.last == Last::Reason && !draft.names.is_empty() && draft.regions.is_empty() {
            // "stay off the tiles, they are wet, and the rug": more of the reason, or of the order?
            let of_order = draft.join == Some(Join::And)
                && self.out.stories.last().is_some_and(|story| {
                    story.join != Some(Join::Because) || story.names.iter().any(|name| name.is_pronoun)
                })
                && !self.out.orders.is_empty();
            if of_order {
                self.out.unclaimed.extend(draft.names);
            }
            return;
        }
        // "cleaning in progress in the restroom": the place is meant.
        if !draft.regions.is_empty() {
            draft.names.retain(|name| !Nouns::get().is_event(&name.obj));
        }
        // "no need to slow down in the hall, but do near the tanks": the other way round, and not said how.
        let turns = draft.join == Some(Join::But)
            && self.last == Last::Order
            && self
                .out
                .orders
                .last()
                .is_some_and(|clause| clause.draft.has_any(&[Sense::Lift, Sense::Allow, Sense::Fine]));
        if turns {
            self.out.leftover.push(draft.words.clone());
            return;
        }
        let ttl_s = draft.ttl_s;
        if let (true, Last::Order, Some(clause)) = (goes_on, self.last, self.out.orders.last_mut()) {
            let only_names = draft.regions.is_empty();
            // "the stools for 20 min and the stage for an hour": each its own time.
            if only_names && ttl_s.is_some() && clause.draft.ttl_s.is_some_and(|old| Some(old) != ttl_s) {
                let mut again = clause.clone();
                again.draft.regions.truncate(1);
                again.draft.names.clear();
                match again.draft.regions.last_mut() {
                    Some(region) if clause.draft.names.is_empty() => region.names = draft.names,
                    _ => again.draft.names = draft.names,
                }
                again.draft.ttl_s = ttl_s;
                self.out.orders.push(again);
                return;
            }
            if !draft.except.is_empty() {
                clause.draft.except.extend(draft.except);
            }
            if only_names && !clause.draft.except.is_empty() && !draft.names.is_empty() {
                clause.draft.except.extend(draft.names);
            } else if only_names {
                let shared = (clause.draft.regions.clone(), clause.draft.names.clone());
                extend_names(&mut clause.draft, draft.names.clone());
                // "be quiet and slow near the bed and the crib": both near both.
                let n_before = self.out.orders.len().saturating_sub(1);
                if let Some(twin) = self.out.orders.get_mut(..n_before).and_then(|orders| orders.last_mut())
                    && (&twin.draft.regions, &twin.draft.names) == (&shared.0, &shared.1)
                {
                    extend_names(&mut twin.draft, draft.names);
                }
            } else if clause.draft.regions.is_empty() && clause.draft.names.is_empty() {
                clause.draft.regions = draft.regions;
            } else {
                // "or over the cables": the same order at another place.
                let mut again = clause.clone();
                again.draft.regions = draft.regions;
                again.draft.names = draft.names;
                again.draft.quantities.retain(|q| q.kind != Kind::Distance || is_limit(&clause.draft));
                self.out.orders.push(again);
            }
            if let Some(clause) = self.out.orders.last_mut() {
                clause.draft.ttl_s = clause.draft.ttl_s.or(ttl_s);
            }
            return;
        }
        if let (true, Last::Condition, Some(condition)) = (goes_on, self.last, self.condition.as_mut()) {
            extend_names(condition, draft.names);
            return;
        }
        self.waiting_names.extend(draft.names);
        self.group.clone_from(&self.waiting_names);
        self.group.truncate(N_MENTIONS_MAX);
        self.waiting_regions.extend(draft.regions);
        self.waiting_except.extend(draft.except);
        self.waiting_ttl_s = self.waiting_ttl_s.or(ttl_s);
        self.last = Last::Names;
    }
}

fn extend_names(draft: &mut Draft, names: Vec<Name>) {
    match draft.regions.last_mut() {
        Some(region) if draft.names.is_empty() => region.names.extend(names),
        _ => draft.names.extend(names),
    }
}
