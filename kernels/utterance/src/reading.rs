//! From words to a reply: the readings tried, and how their parts make one answer.

mod question;
mod settle;

use geometry::Profile;
use rules::{Outcome, RefuseReason, Reply, Rule, RuleType};

use crate::clause::{Clause, Clauses};
use crate::combine::combine;
use crate::dialogue::{Change, talk};
use crate::draft::{Draft, Place};
use crate::item::{Item, items};
use crate::lexicon::{Lexicon, Sense};
use crate::noun::{Name, Nouns};
use crate::quantity::BareUnit;
use crate::resolve::{Trouble, resolve};
use crate::scan::scan;
use crate::segment::segments;
use crate::text::{CHARS_MAX, Token, tokens};
use crate::{answer, background, doubt, gate, spelling};
use settle::{repeats, settle};

/// The reply to an utterance, given the rules in force.
///
/// Pure and total: any text gives a reply, in time linear in its length; more than [`CHARS_MAX`]
/// characters are refused. New rules come without `id` and `anchor`; `revoked` holds ids of
/// `active`, whose last element is the newest.
#[must_use]
pub fn parse(active: &[Rule], profile: &Profile, words: &str) -> Reply {
    if words.chars().count() > CHARS_MAX {
        let say =
            format!("That is longer than {CHARS_MAX} characters. Please tell me one or two rules at a time.");
        return answer::refuse(RefuseReason::Unsupported, &say);
    }
    if gate::is_unsafe(words).is_some() {
        return answer::refuse(RefuseReason::Unsafe, "I won't do that: it would loosen my base safety.");
    }
    let plain = tokens(words, Lexicon::get());
    let context = Context { active, profile, words };
    let reply = context.read(&plain, None, true);
    // A slip in an order can look like talk: "go to the hall and avod the rug".
    let may_hide_a_slip = reply.outcome == Outcome::Clarify || reply.reason == Some(RefuseReason::NotSafety);
    if !may_hide_a_slip {
        return reply;
    }
    if plain.len() > N_TOKENS_PUT_RIGHT_MAX {
        return reply;
    }
    match spelling::put_right(&plain) {
        Some((fixed, told)) => {
            let mut second = context.read(&fixed, None, true);
            let helps = match reply.outcome {
                Outcome::Clarify => second.outcome != Outcome::Clarify,
                _ => second.outcome == Outcome::Accept,
            };
            if !helps {
                return reply;
            }
            for (wrong, right) in told {
                second.say.push_str(&format!(" I took \"{wrong}\" as \"{right}\"."));
            }
            second
        }
        None => reply,
    }
}

/// Most tokens that slips are looked for in. Chosen: longer texts would be read four times, and may be asked about.
const N_TOKENS_PUT_RIGHT_MAX: usize = 64;

/// Most rules of one utterance. Chosen: more cannot be read back, and a robot holds no more.
const N_RULES_MAX: usize = 16;

struct Context<'a> {
    active: &'a [Rule],
    profile: &'a Profile,
    words: &'a str,
}

/// What the clauses of an utterance add up to.
#[derive(Default)]
struct Sum {
    added: Vec<Rule>,
    lifted: Vec<String>,
    is_revoke: bool,
    notes: Vec<String>,
    not_safety: bool,
}

impl Context<'_> {
    fn read(&self, tokens: &[Token], bare_unit: BareUnit, may_offer: bool) -> Reply {
        let items = items(tokens, bare_unit);
        let drafts: Vec<(Draft, &[Item])> = segments(&items)
            .into_iter()
            .map(|segment| {
                let range = segment.range.clone();
                let draft = Draft {
                    is_fresh: segment.is_fresh,
                    lead: segment.lead,
                    ..scan(&items[segment.range], segment.join)
                };
                (draft, &items[range])
            })
            .collect();
        let drafts = background::of_the_past(drafts);
        let clauses = combine(drafts.iter().map(|(draft, _)| draft.clone()).collect());
        let trouble = match self.sum(&clauses) {
            Ok(sum) => return self.concluded(sum, &clauses, tokens),
            Err(trouble) => trouble,
        };
        let asks = !matches!(trouble, Trouble::Unsafe(_) | Trouble::Unsupported(_) | Trouble::NotSafety);
        // What only tells may have stood in the way of what orders.
        let second = asks.then(|| background::told(drafts)).flatten().map(combine);
        let summed = second.and_then(|second| Some((self.sum(&second).ok()?, second)));
        match summed.filter(|(sum, _)| !sum.added.is_empty()) {
            Some((sum, second)) => self.concluded(sum, &second, tokens),
            None => self.explain(trouble, tokens, may_offer),
        }
    }

    fn sum(&self, clauses: &Clauses) -> Result<Sum, Trouble> {
        let mut sum = Sum::default();
        let mut first_trouble = None;
        for clause in &clauses.orders {
            match self.one(clause, &sum.added) {
                Ok(change) if sum.added.len() + change.added.len() > N_RULES_MAX => {
                    let question =
                        format!("At most {N_RULES_MAX} rules at a time, please. Which come first?");
                    return Err(Trouble::Ask(question));
                }
                Ok(change) if self.lets_off(clause, &change, &mut sum) => {}
                // "avoid the furniture, only the rug is ok": of the furniture, or of what?
                Ok(change)
                    if change.is_revoke
                        && change.lifted.is_empty()
                        && !sum.added.is_empty()
                        && (matches!(clause.draft.lead.as_str(), "only" | "just")
                            || ["only", "just"].iter().any(|word| clause.draft.words.starts_with(word))) =>
                {
                    let question = format!("What do you mean by \"only {}\"?", clause.draft.words);
                    first_trouble.get_or_insert(Trouble::Ask(question));
                }
                // "I changed my mind, …": what follows says about what.
                Ok(change)
                    if change.is_revoke
                        && clause.draft.senses == [Sense::Revoke]
                        && clause.draft.all_names().next().is_none()
                        && clause.draft.words.ends_with("changed my mind")
                        && clauses.orders.len() > 1 => {}
                // "open the door with it": part of the task before it, when no rule is about it.
                Ok(change)
                    if change.is_revoke
                        && change.lifted.is_empty()
                        && !clause.draft.has_any(&[
                            Sense::Revoke,
                            Sense::Lift,
                            Sense::StartOver,
                            Sense::NormalSpeed,
                        ])
                        && !clauses.others.is_empty() =>
                {
                    sum.not_safety = true;
                }
                Ok(change) => {
                    sum.is_revoke |= change.is_revoke;
                    sum.lifted.extend(change.lifted);
                    sum.added.extend(change.added);
                    sum.notes.extend(clause.notes.iter().map(|note| note_words(note)));
                    if let Some(when) = &clause.draft.unobservable {
                        sum.notes.push(note_words(when));
                    }
                }
                Err(Trouble::NotSafety) => sum.not_safety = true,
                // What must be refused outweighs what must be asked.
                Err(trouble @ (Trouble::Unsafe(_) | Trouble::Unsupported(_))) => {
                    let opposites = matches!(trouble, Trouble::Unsupported(_))
                        && clause.draft.has(Sense::Fast)
                        && clauses.orders.len() > 1;
                    return Err(if opposites {
                        Trouble::Ask("Slow or fast: which should it be?".into())
                    } else {
                        trouble
                    });
                }
                Err(trouble) => {
                    first_trouble.get_or_insert(trouble);
                }
            }
        }
        if let Some(trouble) = first_trouble {
            return Err(trouble);
        }
        self.check_coverage(clauses, &sum)?;
        match doubt::of_reading(clauses, &sum.added) {
            Some(question) if !sum.added.is_empty() => Err(Trouble::Ask(question)),
            _ => Ok(sum),
        }
    }

    /// "stay out of the bays, bay 2 is ok though": an exception to what was just said, not a lift.
    fn lets_off(&self, clause: &Clause, change: &Change, sum: &mut Sum) -> bool {
        if !change.is_revoke || !change.lifted.is_empty() {
            return false;
        }
        let nouns = Nouns::get();
        let mut done = false;
        for name in clause.draft.all_names().filter(|name| !name.is_pronoun) {
            for rule in &mut sum.added {
                let one_of = name.obj.starts_with(&format!("{} ", rule.obj))
                    || nouns.same(&rule.obj, &name.obj) && name.reference != rule.phrase();
                if one_of && rule.rule_type == RuleType::Exclusion {
                    rule.except.push(name.reference.clone());
                    done = true;
                }
            }
        }
        done
    }

    fn one(&self, clause: &Clause, fresh: &[Rule]) -> Result<Change, Trouble> {
        if let Some(change) = talk(clause, self.active, fresh, self.profile)? {
            return Ok(change);
        }
        match resolve(clause, self.active, self.profile) {
            Ok(added) => Ok(Change { added, ..Change::default() }),
            Err(Trouble::Loosens) => {
                let mut lifting = clause.clone();
                lifting.draft.n_neg = 0;
                lifting.draft.senses.push(Sense::Lift);
                // A negation that we may have misread lifts what is there, or leads to a question.
                talk(&lifting, self.active, fresh, self.profile)?
                    .filter(|change| !change.lifted.is_empty())
                    .ok_or(Trouble::Ask("I did not understand that as a rule. What should I heed?".into()))
            }
            Err(trouble) => Err(trouble),
        }
    }

    fn check_coverage(&self, clauses: &Clauses, sum: &Sum) -> Result<(), Trouble> {
        if let Some(word) = clauses.leftover.first() {
            return Err(Trouble::Ask(format!("I did not understand \"{word}\". What should I heed?")));
        }
        let claimed =
            |name: &Name| name.is_pronoun || sum.added.iter().any(|rule| rule.phrase() == name.reference);
        if let Some(name) = clauses.unclaimed.iter().find(|name| !claimed(name)) {
            return Err(Trouble::WhatAbout(name.clone()));
        }
        // "avoid the rug and drive over the rug" cannot both be.
        for other in &clauses.others {
            let onto = other
                .regions
                .iter()
                .filter(|region| matches!(region.place, Place::On | Place::Under))
                .flat_map(|region| &region.names);
            let onto = onto.chain(other.names.iter().filter(|_| other.has(Sense::VerbOn)));
            for name in onto {
                let clash = |rule: &Rule| {
                    rule.rule_type == RuleType::Exclusion
                        && !name.is_pronoun
                        && Nouns::get().canonical(&rule.obj) == Nouns::get().canonical(&name.obj)
                };
                if sum.added.iter().any(clash) {
                    return Err(Trouble::Ask(format!(
                        "Should I go there or keep off the {}?",
                        name.reference
                    )));
                }
            }
        }
        Ok(())
    }

    /// The reply, or a question when the words cast doubt on whatever was understood.
    fn concluded(&self, sum: Sum, clauses: &Clauses, tokens: &[Token]) -> Reply {
        let changes = !sum.added.is_empty() || !sum.lifted.is_empty();
        match doubt::of_words(tokens).filter(|_| changes) {
            Some(question) => answer::clarify(&question, vec![]),
            None => self.conclude(sum, clauses),
        }
    }

    fn conclude(&self, sum: Sum, clauses: &Clauses) -> Reply {
        // "touching the lamp could burn you, so please don't": an order half heard, and nothing to lift.
        let forbids = |draft: &Draft| draft.is_negated() && !draft.has_any(&[Sense::Revoke, Sense::Lift]);
        let forbids_unheard = sum.added.is_empty()
            && sum.lifted.is_empty()
            && sum.is_revoke
            && (clauses.stories.iter().chain(&clauses.others).any(forbids)
                || clauses.orders.len() > 1 && clauses.orders.iter().any(|clause| forbids(&clause.draft)));
        if forbids_unheard {
            return answer::clarify(
                "I understood what is allowed, not what is forbidden. What should I heed?",
                vec![],
            );
        }
        if sum.added.is_empty() && !sum.is_revoke {
            return self.nothing(&sum, clauses);
        }
        let mut notes = sum.notes;
        if !clauses.others.is_empty() || sum.not_safety {
            notes.push("I only took the rule; tasks are not mine.".into());
        }
        let mut lifted = sum.lifted;
        if sum.added.is_empty() {
            dedup(&mut lifted);
            let rules: Vec<&Rule> = self.active.iter().filter(|rule| lifted.contains(&rule.id)).collect();
            return answer::revoke(&rules, &notes);
        }
        let mut added = settle(rules::tighten::join(sum.added));
        for rule in &mut added {
            rule.text = self.words.to_owned();
            rule.parser = "offline".into();
            for old in self
                .active
                .iter()
                .filter(|old| !lifted.contains(&old.id))
                .filter(|old| repeats(rule, old))
                .collect::<Vec<_>>()
            {
                // What was filled in never loosens what was said before.
                if rule.defaults.iter().any(|field| field == "buffer_m")
                    && rule.rule_type == RuleType::Exclusion
                {
                    rule.buffer_m = rule.buffer_m.max(old.buffer_m);
                }
                lifted.push(old.id.clone());
            }
        }
        dedup(&mut lifted);
        for rule in &added {
            if let Err(error) = rule.check(self.profile) {
                return answer::clarify(
                    &format!("I cannot take that as it is ({error}). What should it be?"),
                    vec![],
                );
            }
        }
        answer::accept(added, lifted, &notes)
    }
}

fn note_words(when: &str) -> String {
    format!("I cannot tell \"{when}\" by myself, so this holds until you lift it: say \"forget it\".")
}

fn dedup(ids: &mut Vec<String>) {
    let mut seen = std::collections::HashSet::new();
    ids.retain(|id| seen.insert(id.clone()));
}
