//! From a phrase to the classes of models that know only their own: by name, by synonym, by likeness.
//!
//! Names and synonyms are data (`vocabulary.toml`). What is in neither is compared by sentence embedding with
//! all of them, and also with words that are known to mean no class: the nearest wins, if it is near
//! enough. Words that no class can tell ("red", "by the window") are left out, and that is said. A phrase
//! that means no class is not guessed at. Not here: images.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::Context;
use serde::Deserialize;

use super::sentence::Sentences;

const DATA: &str = include_str!("vocabulary.toml");

/// Words that say nothing about which thing is meant.
const FILLERS: [&str; 24] = [
    "the", "a", "an", "any", "all", "every", "each", "my", "our", "your", "his", "her", "their", "this",
    "that", "these", "those", "some", "of", "both", "other", "whole", "entire", "its",
];
/// From such a word on, a phrase says where the thing is or what it is like.
const PREPOSITIONS: [&str; 27] = [
    "by", "near", "next", "in", "on", "at", "with", "without", "under", "beneath", "behind", "from", "that",
    "which", "to", "between", "beside", "against", "along", "around", "across", "over", "where", "who",
    "for", "closest", "nearest",
];

/// What a phrase means to the models.
#[derive(Clone, Debug, PartialEq)]
pub enum Meaning {
    /// These classes, and the phrase says no more than they can tell.
    Classes(Vec<String>),
    /// These classes, but they cover more than was said: in words.
    MoreThanSaid(Vec<String>, String),
    /// No class: in words.
    Nothing(String),
}

/// The words that are known, and who compares others with them.
pub struct Vocabulary {
    data: Data,
    /// Classes that an open model has and that are believed, by their usual names.
    classes: BTreeSet<String>,
    sentences: Option<Sentences>,
    cosine_min: f32,
}

#[derive(Deserialize)]
struct Data {
    means: BTreeMap<String, Vec<String>>,
    alias: BTreeMap<String, String>,
    segmentation: Segmentation,
    wider: Words,
    none: Words,
}

#[derive(Deserialize)]
struct Segmentation {
    believed: BTreeSet<String>,
}

#[derive(Deserialize)]
struct Words {
    words: BTreeSet<String>,
}

impl Vocabulary {
    /// The vocabulary of models whose labels are `things` and, as far as they are believed, `stuff`; without
    /// `sentences`, only names and synonyms are known.
    ///
    /// # Errors
    /// When the data that is built in cannot be read.
    pub fn new(
        things: &[String],
        stuff: &[String],
        sentences: Option<Sentences>,
        cosine_min: f32,
    ) -> anyhow::Result<Self> {
        let data: Data = toml::from_str(DATA).context("vocabulary")?;
        let mut vocabulary = Vocabulary { data, classes: BTreeSet::new(), sentences, cosine_min };
        let things = things.iter().map(|label| vocabulary.usual(label));
        let stuff =
            stuff.iter().map(|label| vocabulary.usual(label)).filter(|name| vocabulary.is_believed(name));
        vocabulary.classes = things.chain(stuff).collect();
        Ok(vocabulary)
    }

    /// A class by its usual name.
    #[must_use]
    pub fn usual(&self, label: &str) -> String {
        let label = label.trim().to_lowercase();
        self.data.alias.get(&label).cloned().unwrap_or(label)
    }

    /// Whether a semantic segmentation is believed about a class.
    #[must_use]
    pub fn is_believed(&self, usual: &str) -> bool {
        self.data.segmentation.believed.contains(usual)
    }

    /// What a phrase means.
    ///
    /// # Errors
    /// When the sentence embedding fails.
    pub fn meaning(&self, phrase: &str) -> anyhow::Result<Meaning> {
        let (words, was_cut) = nouns(phrase);
        if words.is_empty() {
            return Ok(Meaning::Nothing(format!("the phrase {phrase:?} names no thing")));
        }
        let parts: Vec<String> = (0..words.len()).map(|k| singular(&words, k)).collect();
        for (k, part) in parts.iter().enumerate() {
            if self.data.none.words.contains(part) {
                return Ok(Meaning::Nothing(format!("the models know no {part:?}")));
            }
            if let Some(classes) = self.named(part) {
                return Ok(self.told(phrase, part, classes, k > 0 || was_cut));
            }
        }
        for (k, part) in parts.iter().enumerate() {
            // A known word before the last ("tv stand") would draw the whole to itself.
            let rest = words.get(k..words.len() - 1).unwrap_or_default();
            if rest.iter().any(|word| self.named(word).is_some()) {
                continue;
            }
            if let Some((name, classes)) = self.alike(part)? {
                let more = format!("takes {part:?} for {name:?}");
                return Ok(match self.told(phrase, part, classes, k > 0 || was_cut) {
                    Meaning::MoreThanSaid(classes, words) => {
                        Meaning::MoreThanSaid(classes, format!("{more}; {words}"))
                    }
                    Meaning::Classes(classes) => Meaning::MoreThanSaid(classes, more),
                    nothing @ Meaning::Nothing(_) => nothing,
                });
            }
        }
        let last = parts.first().map_or(phrase, String::as_str);
        Ok(Meaning::Nothing(format!("the models know no {last:?}")))
    }

    fn told(&self, phrase: &str, part: &str, classes: Vec<String>, is_more: bool) -> Meaning {
        if classes.is_empty() {
            return Meaning::Nothing(format!("no model that is open knows {part:?}"));
        }
        // "armchair" is any chair to a model that has no armchairs.
        let is_wider = self.data.wider.words.contains(part) && !self.classes.contains(part);
        if is_more || is_wider {
            let like = if is_wider { classes.join(" or ") } else { part.to_owned() };
            let words = format!("cannot tell {phrase:?} from any other {like}: all are covered");
            return Meaning::MoreThanSaid(classes, words);
        }
        Meaning::Classes(classes)
    }

    /// The classes that a word names; empty when it is a known word and no open model has its classes.
    fn named(&self, word: &str) -> Option<Vec<String>> {
        if let Some(names) = self.data.means.get(word) {
            return Some(names.iter().filter(|name| self.classes.contains(*name)).cloned().collect());
        }
        self.classes.contains(word).then(|| vec![word.to_owned()])
    }

    /// The known word that means most nearly the same, and its classes; `None` when nothing is near enough.
    fn alike(&self, part: &str) -> anyhow::Result<Option<(String, Vec<String>)>> {
        let Some(sentences) = &self.sentences else { return Ok(None) };
        let known = self.data.means.keys().chain(&self.classes).chain(&self.data.none.words);
        let mut best: Option<(f32, &String)> = None;
        for word in known {
            let cosine = sentences.cosine(part, word)?;
            if best.is_none_or(|(most, _)| cosine > most) {
                best = Some((cosine, word));
            }
        }
        Ok(best
            .filter(|(cosine, word)| *cosine >= self.cosine_min && !self.data.none.words.contains(*word))
            .and_then(|(_, word)| Some((word.clone(), self.named(word)?))))
    }
}

/// The words of a phrase that name the thing, and whether others were left out that tell it from its like.
fn nouns(phrase: &str) -> (Vec<String>, bool) {
    let lower = phrase.to_lowercase().replace('\u{2019}', "'");
    let mut words = Vec::new();
    let mut was_cut = false;
    for word in lower.split(|c: char| c.is_whitespace() || c == ',' || c == '/') {
        let word = word.trim_matches(|c: char| !c.is_alphanumeric() && c != '\'');
        if word.is_empty() {
            continue;
        }
        if PREPOSITIONS.contains(&word) && !words.is_empty() {
            was_cut = true;
            break;
        }
        if word.ends_with("'s") || word.ends_with("s'") {
            // "the patient's bed" is a bed; whose it is cannot be seen.
            was_cut = true;
            words.clear();
            continue;
        }
        words.push(word.to_owned());
    }
    let is_filler = |word: &String| FILLERS.contains(&word.as_str());
    // "of" stays within: "chest of drawers".
    while words.first().is_some_and(is_filler) {
        words.remove(0);
    }
    (words, was_cut)
}

/// The words from the `k`-th on, the last one singular.
fn singular(words: &[String], k: usize) -> String {
    let part = words.get(k..).unwrap_or_default();
    let Some((last, before)) = part.split_last() else { return String::new() };
    let last = match last.as_str() {
        "drawers" | "stairs" | "drapes" | "people" | "men" | "women" | "children" | "scissors" | "skis" => {
            last.clone()
        }
        "shelves" => "shelf".to_owned(),
        "knives" => "knife".to_owned(),
        "couches" | "benches" | "boxes" | "glasses" | "buses" | "watches" => {
            last.trim_end_matches("es").to_owned()
        }
        word if word.ends_with("ies") && word.len() > 4 => format!("{}y", word.trim_end_matches("ies")),
        word if word.ends_with('s') && !word.ends_with("ss") && !word.ends_with("us") => {
            word.trim_end_matches('s').to_owned()
        }
        word => word.to_owned(),
    };
    before.iter().map(String::as_str).chain([last.as_str()]).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn vocabulary() -> Vocabulary {
        let labels = |words: &[&str]| words.iter().map(|w| (*w).to_owned()).collect::<Vec<_>>();
        let things = labels(&["chair", "couch", "dining table", "tv", "dog", "bed", "person", "bowl"]);
        Vocabulary::new(&things, &labels(&["floor", "rug", "swimming", "plaything"]), None, 0.65).unwrap()
    }

    #[test]
    fn names_and_synonyms_mean_the_classes_that_the_models_have() {
        let check = |phrase: &str, wanted: &[&str]| {
            let wanted = wanted.iter().map(|w| (*w).to_owned()).collect();
            assert_eq!(vocabulary().meaning(phrase).unwrap(), Meaning::Classes(wanted), "{phrase:?}");
        };
        check("the chairs", &["chair"]);
        check("Sofa", &["couch"]);
        check("all the couches", &["couch"]);
        check("table", &["dining table"]);
        check("carpet", &["rug"]);
        check("pool", &["swimming pool"]);
        check("people", &["person"]);
    }

    #[test]
    fn a_qualifier_that_no_class_can_tell_is_said() {
        let check = |phrase: &str, class: &str, said: &str| match vocabulary().meaning(phrase).unwrap() {
            Meaning::MoreThanSaid(classes, words) => {
                assert_eq!(classes, [class], "{phrase:?}");
                assert!(words.contains(said), "{words}");
            }
            other => panic!("{phrase:?}: {other:?}"),
        };
        check("the red sofa", "couch", "cannot tell \"the red sofa\" from any other sofa");
        check("chair by the window", "chair", "any other chair");
        check("the patient's bed", "bed", "any other bed");
        check("the standing desk", "dining table", "any other dining table");
    }

    #[test]
    fn a_phrase_that_means_no_class_is_not_guessed_at() {
        let check = |phrase: &str, said: &str| match vocabulary().meaning(phrase).unwrap() {
            Meaning::Nothing(words) => assert!(words.contains(said), "{words}"),
            other => panic!("{phrase:?}: {other:?}"),
        };
        check("fire extinguisher", "know no \"fire extinguisher\"");
        check("tv stand", "know no \"tv stand\"");
        check("the dining room", "know no \"dining room\"");
        check("gizmo", "know no \"gizmo\"");
        check("fridge", "no model that is open knows \"fridge\"");
        check("", "names no thing");
        check("  the ", "names no thing");
    }

    #[test]
    fn every_class_that_a_synonym_names_is_one_of_a_usual_model() {
        let vocabulary = vocabulary();
        let coco: BTreeSet<&str> = super::super::COCO.lines().collect();
        for (word, classes) in &vocabulary.data.means {
            assert!(!classes.is_empty(), "{word}");
            assert!(!vocabulary.data.none.words.contains(word), "{word} means something and nothing");
        }
        let things = vocabulary.data.means.values().flatten().filter(|c| coco.contains(c.as_str())).count();
        assert!(things > 80, "{things}");
    }
}
