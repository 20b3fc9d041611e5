//! What phrases mean: the tables of `lexicon.toml`, parsed once.
//!
//! A phrase may have several senses ("about" is a place, an approximation and a topic); the clause
//! scanner decides by context. If the tables could not be read the lexicon is empty, which makes
//! every utterance a question and the gate refuse everything; a test keeps that from shipping.

mod sense;

use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::LazyLock;

use crate::quantity::{Bound, Kind};
use crate::text::Token;
pub use sense::{GOING, Sense};

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    contractions: BTreeMap<String, String>,
    states: States,
    tenses: Tenses,
    doubts: Doubts,
    bounds: BTreeMap<String, Vec<String>>,
    units: BTreeMap<String, BTreeMap<String, f64>>,
    senses: BTreeMap<Sense, Vec<String>>,
}

/// Words that show "'s" and "its" to be an "is".
#[derive(Default, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct States {
    leads: Vec<String>,
    words: Vec<String>,
}

/// Forms of verbs that no ending shows.
#[derive(Default, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Tenses {
    past: HashSet<String>,
}

/// Phrases that make a guess of any rule in the same breath.
#[derive(Default, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Doubts {
    always: Vec<String>,
    /// What shows that a question mark asks for a favour.
    requests: HashSet<String>,
}

struct Phrase<T> {
    words: Vec<String>,
    meaning: T,
}

/// Phrases by first word, the longest first.
type Phrases<T> = HashMap<String, Vec<Phrase<T>>>;

/// The tables, ready for matching.
#[derive(Default)]
pub struct Lexicon {
    contractions: HashMap<String, Vec<String>>,
    states: States,
    tenses: Tenses,
    doubts: Phrases<()>,
    requests: HashSet<String>,
    bounds: Phrases<Bound>,
    units: Phrases<(Kind, f64)>,
    rate_units: Vec<String>,
    senses: Phrases<Vec<Sense>>,
    single_words: Vec<String>,
}

static LEXICON: LazyLock<Lexicon> =
    LazyLock::new(|| Lexicon::read(include_str!("lexicon.toml")).unwrap_or_default());

impl Lexicon {
    /// The lexicon this crate carries.
    #[must_use]
    pub fn get() -> &'static Lexicon {
        &LEXICON
    }

    /// Whether the tables could not be read.
    #[must_use]
    pub fn is_broken(&self) -> bool {
        self.senses.is_empty()
    }

    fn read(text: &str) -> Result<Lexicon, toml::de::Error> {
        let file: File = toml::from_str(text)?;
        let mut lexicon = Lexicon { states: file.states, tenses: file.tenses, ..Lexicon::default() };
        file.doubts.always.iter().for_each(|phrase| insert(&mut lexicon.doubts, phrase, ()));
        lexicon.requests = file.doubts.requests;
        for (short, long) in &file.contractions {
            lexicon.contractions.insert(short.clone(), words_of(long));
        }
        for (name, phrases) in &file.bounds {
            let bound = match name.as_str() {
                "upper" => Bound::Upper,
                "lower" => Bound::Lower,
                "over" => Bound::Over,
                "within" => Bound::Within,
                _ => Bound::Plain,
            };
            phrases.iter().for_each(|phrase| insert(&mut lexicon.bounds, phrase, bound));
        }
        for (name, units) in &file.units {
            let kind = match name.as_str() {
                "distance" => Kind::Distance,
                "speed" => Kind::Speed,
                "duration" => Kind::Duration,
                _ => Kind::TurnRate,
            };
            for (unit, scale) in units {
                insert(&mut lexicon.units, unit, (kind, *scale));
                if name == "turn_rate" {
                    lexicon.rate_units.push(unit.clone());
                }
            }
        }
        let mut by_phrase: BTreeMap<&str, Vec<Sense>> = BTreeMap::new();
        for (sense, phrases) in &file.senses {
            phrases.iter().for_each(|phrase| by_phrase.entry(phrase).or_default().push(*sense));
        }
        for (phrase, senses) in by_phrase {
            insert(&mut lexicon.senses, phrase, senses);
            lexicon.single_words.extend(words_of(phrase).into_iter().filter(|word| word.len() >= 4));
        }
        lexicon.single_words.sort_unstable();
        lexicon.single_words.dedup();
        sort_longest_first(&mut lexicon.senses);
        sort_longest_first(&mut lexicon.bounds);
        sort_longest_first(&mut lexicon.units);
        Ok(lexicon)
    }

    /// What a contraction stands for.
    #[must_use]
    pub fn written_out(&self, word: &str) -> Option<&[String]> {
        self.contractions.get(word).map(Vec::as_slice)
    }

    /// Whether the word stands between "is" and what is said ("still", "very").
    #[must_use]
    pub fn leads_to_state(&self, word: &str) -> bool {
        self.states.leads.iter().any(|lead| lead == word)
    }

    /// Whether the word tells how something is ("wet", "hot").
    #[must_use]
    pub fn is_state_word(&self, word: &str) -> bool {
        self.states.words.iter().any(|state| state == word)
    }

    /// Whether the word is a verb in the past that does not end in "ed": "went".
    #[must_use]
    pub fn is_past(&self, word: &str) -> bool {
        self.tenses.past.contains(word)
    }

    /// Tokens of the phrase at `at` that makes a guess of any rule; none when there is none.
    #[must_use]
    pub fn doubt_at(&self, tokens: &[Token], at: usize) -> Option<usize> {
        longest(&self.doubts, tokens, at).map(|(_, n)| n)
    }

    /// Whether the word shows that a question asks for a favour: "could".
    #[must_use]
    pub fn is_request(&self, word: &str) -> bool {
        self.requests.contains(word)
    }

    /// Whether the words, separated by spaces, are a phrase of some sense or bound.
    #[must_use]
    pub fn is_phrase(&self, text: &str) -> bool {
        let words = words_of(text);
        let first = words.first().cloned().unwrap_or_default();
        let in_senses = self.senses.get(&first).is_some_and(|list| list.iter().any(|p| p.words == words));
        in_senses || self.bounds.get(&first).is_some_and(|list| list.iter().any(|p| p.words == words))
    }

    /// The senses of the longest phrase at `at`, and its tokens.
    #[must_use]
    pub fn senses_at(&self, tokens: &[Token], at: usize) -> Option<(&[Sense], usize)> {
        longest(&self.senses, tokens, at).map(|(senses, n)| (senses.as_slice(), n))
    }

    /// The senses of the longest phrase at `at` of fewer than `n_tokens` tokens, and its tokens.
    #[must_use]
    pub fn shorter_senses_at(
        &self,
        tokens: &[Token],
        at: usize,
        n_tokens: usize,
    ) -> Option<(&[Sense], usize)> {
        let list = self.senses.get(&tokens.get(at)?.text)?;
        let shorter = list.iter().filter(|phrase| phrase.words.len() < n_tokens);
        shorter.into_iter().find_map(|phrase| {
            let here = tokens.get(at..at + phrase.words.len())?;
            let same = here.iter().zip(&phrase.words).all(|(token, word)| token.text == *word);
            same.then_some((phrase.meaning.as_slice(), phrase.words.len()))
        })
    }

    /// The bound phrase at `at`, and its tokens.
    #[must_use]
    pub fn bound_at(&self, tokens: &[Token], at: usize) -> Option<(Bound, usize)> {
        longest(&self.bounds, tokens, at).map(|(bound, n)| (*bound, n))
    }

    /// The unit at `at`: what it measures, its SI scale, and its tokens.
    #[must_use]
    pub fn unit_at(&self, tokens: &[Token], at: usize) -> Option<(Kind, f64, usize)> {
        longest(&self.units, tokens, at).map(|(unit, n)| (unit.0, unit.1, n))
    }

    /// A unit by name.
    #[must_use]
    pub fn unit(&self, name: &str) -> Option<(Kind, f64)> {
        self.units.get(name)?.iter().find(|phrase| phrase.words.len() == 1).map(|phrase| phrase.meaning)
    }

    /// Whether the unit is a turn rate by itself ("rad/s"), rather than an angle.
    #[must_use]
    pub fn is_rate_unit(&self, name: &str) -> bool {
        self.rate_units.iter().any(|unit| unit == name)
    }

    /// Whether the word occurs in some phrase, or is a unit.
    #[must_use]
    pub fn knows(&self, word: &str) -> bool {
        self.single_words.binary_search_by(|known| known.as_str().cmp(word)).is_ok()
            || self.senses.contains_key(word)
            || self.units.contains_key(word)
    }

    /// Whether the word is a determiner.
    #[must_use]
    pub fn is_article(&self, word: &str) -> bool {
        let is_det =
            |phrase: &Phrase<Vec<Sense>>| phrase.words.len() == 1 && phrase.meaning.contains(&Sense::Det);
        self.senses.get(word).is_some_and(|phrases| phrases.iter().any(is_det))
    }

    /// Words of four letters and more that spelling may be put right to.
    #[must_use]
    pub fn spellings(&self) -> &[String] {
        &self.single_words
    }
}

fn words_of(text: &str) -> Vec<String> {
    text.split_whitespace().map(str::to_owned).collect()
}

fn insert<T>(phrases: &mut Phrases<T>, text: &str, meaning: T) {
    let words = words_of(text);
    if let Some(first) = words.first() {
        phrases.entry(first.clone()).or_default().push(Phrase { words, meaning });
    }
}

fn sort_longest_first<T>(phrases: &mut Phrases<T>) {
    for list in phrases.values_mut() {
        list.sort_by_key(|phrase| std::cmp::Reverse(phrase.words.len()));
    }
}

fn longest<'a, T>(phrases: &'a Phrases<T>, tokens: &[Token], at: usize) -> Option<(&'a T, usize)> {
    crate::steps::step();
    let first = tokens.get(at)?;
    phrases.get(&first.text)?.iter().find_map(|phrase| {
        let here = tokens.get(at..at + phrase.words.len())?;
        let same = here.iter().zip(&phrase.words).all(|(token, word)| token.text == *word);
        same.then_some((&phrase.meaning, phrase.words.len()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tables_are_readable_and_lower_case() {
        let lexicon = Lexicon::read(include_str!("lexicon.toml")).unwrap();
        assert!(!lexicon.is_broken());
        assert!(lexicon.senses.keys().all(|word| word.to_lowercase() == *word));
    }

    #[test]
    fn the_longest_phrase_wins() {
        let lexicon = Lexicon::get();
        let tokens = crate::text::tokens("keep out of that", lexicon);
        let (senses, n_tokens) = lexicon.senses_at(&tokens, 0).unwrap();
        assert_eq!((senses, n_tokens), (&[Sense::StayOff][..], 3));
    }
}
