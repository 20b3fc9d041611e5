//! Replies: what the robot says, with every number of every rule read back.

use rules::english::{and_list, read_back, taken_defaults};
use rules::{Outcome, RefuseReason, Reply, ReplyOption, Rule};

/// New rules in force, and which they replace.
#[must_use]
pub fn accept(rules: Vec<Rule>, revoked: Vec<String>, notes: &[String]) -> Reply {
    let mut said: Vec<String> = Vec::new();
    for rule in &rules {
        let taken = taken_defaults(rule).map(|words| format!(" ({words})")).unwrap_or_default();
        said.push(format!("{}{taken}.", read_back(rule)));
    }
    if !revoked.is_empty() {
        said.push(format!("That replaces {}.", and_list(&revoked)));
    }
    said.extend(notes.iter().cloned());
    Reply { specs: rules, revoked, say: said.join(" "), ..Reply::of(Outcome::Accept) }
}

/// Rules lifted.
#[must_use]
pub fn revoke(lifted: &[&Rule], notes: &[String]) -> Reply {
    let mut said = if lifted.is_empty() {
        "I had no such rule, so nothing changes.".to_owned()
    } else {
        let names: Vec<String> = lifted.iter().map(|rule| rules::english::status(rule)).collect();
        format!("No longer in force: {}.", names.join("; "))
    };
    for note in notes {
        said.push(' ');
        said.push_str(note);
    }
    Reply {
        revoked: lifted.iter().map(|rule| rule.id.clone()).collect(),
        say: said,
        ..Reply::of(Outcome::Revoke)
    }
}

/// A question, with up to four answers that are ready replies.
#[must_use]
pub fn clarify(question: &str, options: Vec<ReplyOption>) -> Reply {
    let mut options = options;
    options.truncate(4);
    Reply {
        question: Some(question.to_owned()),
        say: question.to_owned(),
        options,
        ..Reply::of(Outcome::Clarify)
    }
}

/// Nothing to heed, or nothing that may be done.
#[must_use]
pub fn refuse(reason: RefuseReason, say: &str) -> Reply {
    Reply { reason: Some(reason), say: say.to_owned(), ..Reply::of(Outcome::Refuse) }
}
