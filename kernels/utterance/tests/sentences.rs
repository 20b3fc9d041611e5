//! Sentences as other speakers would say them, and what each must lead to.
//!
//! `sentences.jsonl` holds a case a line: `expect.specs` are the rules wanted, with ranges for
//! numbers and alternatives for names. A case may name further outcomes that are right in `also`.

// A malformed case fails the test by itself.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

use geometry::Profile;
use rules::{Outcome, Relation, Reply, Rule, RuleType};
use serde_json::Value;

fn cases(text: &str) -> Vec<Value> {
    text.lines()
        .filter(|line| !line.trim().is_empty())
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

fn active(case: &Value) -> Vec<Rule> {
    let entries = case["context"].as_array().cloned().unwrap_or_default();
    entries.into_iter().map(|entry| serde_json::from_value(entry["active"].clone()).unwrap()).collect()
}

fn outcome(reply: &Reply) -> &'static str {
    match reply.outcome {
        Outcome::Accept => "accept",
        Outcome::Clarify => "clarify",
        Outcome::Refuse => "refuse",
        Outcome::Revoke => "revoke",
    }
}

fn list(value: &Value) -> Vec<String> {
    value.as_array().into_iter().flatten().filter_map(|entry| entry.as_str().map(str::to_owned)).collect()
}

fn in_range(found: Option<f64>, wanted: &Value) -> bool {
    match (wanted[0].as_f64(), wanted[1].as_f64()) {
        (Some(low), Some(high)) => found.is_some_and(|value| (low - 1e-9..=high + 1e-9).contains(&value)),
        _ => found.is_none(),
    }
}

fn relation(rule: &Rule) -> String {
    serde_json::to_value(rule.relation).unwrap().as_str().unwrap().to_owned()
}

fn fits(rule: &Rule, wanted: &Value) -> bool {
    let kind = if rule.rule_type == RuleType::Exclusion { "exclusion" } else { "kinematic" };
    let named = |found: &str, names: &Value| {
        list(names).iter().any(|name| name == found || found.ends_with(&format!(" {name}")))
    };
    wanted["type"] == kind
        && list(&wanted["relation"]).contains(&relation(rule))
        && (rule.relation == Relation::Global || named(&rule.obj, &wanted["obj"]))
        && (wanted["obj2"].is_null() || named(rule.obj2.as_deref().unwrap_or_default(), &wanted["obj2"]))
        && in_range(Some(rule.buffer_m), &wanted["buffer_m"])
        && (wanted["vel_max"].is_null() || in_range(rule.vel_max, &wanted["vel_max"]))
        && (wanted["ang_vel_max"].is_null() || in_range(rule.ang_vel_max, &wanted["ang_vel_max"]))
        && in_range(rule.ttl_s.map(|seconds| seconds as f64), &wanted["ttl_s"])
        && rule.except.len() == wanted["except"].as_array().map_or(0, Vec::len)
}

/// What is wrong with the reply, if anything.
fn wrong(case: &Value, reply: &Reply) -> Option<String> {
    let expect = &case["expect"];
    let found = outcome(reply);
    if expect["outcome"] != found {
        return if list(&expect["also"]).iter().any(|also| also == found) {
            None
        } else {
            Some(format!("{found}: {}", reply.say))
        };
    }
    let mut revoked = reply.revoked.clone();
    let mut wanted_revoked = list(&expect["revoked"]);
    revoked.sort();
    wanted_revoked.sort();
    if revoked != wanted_revoked {
        return Some(format!("revoked {revoked:?}"));
    }
    let wanted: Vec<&Value> = expect["specs"].as_array().into_iter().flatten().collect();
    let all_found = wanted.len() == reply.specs.len()
        && wanted.iter().all(|want| reply.specs.iter().any(|rule| fits(rule, want)));
    if all_found { None } else { Some(format!("{:?}", rules::english::read_back_all(&reply.specs))) }
}

fn failures(text: &str) -> (usize, Vec<String>) {
    let cases = cases(text);
    let failed = cases
        .iter()
        .filter_map(|case| {
            let words = case["text"].as_str().unwrap();
            let reply = utterance::parse(&active(case), &Profile::sim(), words);
            wrong(case, &reply).map(|why| format!("{words:?} -> {why}"))
        })
        .collect();
    (cases.len(), failed)
}

#[test]
fn every_sentence_becomes_its_rules_or_a_question() {
    let (n_cases, failed) = failures(include_str!("sentences.jsonl"));
    assert!(n_cases >= 250, "{n_cases} cases");
    assert!(failed.is_empty(), "{} of {n_cases}:\n{}", failed.len(), failed.join("\n"));
}

#[test]
fn every_accepted_rule_is_one_the_robot_may_enforce() {
    for profile in [Profile::sim(), Profile::turtlebot2()] {
        for case in cases(include_str!("sentences.jsonl")) {
            let reply = utterance::parse(&active(&case), &profile, case["text"].as_str().unwrap());
            for rule in &reply.specs {
                assert_eq!(rule.check(&profile), Ok(()), "{}", case["text"]);
                assert_eq!((rule.id.as_str(), rule.anchor, rule.parser.as_str()), ("", None, "offline"));
                assert_eq!(rule.text, case["text"].as_str().unwrap());
            }
        }
    }
}

#[test]
fn the_reply_reads_back_every_number() {
    for case in cases(include_str!("sentences.jsonl")) {
        let reply = utterance::parse(&active(&case), &Profile::sim(), case["text"].as_str().unwrap());
        for rule in &reply.specs {
            assert!(
                reply.say.contains(&rules::english::read_back(rule)),
                "{} -> {}",
                case["text"],
                reply.say
            );
        }
    }
}

#[test]
fn a_reply_has_the_parts_of_its_outcome_and_no_others() {
    for case in cases(include_str!("sentences.jsonl")) {
        let reply = utterance::parse(&active(&case), &Profile::sim(), case["text"].as_str().unwrap());
        assert_eq!(reply.outcome == Outcome::Accept, !reply.specs.is_empty(), "{}", case["text"]);
        assert_eq!(reply.outcome == Outcome::Clarify, reply.question.is_some(), "{}", case["text"]);
        assert_eq!(reply.outcome == Outcome::Refuse, reply.reason.is_some(), "{}", case["text"]);
        assert!(reply.options.len() <= 4 && !reply.say.is_empty());
        if matches!(reply.outcome, Outcome::Clarify | Outcome::Refuse) {
            assert!(reply.revoked.is_empty());
        }
    }
}

#[test]
fn the_development_cases_reach_their_bar() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/language/dev.jsonl");
    let Ok(text) = std::fs::read_to_string(path) else {
        println!("skipped: {path} is absent");
        return;
    };
    let cases = cases(&text);
    let right = cases.iter().filter(|case| {
        let reply = utterance::parse(&active(case), &Profile::sim(), case["text"].as_str().unwrap());
        case["expect"]["outcome"] == outcome(&reply)
            || list(&case["expect"]["also"]).iter().any(|also| also == outcome(&reply))
    });
    let share = right.count() as f64 / cases.len() as f64;
    assert!(share >= 0.95, "right outcome in {share}");
}
