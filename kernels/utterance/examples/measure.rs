//! How long a parse takes: the tests' sentences, texts of 500 characters, and texts made to be slow.
//!
//! `cargo run --release -p heedway-utterance --example measure`; prints microseconds, judges nothing. The
//! slow texts are found by trying: every run of one to four words of the tests' sentences, repeated up to
//! 500 characters, and random mixtures of the slowest.
#![allow(clippy::print_stdout, clippy::disallowed_methods, reason = "it measures and prints")]

use std::collections::BTreeSet;
use std::error::Error;
use std::time::Instant;

use geometry::Profile;
use rules::Rule;
use serde_json::Value;

/// How often each text is parsed; its fastest time counts, so that other work on the host does not.
const N_RUNS: usize = 5;
/// Length of the long texts, characters.
const N_CHARS: usize = 500;
/// Most repeated phrases that are tried, spread over all there are.
const N_PHRASES_MAX: usize = 6000;

type Case = (Vec<Rule>, String);

fn main() -> Result<(), Box<dyn Error>> {
    let files = [include_str!("../tests/sentences.jsonl"), include_str!("../tests/speakers.jsonl")];
    let mut cases: Vec<Case> = Vec::new();
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
    let _ = utterance::parse(&[], &profile, "aviod the rgu somehow");
    let long: Vec<Case> = cases
        .windows(30)
        .map(|window| {
            let joined: Vec<&str> = window.iter().map(|(_, text)| text.as_str()).collect();
            (Vec::new(), joined.join(". ").chars().take(N_CHARS).collect())
        })
        .collect();
    report("sentences", &cases, &profile);
    report("500 characters", &long, &profile);
    report("500 characters, made to be slow", &slow_texts(&cases, &profile), &profile);
    Ok(())
}

/// Phrases repeated, and mixtures of the slowest of them.
fn slow_texts(cases: &[Case], profile: &Profile) -> Vec<Case> {
    let mut phrases = BTreeSet::new();
    for (_, text) in cases {
        let words: Vec<&str> = text.split_whitespace().collect();
        (1..=4).for_each(|n| phrases.extend(words.windows(n).map(|run| run.join(" "))));
    }
    let step = (phrases.len() / N_PHRASES_MAX).max(1);
    let filled = |phrase: &str| {
        let text: String = format!("{phrase} ").chars().cycle().take(N_CHARS).collect();
        (Vec::new(), text)
    };
    let mut timed: Vec<(f64, Case)> = phrases
        .iter()
        .step_by(step)
        .map(|phrase| filled(phrase))
        .map(|case| (fastest_us(&case, profile, 2), case))
        .collect();
    timed.sort_by(|a, b| b.0.total_cmp(&a.0));
    timed.truncate(200);
    let head = |text: &str| text.chars().take(60).collect::<String>();
    let mixed: Vec<Case> = timed
        .windows(8)
        .map(|window| {
            let parts: Vec<String> = window.iter().map(|(_, (_, text))| head(text)).collect();
            (Vec::new(), parts.join(" ").chars().take(N_CHARS).collect())
        })
        .collect();
    timed.into_iter().map(|(_, case)| case).chain(mixed).collect()
}

fn fastest_us((active, text): &Case, profile: &Profile, n_runs: usize) -> f64 {
    let run = |_| {
        let start = Instant::now();
        let reply = utterance::parse(active, profile, text);
        let elapsed = start.elapsed();
        assert!(!reply.say.is_empty());
        elapsed.as_secs_f64() * 1e6
    };
    (0..n_runs).map(run).fold(f64::INFINITY, f64::min)
}

fn report(name: &str, cases: &[Case], profile: &Profile) {
    let mut timed: Vec<(f64, &str)> =
        cases.iter().map(|case| (fastest_us(case, profile, N_RUNS), case.1.as_str())).collect();
    timed.sort_by(|a, b| a.0.total_cmp(&b.0));
    let at = |share: f64| {
        timed.get(((timed.len().saturating_sub(1)) as f64 * share) as usize).copied().unwrap_or((0.0, ""))
    };
    println!(
        "{name}: {} texts, median {:.0} us, p99 {:.0} us, worst {:.0} us: {:?}",
        cases.len(),
        at(0.5).0,
        at(0.99).0,
        at(1.0).0,
        at(1.0).1.chars().take(60).collect::<String>()
    );
}
