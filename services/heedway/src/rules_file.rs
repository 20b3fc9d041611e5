//! Rules in a file: sentences, one a line, or rules as JSON, an array or one a line.
//!
//! Sentences go through the offline parser one after the other, each with the rules before it in force. What is
//! no rule is told and left out. Rules without an id are given one.

use std::path::Path;

use anyhow::{Context, ensure};
use geometry::Profile;
use rules::{Outcome, Rule};
use serde::Deserialize;

/// Largest file, bytes.
const N_BYTES_MAX: u64 = 1024 * 1024;

/// What a file holds.
#[derive(Debug, Default)]
pub struct Read {
    /// The rules, oldest first, each with an id of its own.
    pub rules: Vec<Rule>,
    /// Sentences that are no rule, and what the parser says of them.
    pub refused: Vec<(String, String)>,
}

/// One entry of JSON.
#[derive(Deserialize)]
#[serde(untagged)]
enum Entry {
    Rule(Box<Rule>),
    /// As in files of sentences and in replies of the parser.
    Specs {
        specs: Vec<Rule>,
    },
    Sentence {
        text: String,
    },
    Words(String),
}

/// Reads a file of rules.
///
/// # Errors
/// When it cannot be read, or a line of JSON is none; names the file and the line.
pub fn read(file: &Path, profile: &Profile) -> anyhow::Result<Read> {
    let shown = || file.display().to_string();
    let n_bytes = std::fs::metadata(file).with_context(shown)?.len();
    ensure!(n_bytes <= N_BYTES_MAX, "{}: {n_bytes} bytes, at most {N_BYTES_MAX}", shown());
    let text = std::fs::read_to_string(file).with_context(shown)?;
    parse(&text, profile).with_context(shown)
}

fn parse(text: &str, profile: &Profile) -> anyhow::Result<Read> {
    let mut read = Read::default();
    if let Ok(entries) = serde_json::from_str::<Vec<Entry>>(text) {
        entries.into_iter().for_each(|entry| read.take(entry, profile));
        return Ok(read);
    }
    if let Ok(entry) = serde_json::from_str::<Entry>(text) {
        read.take(entry, profile);
        return Ok(read);
    }
    for (idx, line) in text.lines().enumerate().map(|(idx, line)| (idx, line.trim())) {
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let entry = if line.starts_with('{') {
            serde_json::from_str(line).with_context(|| format!("line {}", idx + 1))?
        } else {
            Entry::Words(line.to_owned())
        };
        read.take(entry, profile);
    }
    Ok(read)
}

impl Read {
    fn take(&mut self, entry: Entry, profile: &Profile) {
        match entry {
            Entry::Rule(rule) => self.add(*rule),
            Entry::Specs { specs } => specs.into_iter().for_each(|rule| self.add(rule)),
            Entry::Sentence { text } | Entry::Words(text) => {
                let reply = utterance::parse(&self.rules, profile, &text);
                if reply.outcome == Outcome::Accept {
                    self.rules.retain(|rule| !reply.revoked.contains(&rule.id));
                    reply.specs.into_iter().for_each(|rule| self.add(rule));
                } else {
                    self.refused.push((text, reply.say));
                }
            }
        }
    }

    fn add(&mut self, mut rule: Rule) {
        let is_taken = |id: &str| self.rules.iter().any(|other| other.id == id);
        if rule.id.is_empty() || is_taken(&rule.id) {
            rule.id = (1..).map(|n| format!("s{n}")).find(|id| !is_taken(id)).unwrap_or_default();
        }
        self.rules.push(rule);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(text: &str, wanted: &[(&str, &str)], n_refused: usize) {
        let read = parse(text, &Profile::turtlebot2()).unwrap();
        let found: Vec<(&str, &str)> = read.rules.iter().map(|r| (r.id.as_str(), r.obj.as_str())).collect();
        assert_eq!((found.as_slice(), read.refused.len()), (wanted, n_refused), "{:?}", read.refused);
    }

    #[test]
    fn sentences_and_rules_are_read_in_every_layout() {
        let rule = r#"{"id": "a", "type": "exclusion", "relation": "near", "obj": "bed"}"#;
        check(
            "don't go under the table\n\n# why\nkeep 30 cm from the chairs\n",
            &[("s1", "table"), ("s2", "chair")],
            0,
        );
        check(rule, &[("a", "bed")], 0);
        check(&format!("[{rule}, {rule}]"), &[("a", "bed"), ("s1", "bed")], 0);
        check(&format!("{rule}\n{{\"text\": \"keep off the rug\"}}"), &[("a", "bed"), ("s1", "rug")], 0);
        check("[\"keep off the rug\", \"what a nice day\"]", &[("s1", "rug")], 1);
        check(&format!("{{\"id\": 3, \"specs\": [{rule}]}}"), &[("a", "bed")], 0);
    }

    #[test]
    fn a_bad_line_is_named() {
        let error = parse("keep off the rug\n{\"type\": 1}", &Profile::turtlebot2()).unwrap_err();
        assert!(format!("{error:#}").contains("line 2"), "{error:#}");
    }
}
