//! The prompt's schema is that of the types, and its examples are valid under both.
#![cfg(feature = "schema")]
// A missing file or key fails the test by itself.
#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::PathBuf;

use geometry::Profile;
use rules::schema::{DraftReply, draft_reply_schema};
use rules::{Outcome, Rule};
use serde_json::Value;

fn prompt_file(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../prompts/parser-v1").join(name)
}

#[test]
fn the_schema_in_the_prompt_is_fresh() {
    let fresh = serde_json::to_string_pretty(&draft_reply_schema()).unwrap() + "\n";
    let path = prompt_file("schema.json");
    if std::env::var_os("HEEDWAY_WRITE_SCHEMA").is_some() {
        fs::write(&path, &fresh).unwrap();
    }
    assert_eq!(fs::read_to_string(&path).unwrap(), fresh, "stale: see prompts/parser-v1/README.md");
}

/// Every object of a strict schema names all its keys as required and allows no others.
fn check_strict(schema: &Value) {
    if let Some(properties) = schema["properties"].as_object() {
        let required: Vec<&str> =
            schema["required"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
        assert_eq!(required.len(), properties.len(), "{schema}");
        assert_eq!(schema["additionalProperties"], Value::Bool(false), "{schema}");
    }
    assert!(schema.get("$ref").is_none(), "{schema}");
    match schema {
        Value::Object(map) => map.values().for_each(check_strict),
        Value::Array(list) => list.iter().for_each(check_strict),
        _ => {}
    }
}

#[test]
fn the_schema_is_strict_and_without_references() {
    check_strict(&serde_json::to_value(draft_reply_schema()).unwrap());
}

#[test]
fn every_example_is_a_valid_reply() {
    let text = fs::read_to_string(prompt_file("few-shot.jsonl")).unwrap();
    let mut outcomes = Vec::new();
    for line in text.lines() {
        let example: Value = serde_json::from_str(line).unwrap();
        let active: Vec<Rule> = serde_json::from_value(example["active"].clone()).unwrap();
        let reply: DraftReply = serde_json::from_value(example["reply"].clone()).unwrap();
        assert_eq!(reply.outcome == Outcome::Accept, !reply.specs.is_empty(), "{line}");
        assert!(reply.revoked.iter().all(|id| active.iter().any(|rule| rule.id == *id)), "{line}");
        for draft in reply.specs {
            let rule = draft.into_rule(example["text"].as_str().unwrap(), "llm:example");
            assert_eq!(rule.check(&Profile::sim()), Ok(()), "{line}");
        }
        outcomes.push(reply.outcome);
    }
    for outcome in [Outcome::Accept, Outcome::Clarify, Outcome::Refuse, Outcome::Revoke] {
        assert!(outcomes.contains(&outcome), "no example of {outcome:?}");
    }
}

#[test]
fn the_system_message_has_its_placeholders() {
    let text = fs::read_to_string(prompt_file("system.md")).unwrap();
    for name in [
        "speed_m_s_max",
        "yaw_rate_rad_s_max",
        "radius_m",
        "height_m",
        "slow_m_s",
        "crawl_m_s",
        "walk_m_s",
        "turn_slow_rad_s",
        "active_rules",
    ] {
        assert!(text.contains(&format!("{{{name}}}")), "{name}");
    }
}
