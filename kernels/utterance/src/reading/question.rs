//! When there is no rule: refusals, questions, and the answers offered to them.

use rules::{Outcome, RefuseReason, Reply, ReplyOption};

use super::{Context, Sum};
use crate::answer;
use crate::clause::{Clauses, has_strong_order};
use crate::draft::{Draft, Place};
use crate::lexicon::{Lexicon, Sense};
use crate::noun::{Name, Nouns};
use crate::quantity::Kind;
use crate::resolve::Trouble;
use crate::text::{Token, tokens};

impl Context<'_> {
    /// No rule and nothing lifted: a task, a story, or nothing we know.
    pub(super) fn nothing(&self, sum: &Sum, clauses: &Clauses) -> Reply {
        if let Some(doubtful) = clauses.others.iter().find(|draft| may_be_a_rule(draft)) {
            let question = format!("Is \"{}\" a rule? Please say what I should heed.", doubtful.words);
            return answer::clarify(&question, vec![]);
        }
        let orders = |draft: &Draft| {
            draft.has_any(&[
                Sense::Avoid,
                Sense::StayOff,
                Sense::Wide,
                Sense::Slow,
                Sense::Crawl,
                Sense::Careful,
                Sense::Quiet,
                Sense::OffLimits,
                Sense::Fragile,
            ]) && !matches!(draft.senses.first(), Some(Sense::Task | Sense::Question))
        };
        // Only what is plainly a task, talk, or a way to go is refused; anything else is asked about.
        let plain = |draft: &Draft| {
            let first = draft.senses.iter().find(|sense| **sense != Sense::SelfRef);
            matches!(first, Some(Sense::Task | Sense::Chat | Sense::Question))
                || draft.regions.iter().all(|region| matches!(region.place, Place::To | Place::On))
                    && draft
                        .senses
                        .iter()
                        .all(|sense| matches!(sense, Sense::Motion | Sense::VerbOn | Sense::SelfRef))
        };
        let sounds_like_one = clauses.others.iter().chain(&clauses.stories).any(orders)
            || clauses.others.first().is_some_and(|draft| !plain(draft));
        let half_heard = sounds_like_one
            || !clauses.leftover.is_empty()
                && clauses.orders.iter().any(|clause| has_strong_order(&clause.draft));
        if (!clauses.others.is_empty() || sum.not_safety) && !half_heard {
            return answer::refuse(
                RefuseReason::NotSafety,
                "I only take rules about where and how fast I may go.",
            );
        }
        let greeting = ["hello", "hi", "hey", "thanks", "thank you", "cheers"]
            .iter()
            .any(|word| self.words.to_lowercase().starts_with(word));
        if greeting && clauses.stories.is_empty() && clauses.unclaimed.is_empty() {
            return answer::refuse(
                RefuseReason::NotSafety,
                "I only take rules about where and how fast I may go.",
            );
        }
        let of_me = |story: &Draft| {
            story.words.starts_with("you are")
                && story.senses.iter().all(|sense| matches!(sense, Sense::Subject | Sense::SelfRef))
        };
        if !clauses.stories.is_empty() && clauses.stories.iter().all(of_me) && clauses.unclaimed.is_empty() {
            return answer::refuse(
                RefuseReason::NotSafety,
                "I only take rules about where and how fast I may go.",
            );
        }
        let told = clauses.stories.iter().flat_map(Draft::all_names).find(|name| !name.is_pronoun);
        match told {
            Some(name) => self.offer(name),
            None => answer::clarify("I did not understand that as a rule. What should I heed?", vec![]),
        }
    }

    /// A thing was named, but not what to heed about it.
    fn offer(&self, name: &Name) -> Reply {
        if Nouns::get().is_empty_name(&name.reference) || name.n_words > 4 {
            return answer::clarify("I did not understand that as a rule. What should I heed?", vec![]);
        }
        let options = [
            ("Keep away from it", "keep away from the"),
            ("Slow down near it", "slow down near the"),
            ("Be careful near it", "be careful near the"),
        ]
        .into_iter()
        .filter_map(|(label, order)| {
            let reply =
                self.read(&tokens(&format!("{order} {}", name.reference), Lexicon::get()), None, false);
            (reply.outcome == Outcome::Accept).then(|| ReplyOption { label: label.into(), reply })
        })
        .collect();
        answer::clarify(&format!("What should I heed about the {}?", name.reference), options)
    }

    pub(super) fn explain(&self, trouble: Trouble, tokens: &[Token], may_offer: bool) -> Reply {
        match trouble {
            Trouble::Ask(question) if question == "Which rule do you mean?" && may_offer => {
                answer::clarify(&question, self.lift_options())
            }
            Trouble::Ask(question) => answer::clarify(&question, vec![]),
            Trouble::Unit(number) => {
                let question = format!("{number} metres, feet or centimetres?");
                let units = if may_offer { vec!["m", "ft", "cm"] } else { vec![] };
                let options = units
                    .into_iter()
                    .filter_map(|unit| {
                        let reply = self.read(tokens, Some(unit), false);
                        (reply.outcome == Outcome::Accept)
                            .then(|| ReplyOption { label: format!("{number} {unit}"), reply })
                    })
                    .collect();
                answer::clarify(&question, options)
            }
            Trouble::WhatAbout(name) if may_offer => self.offer(&name),
            Trouble::WhatAbout(name) => {
                answer::clarify(&format!("What should I heed about the {}?", name.reference), vec![])
            }
            Trouble::Unsupported(what) => answer::refuse(
                RefuseReason::Unsupported,
                &format!("I cannot {what}; my rules are about places, distances and top speeds."),
            ),
            Trouble::Unsafe(what) => answer::refuse(RefuseReason::Unsafe, &format!("I won't {what}.")),
            Trouble::Loosens => answer::clarify("What should I change?", vec![]),
            Trouble::NotSafety => answer::refuse(
                RefuseReason::NotSafety,
                "I only take rules about where and how fast I may go.",
            ),
        }
    }

    fn lift_options(&self) -> Vec<ReplyOption> {
        self.active
            .iter()
            .rev()
            .take(4)
            .map(|rule| ReplyOption {
                label: rules::english::status(rule),
                reply: answer::revoke(&[rule], &[]),
            })
            .collect()
    }
}

/// Words of a rule inside what reads as a task: better asked than refused.
fn may_be_a_rule(draft: &Draft) -> bool {
    let measures = |kind| matches!(kind, Kind::Distance | Kind::Speed | Kind::TurnRate | Kind::Fraction);
    let opens_question = draft.senses.first() == Some(&Sense::Question);
    !opens_question
        && (draft.n_neg > 0
            || draft.has(Sense::RuleNoun)
            || draft.quantities.iter().any(|quantity| measures(quantity.kind)))
}
