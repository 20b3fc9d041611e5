//! Joins stretches into clauses: what was said in pieces and means one order.
//!
//! A clause is one order with its condition. Names and places without an order of their own go to
//! the neighbour they belong to; stories are remembered for what they mention and otherwise let be.

mod fragment;
mod join;
mod order;
mod story;

use crate::clause::{Clause, Clauses, has_strong_order, is_order, is_other, is_story};
use crate::condition::apply;
use crate::draft::{Draft, Region};
use crate::lexicon::Sense;
use crate::noun::Name;
use crate::segment::Join;
use story::{does_something, verb_out_of_names};

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
    /// Whether the latest of them is a gap or a side: "the area behind the stove".
    is_side_mentioned: bool,
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
        // "avoid the rug, no, the sofa": one of the two.
        if draft.words == "no" && self.last == Last::Order {
            self.out.leftover.push(draft.words.clone());
            return;
        }
        self.same_unit(&mut draft);
        let corrects = self.corrects(&draft);
        if corrects {
            self.out.leftover.push(draft.words.clone());
        }
        if told && !draft.leftover.is_empty() {
            verb_out_of_names(&mut draft);
        }
        if is_order(&draft)
            && (!draft.has_any(&[Sense::Task, Sense::Chat, Sense::Question]) || has_strong_order(&draft))
        {
            self.order(draft);
        } else if told && !draft.has_any(&[Sense::Chat, Sense::Question, Sense::Task]) {
            self.tells(draft);
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
