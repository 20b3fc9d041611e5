//! Names of things: the class noun behind a phrase, and which names mean one thing.
//!
//! The vocabulary is open: any words may name an object. The tables of `nouns.toml` only inform.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::LazyLock;

/// Something an utterance points at.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub struct Name {
    /// Class noun, lower case, singular; empty for a pronoun.
    pub obj: String,
    /// The whole phrase as spoken, without its leading article.
    pub reference: String,
    /// "it", "that", "there": what was meant is said elsewhere.
    pub is_pronoun: bool,
    /// "every", "all", "any": an exception may follow with "but".
    pub is_universal: bool,
    /// Words in the phrase before any "by the window".
    pub n_words: usize,
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    synonyms: Vec<Vec<String>>,
    irregular: BTreeMap<String, String>,
    lists: Lists,
}

#[derive(Default, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Lists {
    keep_plural: HashSet<String>,
    adjectives: HashSet<String>,
    parts: HashSet<String>,
    places: HashSet<String>,
    boundaries: HashSet<String>,
    drops: HashSet<String>,
    empty: HashSet<String>,
    measures: HashSet<String>,
    numbered: HashSet<String>,
    passages: HashSet<String>,
    events: HashSet<String>,
    cans: HashSet<String>,
    living: HashSet<String>,
    animals: HashSet<String>,
    thresholds: HashSet<String>,
    common: Vec<String>,
}

/// The noun tables.
#[derive(Default)]
pub struct Nouns {
    synonym_of: HashMap<String, String>,
    irregular: HashMap<String, String>,
    lists: Lists,
}

static NOUNS: LazyLock<Nouns> = LazyLock::new(|| Nouns::read(include_str!("nouns.toml")).unwrap_or_default());

impl Nouns {
    /// The tables this crate carries.
    #[must_use]
    pub fn get() -> &'static Nouns {
        &NOUNS
    }

    fn read(text: &str) -> Result<Nouns, toml::de::Error> {
        let file: File = toml::from_str(text)?;
        let mut nouns =
            Nouns { irregular: file.irregular.into_iter().collect(), lists: file.lists, ..Nouns::default() };
        for group in &file.synonyms {
            for word in group {
                if let Some(first) = group.first() {
                    nouns.synonym_of.entry(word.clone()).or_insert_with(|| first.clone());
                }
            }
        }
        Ok(nouns)
    }

    /// The singular of a word; unchanged when it has none or is one.
    #[must_use]
    pub fn singular(&self, word: &str) -> String {
        if self.lists.keep_plural.contains(word) || word.ends_with("'s") {
            return word.to_owned();
        }
        if let Some(one) = self.irregular.get(word) {
            return one.clone();
        }
        let n = word.chars().count();
        if n > 4 && word.ends_with("ies") {
            return format!("{}y", word.trim_end_matches("ies"));
        }
        if ["ches", "shes", "sses", "xes", "zes"].iter().any(|ending| word.ends_with(ending)) {
            return word.trim_end_matches("es").to_owned();
        }
        let keeps = ["ss", "us", "is", "'s"].iter().any(|ending| word.ends_with(ending));
        if n > 3 && word.ends_with('s') && !keeps {
            return word.strip_suffix('s').unwrap_or(word).to_owned();
        }
        word.to_owned()
    }

    /// The class noun of a phrase: no adjectives of look, no possessor, the last word singular.
    #[must_use]
    pub fn class_noun(&self, words: &[&str]) -> String {
        let mut words: Vec<&str> = words.to_vec();
        while words.len() > 1 && self.lists.adjectives.contains(words[0]) {
            words.remove(0);
        }
        if let Some(last_owner) = words.iter().rposition(|word| word.ends_with("'s") || word.ends_with("s'"))
        {
            // "nurse's station" is a kind of station; "baby's crib" is a crib.
            let rest = &words[last_owner + 1..];
            let is_kind = rest.len() == 1
                && ["station", "room", "area", "bay", "seat", "lounge", "desk"].contains(&rest[0]);
            if !rest.is_empty() && !is_kind {
                words.drain(..=last_owner);
            }
        }
        while words.len() > 1 && self.lists.adjectives.contains(words[0]) {
            words.remove(0);
        }
        let Some((last, rest)) = words.split_last() else { return String::new() };
        // "the rug thing"
        if matches!(*last, "thing" | "things" | "one" | "ones" | "business" | "stuff") && !rest.is_empty() {
            return self.class_noun(rest);
        }
        // "the nurses' (way)": of the nurses.
        let owner = last.strip_suffix("'s").or_else(|| last.strip_suffix('\''));
        if let Some(owner) = owner {
            return self.singular(owner);
        }
        let head =
            if last.chars().all(|c| c.is_ascii_digit()) { (*last).to_owned() } else { self.singular(last) };
        let mut out: Vec<&str> = rest.to_vec();
        out.push(&head);
        out.join(" ")
    }

    /// Whether two names mean one kind of thing; the longer may carry more words in front.
    #[must_use]
    pub fn same(&self, a: &str, b: &str) -> bool {
        let (a, b) = (self.canonical(a), self.canonical(b));
        !a.is_empty()
            && !b.is_empty()
            && (a == b || a.ends_with(&format!(" {b}")) || b.ends_with(&format!(" {a}")))
    }

    /// The one word we compare by.
    #[must_use]
    pub fn canonical(&self, name: &str) -> String {
        crate::steps::step();
        if let Some(first) = self.synonym_of.get(name) {
            return first.clone();
        }
        let words: Vec<&str> = name.split_whitespace().collect();
        let Some((last, rest)) = words.split_last() else { return String::new() };
        let one = self.singular(last);
        let head = self.synonym_of.get(&one).cloned().unwrap_or(one);
        if rest.is_empty() { head } else { format!("{} {head}", rest.join(" ")) }
    }

    fn head<'a>(&self, obj: &'a str) -> &'a str {
        obj.split_whitespace().last().unwrap_or_default()
    }

    fn has(&self, set: &HashSet<String>, obj: &str) -> bool {
        let head = self.head(obj);
        set.contains(obj) || set.contains(head) || set.contains(&self.singular(head))
    }

    /// Whether it says how a thing looks, and is left out of its class noun.
    #[must_use]
    pub fn is_adjective(&self, word: &str) -> bool {
        self.lists.adjectives.contains(word)
    }

    /// An area one is on or in, rather than near.
    #[must_use]
    pub fn is_place(&self, obj: &str) -> bool {
        let numbered = match obj.split_whitespace().collect::<Vec<_>>().as_slice() {
            [first, mark] => {
                let is_mark = mark.len() <= 3 || crate::number::is_number_word(mark);
                is_mark && (*first == "room" || self.lists.places.contains(*first))
            }
            _ => false,
        };
        numbered || self.has(&self.lists.places, obj)
    }

    /// A line or barrier, whose far side is what "behind" keeps from.
    #[must_use]
    pub fn is_boundary(&self, obj: &str) -> bool {
        self.has(&self.lists.boundaries, obj)
    }

    /// A drop, water or fire.
    #[must_use]
    pub fn is_drop(&self, obj: &str) -> bool {
        self.has(&self.lists.drops, obj)
    }

    /// A word that names a part of what follows "of".
    #[must_use]
    pub fn is_part(&self, word: &str) -> bool {
        self.lists.parts.contains(word)
    }

    /// Whether the name consists of words that name nothing.
    #[must_use]
    pub fn is_empty_name(&self, reference: &str) -> bool {
        // "the light", "the orange"; "the water meter"
        if matches!(reference, "light" | "orange") || reference.ends_with(" meter") {
            return false;
        }
        reference.split_whitespace().any(|word| self.lists.measures.contains(word))
            || reference.split_whitespace().all(|word| {
                self.lists.empty.contains(word)
                    || word.chars().all(|c| c.is_ascii_digit() || c == '.')
                    || self.lists.adjectives.contains(word)
            })
    }

    /// A kind of place that people number: "bay four".
    #[must_use]
    pub fn is_numbered(&self, phrase: &str) -> bool {
        phrase.split_whitespace().last().is_some_and(|word| self.lists.numbered.contains(word))
    }

    /// A word for a way through: "the path between A and B" is the gap itself.
    #[must_use]
    pub fn is_passage(&self, obj: &str) -> bool {
        self.lists.passages.contains(obj)
    }

    /// Something that takes place rather than stands there: "a meeting in the boardroom".
    #[must_use]
    pub fn is_event(&self, obj: &str) -> bool {
        self.lists.events.contains(obj) || self.lists.events.contains(self.head(obj))
    }

    /// A person or an animal.
    #[must_use]
    pub fn is_living(&self, obj: &str) -> bool {
        self.has(&self.lists.living, obj)
    }

    /// A person rather than an animal or a thing.
    #[must_use]
    pub fn is_someone(&self, obj: &str) -> bool {
        self.is_living(obj) && !self.has(&self.lists.animals, obj)
    }

    /// Something one stops at so as not to pass it.
    #[must_use]
    pub fn is_threshold(&self, obj: &str) -> bool {
        self.is_boundary(obj) || self.has(&self.lists.thresholds, obj)
    }

    /// What "can" is a vessel after: "trash can".
    #[must_use]
    pub fn has_can(&self, word: &str) -> bool {
        self.lists.cans.contains(word)
    }

    /// Whether the word stands in one of the tables.
    #[must_use]
    pub fn knows(&self, word: &str) -> bool {
        let one = self.singular(word);
        self.lists.places.contains(&one)
            || self.lists.places.contains(word)
            || self.lists.adjectives.contains(word)
            || self.synonym_of.contains_key(&one)
            || self.irregular.contains_key(word)
            || self.lists.common.iter().any(|known| known == word || *known == one)
    }

    /// Nouns that a slip of the fingers may be put right to.
    #[must_use]
    pub fn common(&self) -> &[String] {
        &self.lists.common
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tables_are_readable() {
        assert!(Nouns::read(include_str!("nouns.toml")).is_ok());
    }

    #[test]
    fn class_nouns_are_singular_and_keep_compounds() {
        let nouns = Nouns::get();
        for (phrase, noun) in [
            ("red sofa", "sofa"),
            ("coffee tables", "coffee table"),
            ("baby's crib", "crib"),
            ("shelves", "shelf"),
            ("stairs", "stairs"),
            ("people", "person"),
            ("glass vase", "glass vase"),
            ("room 3", "room 3"),
            ("nurse's station", "nurse's station"),
            ("boxes", "box"),
            ("vases", "vase"),
            ("glass", "glass"),
        ] {
            assert_eq!(nouns.class_noun(&phrase.split(' ').collect::<Vec<_>>()), noun, "{phrase}");
        }
    }

    #[test]
    fn synonyms_and_longer_names_meet() {
        let nouns = Nouns::get();
        assert!(nouns.same("sofa", "couch"));
        assert!(nouns.same("red sofa", "couch"));
        assert!(nouns.same("person", "people"));
        assert!(!nouns.same("table", "tablecloth"));
        assert!(!nouns.same("", "rug"));
    }
}
