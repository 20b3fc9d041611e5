//! How long a parse takes: the tests' sentences, and texts of 500 characters.
//!
//! `cargo run --release -p heedway-utterance --example measure`; prints microseconds, judges nothing.
#![allow(clippy::print_stdout, clippy::disallowed_methods, reason = "it measures and prints")]

use std::error::Error;
use std::time::Instant;

use geometry::Profile;
use rules::Rule;
use serde_json::Value;

/// How often each text is parsed; its fastest time counts, so that other work on the host does not.
const N_RUNS: usize = 5;

fn main() -> Result<(), Box<dyn Error>> {
    let files = [include_str!("../tests/sentences.jsonl"), include_str!("../tests/speakers.jsonl")];
    let mut cases: Vec<(Vec<Rule>, String)> = Vec::new();
    for line in files.iter().flat_map(|file| file.lines()) {
        let case: Value = serde_json::from_str(line)?;
        let context = case["context"].as_array().cloned().unwrap_or_default();
        let active = context
            .into_iter()
            .map(|entry| serde_json::from_value(entry["active"].clone()))
            .collect::<Result<_, _>>()?;
        cases.push((active, case["text"].as_str().unwrap_or_default().to_owned()));
    }
    let profile = Profile::sim();
    // The tables are read at the first use.
    let _ = utterance::parse(&[], &profile, "avoid the rug");
    let long: Vec<(Vec<Rule>, String)> = cases
        .windows(30)
        .map(|window| {
            let joined: Vec<&str> = window.iter().map(|(_, text)| text.as_str()).collect();
            (Vec::new(), joined.join(". ").chars().take(500).collect())
        })
        .collect();
    report("sentences", &cases, &profile);
    report("500 characters", &long, &profile);
    Ok(())
}

fn report(name: &str, cases: &[(Vec<Rule>, String)], profile: &Profile) {
    let fastest_us = |(active, text): &(Vec<Rule>, String)| {
        let run = |_| {
            let start = Instant::now();
            let reply = utterance::parse(active, profile, text);
            let elapsed = start.elapsed();
            assert!(!reply.say.is_empty());
            elapsed.as_secs_f64() * 1e6
        };
        (0..N_RUNS).map(run).fold(f64::INFINITY, f64::min)
    };
    let mut times_us: Vec<f64> = cases.iter().map(fastest_us).collect();
    times_us.sort_by(f64::total_cmp);
    let at =
        |share: f64| times_us.get(((times_us.len() - 1) as f64 * share) as usize).copied().unwrap_or(0.0);
    println!(
        "{name}: {} texts, median {:.0} us, p99 {:.0} us, worst {:.0} us",
        cases.len(),
        at(0.5),
        at(0.99),
        at(1.0)
    );
}
