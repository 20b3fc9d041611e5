//! Doubts: signs that a reading which gives rules is a guess, and so has to be asked about.
//!
//! The grammar elsewhere finds a reading; this looks at what came out and at what went in, and asks
//! whether every name, number and side that was said is in a rule, and whether every rule is about
//! something that can be seen. It never changes a rule.

use rules::{Relation, Rule, RuleType};

use crate::clause::{Clause, Clauses, has_strong_order};
use crate::draft::Draft;
use crate::exclusion::object;
use crate::lexicon::{Lexicon, Sense};
use crate::noun::Name;
use crate::quantity::{Kind, Quantity};
use crate::segment::Join;
use crate::speech::{Speech, speech};
use crate::text::Token;

/// Metres, m/s or rad/s by which a number may differ from what was said: rounding.
const SLACK: f64 = 1e-3;

/// Words that point at no kind of thing.
const POINTERS: [&str; 25] = [
    "stroll",
    "trot",
    "tip",
    "whipping",
    "whirling",
    "scuffing",
    "swerving",
    "speeding",
    "dashing",
    "anything",
    "everything",
    "something",
    "whatever",
    "whoever",
    "whichever",
    "whomever",
    "someplace",
    "somewhere",
    "nothing",
    "none",
    "each",
    "all",
    "both",
    "else",
    "elsewhere",
];

/// What to ask about the words, whatever was made of them; none when nothing in them casts doubt.
#[must_use]
pub fn of_words(tokens: &[Token]) -> Option<String> {
    let lexicon = Lexicon::get();
    let doubted = (0..tokens.len()).find_map(|at| Some((at, lexicon.doubt_at(tokens, at)?)));
    if let Some((at, n_tokens)) = doubted {
        let said: Vec<&str> =
            tokens.iter().skip(at).take(n_tokens).map(|token| token.text.as_str()).collect();
        return Some(format!("You said \"{}\": what should I heed?", said.join(" ")));
    }
    // "should you avoid the stairs?", "the rug is off limits?"
    let asks = tokens.iter().any(|token| token.text == "?");
    let first = tokens.iter().find(|token| !token.is_mark()).map_or("", |token| token.text.as_str());
    let is_request = !matches!(first, "should" | "must" | "may" | "shall")
        && tokens.iter().any(|token| lexicon.is_request(&token.text));
    (asks && !is_request).then(|| "Is that a question, or something that I should heed?".to_owned())
}

/// What to ask about one order whose words gave these rules; none when nothing is in doubt.
#[must_use]
pub fn of_order(draft: &Draft, rules: &[Rule]) -> Option<String> {
    if let Some(rule) = rules.iter().find(|rule| !can_be_seen(rule)) {
        return Some(format!("What do you mean by \"{}\"?", rule.phrase()));
    }
    if let Some(name) = draft.all_names().find(|name| !is_in(name, rules)) {
        return Some(format!("What should I heed about the {}?", name.reference));
    }
    if let Some(quantity) = draft.quantities.iter().find(|quantity| !is_carried(quantity, rules)) {
        return Some(format!("What is \"{}\" about?", quantity.said));
    }
    if draft.has(Sense::AllRules) {
        return Some("Everything? Please name what I should heed.".into());
    }
    let sided = draft.has_any(&[Sense::SideLeft, Sense::SideRight, Sense::SelfLeft, Sense::SelfRight]);
    let sides = [Relation::LeftOf, Relation::RightOf, Relation::FrontOf, Relation::Behind];
    if sided && !rules.iter().any(|rule| sides.contains(&rule.relation)) {
        return Some("On which side of what?".into());
    }
    None
}

/// What to ask about the whole of it; none when nothing is in doubt.
#[must_use]
pub fn of_reading(clauses: &Clauses, rules: &[Rule]) -> Option<String> {
    let stops = |rule: &Rule| rule.relation == Relation::Global && rule.vel_max == Some(0.0);
    if rules.len() > 1 && rules.iter().any(stops) {
        return Some("Should I stop altogether? Please tell me where to stop.".into());
    }
    let waits = |clause: &Clause| !clause.notes.is_empty() && clause.draft.has(Sense::Halt);
    if rules.iter().any(stops) && clauses.orders.iter().any(waits) {
        return Some("I cannot tell when that is. Should I stop now, or near something?".into());
    }
    // "stay off the rug or go slowly on it": one of two, and we cannot tell which.
    let either = clauses.orders.iter().skip(1).any(|clause| {
        clause.draft.join == Some(Join::Or) && clause.draft.n_neg == 0 && !clause.draft.senses.is_empty()
    });
    if either && clauses.orders.first().is_some_and(|clause| clause.draft.n_neg == 0) && rules.len() > 1 {
        return Some("Which of the two should I heed?".into());
    }
    let opens_question = |draft: &Draft| draft.has_any(&[Sense::Question, Sense::Chat]);
    let half_heard = clauses
        .others
        .iter()
        .find(|draft| has_strong_order(draft) && !opens_question(draft) && !is_of_task(draft));
    half_heard.map(|draft| format!("I did not understand \"{}\". What should I heed?", draft.words))
}

/// "take the trash out": words that look like an order and belong to a task.
fn is_of_task(draft: &Draft) -> bool {
    draft.senses.first() == Some(&Sense::Task) && draft.n_neg == 0
}

/// Whether the rule is about a kind of thing, rather than about a word that names none.
fn can_be_seen(rule: &Rule) -> bool {
    let is_kind = |obj: &str| {
        let words: Vec<&str> = obj.split_whitespace().collect();
        let head = words.last().copied().unwrap_or_default();
        let names =
            matches!(speech(head), Speech::MayName) || words.len() > 1 && speech(head) == Speech::Participle;
        names
            && !POINTERS.contains(&head)
            && !words.iter().any(|word| POINTERS.contains(word) || speech(word) == Speech::Verb)
    };
    rule.relation == Relation::Global || is_kind(&rule.obj) && rule.obj2.as_deref().is_none_or(is_kind)
}

/// Whether the name is in one of the rules.
fn is_in(name: &Name, rules: &[Rule]) -> bool {
    let (obj, reference) = object(name);
    name.is_pronoun
        || matches!(name.obj.as_str(), "robot" | "you" | "yourself")
        || rules.iter().any(|rule| {
            rule.phrase() == reference
                || rule.obj == obj
                || rule.obj2.as_deref() == Some(obj.as_str())
                || rule.except.contains(&reference)
        })
}

/// Whether the number is in one of the rules.
fn is_carried(quantity: &Quantity, rules: &[Rule]) -> bool {
    let near = |found: Option<f64>| found.is_some_and(|found| (found - quantity.value).abs() <= SLACK);
    rules.iter().any(|rule| match quantity.kind {
        Kind::Distance => near(Some(rule.buffer_m)),
        Kind::Speed => near(rule.vel_max),
        Kind::TurnRate => near(rule.ang_vel_max),
        Kind::Fraction => rule.rule_type == RuleType::Kinematic,
        Kind::Bare => near(rule.vel_max) || near(Some(rule.buffer_m)),
        Kind::Duration => true,
    })
}
