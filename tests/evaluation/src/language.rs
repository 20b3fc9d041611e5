//! How well a parser understands twelve instructions, each asked several times, as the paper asks GPT-4o.
//!
//! The kinds are the paper's (exclusion zones, spatial relations, pace, intent, both at once), and eight of
//! the sentences are printed in it; the others are ours, since it only describes them. A reply is right
//! when its rules are the wanted ones, within ranges where words are vague; a question is no error.

use anyhow::{Context, bail};
use heedway_language::lone::LoneParser;
use rules::{Outcome, Relation, Reply, Rule, RuleType};
use serde::{Deserialize, Serialize};

pub mod cases;

/// The instructions, one JSON object a line.
const INSTRUCTIONS: &str = include_str!("../language/instructions.jsonl");

/// One instruction, and which rules are right for it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Instruction {
    /// The paper's kind of constraint.
    pub kind: String,
    /// What is said.
    pub text: String,
    /// Lists of rules of which any one is right.
    right: Vec<Vec<Wanted>>,
}

/// One rule that is wanted; a missing range means that the rule must hold no such limit.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Wanted {
    #[serde(rename = "type")]
    rule_type: RuleType,
    relation: Vec<Relation>,
    obj: Vec<String>,
    /// Metres, both ends included.
    buffer_m: [f64; 2],
    /// m/s.
    #[serde(default)]
    vel_max: Option<[f64; 2]>,
}

impl Wanted {
    fn is_met(&self, rule: &Rule) -> bool {
        // Rounding to the safe side may move a number by a tenth of a millimetre.
        const SLACK: f64 = 1e-3;
        let within = |value: f64, [low, high]: [f64; 2]| (low - SLACK..=high + SLACK).contains(&value);
        let limited = match (self.vel_max, rule.vel_max) {
            (Some(range), Some(value)) => within(value, range),
            (None, None) => true,
            _ => false,
        };
        rule.rule_type == self.rule_type
            && self.relation.contains(&rule.relation)
            && self.obj.contains(&rule.obj)
            && within(rule.buffer_m, self.buffer_m)
            && limited
            && rule.ttl_s.is_none()
            && rule.except.is_empty()
    }
}

impl Instruction {
    /// Whether the reply gives the rules that are wanted, each once.
    #[must_use]
    pub fn verdict(&self, reply: &Reply) -> Verdict {
        match reply.outcome {
            Outcome::Clarify => return Verdict::Asked,
            Outcome::Refuse | Outcome::Revoke => return Verdict::Wrong,
            Outcome::Accept => {}
        }
        let fits = |wanted: &Vec<Wanted>| {
            let each = wanted.iter().all(|want| reply.specs.iter().any(|rule| want.is_met(rule)));
            each && wanted.len() == reply.specs.len()
        };
        if reply.revoked.is_empty() && self.right.iter().any(fits) {
            Verdict::Correct
        } else {
            Verdict::Wrong
        }
    }
}

/// What came of one try.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The wanted rules.
    Correct,
    /// A question.
    Asked,
    /// Other rules, or a refusal.
    Wrong,
}

/// One try, with everything that was written.
#[derive(Clone, Debug, Serialize)]
pub struct Try {
    /// The kind of constraint.
    pub kind: String,
    /// What was said.
    pub text: String,
    /// Which try, from 1.
    pub attempt: usize,
    /// What came of it.
    pub verdict: Verdict,
    /// Who answered.
    pub parser: String,
    /// The reply.
    pub reply: Reply,
    /// What the model wrote.
    pub raw: Vec<String>,
    /// Why the model gave no answer, if it gave none.
    pub failure: Option<String>,
}

/// The built-in instructions.
///
/// # Errors
/// When the file is malformed: names the line.
pub fn instructions() -> anyhow::Result<Vec<Instruction>> {
    let lines = INSTRUCTIONS.lines().enumerate();
    let found: Vec<Instruction> = lines
        .map(|(idx, line)| {
            serde_json::from_str(line).with_context(|| format!("instructions.jsonl, line {}", idx + 1))
        })
        .collect::<anyhow::Result<_>>()?;
    if found.iter().any(|instruction| instruction.right.is_empty()) {
        bail!("instructions.jsonl: an instruction without anything right");
    }
    Ok(found)
}

/// Asks each instruction `n_times`, with no rule in force, and tells every try as soon as it is done.
pub async fn ask_all(
    parser: &LoneParser,
    instructions: &[Instruction],
    n_times: usize,
    mut told: impl FnMut(&Try),
) -> Vec<Try> {
    let mut tries = Vec::with_capacity(instructions.len() * n_times);
    for instruction in instructions {
        for attempt in 1..=n_times {
            let reading = parser.read(&instruction.text, &[]).await;
            let one = Try {
                kind: instruction.kind.clone(),
                text: instruction.text.clone(),
                attempt,
                verdict: instruction.verdict(&reading.reply),
                parser: reading.parser,
                reply: reading.reply,
                raw: reading.raw,
                failure: reading.failure,
            };
            told(&one);
            tries.push(one);
        }
    }
    tries
}

/// The tries as a Markdown table: a row an instruction, and the sum, with the paper's figure for GPT-4o.
#[must_use]
pub fn table(tries: &[Try]) -> String {
    let mut rows: Vec<(&str, &str)> =
        tries.iter().map(|one| (one.kind.as_str(), one.text.as_str())).collect();
    rows.dedup();
    let count = |of: &dyn Fn(&&Try) -> bool, verdict| {
        tries.iter().filter(|one| of(one) && one.verdict == verdict).count()
    };
    let mut text =
        "| kind | instruction | correct | asked | wrong | said back |\n|---|---|--:|--:|--:|---|\n"
            .to_owned();
    for (kind, instruction) in rows {
        let of = |one: &&Try| one.text == instruction;
        let said = tries.iter().find(of).map_or("", |one| one.reply.say.as_str()).replace('|', "/");
        text += &format!(
            "| {kind} | {instruction} | {} | {} | {} | {said} |\n",
            count(&of, Verdict::Correct),
            count(&of, Verdict::Asked),
            count(&of, Verdict::Wrong)
        );
    }
    let all = |_: &&Try| true;
    let n_failed = tries.iter().filter(|one| one.failure.is_some()).count();
    text + &format!(
        "| | **all {}** | **{}** | **{}** | **{}** | the paper's GPT-4o: 52 of 60 correct, 8 asked |\n\n\
         The model gave no answer in {n_failed} of {} tries.\n",
        tries.len(),
        count(&all, Verdict::Correct),
        count(&all, Verdict::Asked),
        count(&all, Verdict::Wrong),
        tries.len()
    )
}
