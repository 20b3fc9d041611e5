//! Distances, speeds, turn rates, fractions of the top speed and durations, in SI units.
//!
//! Values are rounded to a tenth of a millimetre, millimetre per second or milliradian per second,
//! each to the safe side, so that what is read back is exactly what holds.

mod measure;

use crate::lexicon::Lexicon;
use crate::number::{fraction_word, is_number_word, number_at};
use crate::text::{Token, tokens};
use measure::{compound, fraction_of_speed, share, single_duration, single_of};

/// What a number measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Metres.
    Distance,
    /// Metres per second.
    Speed,
    /// Radians per second.
    TurnRate,
    /// Share of the robot's top speed, 1 is all of it.
    Fraction,
    /// Seconds.
    Duration,
    /// A number without a unit.
    Bare,
}

/// How a number bounds what it measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bound {
    /// Just the number, or roughly it.
    Plain,
    /// "at most", "under", "no more than".
    Upper,
    /// "at least", "no closer than", "minimum".
    Lower,
    /// "more than", "faster than", "exceed": a maximum once negated.
    Over,
    /// "within", "closer than": a keep-out once negated.
    Within,
}

/// One measured number.
#[derive(Clone, Debug, PartialEq)]
pub struct Quantity {
    /// What it measures.
    pub kind: Kind,
    /// SI value.
    pub value: f64,
    /// How it bounds.
    pub bound: Bound,
    /// "by 30 %": counted off rather than set to.
    pub by: bool,
    /// The words, normalised.
    pub said: String,
    /// Tokens covered.
    pub n_tokens: usize,
}

/// A unit that bare numbers are read in, for the answers offered to "2 what?".
pub type BareUnit = Option<&'static str>;

/// Every quantity in a text, in order; for checking that none was lost or invented.
#[must_use]
pub fn extract(text: &str) -> Vec<Quantity> {
    let tokens = tokens(text, Lexicon::get());
    let mut found = Vec::new();
    let mut at = 0;
    while at < tokens.len() {
        match quantity_at(&tokens, at, None) {
            Some(quantity) => {
                at += quantity.n_tokens;
                found.push(quantity);
            }
            None => at += 1,
        }
    }
    found
}

/// The quantity that starts at `at`, with its bound words.
#[must_use]
pub fn quantity_at(tokens: &[Token], at: usize, bare_unit: BareUnit) -> Option<Quantity> {
    let lexicon = Lexicon::get();
    let mut start = at;
    let mut bound = Bound::Plain;
    let mut by = false;
    // "no more than about": at most three bound phrases before the number.
    for _ in 0..3 {
        match lexicon.bound_at(tokens, start) {
            Some((found, n_tokens)) => {
                bound = stronger(bound, found);
                start += n_tokens;
            }
            None => break,
        }
    }
    // "a good yard": the article went with the bound.
    let article = start > at && word(tokens, at) == "a";
    if word(tokens, start) == "by" {
        by = true;
        start += 1;
    }
    // "by half", "by a third"
    if by && let Some((value, after, _)) = share(tokens, start) {
        let said = tokens[at..after].iter().map(|token| token.text.as_str()).collect::<Vec<_>>().join(" ");
        return Some(Quantity { bound, by, said, ..quantity(Kind::Fraction, value, after - at) });
    }
    let lead = duration_lead(tokens, start);
    let (mut quantity, start) =
        match lead.and_then(|start| single_duration(tokens, start).map(|q| (q, start))) {
            Some(found) => found,
            None => match measured(tokens, start, bare_unit) {
                Some(found) => (found, start),
                None => (single_of(tokens, start).filter(|_| article)?, start),
            },
        };
    let mut end = start + quantity.n_tokens;
    // "2 metres minimum", "0.5 m/s max"
    if quantity.kind != Kind::Bare {
        let (after, n_after) = match (word(tokens, end), word(tokens, end + 1)) {
            ("max" | "maximum" | "tops", _) => (Bound::Upper, 1),
            ("at", "most") => (Bound::Upper, 2),
            ("minimum" | "min", _) => (Bound::Lower, 1),
            ("at", "least") => (Bound::Lower, 2),
            _ => (Bound::Plain, 0),
        };
        bound = stronger(bound, after);
        end += n_after;
    }
    if word(tokens, end) == "or" && matches!(word(tokens, end + 1), "so" | "more" | "less") {
        bound = match word(tokens, end + 1) {
            "more" => Bound::Lower,
            "less" => Bound::Upper,
            _ => bound,
        };
        end += 2;
    }
    // "by one about the mud": a rule, not a number.
    if by && quantity.kind == Kind::Bare && word(tokens, start) == "one" {
        return None;
    }
    if by && quantity.kind != Kind::Fraction && quantity.kind != Kind::Distance {
        by = quantity.kind == Kind::Duration;
    }
    quantity.bound = bound;
    quantity.by = by;
    quantity.said = tokens[at..end].iter().map(|token| token.text.as_str()).collect::<Vec<_>>().join(" ");
    quantity.n_tokens = end - at;
    Some(quantity)
}

/// Where the duration of "for the next ten minutes" starts.
fn duration_lead(tokens: &[Token], at: usize) -> Option<usize> {
    let mut idx = at;
    for lead in [
        &["for", "over", "during"][..],
        &["just", "only", "about", "around", "at"],
        &["least"],
        &["the", "another"],
        &["next", "following", "coming"],
        &["full"],
    ] {
        idx += usize::from(lead.contains(&word(tokens, idx)));
    }
    (idx > at).then_some(idx)
}

fn stronger(a: Bound, b: Bound) -> Bound {
    if b == Bound::Plain { a } else { b }
}

fn word(tokens: &[Token], at: usize) -> &str {
    tokens.get(at).map_or("", |token| token.text.as_str())
}

fn measured(tokens: &[Token], at: usize, bare_unit: BareUnit) -> Option<Quantity> {
    // Most words open no number: they are told apart first, since this is asked of every word.
    if !may_open(word(tokens, at)) {
        return None;
    }
    fraction_of_speed(tokens, at).or_else(|| compound(tokens, at)).or_else(|| bare(tokens, at, bare_unit))
}

/// Whether a measured number can begin with this word.
fn may_open(word: &str) -> bool {
    word.starts_with(|c: char| c.is_ascii_digit() || c == '.')
        || matches!(
            word,
            "a" | "an"
                | "one"
                | "another"
                | "single"
                | "full"
                | "point"
                | "oh"
                | "o"
                | "minus"
                | "negative"
                | "arm's"
                | "arms"
                | "arm"
                | "hour"
        )
        || is_number_word(word)
        || fraction_word(word).is_some()
}

fn bare(tokens: &[Token], at: usize, bare_unit: BareUnit) -> Option<Quantity> {
    let number = number_at(tokens, at)?;
    // "room 3", "the two chairs": a number in a name or a count is the noun phrase's business.
    match bare_unit.and_then(|unit| Lexicon::get().unit(unit)) {
        Some((kind, scale)) => Some(quantity(kind, round_safe(kind, number.value * scale), number.n_tokens)),
        None => Some(quantity(Kind::Bare, number.value, number.n_tokens)),
    }
}

/// Distances round up and limits down, to 1e-4.
#[must_use]
pub fn round_safe(kind: Kind, value: f64) -> f64 {
    let scaled = value * 1e4;
    // Within rounding noise of a tick, that tick was meant.
    let ticks = if (scaled - scaled.round()).abs() < 1e-6 {
        scaled.round()
    } else if kind == Kind::Distance {
        scaled.ceil()
    } else {
        scaled.floor()
    };
    ticks / 1e4
}

fn quantity(kind: Kind, value: f64, n_tokens: usize) -> Quantity {
    Quantity { kind, value, bound: Bound::Plain, by: false, said: String::new(), n_tokens }
}

#[cfg(test)]
mod tests;
