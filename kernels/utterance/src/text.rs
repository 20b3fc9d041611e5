//! Words out of raw text: lower case, contractions undone, numbers apart from their units.
//!
//! Nothing is interpreted here and nothing is dropped but characters that carry no words. Work is
//! linear in the text.

mod frame;
mod repair;
mod subject;

use crate::lexicon::Lexicon;
use frame::said_plainly;
use repair::{function_words, push_compound, shortened, split_short_is, than_for_then, without_counts};
use subject::spoken_to;

/// Most characters an utterance may have.
pub const CHARS_MAX: usize = 2000;

/// One word, number or punctuation mark.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Token {
    /// Lower case, with straight apostrophes.
    pub text: String,
    /// Whether the speaker wrote it glued to the token before ("60" and "cm").
    pub glued: bool,
}

impl Token {
    /// Whether it is a mark that ends or pauses a sentence.
    #[must_use]
    pub fn is_mark(&self) -> bool {
        matches!(self.text.as_str(), "." | "," | ";" | "!" | "?" | ":" | "-")
    }
}

/// The tokens of a text, with contractions written out.
#[must_use]
pub fn tokens(text: &str, lexicon: &Lexicon) -> Vec<Token> {
    let mut out = Vec::new();
    for mut token in raw_tokens(text) {
        if let Some(word) = shortened(&token.text, lexicon) {
            token.text = word;
        }
        if let Some(words) = lexicon.written_out(&token.text) {
            out.extend(words.iter().map(|word| Token { text: word.clone(), glued: false }));
        } else if token.text.contains('-') && token.text.len() > 1 {
            push_compound(&token, lexicon, &mut out);
        } else {
            out.push(token);
        }
    }
    let repaired = function_words(than_for_then(without_counts(out)), lexicon);
    said_plainly(spoken_to(split_short_is(repaired, lexicon), lexicon))
}

fn raw_tokens(text: &str) -> Vec<Token> {
    let chars: Vec<char> = text.chars().take(CHARS_MAX).flat_map(plain).collect();
    let mut out = Vec::new();
    let mut at = 0;
    while at < chars.len() {
        let start = at;
        let glued = at > 0 && !chars[at - 1].is_whitespace();
        let c = chars[at];
        if c.is_ascii_digit() || (c == '.' && digit_at(&chars, at + 1) && !digit_before(&chars, at)) {
            at = number_end(&chars, at);
            // "3rd floor": an ordinal names.
            let ending: String = chars.iter().skip(at).take(2).collect();
            let ends = chars.get(at + 2).is_none_or(|c| !c.is_alphanumeric());
            if ends && matches!(ending.as_str(), "st" | "nd" | "rd" | "th") {
                at += 2;
                out.push(Token { text: word_text(&chars[start..at]), glued });
                continue;
            }
            out.push(Token { text: number_text(&chars[start..at]), glued });
        } else if c.is_alphabetic() || c == '°' {
            at = word_end(&chars, at);
            out.push(Token { text: word_text(&chars[start..at]), glued });
        } else {
            at += 1;
            match c {
                '\'' | '"' if digit_before(&chars, start) => out.push(Token { text: c.to_string(), glued }),
                '%' | '/' | '.' | ',' | ';' | '!' | '?' | ':' => {
                    out.push(Token { text: c.to_string(), glued })
                }
                '-' if !glued && digit_at(&chars, at) => {
                    out.push(Token { text: "minus".into(), glued });
                }
                // A dash between spaces pauses; a lone hyphen elsewhere joins nothing.
                '-' if !glued => out.push(Token { text: "-".into(), glued }),
                '\n' => out.push(Token { text: ".".into(), glued: false }),
                '(' | ')' | '[' | ']' => {
                    // "1) … 2) …", "(a) … (b) …": marks of a list.
                    let mark = list_mark(&chars, start);
                    if mark.is_some_and(|n| n < 0) {
                        out.pop();
                    }
                    at += mark.map_or(0, |n| usize::try_from(n).unwrap_or(0));
                    let text = if mark.is_some() { "." } else { "," };
                    out.push(Token { text: text.into(), glued: false });
                }
                // "distance < 2 m", ">= 2 m"
                '<' | '>' | '≤' | '≥' => {
                    let equal = chars.get(at) == Some(&'=');
                    at += usize::from(equal);
                    let words = match c {
                        '>' if equal => ["at", "least"],
                        '≥' => ["at", "least"],
                        '>' => ["more", "than"],
                        _ => ["less", "than"],
                    };
                    out.extend(words.map(|word| Token { text: word.to_owned(), glued: false }));
                }
                '=' => out.push(Token { text: "is".into(), glued: false }),
                '&' => out.push(Token { text: "and".into(), glued: false }),
                _ => {}
            }
        }
    }
    out
}

/// Whether a bracket belongs to the mark of a list: how many characters follow of it, or -1 for "1)".
fn list_mark(chars: &[char], at: usize) -> Option<isize> {
    let is_label = |idx: usize| chars.get(idx).is_some_and(|c| c.is_alphanumeric());
    if chars.get(at) == Some(&'(') && is_label(at + 1) && chars.get(at + 2) == Some(&')') {
        return Some(2);
    }
    let starts = |idx: usize| idx == 0 || chars.get(idx - 1).is_some_and(|c| c.is_whitespace());
    let closes = chars.get(at) == Some(&')') && at > 0 && is_label(at - 1) && starts(at - 1);
    closes.then_some(-1)
}

/// Lower case, straight quotes, plain dashes, vulgar fractions as digits.
fn plain(c: char) -> Vec<char> {
    match c {
        '’' | '‘' | 'ʼ' | '`' | '´' | '′' => vec!['\''],
        '“' | '”' | '″' => vec!['"'],
        '–' | '—' | '−' | '‐' | '‑' => vec!['-'],
        '½' => " 0.5 ".chars().collect(),
        '¼' => " 0.25 ".chars().collect(),
        '¾' => " 0.75 ".chars().collect(),
        '…' => vec![',', ' '],
        _ => c.to_lowercase().collect(),
    }
}

fn digit_at(chars: &[char], at: usize) -> bool {
    chars.get(at).is_some_and(char::is_ascii_digit)
}

fn digit_before(chars: &[char], at: usize) -> bool {
    at > 0 && digit_at(chars, at - 1)
}

/// Digits with one decimal point or comma, or thousands' commas.
fn number_end(chars: &[char], start: usize) -> usize {
    let mut at = start;
    let mut seen_point = false;
    while at < chars.len() {
        let joins = (chars[at] == '.' || chars[at] == ',') && !seen_point && digit_at(chars, at + 1);
        if joins {
            seen_point = chars[at] == '.';
        } else if !chars[at].is_ascii_digit() {
            break;
        }
        at += 1;
    }
    at
}

/// "1,000" loses its comma; "1,5" is a decimal comma.
fn number_text(chars: &[char]) -> String {
    let text: String = chars.iter().collect();
    let groups: Vec<&str> = text.split(',').collect();
    match groups.as_slice() {
        [_] => text,
        [_, rest @ ..] if rest.iter().all(|group| group.split('.').next().is_some_and(|g| g.len() == 3)) => {
            groups.concat()
        }
        [whole, decimals] if !text.contains('.') => format!("{whole}.{decimals}"),
        _ => text,
    }
}

/// Letters and digits with inner apostrophes and hyphens; "m/s" and its like stay whole.
fn word_end(chars: &[char], start: usize) -> usize {
    let mut at = start + 1;
    let letter = |at: usize| chars.get(at).is_some_and(|c| c.is_alphanumeric());
    while at < chars.len() {
        let c = chars[at];
        let inner = matches!(c, '\'' | '-') && letter(at + 1);
        let slash = c == '/' && is_unit_slash(&chars[start..at], &chars[at + 1..]);
        // The plural possessive: "nurses' station".
        let trailing = c == '\'' && chars[at - 1] == 's';
        if !(c.is_alphanumeric() || inner || slash || trailing) {
            break;
        }
        at += 1;
    }
    at
}

fn word_text(chars: &[char]) -> String {
    chars.iter().collect()
}

fn is_unit_slash(before: &[char], after: &[char]) -> bool {
    const TOPS: [&str; 12] = ["m", "cm", "mm", "km", "ft", "in", "rad", "rads", "deg", "°", "mi", "degrees"];
    const BOTTOMS: [&str; 8] = ["s", "sec", "second", "h", "hr", "hour", "min", "minute"];
    let top: String = before.iter().collect();
    let bottom: String = after.iter().take_while(|c| c.is_alphabetic()).take(8).collect();
    TOPS.contains(&top.as_str()) && BOTTOMS.contains(&bottom.as_str())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(text: &str, words: &[&str]) {
        check_read_as(text, &words.join(" "));
    }

    /// What a text is read as, a space between its words.
    #[track_caller]
    pub(super) fn check_read_as(text: &str, expected: &str) {
        let words: Vec<String> = tokens(text, Lexicon::get()).into_iter().map(|token| token.text).collect();
        assert_eq!(words.join(" "), expected, "{text}");
    }

    #[test]
    fn contractions_are_written_out_with_and_without_apostrophes() {
        check("Don’t go", &["do", "not", "go"]);
        check("dont go", &["do", "not", "go"]);
        check("it's the baby's crib", &["it", "is", "the", "baby's", "crib"]);
    }

    #[test]
    fn numbers_part_from_their_units() {
        check("60cm", &["60", "cm"]);
        check("1.5m/s, .5 m", &["1.5", "m/s", ",", ".5", "m"]);
        check("6\" or 3'", &["6", "\"", "or", "3", "'"]);
        check("1,5 m and 1,000 m", &["1.5", "m", "and", "1000", "m"]);
        check("30-centimetre", &["30", "centimetre"]);
    }

    #[test]
    fn other_scripts_and_symbols_never_stop_the_tokens() {
        check("не ходи 走开 🤖 avoid", &["не", "ходи", "走开", "avoid"]);
        check("nurses' station", &["nurses'", "station"]);
    }
}
