//! `heedway rules`: the rules in force, and how far the filter holds and semantics grounds each.

use std::fmt::Write;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::bail;
use clap::Args;
use proto::{RuleSet, RulesHeld};
use service::Inbox;

use crate::board::{Board, grounding_word};
use crate::connection::{PATIENCE, Reach};
use crate::hearing::{Heard, listen_to_rules};
use crate::terminal::Terminal;

/// Who is expected to hold the rules.
const HOLDERS: [&str; 2] = ["filter", "semantics"];

/// How long the holders are waited for once the rules are known.
const HOLDERS_PATIENCE: Duration = Duration::from_secs(1);

/// Arguments of `heedway rules`.
#[derive(Args, Debug)]
pub struct Arguments {
    #[command(flatten)]
    reach: Reach,
    /// One JSON object instead of words: `version`, `specs`, `held`.
    #[arg(long)]
    json: bool,
}

/// Shows the rules in force.
///
/// # Errors
/// When nobody is reached, or no language service gives the rules within [`PATIENCE`].
pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let bus = arguments.reach.open().await?;
    let inbox: Inbox<Heard> = Inbox::new();
    listen_to_rules(&bus, &inbox).await?;
    let mut board = Board::default();
    let rules_known = hear_until(&inbox, &mut board, |board| board.rules().is_some());
    if tokio::time::timeout(PATIENCE, rules_known).await.is_err() {
        bail!(
            "no rules heard from robot {:?} at {} within {} s: is its language service running?",
            arguments.reach.robot,
            arguments.reach.connect,
            PATIENCE.as_secs()
        );
    }
    // A holder that stays silent is shown as such.
    let all_held = |board: &Board| HOLDERS.iter().all(|holder| board.held().contains_key(*holder));
    let _ = tokio::time::timeout(HOLDERS_PATIENCE, hear_until(&inbox, &mut board, all_held)).await;

    let Some(set) = board.rules() else { bail!("no rules") };
    let held: Vec<&RulesHeld> = board.held().values().collect();
    let text = if arguments.json { as_json(set, &held)? } else { as_words(set, &held) };
    Terminal::stdout().line(&text);
    Ok(ExitCode::SUCCESS)
}

async fn hear_until(inbox: &Inbox<Heard>, board: &mut Board, done: impl Fn(&Board) -> bool) {
    while !done(board) {
        board.hear(&inbox.next().await);
    }
}

fn as_json(set: &RuleSet, held: &[&RulesHeld]) -> anyhow::Result<String> {
    let value = serde_json::json!({ "version": set.version, "specs": set.specs, "held": held });
    Ok(serde_json::to_string_pretty(&value)?)
}

fn as_words(set: &RuleSet, held: &[&RulesHeld]) -> String {
    let mut text = match set.specs.len() {
        0 => format!("no rules in force, version {}", set.version),
        1 => format!("1 rule in force, version {}", set.version),
        n => format!("{n} rules in force, version {}", set.version),
    };
    for rule in &set.specs {
        // Writing to a string does not fail.
        let _ = write!(text, "\n  {:<4} {}", rule.id, rules::english::status(rule));
        for holder in HOLDERS {
            let state = holder_state(held.iter().find(|h| h.service == holder).copied(), &rule.id);
            let _ = write!(text, "\n         {holder}: {state}");
        }
    }
    text
}

/// What one holder does with one rule.
fn holder_state(held: Option<&RulesHeld>, rule_id: &str) -> String {
    let Some(held) = held else { return "not heard of".to_owned() };
    match held.rules.iter().find(|rule| rule.id == rule_id) {
        Some(rule) => format!("holds it (version {}), {}", held.version, grounding_word(rule.grounding)),
        None => format!("does not hold it yet (it has version {})", held.version),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::{Grounding, RuleHeld};
    use rules::{Relation, Rule};

    fn set() -> RuleSet {
        let mut rule = Rule::exclusion(Relation::Beneath, "standing desk");
        rule.id = "s1".into();
        RuleSet { version: 3, specs: vec![rule] }
    }

    #[test]
    fn a_rule_shows_who_holds_it_and_who_does_not() {
        let held = RulesHeld {
            service: "filter".into(),
            version: 3,
            rules: vec![RuleHeld { id: "s1".into(), grounding: Grounding::Searching }],
        };
        let text = as_words(&set(), &[&held]);
        assert!(text.contains("standing desk"), "{text}");
        assert!(text.contains("filter: holds it (version 3), looking for it"), "{text}");
        assert!(text.contains("semantics: not heard of"), "{text}");
    }

    #[test]
    fn a_holder_of_an_older_version_is_seen_not_to_hold_a_new_rule() {
        let held = RulesHeld { service: "filter".into(), version: 2, rules: vec![] };
        let text = as_words(&set(), &[&held]);
        assert!(text.contains("filter: does not hold it yet (it has version 2)"), "{text}");
    }

    #[test]
    fn json_carries_the_rules_as_the_wire_has_them() {
        let value: serde_json::Value = serde_json::from_str(&as_json(&set(), &[]).unwrap()).unwrap();
        assert_eq!(value["version"], 3);
        let rule: Rule = serde_json::from_value(value["specs"][0].clone()).unwrap();
        assert_eq!(rule, set().specs[0]);
    }
}
