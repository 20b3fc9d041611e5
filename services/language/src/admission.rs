//! From a parser's reply to a change of the rules, or to what is said instead.
//!
//! Whoever parsed, nothing is taken on trust: each rule is stamped and checked against the robot's
//! profile, ids must be in force, the list has a limit. What does not pass becomes a question; the rules
//! are then as they were.

use geometry::Profile;
use rules::{Outcome, RefuseReason, Reply, ReplyOption, Rule, english, tighten};

use crate::rulebook::Rulebook;

/// Most answers a question offers.
const N_OPTIONS_MAX: usize = 4;
/// Longest question or spoken reply, characters. Chosen: what still fits a small screen.
const N_SAY_CHARS_MAX: usize = 2_000;

/// What is needed to judge a reply.
pub struct Admission<'a> {
    /// The rules in force.
    pub book: &'a Rulebook,
    /// The robot.
    pub profile: &'a Profile,
    /// Most rules in force at once.
    pub n_rules_max: usize,
    /// The rule that ends first, if any has a lifetime.
    pub first_to_end: Option<&'a str>,
    /// Where the robot stands in the map.
    pub anchor: Option<[f64; 3]>,
}

/// The words a reply came from.
pub struct Words<'a> {
    /// What was said.
    pub text: &'a str,
    /// Who said it.
    pub speaker: &'a str,
    /// Who parsed it.
    pub parser: &'a str,
    /// When, milliseconds since the Unix epoch.
    pub unix_ms: u64,
}

/// A reply that may be given, and the book it leads to, if the rules change.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// The reply.
    pub reply: Reply,
    /// The next book.
    pub book: Option<Rulebook>,
}

impl From<Reply> for Verdict {
    fn from(reply: Reply) -> Verdict {
        Verdict { reply, book: None }
    }
}

impl Admission<'_> {
    /// Judges a parser's reply.
    #[must_use]
    pub fn judge(&self, reply: Reply, words: &Words<'_>) -> Verdict {
        let reply = Reply { say: shortened(reply.say), ..reply };
        match reply.outcome {
            Outcome::Accept => self.accept(reply, words),
            Outcome::Revoke => self.revoke(reply, words),
            Outcome::Clarify => {
                let question = reply.question.filter(|question| !question.trim().is_empty());
                let question = shortened(question.unwrap_or_else(|| "What should I heed?".into()));
                clarify(&question, reply.options.into_iter().take(N_OPTIONS_MAX).collect()).into()
            }
            Outcome::Refuse => refuse(reply.reason.unwrap_or(RefuseReason::NotSafety), &reply.say).into(),
        }
    }

    fn accept(&self, reply: Reply, words: &Words<'_>) -> Verdict {
        if reply.specs.is_empty() {
            return clarify("What should I heed?", vec![]).into();
        }
        let active = self.book.active();
        let specs: Vec<Rule> = reply.specs.iter().map(|rule| self.stamped(rule, words)).collect();
        for rule in &specs {
            if let Err(reason) = rule.check(self.profile) {
                return clarify(&format!("I can't hold that: {reason}. What should it be?"), vec![]).into();
            }
        }
        let mut revoked = self.in_force(&reply.revoked);
        for id in tighten::replaced(&active, &specs) {
            if !revoked.contains(&id) {
                revoked.push(id);
            }
        }
        let n_after = self.book.kept.len() - revoked.len() + specs.len();
        if n_after > self.n_rules_max {
            return self.full(n_after - self.n_rules_max, &reply, &revoked).into();
        }
        let n_new = specs.len();
        let sideless: Vec<String> = specs
            .iter()
            .filter(|rule| rule.relation.needs_anchor() && rule.anchor.is_none())
            .map(|rule| rule.phrase().to_owned())
            .collect();
        let book = self.book.changed(&revoked, specs, words.speaker, words.unix_ms);
        let specs = book.newest(n_new);
        let mut say = if reply.say.is_empty() { english::read_back_all(&specs) } else { reply.say };
        if !sideless.is_empty() {
            let names = english::and_list(&sideless);
            say.push_str(&format!(
                " I don't know where I stand in the map, so I can't tell the sides of {names} yet; \
                 say it again once I do."
            ));
        }
        let reply = Reply { specs, revoked, say, ..Reply::of(reply.outcome) };
        Verdict { reply, book: Some(book) }
    }

    fn revoke(&self, reply: Reply, words: &Words<'_>) -> Verdict {
        let revoked = self.in_force(&reply.revoked);
        let book =
            (!revoked.is_empty()).then(|| self.book.changed(&revoked, vec![], words.speaker, words.unix_ms));
        Verdict { reply: revocation(revoked, reply.say), book }
    }

    /// The rule with what only the service may set; the parser's own values give way.
    fn stamped(&self, rule: &Rule, words: &Words<'_>) -> Rule {
        Rule {
            id: String::new(),
            text: words.text.chars().take(rules::rule::TEXT_CHARS_MAX).collect(),
            parser: words.parser.to_owned(),
            anchor: self.anchor,
            ..rule.clone()
        }
    }

    fn in_force(&self, ids: &[String]) -> Vec<String> {
        let mut found: Vec<String> = Vec::new();
        for id in ids {
            if self.book.holds(id) && !found.contains(id) {
                found.push(id.clone());
            }
        }
        found
    }

    /// The question when the list is full: what may go for the new rules?
    fn full(&self, n_over: usize, reply: &Reply, revoked: &[String]) -> Reply {
        let left: Vec<&Rule> =
            self.book.kept.iter().map(|kept| &kept.rule).filter(|rule| !revoked.contains(&rule.id)).collect();
        let mut options = Vec::new();
        let mut offer = |lead: &str, gone: Vec<&Rule>| {
            let names: Vec<String> = gone.iter().map(|rule| english::status(rule)).collect();
            let ids = gone.iter().map(|rule| rule.id.clone());
            options.push(ReplyOption {
                label: format!("{lead}: {}", english::and_list(&names)),
                reply: Reply { revoked: revoked.iter().cloned().chain(ids).collect(), ..reply.clone() },
            });
        };
        if left.len() >= n_over {
            offer("drop the oldest", left.iter().copied().take(n_over).collect());
        }
        let ending = left.iter().find(|rule| Some(rule.id.as_str()) == self.first_to_end);
        if let (1, Some(ending)) = (n_over, ending) {
            offer("drop the one that ends first", vec![*ending]);
        }
        let n_max = self.n_rules_max;
        clarify(&format!("I can hold {n_max} rules and have them all. Which one may go?"), options)
    }
}

/// A question back; nothing changes.
#[must_use]
pub fn clarify(question: &str, options: Vec<ReplyOption>) -> Reply {
    let labels: Vec<String> = options.iter().map(|option| option.label.clone()).collect();
    let say =
        if labels.is_empty() { question.to_owned() } else { format!("{question} ({})", labels.join("; ")) };
    Reply { question: Some(question.to_owned()), options, say, ..Reply::of(Outcome::Clarify) }
}

/// A refusal; nothing changes.
#[must_use]
pub fn refuse(reason: RefuseReason, say: &str) -> Reply {
    let say = if !say.is_empty() {
        say
    } else {
        match reason {
            RefuseReason::NotSafety => "I only take safety rules.",
            RefuseReason::Unsafe => "I won't do that: it would loosen my own safety.",
            RefuseReason::Unsupported => "I can't put that into a rule.",
        }
    };
    Reply { reason: Some(reason), say: say.to_owned(), ..Reply::of(Outcome::Refuse) }
}

/// Rules lifted, or none.
#[must_use]
pub fn revocation(revoked: Vec<String>, say: String) -> Reply {
    Reply { revoked, say, ..Reply::of(Outcome::Revoke) }
}

fn shortened(text: String) -> String {
    if text.chars().count() <= N_SAY_CHARS_MAX { text } else { text.chars().take(N_SAY_CHARS_MAX).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rules::Relation;

    fn accept(specs: Vec<Rule>) -> Reply {
        Reply { specs, ..Reply::of(Outcome::Accept) }
    }

    fn book(n: usize) -> Rulebook {
        let rules = (0..n).map(|i| Rule::exclusion(Relation::On, &format!("rug {i}"))).collect();
        Rulebook::default().changed(&[], rules, "", 0)
    }

    fn judge(book: &Rulebook, reply: Reply) -> Verdict {
        let profile = Profile::sim();
        let admission =
            Admission { book, profile: &profile, n_rules_max: 3, first_to_end: Some("s2"), anchor: None };
        admission.judge(reply, &Words { text: "words", speaker: "ann", parser: "offline", unix_ms: 0 })
    }

    #[test]
    fn an_accepted_rule_is_stamped_by_the_service() {
        let claimed = Rule {
            id: "s1".into(),
            text: "other".into(),
            parser: "me".into(),
            anchor: Some([1.0; 3]),
            ..Rule::exclusion(Relation::On, "sofa")
        };
        let verdict = judge(&book(1), accept(vec![claimed]));
        let rule = &verdict.reply.specs[0];
        assert_eq!((rule.id.as_str(), rule.text.as_str(), rule.parser.as_str()), ("s2", "words", "offline"));
        assert_eq!(rule.anchor, None);
        assert_eq!(verdict.book.unwrap().active()[1], *rule);
    }

    #[test]
    fn a_rule_that_does_not_pass_its_check_becomes_a_question_with_the_limit() {
        let far = Rule { buffer_m: 7.0, ..Rule::exclusion(Relation::Near, "sofa") };
        let verdict = judge(&book(1), accept(vec![Rule::exclusion(Relation::On, "bed"), far]));
        assert_eq!((verdict.reply.outcome, verdict.book), (Outcome::Clarify, None));
        assert!(verdict.reply.question.unwrap().contains("0 to 5"));
        assert_eq!(judge(&book(1), accept(vec![])).reply.outcome, Outcome::Clarify);
    }

    #[test]
    fn a_full_list_offers_the_oldest_and_the_first_to_end() {
        let new = || accept(vec![Rule::exclusion(Relation::On, "sofa")]);
        assert!(judge(&book(2), new()).book.is_some());
        let verdict = judge(&book(3), new());
        assert_eq!((verdict.reply.outcome, verdict.book), (Outcome::Clarify, None));
        let gone: Vec<_> = verdict.reply.options.iter().map(|option| option.reply.revoked.clone()).collect();
        assert_eq!(gone, [["s1"], ["s2"]]);
        let picked = judge(&book(3), verdict.reply.options[1].reply.clone());
        assert_eq!(picked.book.unwrap().kept.len(), 3);
    }

    #[test]
    fn a_repeated_rule_takes_the_place_of_the_older_one_even_in_a_full_list() {
        let verdict = judge(&book(3), accept(vec![Rule::exclusion(Relation::On, "rug 1")]));
        assert_eq!(verdict.reply.revoked, ["s2"]);
        assert_eq!(verdict.book.unwrap().kept.len(), 3);
    }

    #[test]
    fn ids_that_are_not_in_force_are_not_revoked() {
        let revoke = |ids: &[&str]| {
            judge(&book(2), revocation(ids.iter().map(|id| (*id).into()).collect(), "gone".into()))
        };
        assert_eq!(revoke(&["s9"]).book, None);
        assert_eq!(revoke(&["s1", "s1", "s9"]).reply.revoked, ["s1"]);
        assert_eq!(revoke(&["s1"]).book.unwrap().version, 3);
    }

    #[test]
    fn a_side_without_a_pose_is_said_so() {
        let verdict = judge(&book(0), accept(vec![Rule::exclusion(Relation::LeftOf, "table")]));
        assert!(verdict.book.is_some() && verdict.reply.say.contains("sides of table"));
    }
}
