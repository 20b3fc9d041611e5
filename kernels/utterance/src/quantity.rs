//! Distances, speeds, turn rates, fractions of the top speed and durations, in SI units.
//!
//! Values are rounded to a tenth of a millimetre, millimetre per second or milliradian per second,
//! each to the safe side, so that what is read back is exactly what holds.

use crate::lexicon::Lexicon;
use crate::number::{fraction_word, is_number_word, number_at};
use crate::text::{Token, tokens};

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

fn single_duration(tokens: &[Token], at: usize) -> Option<Quantity> {
    let bare_unit = matches!(word(tokens, at.saturating_sub(1)), "next" | "following" | "coming")
        .then(|| unit_at_token(tokens, at))
        .flatten()
        .filter(|unit| unit.kind == Kind::Duration);
    match bare_unit {
        // "for the next hour", "for the next hour and a half"
        Some(unit) => {
            let end = at + unit.n_tokens;
            let part = match (word(tokens, end), word(tokens, end + 1)) {
                ("and", "a") => fraction_word(word(tokens, end + 2)),
                _ => None,
            };
            let n_more = if part.is_some() { 3 } else { 0 };
            let value = unit.scale * (1.0 + part.unwrap_or(0.0));
            Some(quantity(Kind::Duration, value, unit.n_tokens + n_more))
        }
        None => compound(tokens, at).filter(|quantity| quantity.kind == Kind::Duration),
    }
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

/// "half speed", "a quarter of your top speed", "30 percent".
fn fraction_of_speed(tokens: &[Token], at: usize) -> Option<Quantity> {
    let (value, after, percent) = share(tokens, at)?;
    let mut end = after;
    while matches!(
        word(tokens, end),
        "of" | "the"
            | "your"
            | "its"
            | "normal"
            | "usual"
            | "full"
            | "max"
            | "maximum"
            | "top"
            | "regular"
            | "that"
    ) {
        end += 1;
    }
    let names_speed = matches!(word(tokens, end), "speed" | "pace" | "velocity" | "power" | "throttle");
    match (names_speed, percent) {
        (true, _) => Some(quantity(Kind::Fraction, value, end + 1 - at)),
        (false, true) => Some(quantity(Kind::Fraction, value, after - at)),
        _ => None,
    }
}

/// A share, the token after it, and whether it was a percentage.
fn share(tokens: &[Token], at: usize) -> Option<(f64, usize, bool)> {
    let skip = usize::from(matches!(word(tokens, at), "a" | "one"));
    if let Some(part) = fraction_word(word(tokens, at + skip)) {
        return Some((part, at + skip + 1, false));
    }
    let number = number_at(tokens, at)?;
    let after = at + number.n_tokens;
    match word(tokens, after) {
        "%" | "percent" | "pct" | "procent" => Some((number.value / 100.0, after + 1, true)),
        "per" if word(tokens, after + 1) == "cent" => Some((number.value / 100.0, after + 2, true)),
        part => fraction_word(part).map(|part| (number.value * part, after + 1, false)),
    }
}

/// "2 feet 6 inches", "an hour and 30 minutes", or a single measure.
fn compound(tokens: &[Token], at: usize) -> Option<Quantity> {
    let first = single(tokens, at)?;
    let after = at + first.n_tokens;
    let skip = usize::from(word(tokens, after) == "and");
    let second = match first.kind {
        Kind::Distance | Kind::Duration if number_at(tokens, after + skip).is_some() => {
            single(tokens, after + skip)
                .filter(|second| second.kind == first.kind && second.value < first.value)
        }
        _ => None,
    };
    // Only a smaller unit continues a measure: "2 m 50 cm", but not "1 m and 50 cm from the table".
    match second {
        Some(second) if skip == 0 || first.kind == Kind::Duration => Some(quantity(
            first.kind,
            round_safe(first.kind, first.value + second.value),
            first.n_tokens + skip + second.n_tokens,
        )),
        _ => Some(first),
    }
}

fn single(tokens: &[Token], at: usize) -> Option<Quantity> {
    let (value, unit_at) = amount(tokens, at)?;
    let unit = unit_at_token(tokens, unit_at)?;
    let mut end = unit_at + unit.n_tokens;
    let mut value = value;
    // "a metre and a half", "an hour and a quarter"
    if word(tokens, end) == "and"
        && word(tokens, end + 1) == "a"
        && let Some(part) = fraction_word(word(tokens, end + 2))
    {
        value += part;
        end += 3;
    }
    let (kind, scale, n_more) = with_rate(tokens, end, unit)?;
    Some(quantity(kind, round_safe(kind, value * scale), end + n_more - at))
}

/// How many of the unit, and where the unit stands.
fn amount(tokens: &[Token], at: usize) -> Option<(f64, usize)> {
    let after_of = |mut idx: usize| {
        for skip in ["of", "a", "an"] {
            idx += usize::from(word(tokens, idx) == skip);
        }
        idx
    };
    // "half a metre", "a quarter of an hour", "three quarters of a metre"
    if let Some((value, after, false)) = share(tokens, at)
        && unit_at_token(tokens, after_of(after)).is_some()
    {
        return Some((value, after_of(after)));
    }
    if let Some(number) = number_at(tokens, at) {
        let mut after = at + number.n_tokens;
        after += usize::from(word(tokens, after) == "of" && number.value <= 3.0);
        return Some((number.value, after));
    }
    if matches!(word(tokens, at), "a" | "an" | "one" | "another" | "single" | "full") {
        let skip = usize::from(matches!(
            word(tokens, at + 1),
            "full" | "single" | "good" | "whole" | "entire" | "clear"
        ));
        return unit_at_token(tokens, at + 1 + skip).filter(|unit| !unit.short).map(|_| (1.0, at + 1 + skip));
    }
    // "an arm's length" with the article dropped; "hour and a half"
    let bare_first = matches!(word(tokens, at), "arm's" | "arms" | "arm" | "hour");
    unit_at_token(tokens, at).filter(|_| bare_first).map(|_| (1.0, at))
}

/// One of the unit that stands here: "(a good) yard".
fn single_of(tokens: &[Token], at: usize) -> Option<Quantity> {
    let unit = unit_at_token(tokens, at).filter(|unit| !unit.short)?;
    let (kind, scale, n_more) = with_rate(tokens, at + unit.n_tokens, unit)?;
    let n_tokens = unit_at_token(tokens, at)?.n_tokens + n_more;
    Some(quantity(kind, round_safe(kind, scale), n_tokens))
}

struct Unit {
    kind: Kind,
    scale: f64,
    n_tokens: usize,
    /// Too short to follow "a": "a m" is no metre.
    short: bool,
}

fn unit_at_token(tokens: &[Token], at: usize) -> Option<Unit> {
    let lexicon = Lexicon::get();
    let (kind, scale, n_tokens) = lexicon.unit_at(tokens, at)?;
    let text = word(tokens, at);
    // "6 in from the wall" is inches; "2 in the kitchen" is not.
    if text == "in" && !matches!(word(tokens, at + 1), "from" | "away" | "of" | "clear" | "gap" | "off" | "")
    {
        return None;
    }
    Some(Unit { kind, scale, n_tokens, short: text.len() <= 2 })
}

/// A distance or an angle per time is a speed or a turn rate; an angle alone is nothing we know.
fn with_rate(tokens: &[Token], at: usize, unit: Unit) -> Option<(Kind, f64, usize)> {
    const ANGLE: Kind = Kind::TurnRate;
    if unit.kind == Kind::Speed || unit.kind == Kind::Duration {
        return Some((unit.kind, unit.scale, 0));
    }
    let skip = match word(tokens, at) {
        "per" | "a" | "an" | "each" | "every" | "/" => 1,
        "in" if matches!(word(tokens, at + 1), "a" | "one") => 2,
        _ => 0,
    };
    if skip > 0
        && let Some(time) = unit_at_token(tokens, at + skip).filter(|time| time.kind == Kind::Duration)
    {
        let kind = if unit.kind == ANGLE { ANGLE } else { Kind::Speed };
        return Some((kind, unit.scale / time.scale, skip + time.n_tokens));
    }
    let whole_rate = Lexicon::get().is_rate_unit(word(tokens, at.saturating_sub(1)));
    if unit.kind == ANGLE && !whole_rate {
        return None;
    }
    Some((unit.kind, unit.scale, 0))
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
