//! Typed items out of tokens: quantities, phrases with senses, other words, marks.

use crate::lexicon::{GOING, Lexicon, Sense};
use crate::noun::Nouns;
use crate::phrase::ARTICLES;
use crate::quantity::{BareUnit, Kind, Quantity, quantity_at};
use crate::speech::{Speech, speech};
use crate::text::Token;

/// What an item is.
#[derive(Clone, Debug, PartialEq)]
pub enum Sort {
    /// A measured number.
    Quantity(Quantity),
    /// A phrase of the lexicon, with all its senses.
    Phrase(&'static [Sense]),
    /// Any other word: material for a name.
    Word,
    /// Punctuation.
    Mark,
}

/// One item and its words.
#[derive(Clone, Debug, PartialEq)]
pub struct Item {
    /// What it is.
    pub sort: Sort,
    /// Its words, normalised.
    pub text: String,
}

impl Item {
    /// Whether one of its senses is this.
    #[must_use]
    pub fn is(&self, sense: Sense) -> bool {
        crate::steps::step();
        matches!(self.sort, Sort::Phrase(senses) if senses.contains(&sense))
    }

    /// Whether one of its senses is among these.
    #[must_use]
    pub fn is_any(&self, senses: &[Sense]) -> bool {
        senses.iter().any(|sense| self.is(*sense))
    }

    /// Whether it is a word without a sense of its own.
    #[must_use]
    pub fn is_word(&self) -> bool {
        self.sort == Sort::Word
    }
}

/// The items of an utterance.
#[must_use]
pub fn items(tokens: &[Token], bare_unit: BareUnit) -> Vec<Item> {
    let lexicon = Lexicon::get();
    let mut out: Vec<Item> = Vec::with_capacity(tokens.len());
    let mut at = 0;
    while let Some(token) = tokens.get(at) {
        if token.is_mark() {
            out.push(Item { sort: Sort::Mark, text: token.text.clone() });
            at += 1;
            continue;
        }
        let mut phrase = lexicon.senses_at(tokens, at);
        if is_noun_here(tokens, at, out.last()) {
            phrase = lexicon.shorter_senses_at(tokens, at, phrase.map_or(0, |(_, n)| n));
        }
        // "the box in the corner": behind an article there is no "box in".
        let behind_article = out.last().is_some_and(|item| ARTICLES.contains(&item.text.as_str()));
        if let Some((senses, n)) = phrase
            && n > 1
            && behind_article
            && senses.iter().any(|sense| GOING.contains(sense))
        {
            phrase = lexicon.shorter_senses_at(tokens, at, n);
        }
        // "turn slower than 25°/s": the comparison belongs to the number.
        if let Some((_, n)) = phrase
            && n > 1
            && tokens.get(at + n).is_some_and(|after| after.text == "than")
        {
            phrase = lexicon.shorter_senses_at(tokens, at, n);
        }
        let phrase_len = phrase.map_or(0, |(_, n)| n);
        let measured = quantity_at(tokens, at, bare_unit).filter(|quantity| quantity.n_tokens >= phrase_len);
        let (sort, n_tokens) = match (measured, phrase) {
            (Some(quantity), _) if !is_part_of_a_name(&quantity, tokens, at, out.last()) => {
                let n_tokens = quantity.n_tokens;
                (Sort::Quantity(quantity), n_tokens)
            }
            (Some(_), None) => (Sort::Word, 1),
            (_, Some((senses, n_tokens))) => (Sort::Phrase(senses), n_tokens),
            _ => (Sort::Word, 1),
        };
        let text = tokens[at..at + n_tokens].iter().map(|t| t.text.as_str()).collect::<Vec<_>>().join(" ");
        out.push(Item { sort, text });
        at += n_tokens;
    }
    out
}

/// "the bar", "steps ahead": words that only otherwise mean something to the grammar.
fn is_noun_here(tokens: &[Token], at: usize, before: Option<&Item>) -> bool {
    let word = tokens.get(at).map_or("", |token| token.text.as_str());
    let after = tokens.get(at + 1).map_or("", |token| token.text.as_str());
    let opens = before.is_none_or(|item| {
        item.sort == Sort::Mark
            || item.is(Sense::Det)
            || item.is_any(&[Sense::PrepBetween, Sense::PrepNear, Sense::PrepOn, Sense::And, Sense::From])
    });
    let names_on = |n: usize| {
        tokens.get(at + n).is_some_and(|next| {
            !next.is_mark()
                && Lexicon::get().senses_at(tokens, at + n).is_none()
                && speech(&next.text) == Speech::MayName
                && quantity_at(tokens, at + n, None).is_none()
        })
    };
    match word {
        // "the old man", but "slow down, man"
        "man" | "mate" | "buddy" | "pal" | "dude" | "love" | "dear" => {
            before.is_some_and(|item| item.is(Sense::Det) || speech(&item.text) == Speech::Adjective)
                || before.is_some_and(|item| item.is_word() && Nouns::get().knows(&item.text))
        }
        // "the robot cell fence"
        "the" | "a" | "any" if matches!(after, "robot" | "bot" | "machine" | "vehicle") => names_on(2),
        "robot" | "machine" | "vehicle" if at > 0 => {
            before.is_some_and(|item| item.is(Sense::Det)) && names_on(1)
        }
        "bar" => opens || !matches!(after, "the" | "my" | "mine" | "our" | "your" | "this" | "that" | "one"),
        "steps" => opens && !matches!(after, "away" | "back" | "from"),
        _ => false,
    }
}

/// "room 3" and "the two chairs" hold numbers that measure nothing.
fn is_part_of_a_name(quantity: &Quantity, tokens: &[Token], at: usize, before: Option<&Item>) -> bool {
    // "there is a step down"
    if quantity.said == "a step" && before.is_some_and(|b| b.is(Sense::ThereIs)) {
        return true;
    }
    if quantity.kind != Kind::Bare {
        return false;
    }
    let first = tokens.get(at).map_or("", |token| token.text.as_str());
    if first == "one" && quantity.n_tokens == 1 {
        return true;
    }
    let numbered = before.is_some_and(|item| {
        item.is_word() || matches!(item.text.as_str(), "room" | "dock" | "exit" | "charge" | "line" | "stop")
    });
    if numbered && first.starts_with(|c: char| c.is_ascii_digit()) {
        return true;
    }
    // "bay four", "aisle nine"
    if before.is_some_and(|item| Nouns::get().is_numbered(&item.text)) {
        return true;
    }
    let lexicon = Lexicon::get();
    let next_is_word = tokens
        .get(at + quantity.n_tokens)
        .is_some_and(|next| !next.is_mark() && lexicon.senses_at(tokens, at + quantity.n_tokens).is_none());
    quantity.n_tokens == 1
        && next_is_word
        && !lexicon.knows(first)
        && tokens
            .get(at + 1)
            .is_some_and(|next| next.text.ends_with('s') || before.is_some_and(|b| b.is(Sense::Det)))
}
