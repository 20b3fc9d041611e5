//! One order: what it takes from before, and what it lets off.

use super::story::{is_same_name, is_told};
use super::{Joiner, Last};
use crate::clause::{Clause, is_limit};
use crate::condition::apply;
use crate::draft::{Draft, Place, Region};
use crate::lexicon::Sense;
use crate::quantity::Kind;
use crate::segment::Join;

impl Joiner {
    /// Takes an order, with the names, places, times and conditions that waited for it.
    pub(super) fn order(&mut self, mut draft: Draft) {
        if self.lets_off(&mut draft) {
            return;
        }
        if self.is_why(&draft) {
            self.out.stories.push(draft);
            return;
        }
        self.take_back_reason(&draft);
        let antecedents = self.mentioned.clone();
        let places = self.mentioned_places.clone();
        let spots = self.mentioned_spots.clone();
        let follows_side = self.is_side_mentioned;
        self.mention(&draft);
        self.take_waiting(&mut draft);
        let mut clause = Clause {
            draft,
            antecedents,
            places,
            spots,
            group: self.group.clone(),
            notes: self.note.take().into_iter().collect(),
            follows_side,
            is_conditioned: false,
        };
        if let Some(condition) = self.condition.take() {
            clause.is_conditioned = clause.draft.regions.is_empty() && clause.draft.names.is_empty();
            self.mentioned.extend(condition.all_names().filter(|name| !name.is_pronoun).cloned());
            self.forget_old_mentions();
            apply(&mut clause, &condition);
        }
        self.about_the_story(&mut clause);
        self.share_place(&mut clause);
        if !self.joined_to_last(&clause) {
            self.out.orders.push(clause);
        }
        self.last = Last::Order;
    }

    /// Whether the draft only lets something off from the order before; a permission's "but not" forbids.
    fn lets_off(&mut self, draft: &mut Draft) -> bool {
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
            return true;
        }
        false
    }

    /// Whether it only says why the order before was given.
    fn is_why(&self, draft: &Draft) -> bool {
        // "keep a metre from the lamp, it falls over easily": why, not a second order.
        is_told(draft)
            && self.last == Last::Order
            && (draft.all_names().all(|name| name.is_pronoun)
                || self.out.orders.last().is_some_and(|clause| is_same_name(&clause.draft, draft)))
            && self
                .out
                .orders
                .last()
                .is_some_and(|clause| !is_told(&clause.draft) && clause.draft.all_names().next().is_some())
    }

    /// Names, places, a time and exceptions that were said before their order.
    fn take_waiting(&mut self, draft: &mut Draft) {
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
        } else if is_limit(draft) && draft.regions.is_empty() {
            draft.regions.append(&mut self.waiting_regions);
        }
        self.same_place(draft);
        if draft.join == Some(Join::So) && draft.has(Sense::Everywhere) {
            // "visitors on site, so half speed everywhere": why.
            self.waiting_names.clear();
            self.waiting_regions.clear();
        }
        draft.ttl_s = draft.ttl_s.or(self.waiting_ttl_s);
        draft.except.append(&mut self.waiting_except);
    }

    /// A limit without a place, after one that has a place: there too.
    fn share_place(&self, clause: &mut Clause) {
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
    }
}
