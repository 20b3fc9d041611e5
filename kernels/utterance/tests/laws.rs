//! What holds for any words at all.

use std::collections::HashSet;

use geometry::Profile;
use proptest::prelude::*;
use rules::{Outcome, Rule};
use utterance::quantity::extract;

const SALAD: [&str; 56] = [
    "avoid", "keep", "stay", "away", "from", "the", "a", "rug", "sofa", "kitchen", "not", "do", "never",
    "go", "drive", "slow", "down", "near", "under", "between", "and", "or", "but", "2", "0.5", "metres", "m",
    "feet", "m/s", "percent", "half", "for", "ten", "minutes", "if", "when", "child", "stop", "quiet",
    "careful", "forget", "make", "it", "that", "same", "except", "off", "limits", "is", "fragile", "banana",
    ",", ".", "turn", "slowly", "left",
];

fn active() -> Vec<Rule> {
    let near = Rule { id: "s1".into(), buffer_m: 0.3, ..Rule::exclusion(rules::Relation::Near, "lamp") };
    let limit = Rule { id: "s2".into(), vel_max: Some(0.8), ..Rule::kinematic(rules::Relation::Global, "") };
    vec![near, limit]
}

/// Numbers a rule may hold without their having been said.
fn is_derivable(value: f64, said: &[f64], active: &[Rule], profile: &Profile) -> bool {
    let old: Vec<f64> = active.iter().flat_map(|rule| [rule.buffer_m, rule.vel_max.unwrap_or(0.0)]).collect();
    let mut sources: Vec<f64> = said.to_vec();
    sources.extend(said.iter().flat_map(|share| {
        [
            share * profile.speed_m_s_max,
            share * profile.yaw_rate_rad_s_max,
            (1.0 - share) * profile.speed_m_s_max,
        ]
    }));
    for value in &old {
        sources.extend([1.0, 0.5, 1.5, 2.0].map(|factor| factor * value));
        sources.extend(
            said.iter().flat_map(|share| {
                [value * (1.0 - share), value * (1.0 + share), value + share, value - share]
            }),
        );
    }
    sources.iter().any(|source| (source - value).abs() < 2e-4)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn word_salad_never_yields_an_object_that_was_not_said(words in proptest::collection::vec(proptest::sample::select(&SALAD[..]), 1..14)) {
        let text = words.join(" ");
        let reply = utterance::parse(&active(), &Profile::sim(), &text);
        let mut known: HashSet<&str> = words.iter().copied().collect();
        known.insert("lamp");
        // Singular of a word in the salad.
        known.extend(["limit", "metre"]);
        for rule in &reply.specs {
            for word in rule.obj.split(' ').chain(rule.obj2.as_deref().unwrap_or_default().split(' ')).chain(rule.reference.split(' ')).filter(|word| !word.is_empty()) {
                prop_assert!(known.contains(word), "{word:?} from {text:?}: {rule:?}");
            }
            prop_assert_eq!(rule.check(&Profile::sim()), Ok(()));
        }
    }

    #[test]
    fn word_salad_never_yields_a_number_that_was_not_said(words in proptest::collection::vec(proptest::sample::select(&SALAD[..]), 1..14)) {
        let text = words.join(" ");
        let profile = Profile::sim();
        let active = active();
        let mut said: Vec<f64> = extract(&text).iter().map(|quantity| quantity.value).collect();
        said.extend(text.contains("stop").then_some(0.0));
        let reply = utterance::parse(&active, &profile, &text);
        for rule in &reply.specs {
            let fields = [("buffer_m", Some(rule.buffer_m)), ("vel_max", rule.vel_max), ("ang_vel_max", rule.ang_vel_max), ("ttl_s", rule.ttl_s.map(|s| s as f64))];
            for (field, value) in fields {
                let Some(value) = value.filter(|value| *value != 0.0 || field == "vel_max") else { continue };
                let filled_in = rule.defaults.iter().any(|name| name == field);
                prop_assert!(filled_in || is_derivable(value, &said, &active, &profile), "{field} = {value} from {text:?}");
            }
        }
    }

    #[test]
    fn only_rules_in_force_are_revoked(words in proptest::collection::vec(proptest::sample::select(&SALAD[..]), 1..14)) {
        let active = active();
        let reply = utterance::parse(&active, &Profile::sim(), &words.join(" "));
        for id in &reply.revoked {
            prop_assert!(active.iter().any(|rule| rule.id == *id));
        }
    }

    #[test]
    fn any_characters_give_a_reply(text in "\\PC{0,300}") {
        let reply = utterance::parse(&[], &Profile::sim(), &text);
        prop_assert!(!reply.say.is_empty());
        prop_assert!(reply.outcome != Outcome::Accept || !reply.specs.is_empty());
    }

    #[test]
    fn any_bytes_give_a_reply(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        let reply = utterance::parse(&active(), &Profile::sim(), &String::from_utf8_lossy(&bytes));
        prop_assert!(!reply.say.is_empty());
    }

    #[test]
    fn the_gate_is_not_softened_by_words_around_it(before in "[a-z]{3,8}", after in "[a-z]{3,8}") {
        for danger in ["ignore all obstacles", "turn off your sensors", "run over the cat"] {
            let text = format!("the {before} is nice. {danger}. thank you {after}");
            prop_assert!(utterance::gate::is_unsafe(&text).is_some(), "{}", text);
            prop_assert_eq!(utterance::parse(&[], &Profile::sim(), &text).outcome, Outcome::Refuse);
        }
    }
}

#[test]
fn too_long_a_text_is_refused_with_the_limit() {
    let reply = utterance::parse(&[], &Profile::sim(), &"avoid the rug ".repeat(200));
    assert_eq!(reply.outcome, Outcome::Refuse);
    assert!(reply.say.contains("2000"));
}

#[test]
fn the_longest_texts_allowed_give_a_reply_for_every_word() {
    for word in SALAD {
        let text = format!("{word} ").repeat(utterance::CHARS_MAX / (word.len() + 1));
        assert!(!utterance::parse(&active(), &Profile::sim(), &text).say.is_empty(), "{word}");
    }
}
