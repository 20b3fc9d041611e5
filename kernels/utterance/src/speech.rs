//! What part of speech a word can be: where a name ends, and which "names" are none.
//!
//! `speech.txt` lists the common words that are never nouns. Any other word may name a thing: the
//! vocabulary of objects stays open.

use std::collections::HashMap;
use std::sync::LazyLock;

/// What a word is, as far as a name is concerned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Speech {
    /// A noun, or a word we do not know.
    MayName,
    /// A finite verb, never a noun: "belonged", "keeps".
    Verb,
    /// A participle that may stand before a noun or after one: "painted", "folding".
    Participle,
    /// An adverb: "recently".
    Adverb,
    /// An adjective that names nothing by itself: "poisonous".
    Adjective,
}

static TABLE: LazyLock<HashMap<&'static str, Speech>> = LazyLock::new(|| {
    let mut table = HashMap::new();
    let mut section = Speech::MayName;
    for line in include_str!("speech.txt").lines().filter(|line| !line.starts_with('#')) {
        match line.trim() {
            "[verbs]" => section = Speech::Verb,
            "[adverbs]" => section = Speech::Adverb,
            "[adjectives]" => section = Speech::Adjective,
            words => table.extend(words.split_whitespace().map(|word| (word, form(section, word)))),
        }
    }
    table
});

/// Past participles that do not end in "ed", and present ones that WordNet also has as nouns.
const PARTICIPLES: [&str; 62] = [
    "broken",
    "spilt",
    "made",
    "kept",
    "left",
    "built",
    "hung",
    "laid",
    "stuck",
    "bent",
    "torn",
    "worn",
    "frozen",
    "drawn",
    "thrown",
    "hidden",
    "written",
    "given",
    "taken",
    "lit",
    "caught",
    "sold",
    "bought",
    "brought",
    "found",
    "held",
    "lost",
    "shut",
    "set",
    "fallen",
    "lying",
    "laying",
    "sitting",
    "standing",
    "walking",
    "running",
    "playing",
    "crawling",
    "hanging",
    "leaning",
    "working",
    "talking",
    "coming",
    "going",
    "eating",
    "waiting",
    "moving",
    "flashing",
    "dripping",
    "leaking",
    "sticking",
    "wearing",
    "holding",
    "carrying",
    "using",
    "facing",
    "pushing",
    "riding",
    "kneeling",
    "living",
    "belonging",
    "trailing",
];

fn form(section: Speech, word: &str) -> Speech {
    let participle = word.ends_with("ed") || word.ends_with("ing") || PARTICIPLES.contains(&word);
    if section == Speech::Verb && participle { Speech::Participle } else { section }
}

/// What the word can be.
#[must_use]
pub fn speech(word: &str) -> Speech {
    if PARTICIPLES.contains(&word) {
        return Speech::Participle;
    }
    TABLE.get(word).copied().unwrap_or(Speech::MayName)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_that_name_nothing_are_told_from_names() {
        for (word, kind) in [
            ("rug", Speech::MayName),
            ("zorb", Speech::MayName),
            ("building", Speech::MayName),
            ("belonged", Speech::Participle),
            ("grew", Speech::Verb),
            ("become", Speech::Verb),
            ("recently", Speech::Adverb),
            ("poisonous", Speech::Adjective),
            ("lying", Speech::Participle),
        ] {
            assert_eq!(speech(word), kind, "{word}");
        }
    }
}
