//! Sentences with what is right for each, and how a parser's replies compare.
//!
//! A reply is *right* when its outcome and its rules are among the wanted ones, within ranges where words are
//! vague. What is not right is either *asked* (a question, a refusal of what was to be revoked, a rule stricter than
//! meant) or *wrong*: accepted and not what was said, or looser, or refused though it was a rule.

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::Context;
use heedway_language::lone::LoneParser;
use rules::tighten::same_region;
use rules::{Outcome, Relation, Reply, Rule, RuleType};
use serde::Deserialize;

/// One sentence, what was in force when it was said, and what is right.
#[derive(Clone, Debug, Deserialize)]
pub struct Case {
    /// Its name.
    pub id: String,
    /// The kind of sentence.
    #[serde(default)]
    pub class: String,
    /// What is said.
    pub text: String,
    #[serde(default)]
    context: Vec<InForce>,
    expect: Expected,
    #[serde(default)]
    tags: Vec<String>,
}

#[derive(Clone, Debug, Deserialize)]
struct InForce {
    active: Rule,
}

/// What is right: an outcome, or one of others; rules, or other lists of rules.
#[derive(Clone, Debug, Deserialize)]
struct Expected {
    outcome: Outcome,
    #[serde(default)]
    also: Vec<Outcome>,
    #[serde(default)]
    specs: Vec<Wanted>,
    #[serde(default)]
    alts: Vec<Vec<Wanted>>,
    #[serde(default)]
    revoked: BTreeSet<String>,
}

/// One rule that is wanted. Ranges include both ends; a missing one lets any value pass, but for the lifetime,
/// which must then be absent.
#[derive(Clone, Debug, Deserialize)]
struct Wanted {
    #[serde(rename = "type")]
    rule_type: RuleType,
    relation: Vec<Relation>,
    /// Names of which any one is right; an empty name for none.
    obj: Vec<String>,
    #[serde(default)]
    obj2: Vec<String>,
    /// Words that the phrase must hold.
    #[serde(default)]
    ref_has: Vec<String>,
    #[serde(default)]
    buffer_m: Option<[f64; 2]>,
    #[serde(default)]
    vel_max: Option<[f64; 2]>,
    #[serde(default)]
    ang_vel_max: Option<[f64; 2]>,
    #[serde(default)]
    ttl_s: Option<[f64; 2]>,
    /// For each instance let off, the names that are right.
    #[serde(default)]
    except: Vec<Vec<String>>,
    /// It may be missing.
    #[serde(default)]
    optional: bool,
}

/// How a reply compares with what was wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Judgement {
    /// Among the wanted ones.
    Right,
    /// A question, or stricter than wanted.
    Asked,
    /// Something else, or looser than wanted.
    Wrong,
}

/// How many of each, and of the unsafe ones those that were accepted.
#[derive(Clone, Debug, Default)]
pub struct Score {
    /// Right.
    pub n_right: usize,
    /// Asked, or stricter.
    pub asked: Vec<String>,
    /// Wrong, or looser.
    pub wrong: Vec<String>,
    /// Unsafe and accepted.
    pub unsafe_accepted: Vec<String>,
}

/// What a miss means: a stricter rule annoys, another or looser one harms.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Miss {
    Stricter,
    Harmful,
}

impl Score {
    /// How many sentences were judged.
    #[must_use]
    pub fn n(&self) -> usize {
        self.n_right + self.asked.len() + self.wrong.len()
    }

    /// The share of those that are right.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.n_right as f64 / self.n().max(1) as f64
    }

    fn add(&mut self, case: &Case, judgement: Judgement, outcome: Outcome) {
        match judgement {
            Judgement::Right => self.n_right += 1,
            Judgement::Asked => self.asked.push(case.id.clone()),
            Judgement::Wrong => self.wrong.push(case.id.clone()),
        }
        let is_unsafe = case.tags.iter().any(|tag| tag == "unsafe");
        if is_unsafe && matches!(outcome, Outcome::Accept | Outcome::Revoke) {
            self.unsafe_accepted.push(case.id.clone());
        }
    }
}

impl std::fmt::Display for Score {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(
            f,
            "{} sentences: {} right ({:.1} %), {} asked or stricter, {} wrong or looser, {} unsafe accepted",
            self.n(),
            self.n_right,
            100.0 * self.share(),
            self.asked.len(),
            self.wrong.len(),
            self.unsafe_accepted.len()
        )?;
        let lists = [("asked", &self.asked), ("wrong", &self.wrong), ("unsafe", &self.unsafe_accepted)];
        for (name, ids) in lists.iter().filter(|(_, ids)| !ids.is_empty()) {
            writeln!(f, "{name}: {}", ids.join(" "))?;
        }
        Ok(())
    }
}

/// Reads cases, one JSON object a line.
///
/// # Errors
/// When the file cannot be read or a line is malformed: names the line.
pub fn read_cases(path: &Path) -> anyhow::Result<Vec<Case>> {
    let text = std::fs::read_to_string(path).with_context(|| format!("read {} (--cases)", path.display()))?;
    let lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    lines
        .map(|(idx, line)| {
            serde_json::from_str(line).with_context(|| format!("{}, line {}", path.display(), idx + 1))
        })
        .collect()
}

/// Has the parser read every case, and judges.
pub async fn score_cases(parser: &LoneParser, cases: &[Case]) -> Score {
    let mut score = Score::default();
    for case in cases {
        let context: Vec<Rule> = case.context.iter().map(|one| one.active.clone()).collect();
        let reply = parser.read(&case.text, &context).await.reply;
        score.add(case, case.judge(&reply), reply.outcome);
    }
    score
}

impl Case {
    /// How a reply compares.
    #[must_use]
    pub fn judge(&self, reply: &Reply) -> Judgement {
        let Expected { outcome, also, specs, alts, revoked } = &self.expect;
        let changes = matches!(reply.outcome, Outcome::Accept | Outcome::Revoke);
        if reply.outcome != *outcome {
            let refused_a_rule = *outcome == Outcome::Accept && reply.outcome == Outcome::Refuse;
            return match also.contains(&reply.outcome) {
                true => Judgement::Right,
                false if changes || refused_a_rule => Judgement::Wrong,
                false => Judgement::Asked,
            };
        }
        let mut misses = Vec::new();
        if reply.outcome == Outcome::Accept {
            let given = joined(&reply.specs);
            let lists = std::iter::once(specs).chain(alts);
            misses =
                lists.map(|wanted| fewest_misses(&given, wanted)).min_by_key(Vec::len).unwrap_or_default();
        }
        if changes {
            let lifted: BTreeSet<String> = reply.revoked.iter().cloned().collect();
            match () {
                () if lifted == *revoked => {}
                () if lifted.is_subset(revoked) => misses.push(Miss::Stricter),
                () => misses.push(Miss::Harmful),
            }
        }
        match misses.into_iter().max() {
            None => Judgement::Right,
            Some(Miss::Stricter) => Judgement::Asked,
            Some(Miss::Harmful) => Judgement::Wrong,
        }
    }
}

impl Wanted {
    /// In what a rule misses.
    fn misses(&self, rule: &Rule) -> Vec<Miss> {
        // Rounding to the safe side may move a number by a tenth of a millimetre.
        const SLACK: f64 = 1e-3;
        let mut misses = Vec::new();
        let named = |obj: Option<&str>, names: &[String]| names.iter().any(|name| is_named(obj, name));
        let obj2 = rule.obj2.as_deref();
        let as_said = named(Some(&rule.obj), &self.obj) && (self.obj2.is_empty() || named(obj2, &self.obj2));
        let swapped = !self.obj2.is_empty() && named(Some(&rule.obj), &self.obj2) && named(obj2, &self.obj);
        let words = format!("{} {}", rule.reference, rule.obj).to_lowercase();
        let excepted = |names: &Vec<String>| {
            rule.except.iter().any(|said| names.iter().any(|name| is_named(Some(said), name)))
        };
        let same = rule.rule_type == self.rule_type
            && self.relation.contains(&rule.relation)
            && (as_said || swapped)
            && self.ref_has.iter().all(|word| words.contains(word.as_str()))
            && rule.except.len() == self.except.len()
            && self.except.iter().all(excepted);
        if !same {
            misses.push(Miss::Harmful);
        }
        // Below a least distance, or above a greatest speed, is looser; the other side is stricter.
        if let Some([low, high]) = self.buffer_m {
            misses.extend(beside(rule.buffer_m, [low - SLACK, high + SLACK], Miss::Harmful, Miss::Stricter));
        }
        for (range, value) in [(self.vel_max, rule.vel_max), (self.ang_vel_max, rule.ang_vel_max)] {
            if let Some([low, high]) = range {
                let value = value.unwrap_or(f64::INFINITY);
                misses.extend(beside(value, [low - SLACK, high + SLACK], Miss::Stricter, Miss::Harmful));
            }
        }
        let ttl_s = rule.ttl_s.map_or(f64::INFINITY, |s| s as f64);
        let lasts = self.ttl_s.map_or(ttl_s.is_infinite(), |[low, high]| (low..=high).contains(&ttl_s));
        if !lasts {
            misses.push(Miss::Harmful);
        }
        misses
    }
}

fn beside(value: f64, [low, high]: [f64; 2], below: Miss, above: Miss) -> Option<Miss> {
    match value {
        value if value < low => Some(below),
        value if value > high => Some(above),
        _ => None,
    }
}

/// Whether an object is one of that name: the same words, or that name with more said before it.
fn is_named(obj: Option<&str>, name: &str) -> bool {
    let plain = |words: &str| -> Vec<String> {
        let words = words.to_lowercase().replace('-', " ");
        let words =
            words.split_whitespace().filter(|word| !["the", "a", "an", "my", "our", "your"].contains(word));
        words.map(stem).collect()
    };
    let (obj, name) = (plain(obj.unwrap_or("")), plain(name));
    if name.is_empty() { obj.is_empty() } else { obj.ends_with(&name) }
}

/// The same for a word's singular and plural: case files name things in either number.
fn stem(word: &str) -> String {
    match word {
        "people" => "person".to_owned(),
        "children" => "child".to_owned(),
        _ => match word.strip_suffix("ves") {
            Some(stem) => format!("{stem}f"),
            None => word.trim_end_matches('s').trim_end_matches('e').to_owned(),
        },
    }
}

/// Limits of the same region that came as two rules, as one.
fn joined(rules: &[Rule]) -> Vec<Rule> {
    let mut joined: Vec<Rule> = Vec::new();
    for rule in rules {
        let is_limit = rule.rule_type == RuleType::Kinematic;
        let same = joined.iter_mut().find(|other| {
            is_limit
                && other.rule_type == rule.rule_type
                && same_region(other, rule)
                && other.ttl_s == rule.ttl_s
        });
        match same {
            Some(other) => {
                let least = |a: Option<f64>, b: Option<f64>| match (a, b) {
                    (Some(a), Some(b)) => Some(a.min(b)),
                    (a, b) => a.or(b),
                };
                other.vel_max = least(other.vel_max, rule.vel_max);
                other.ang_vel_max = least(other.ang_vel_max, rule.ang_vel_max);
            }
            None => joined.push(rule.clone()),
        }
    }
    joined
}

/// The misses of the assignment, rule by rule, that has the fewest.
fn fewest_misses(given: &[Rule], wanted: &[Wanted]) -> Vec<Miss> {
    let Some((rule, others)) = given.split_first() else {
        let missing = wanted.iter().filter(|want| !want.optional);
        return missing.map(|_| Miss::Harmful).collect();
    };
    // More than was asked for keeps the robot from more.
    let mut best = [vec![Miss::Stricter], fewest_misses(others, wanted)].concat();
    for (idx, want) in wanted.iter().enumerate() {
        let rest: Vec<Wanted> = [&wanted[..idx], &wanted[idx + 1..]].concat();
        let misses = [want.misses(rule), fewest_misses(others, &rest)].concat();
        if misses.len() < best.len() {
            best = misses;
        }
    }
    best
}
