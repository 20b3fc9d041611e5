//! Numbers with their units: shares of the top speed, compound measures, rates.

use super::{Kind, Quantity, quantity, round_safe, word};
use crate::lexicon::Lexicon;
use crate::number::{fraction_word, number_at};
use crate::text::Token;

/// "half speed", "a quarter of your top speed", "30 percent".
pub(super) fn fraction_of_speed(tokens: &[Token], at: usize) -> Option<Quantity> {
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
pub(super) fn share(tokens: &[Token], at: usize) -> Option<(f64, usize, bool)> {
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
pub(super) fn compound(tokens: &[Token], at: usize) -> Option<Quantity> {
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

pub(super) fn single(tokens: &[Token], at: usize) -> Option<Quantity> {
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
pub(super) fn single_of(tokens: &[Token], at: usize) -> Option<Quantity> {
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

pub(super) fn single_duration(tokens: &[Token], at: usize) -> Option<Quantity> {
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
