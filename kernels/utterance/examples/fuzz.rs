//! Parses a million made-up inputs, to see that none ends the program and each gives a sound reply.
//!
//! `cargo run --release -p heedway-utterance --example fuzz -- 1000000 7` (how many, and the seed). Three
//! kinds: words of the tests' sentences shuffled, sentences cut and glued, and characters of all sorts.
#![allow(clippy::print_stdout, clippy::disallowed_methods, reason = "it measures and prints")]

use std::time::Instant;

use geometry::Profile;
use rules::{Outcome, Relation, Rule};

/// Splitmix64: small, and the same everywhere.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }

    fn pick<'a>(&mut self, list: &[&'a str]) -> &'a str {
        let idx = self.below(list.len());
        list.get(idx).copied().unwrap_or_default()
    }
}

fn main() {
    let mut arguments = std::env::args().skip(1).filter_map(|argument| argument.parse::<u64>().ok());
    let n_inputs = arguments.next().unwrap_or(1_000_000);
    let mut random = Random(arguments.next().unwrap_or(7));
    let files =
        [include_str!("../tests/sentences.jsonl"), include_str!("../tests/speakers.jsonl")].join("\n");
    let texts: Vec<&str> =
        files.split("\"text\": \"").skip(1).filter_map(|rest| rest.split('"').next()).collect();
    let words: Vec<&str> = texts.iter().flat_map(|text| text.split(' ')).collect();
    let profile = Profile::sim();
    let near = Rule { id: "s1".into(), buffer_m: 0.3, ..Rule::exclusion(Relation::Near, "lamp") };
    let limit = Rule { id: "s2".into(), vel_max: Some(0.8), ..Rule::kinematic(Relation::Global, "") };
    let active = [near, limit];
    let start = Instant::now();
    let mut n_accepted = 0_u64;
    for _ in 0..n_inputs {
        let text = input(&mut random, &texts, &words);
        let reply = utterance::parse(&active, &profile, &text);
        assert!(!reply.say.is_empty(), "{text:?}");
        for rule in &reply.specs {
            assert_eq!(rule.check(&profile), Ok(()), "{text:?}");
        }
        assert!(reply.revoked.iter().all(|id| active.iter().any(|rule| rule.id == *id)), "{text:?}");
        n_accepted += u64::from(reply.outcome == Outcome::Accept);
    }
    let seconds = start.elapsed().as_secs_f64();
    println!("{n_inputs} inputs in {seconds:.0} s, {n_accepted} accepted, none ended the program");
}

fn input(random: &mut Random, texts: &[&str], words: &[&str]) -> String {
    match random.below(3) {
        0 => {
            let n_words = 1 + random.below(18);
            (0..n_words).map(|_| random.pick(words)).collect::<Vec<_>>().join(" ")
        }
        1 => {
            let cut = |random: &mut Random| -> String {
                let text = random.pick(texts);
                let (from, n) = (random.below(text.len()), 1 + random.below(60));
                text.chars().skip(from / 2).take(n).collect()
            };
            format!(
                "{}{}{}",
                cut(random),
                random.pick(&[" ", ", ", ". ", " and ", " but ", "\n"]),
                cut(random)
            )
        }
        _ => {
            let n_chars = random.below(120);
            let character = |random: &mut Random| match random.below(4) {
                0 => char::from(u8::try_from(random.below(128)).unwrap_or(b' ')),
                1 => char::from_u32((random.next() % 0x3000) as u32).unwrap_or('\u{fffd}'),
                2 => char::from_u32((random.next() % 0x0011_0000) as u32).unwrap_or('\''),
                _ => random
                    .pick(&[" ", "'", "-", ".", ",", "1", "m", "%", "/", "s"])
                    .chars()
                    .next()
                    .unwrap_or(' '),
            };
            (0..n_chars).map(|_| character(random)).collect()
        }
    }
}
