//! Canonical English: what the robot says it will do, and the short words for a status list.
//!
//! Read back from the rule alone, never from what was said, so that the person hears what will be
//! enforced. Numbers are printed so that they read as the very number that is enforced.

use crate::{Relation, Rule, RuleType};

/// One sentence without its full stop: "I'll keep half a metre from the rug".
#[must_use]
pub fn read_back(rule: &Rule) -> String {
    let deed = match rule.rule_type {
        RuleType::Exclusion => format!("I'll {}", exclusion_deed(rule)),
        RuleType::Kinematic => format!("I'll {}", kinematic_deed(rule)),
    };
    finish(deed, rule)
}

/// A few words for a status list: "no going under the standing desk".
#[must_use]
pub fn status(rule: &Rule) -> String {
    let words = match rule.rule_type {
        RuleType::Exclusion => exclusion_status(rule),
        RuleType::Kinematic => {
            format!("{}{}", limits(rule), place(rule).map(|words| format!(" {words}")).unwrap_or_default())
        }
    };
    finish(words, rule)
}

/// Several rules as one spoken reply, with a full stop after each.
#[must_use]
pub fn read_back_all(rules: &[Rule]) -> String {
    rules.iter().map(|rule| read_back(rule) + ".").collect::<Vec<_>>().join(" ")
}

/// What the fields that were filled in hold: "I took 0.5 m"; none when all was said.
#[must_use]
pub fn taken_defaults(rule: &Rule) -> Option<String> {
    let taken: Vec<String> = rule
        .defaults
        .iter()
        .filter_map(|field| match field.as_str() {
            "buffer_m" => Some(format!("{} m", rule.buffer_m)),
            "vel_max" => rule.vel_max.map(|speed| format!("{speed} m/s")),
            "ang_vel_max" => rule.ang_vel_max.map(|rate| format!("{rate} rad/s")),
            "ttl_s" => rule.ttl_s.map(lifetime),
            _ => None,
        })
        .collect();
    if taken.is_empty() { None } else { Some(format!("I took {}", and_list(&taken))) }
}

/// A distance in words: "half a metre", "1 metre", "0.6096 m".
#[must_use]
pub fn distance(metres: f64) -> String {
    if metres == 0.5 {
        "half a metre".into()
    } else if metres == 1.0 {
        "1 metre".into()
    } else if metres.fract() == 0.0 {
        format!("{metres} metres")
    } else {
        format!("{metres} m")
    }
}

/// A lifetime in the largest unit that reads it exactly: "10 minutes", "90 seconds".
#[must_use]
pub fn lifetime(seconds: u64) -> String {
    for (length_s, unit) in [(86_400, "day"), (3600, "hour"), (60, "minute")] {
        if seconds >= length_s && seconds.is_multiple_of(length_s) {
            let count = seconds / length_s;
            return format!("{count} {unit}{}", if count == 1 { "" } else { "s" });
        }
    }
    format!("{seconds} second{}", if seconds == 1 { "" } else { "s" })
}

/// "a", "a and b", "a, b and c".
#[must_use]
pub fn and_list(items: &[String]) -> String {
    match items {
        [] => String::new(),
        [only] => only.clone(),
        [most @ .., last] => format!("{} and {last}", most.join(", ")),
    }
}

fn exclusion_deed(rule: &Rule) -> String {
    let object = the(rule.phrase());
    let margin = distance(rule.buffer_m);
    let has_margin = rule.buffer_m > 0.0;
    let region = match rule.relation {
        Relation::Near if has_margin => return format!("keep {margin} from {object}"),
        Relation::On if has_margin => return format!("stay off {object} and keep {margin} from it"),
        Relation::Near => return format!("not touch {object}"),
        Relation::On => return format!("stay off {object}"),
        Relation::Global => return "stay off everything".into(),
        _ => region(rule, &object),
    };
    if has_margin { format!("not go {region}, with {margin} to spare") } else { format!("not go {region}") }
}

fn exclusion_status(rule: &Rule) -> String {
    let object = the(rule.phrase());
    match rule.relation {
        Relation::Near if rule.buffer_m > 0.0 => format!("{} from {object}", distance(rule.buffer_m)),
        Relation::Near => format!("no touching {object}"),
        Relation::On if rule.buffer_m > 0.0 => format!("off {object}, {} from it", distance(rule.buffer_m)),
        Relation::On => format!("off {object}"),
        _ if rule.buffer_m > 0.0 => {
            format!("no going {}, {} to spare", region(rule, &object), distance(rule.buffer_m))
        }
        _ => format!("no going {}", region(rule, &object)),
    }
}

fn kinematic_deed(rule: &Rule) -> String {
    let place = place(rule).map(|words| format!(" {words}")).unwrap_or_default();
    if rule.vel_max == Some(0.0) {
        return format!("stop{place} (0 m/s)");
    }
    format!("go {}{place}", limits(rule))
}

/// "at most 0.5 m/s and turn at most 0.4 rad/s".
fn limits(rule: &Rule) -> String {
    let speed = rule.vel_max.map(|speed| format!("at most {speed} m/s"));
    let rate = rule.ang_vel_max.map(|rate| format!("at most {rate} rad/s in turns"));
    match (speed, rate) {
        (Some(speed), Some(rate)) => format!("{speed} and {rate}"),
        (one, other) => one.or(other).unwrap_or_else(|| "without a limit".into()),
    }
}

/// Where a limit holds; none when everywhere.
fn place(rule: &Rule) -> Option<String> {
    let object = the(rule.phrase());
    match rule.relation {
        Relation::Global => None,
        Relation::Near => Some(format!("within {} of {object}", distance(rule.buffer_m))),
        _ if rule.buffer_m > 0.0 => {
            Some(format!("{} and {} around it", region(rule, &object), distance(rule.buffer_m)))
        }
        _ => Some(region(rule, &object)),
    }
}

fn region(rule: &Rule, object: &str) -> String {
    match rule.relation {
        Relation::Near => format!("near {object}"),
        Relation::On => format!("on {object}"),
        Relation::Beneath => format!("under {object}"),
        Relation::Between => {
            format!("between {object} and {}", the(rule.obj2.as_deref().unwrap_or("nothing")))
        }
        Relation::Beyond => format!("past {object}"),
        Relation::LeftOf => format!("to the left of {object}"),
        Relation::RightOf => format!("to the right of {object}"),
        Relation::FrontOf => format!("in front of {object}"),
        Relation::Behind => format!("behind {object}"),
        Relation::Global => "anywhere".into(),
    }
}

fn finish(mut words: String, rule: &Rule) -> String {
    if !rule.except.is_empty() {
        let names: Vec<String> = rule.except.iter().map(|name| the(name)).collect();
        words.push_str(&format!(", except {}", and_list(&names)));
    }
    if let Some(ttl_s) = rule.ttl_s {
        words.push_str(&format!(", for {}", lifetime(ttl_s)));
    }
    words
}

/// The phrase with an article, unless it brings its own determiner or is a name of a person.
fn the(phrase: &str) -> String {
    const OWN_DETERMINER: [&str; 20] = [
        "the",
        "a",
        "an",
        "any",
        "all",
        "every",
        "each",
        "my",
        "your",
        "our",
        "his",
        "her",
        "their",
        "its",
        "this",
        "that",
        "these",
        "those",
        "everything",
        "everyone",
    ];
    let first = phrase.split_whitespace().next().unwrap_or_default();
    if OWN_DETERMINER.contains(&first) || ["me", "you", "people", "anyone", "someone"].contains(&phrase) {
        phrase.to_owned()
    } else {
        format!("the {phrase}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[track_caller]
    fn check(rule: &Rule, spoken: &str, short: &str) {
        assert_eq!(read_back(rule), spoken);
        assert_eq!(status(rule), short);
    }

    #[test]
    fn exclusions_read_back_in_one_sentence() {
        let rug = Rule { buffer_m: 0.5, ..Rule::exclusion(Relation::Near, "rug") };
        check(&rug, "I'll keep half a metre from the rug", "half a metre from the rug");
        let desk = Rule::exclusion(Relation::Beneath, "standing desk");
        check(&desk, "I'll not go under the standing desk", "no going under the standing desk");
        let gap =
            Rule { obj2: Some("tv".into()), ttl_s: Some(600), ..Rule::exclusion(Relation::Between, "sofa") };
        check(
            &gap,
            "I'll not go between the sofa and the tv, for 10 minutes",
            "no going between the sofa and the tv, for 10 minutes",
        );
        let rooms = Rule { except: vec!["office".into()], ..Rule::exclusion(Relation::On, "room") };
        check(&rooms, "I'll stay off the room, except the office", "off the room, except the office");
    }

    #[test]
    fn limits_read_back_with_their_place() {
        let crib = Rule {
            vel_max: Some(0.5),
            ang_vel_max: Some(0.4),
            buffer_m: 1.0,
            ..Rule::kinematic(Relation::Near, "baby's crib")
        };
        check(
            &crib,
            "I'll go at most 0.5 m/s and at most 0.4 rad/s in turns within 1 metre of the baby's crib",
            "at most 0.5 m/s and at most 0.4 rad/s in turns within 1 metre of the baby's crib",
        );
        let everywhere = Rule { vel_max: Some(0.5), ..Rule::kinematic(Relation::Global, "") };
        check(&everywhere, "I'll go at most 0.5 m/s", "at most 0.5 m/s");
    }

    #[test]
    fn lifetimes_use_the_largest_exact_unit() {
        assert_eq!(lifetime(3600), "1 hour");
        assert_eq!(lifetime(5400), "90 minutes");
        assert_eq!(lifetime(61), "61 seconds");
    }

    #[test]
    fn what_was_filled_in_is_said() {
        let rule = Rule {
            buffer_m: 0.5,
            defaults: vec!["buffer_m".into()],
            ..Rule::exclusion(Relation::Near, "rug")
        };
        assert_eq!(taken_defaults(&rule).as_deref(), Some("I took 0.5 m"));
        assert_eq!(taken_defaults(&Rule::exclusion(Relation::On, "rug")), None);
    }

    fn numbers(text: &str) -> Vec<f64> {
        let text = text.replace("half a metre", "0.5");
        text.split(|c: char| !c.is_ascii_digit() && c != '.').filter_map(|word| word.parse().ok()).collect()
    }

    proptest! {
        #[test]
        fn every_number_is_read_back_exactly(
            buffer in 1..50_000u32, speed in 1..15_000u32, rate in 1..10_000u32, ttl_s in 1..100_000u64,
        ) {
            let (buffer_m, speed) = (f64::from(buffer) / 1e4, f64::from(speed) / 1e4);
            let rate = f64::from(rate) / 1e4;
            let rule = Rule {
                buffer_m, vel_max: Some(speed), ang_vel_max: Some(rate), ttl_s: Some(ttl_s),
                ..Rule::kinematic(Relation::Near, "bed")
            };
            for words in [read_back(&rule), status(&rule)] {
                let found = numbers(&words);
                for number in [buffer_m, speed, rate] {
                    prop_assert!(found.contains(&number), "{number} in {words}");
                }
                let last = *found.last().unwrap();
                prop_assert!([1.0, 60.0, 3600.0, 86_400.0].iter().any(|unit| last * unit == ttl_s as f64));
            }
        }
    }
}
