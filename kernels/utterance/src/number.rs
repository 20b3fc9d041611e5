//! Numbers in digits and in English words.

use crate::text::Token;

/// A number and how many tokens it took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Number {
    /// Its value.
    pub value: f64,
    /// Tokens it covers.
    pub n_tokens: usize,
}

const UNITS: [&str; 20] = [
    "zero",
    "one",
    "two",
    "three",
    "four",
    "five",
    "six",
    "seven",
    "eight",
    "nine",
    "ten",
    "eleven",
    "twelve",
    "thirteen",
    "fourteen",
    "fifteen",
    "sixteen",
    "seventeen",
    "eighteen",
    "nineteen",
];
const TENS: [&str; 8] = ["twenty", "thirty", "forty", "fifty", "sixty", "seventy", "eighty", "ninety"];

/// Whether the word is a cardinal by itself ("seven", "forty").
#[must_use]
pub fn is_number_word(word: &str) -> bool {
    cardinal(word).is_some()
}

fn cardinal(word: &str) -> Option<f64> {
    let unit = UNITS.iter().position(|name| *name == word).map(|idx| idx as f64);
    let ten = || TENS.iter().position(|name| *name == word).map(|idx| 20.0 + 10.0 * idx as f64);
    unit.or_else(ten).or(match word {
        "nought" | "naught" => Some(0.0),
        "fourty" => Some(40.0),
        "ninty" => Some(90.0),
        "dozen" => Some(12.0),
        _ => None,
    })
}

/// The fraction a word names: "half", "third", "quarter", "tenth".
#[must_use]
pub fn fraction_word(word: &str) -> Option<f64> {
    match word {
        "half" => Some(0.5),
        "third" | "thirds" => Some(1.0 / 3.0),
        "quarter" | "quarters" | "fourth" => Some(0.25),
        "fifth" | "fifths" => Some(0.2),
        "tenth" | "tenths" => Some(0.1),
        _ => None,
    }
}

fn digits(token: &Token) -> Option<f64> {
    if !token.text.starts_with(|c: char| c.is_ascii_digit() || c == '.') {
        return None;
    }
    token.text.parse::<f64>().ok().filter(|value| value.is_finite())
}

/// The number that starts at `at`, in digits or words; "and a half" after it is included.
///
/// "a" and "half" are no numbers by themselves: what they mean depends on the unit.
#[must_use]
pub fn number_at(tokens: &[Token], at: usize) -> Option<Number> {
    if tokens.get(at).is_some_and(|token| matches!(token.text.as_str(), "minus" | "negative")) {
        let number = number_at(tokens, at + 1).filter(|number| number.value >= 0.0)?;
        return Some(Number { value: -number.value, n_tokens: number.n_tokens + 1 });
    }
    let whole = plain_number(tokens, at)?;
    let after = at + whole.n_tokens;
    let word = |offset: usize| tokens.get(after + offset).map_or("", |token| token.text.as_str());
    // "1/2"
    if word(0) == "/"
        && let Some(below) = tokens.get(after + 1).and_then(digits).filter(|below| *below > 0.0)
    {
        return Some(Number { value: whole.value / below, n_tokens: whole.n_tokens + 2 });
    }
    // "one and a half", "two and three quarters"
    if word(0) == "and" && (word(1) == "a" || word(1) == "one") {
        if let Some(part) = fraction_word(word(2)) {
            return Some(Number { value: whole.value + part, n_tokens: whole.n_tokens + 3 });
        }
    } else if word(0) == "and" && word(1) == "three" && word(2) == "quarters" {
        return Some(Number { value: whole.value + 0.75, n_tokens: whole.n_tokens + 3 });
    }
    // "1 ½" arrives as "1 0.5".
    if let Some(part) = tokens.get(after).and_then(digits).filter(|part| [0.25, 0.5, 0.75].contains(part))
        && whole.value.fract() == 0.0
    {
        return Some(Number { value: whole.value + part, n_tokens: whole.n_tokens + 1 });
    }
    Some(whole)
}

fn plain_number(tokens: &[Token], at: usize) -> Option<Number> {
    let first = tokens.get(at)?;
    let word = |idx: usize| tokens.get(idx).map_or("", |token| token.text.as_str());
    if first.text == "point" || (matches!(first.text.as_str(), "oh" | "o") && word(at + 1) == "point") {
        let skip = usize::from(first.text != "point");
        let part = decimals(tokens, at + skip + 1)?;
        return Some(Number { value: part.value, n_tokens: part.n_tokens + skip + 1 });
    }
    let mut number = match digits(first) {
        Some(value) => Number { value, n_tokens: 1 },
        None => words(tokens, at)?,
    };
    if word(at + number.n_tokens) == "point"
        && let Some(part) = decimals(tokens, at + number.n_tokens + 1)
    {
        number = Number { value: number.value + part.value, n_tokens: number.n_tokens + 1 + part.n_tokens };
    }
    Some(number)
}

/// "six", "two five" or "25" after a point.
fn decimals(tokens: &[Token], at: usize) -> Option<Number> {
    let mut text = String::from("0.");
    let mut n_tokens = 0;
    while let Some(token) = tokens.get(at + n_tokens) {
        match cardinal(&token.text) {
            Some(value) if value < 100.0 => text.push_str(&value.to_string()),
            _ if token.text.chars().all(|c| c.is_ascii_digit()) => text.push_str(&token.text),
            _ => break,
        }
        n_tokens += 1;
        if n_tokens == 4 {
            break;
        }
    }
    if n_tokens == 0 { None } else { Some(Number { value: text.parse().ok()?, n_tokens }) }
}

/// "two hundred and fifty", "twenty five", "a hundred", "a couple of", "a few".
fn words(tokens: &[Token], at: usize) -> Option<Number> {
    let word = |idx: usize| tokens.get(idx).map_or("", |token| token.text.as_str());
    let skip = usize::from(word(at) == "a");
    match word(at + skip) {
        "couple" if skip == 1 => {
            return Some(Number { value: 2.0, n_tokens: 2 + usize::from(word(at + 2) == "of") });
        }
        "few" if skip == 1 => return Some(Number { value: 3.0, n_tokens: 2 }),
        "hundred" | "thousand" | "dozen" if skip == 1 => {}
        _ if skip == 1 => return None,
        _ => {}
    }
    let mut idx = at + skip;
    let mut total = 0.0;
    let mut current = if skip == 1 { 1.0 } else { 0.0 };
    let mut may_add = true;
    while idx < tokens.len() {
        match word(idx) {
            "hundred" if idx > at => current *= 100.0,
            "thousand" if idx > at => {
                total += current * 1000.0;
                current = 0.0;
            }
            "and" if idx > at + skip && word(idx - 1) == "hundred" && cardinal(word(idx + 1)).is_some() => {}
            other => match cardinal(other) {
                // "twenty five" adds; "five six" are two numbers.
                Some(value) if may_add || (value < 10.0 && current % 100.0 >= 20.0) => current += value,
                _ => break,
            },
        }
        may_add = matches!(word(idx), "hundred" | "thousand" | "and");
        idx += 1;
    }
    if idx == at + skip { None } else { Some(Number { value: total + current, n_tokens: idx - at }) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lexicon::Lexicon;

    #[track_caller]
    fn check(text: &str, value: f64) {
        let tokens = crate::text::tokens(text, Lexicon::get());
        let number = number_at(&tokens, 0).unwrap_or_else(|| panic!("no number in {text}"));
        assert!((number.value - value).abs() < 1e-12, "{text}: {}", number.value);
        assert_eq!(number.n_tokens, tokens.len(), "{text}");
    }

    #[test]
    fn digits_words_and_fractions_agree() {
        check("0.25", 0.25);
        check("twenty five", 25.0);
        check("twenty-five", 25.0);
        check("two hundred and fifty", 250.0);
        check("a hundred", 100.0);
        check("point six", 0.6);
        check("zero point two five", 0.25);
        check("1 point 5", 1.5);
        check("one and a half", 1.5);
        check("two and three quarters", 2.75);
        check("1/2", 0.5);
        check("1½", 1.5);
        check("a couple of", 2.0);
    }

    #[test]
    fn an_article_is_no_number() {
        let tokens = crate::text::tokens("a metre", Lexicon::get());
        assert_eq!(number_at(&tokens, 0), None);
    }
}
