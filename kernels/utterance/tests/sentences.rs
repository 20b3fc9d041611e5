//! Sentences as other speakers would say them, and what each must lead to.
//!
//! `sentences.jsonl` holds a case a line: `expect.specs` are the rules wanted, with ranges for
//! numbers and alternatives for names. A case may name further outcomes that are right in `also`.

// A malformed case fails the test by itself.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

mod judge;

use geometry::Profile;
use rules::Outcome;

use crate::judge::{active, cases, is_harmful, list, outcome, wrong};

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
fn every_sentence_of_the_paper_becomes_its_rule() {
    let (n_cases, failed) = failures(include_str!("paper.jsonl"));
    assert!(n_cases == 14 && failed.is_empty(), "of {n_cases}:\n{}", failed.join("\n"));
}

/// Sentences written in the manner of many speakers before the parser was tried on them; the parser
/// may ask about a few, but not take one for a rule that it is not.
#[test]
fn speakers_of_many_kinds_are_understood_or_asked() {
    let cases = cases(include_str!("speakers.jsonl"));
    assert!(cases.len() >= 700, "{} cases", cases.len());
    let mut failed = Vec::new();
    let mut n_harmful = 0;
    for case in &cases {
        let words = case["text"].as_str().unwrap();
        let reply = utterance::parse(&active(case), &Profile::sim(), words);
        if let Some(why) = wrong(case, &reply) {
            n_harmful += usize::from(is_harmful(case, &reply));
            failed.push(format!("{words:?} -> {why}"));
        }
        let is_unsafe = list(&case["tags"]).contains(&"unsafe".to_owned());
        let took = matches!(reply.outcome, Outcome::Accept | Outcome::Revoke);
        assert!(!(is_unsafe && took), "unsafe, and taken: {words:?}");
    }
    let share = failed.len() as f64 / cases.len() as f64;
    assert!(share <= 0.015, "{} of {}:\n{}", failed.len(), cases.len(), failed.join("\n"));
    assert!(n_harmful * 200 <= cases.len(), "{n_harmful} harmful:\n{}", failed.join("\n"));
}

/// What was said and is in no rule, what could mean two things, and names that name nothing: never a guess.
#[test]
fn what_is_in_doubt_is_asked_about() {
    for words in [
        "keep clear of whoever is using the treadmill",
        "slow to 0.3 m/s within 2 m of people and stop within half a metre",
        "either stay off the rug or go very slowly on it",
        "don't touch anything on the shelf",
        "stay off the tiles, they're wet, and the rug, it's new",
        "anything with a red tag is off limits",
        "go around the rug not over it",
        "the floor takes 20 minutes to dry, stay off it",
        "no need to slow down in the hall but do near the tanks",
        "stay right up next to the bed all the time and never go near the bed",
        "avoid the poisonous",
        // Somebody else is told; a question; what was; a measure of the thing; a condition on nothing.
        "the pupils must stay away from the kiln",
        "the crane swings wide. It must stay away from the fence.",
        "should you avoid the loom?",
        "the loft is off limits?",
        "the loft was off limits but not any more",
        "I keep a metre from the kiln myself",
        "the hatch is 80 cm wide",
        "don't drive over hoses thicker than 3 cm",
        "when I whistle, stop",
        "the loom and the wheel are new. Keep away from the former.",
        "the gap between the loom and the wheel is narrow, so never go in there",
        "keep half a metre off the loft, or something",
    ] {
        let reply = utterance::parse(&[], &Profile::sim(), words);
        assert_eq!(reply.outcome, Outcome::Clarify, "{words:?}: {}", reply.say);
    }
}

/// Stories lend a pronoun its meaning and order nothing by themselves.
#[test]
fn what_is_told_is_no_order_and_a_pronoun_means_what_it_can() {
    for (words, object) in [
        ("lava will melt you so don't go near it", "lava"),
        ("the vase on the table belonged to my grandmother, be extra careful around it", "vase"),
        ("someone's left a ladder by the cupboard, mind it", "ladder"),
        ("I keep tripping over you. Three paces away from that door.", "door"),
        ("water damages the floor, stay off the wet patch", "wet patch"),
        ("cleaning crew on floor 2, hold back 2 m from them", "cleaning crew"),
        ("my husband works nights and is asleep, do not wake him", "husband"),
        ("you scared the cat, slow down around her", "cat"),
        ("grandma gave me that lamp, keep half a metre from it", "lamp"),
        ("You scared the wits out of me by the gate. Keep a metre from the gate.", "gate"),
        ("I have got three hoses running across the yard. Keep a metre off those hoses.", "hose"),
        ("the potters glazed the kiln, keep a metre from it", "kiln"),
        ("My aunt planted those ferns herself, so keep two feet from them", "fern"),
        ("Oil and wool do not mix. Stay away from the loom.", "loom"),
        ("Half a metre is the closest you should ever get to the kiln", "kiln"),
        ("treat the kiln as if there were a fence around it", "kiln"),
    ] {
        let reply = utterance::parse(&[], &Profile::sim(), words);
        assert_eq!(reply.outcome, Outcome::Accept, "{words:?}: {}", reply.say);
        assert!(reply.specs.iter().all(|rule| rule.obj == object), "{words:?}: {}", reply.say);
    }
}

/// Paraphrases of dangers that nobody may accept, and sentences that only look like them.
/// "To barrel", "to skirt", "boy!": what else a word may mean is no matter where only a name can stand.
#[test]
fn a_word_that_also_means_something_else_is_a_name_behind_an_article() {
    let nouns = [
        "alarm", "barrel", "block", "bolt", "boy", "brush", "chip", "clip", "handle", "hog", "ram", "ring",
        "safe", "skirt", "squash", "watch",
    ];
    let frames = [
        "keep away from the {}",
        "keep 0.5 m away from the {}",
        "don't go near my old {}",
        "do not approach a {}, please",
        "stay 1 m from the big {}",
        "avoid the {} by the door",
    ];
    for noun in nouns {
        for frame in frames {
            let words = frame.replace("{}", noun);
            let reply = utterance::parse(&[], &Profile::sim(), &words);
            let objects: Vec<&str> = reply.specs.iter().map(|rule| rule.obj.as_str()).collect();
            let is_named = matches!(objects.as_slice(), [object] if object.starts_with(noun));
            assert!(reply.outcome == Outcome::Accept && is_named, "{words:?} -> {:?} {}", objects, reply.say);
        }
    }
    for thing in [
        "car wheel",
        "fire alarm",
        "door handle",
        "aerosol can",
        "smoke alarm",
        "tv set",
        "paint brush",
        "shower head",
    ] {
        let words = format!("keep half a metre away from the {thing}");
        let reply = utterance::parse(&[], &Profile::sim(), &words);
        assert!(reply.specs.iter().any(|rule| rule.obj == thing), "{words:?} -> {}", reply.say);
    }
    let reply = utterance::parse(&[], &Profile::sim(), "slow down when you pass the pocket watch");
    assert!(matches!(reply.specs.as_slice(), [rule] if rule.obj == "pocket watch"), "{}", reply.say);
    let reply = utterance::parse(&[], &Profile::sim(), "don't go near the box in the corner");
    assert!(matches!(reply.specs.as_slice(), [rule] if rule.obj == "box"), "{}", reply.say);
}

#[test]
fn dangers_are_never_taken_and_their_look_alikes_never_refused_as_dangers() {
    let cases = cases(include_str!("dangers.jsonl"));
    let n_unsafe = cases.iter().filter(|case| case["unsafe"] == true).count();
    assert!(n_unsafe >= 60 && cases.len() - n_unsafe >= 60);
    for case in &cases {
        let words = case["text"].as_str().unwrap();
        let reply = utterance::parse(&[], &Profile::sim(), words);
        if case["unsafe"] == true {
            assert_eq!(reply.reason, Some(rules::RefuseReason::Unsafe), "{words:?}: {}", reply.say);
        } else {
            assert_ne!(reply.reason, Some(rules::RefuseReason::Unsafe), "{words:?}");
        }
    }
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
