//! Parses JSON lines `{"id","context":[active rules],"text"}` from standard input, for measuring.
//!
//! Prints `{"id","outcome","specs","revoked","question","say"}` a line. A context entry is a rule, or
//! `{"active": rule}`. The robot is the simulated one, or `turtlebot2` as the only argument.
#![allow(clippy::print_stdout)]

use std::error::Error;
use std::io::BufRead;

use geometry::Profile;
use rules::Rule;
use serde_json::{Value, json};

fn main() -> Result<(), Box<dyn Error>> {
    let profile = match std::env::args().nth(1).as_deref() {
        Some("turtlebot2") => Profile::turtlebot2(),
        _ => Profile::sim(),
    };
    for line in std::io::stdin().lock().lines() {
        let case: Value = serde_json::from_str(&line?)?;
        let context = case["context"].as_array().cloned().unwrap_or_default();
        let active: Vec<Rule> = context
            .into_iter()
            .map(|entry| serde_json::from_value(entry.get("active").cloned().unwrap_or(entry)))
            .collect::<Result<_, _>>()?;
        let reply = utterance::parse(&active, &profile, case["text"].as_str().unwrap_or_default());
        println!(
            "{}",
            json!({"id": case["id"], "outcome": reply.outcome, "specs": reply.specs, "revoked": reply.revoked,
                   "question": reply.question, "say": reply.say})
        );
    }
    Ok(())
}
