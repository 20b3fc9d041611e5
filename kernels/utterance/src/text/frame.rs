//! Turns of speech that say an order backwards: "a metre is the closest you should be to it" becomes "keep a metre
//! from it".
//!
//! `frames.txt` lists them, a line each, with holes for a distance and for some words. One rewriting before the
//! grammar, so that the rest of the parser sees plain orders only; it adds no number and no name that was not said.

use std::collections::{HashMap, HashSet};
use std::sync::LazyLock;

use super::Token;
use crate::quantity::{Kind, quantity_at};

/// Most words that a hole takes.
const N_WORDS_MAX: usize = 8;

/// One element of a turn of speech.
enum Part {
    /// Where a sentence, or a clause behind a connector, begins.
    Start,
    /// Where it ends.
    End,
    /// One of these words.
    Word { choices: Vec<String>, may_miss: bool },
    /// A distance.
    Distance,
    /// Some words, as few as fit, with no mark among them.
    Words,
}

struct Frame {
    parts: Vec<Part>,
    /// Words, and `{1}` for what the first hole took.
    plain: Vec<String>,
}

#[derive(Default)]
struct Frames {
    all: Vec<Frame>,
    /// Frames by a word that they cannot do without.
    by_word: HashMap<String, Vec<usize>>,
}

static FRAMES: LazyLock<Frames> = LazyLock::new(|| Frames::read(include_str!("../frames.txt")));

impl Frames {
    fn read(text: &str) -> Frames {
        let mut frames = Frames::default();
        let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
        for (turn, plain) in lines.filter_map(|line| line.split_once("=>")) {
            let parts: Vec<Part> = turn.split_whitespace().map(part).collect();
            let needed = parts.iter().filter_map(|part| match part {
                Part::Word { choices, may_miss: false } => Some(choices),
                _ => None,
            });
            // The fewest choices, and among those the longest word: the rarest in speech.
            let rarest = needed.min_by_key(|choices| {
                let shortest = choices.iter().map(String::len).min().unwrap_or_default();
                std::cmp::Reverse(shortest)
            });
            for word in rarest.into_iter().flatten() {
                frames.by_word.entry(word.clone()).or_default().push(frames.all.len());
            }
            let plain = plain.split_whitespace().map(str::to_owned).collect();
            frames.all.push(Frame { parts, plain });
        }
        frames
    }
}

fn part(text: &str) -> Part {
    match text {
        "^" => Part::Start,
        "$" => Part::End,
        "<distance>" => Part::Distance,
        "<words>" => Part::Words,
        word => {
            let may_miss = word.ends_with('?');
            let choices = word.trim_end_matches('?').split('|').map(str::to_owned).collect();
            Part::Word { choices, may_miss }
        }
    }
}

/// The tokens with turns of speech said plainly.
pub(super) fn said_plainly(tokens: Vec<Token>) -> Vec<Token> {
    let frames = &*FRAMES;
    let mut seen = HashSet::new();
    let candidates: Vec<&Frame> = tokens
        .iter()
        .filter_map(|token| frames.by_word.get(&token.text))
        .flatten()
        .filter(|idx| seen.insert(**idx))
        .filter_map(|idx| frames.all.get(*idx))
        .collect();
    if candidates.is_empty() {
        return tokens;
    }
    let mut out: Vec<Token> = Vec::with_capacity(tokens.len());
    let mut at = 0;
    while let Some(token) = tokens.get(at) {
        let found = candidates.iter().find_map(|frame| {
            let mut holes = Vec::new();
            fits(&frame.parts, &tokens, at, &mut holes).filter(|end| *end > at).map(|end| (frame, holes, end))
        });
        match found {
            Some((frame, holes, end)) => {
                for word in &frame.plain {
                    let hole = word
                        .strip_prefix('{')
                        .and_then(|rest| rest.strip_suffix('}'))
                        .and_then(|number| number.parse::<usize>().ok())
                        .and_then(|number| holes.get(number.wrapping_sub(1)));
                    match hole {
                        Some((from, to)) => {
                            out.extend(tokens.get(*from..*to).unwrap_or_default().iter().cloned())
                        }
                        None => out.push(Token { text: word.clone(), glued: false }),
                    }
                }
                at = end;
            }
            None => {
                out.push(token.clone());
                at += 1;
            }
        }
    }
    out
}

/// Where the parts end when they fit at `at`; the holes' ranges are put into `holes`.
fn fits(parts: &[Part], tokens: &[Token], at: usize, holes: &mut Vec<(usize, usize)>) -> Option<usize> {
    crate::steps::step();
    let Some((first, rest)) = parts.split_first() else { return Some(at) };
    let word = |idx: usize| tokens.get(idx).map_or("", |token| token.text.as_str());
    match first {
        Part::Start => {
            let before = at.checked_sub(1).map_or(".", word);
            const OPENERS: [&str; 12] = [
                "so",
                "and",
                "but",
                "because",
                "then",
                "hence",
                "therefore",
                "thus",
                "please",
                ".",
                ",",
                ";",
            ];
            (OPENERS.contains(&before) || matches!(before, "!" | "?" | ":" | "-"))
                .then(|| fits(rest, tokens, at, holes))
                .flatten()
        }
        Part::End => {
            const CLOSERS: [&str; 16] = [
                "so", "and", "but", "because", "until", "for", "when", "while", "if", "or", "please",
                "since", "as", "ok", "okay", "thanks",
            ];
            let ends =
                tokens.get(at).is_none_or(|next| next.is_mark() || CLOSERS.contains(&next.text.as_str()));
            ends.then(|| fits(rest, tokens, at, holes)).flatten()
        }
        Part::Word { choices, may_miss } => {
            let taken = tokens
                .get(at)
                .filter(|token| choices.contains(&token.text))
                .and_then(|_| fits(rest, tokens, at + 1, holes));
            taken.or_else(|| may_miss.then(|| fits(rest, tokens, at, holes)).flatten())
        }
        Part::Distance => {
            let quantity = quantity_at(tokens, at, None).filter(|found| found.kind == Kind::Distance)?;
            holes.push((at, at + quantity.n_tokens));
            fits(rest, tokens, at + quantity.n_tokens, holes).or_else(|| {
                holes.pop();
                None
            })
        }
        Part::Words => (1..=N_WORDS_MAX).find_map(|n_words| {
            let here = tokens.get(at..at + n_words)?;
            if here.last().is_some_and(Token::is_mark) || here.iter().any(Token::is_mark) {
                return None;
            }
            holes.push((at, at + n_words));
            let n_holes = holes.len();
            fits(rest, tokens, at + n_words, holes).or_else(|| {
                holes.truncate(n_holes - 1);
                None
            })
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::FRAMES;
    use crate::text::tests::check_read_as as check;

    #[test]
    fn every_line_of_the_file_is_a_frame_that_names_its_holes() {
        let lines = include_str!("../frames.txt").lines().filter(|line| line.contains("=>")).count();
        assert_eq!(FRAMES.all.len(), lines);
        for frame in &FRAMES.all {
            let n_holes = frame
                .parts
                .iter()
                .filter(|part| matches!(part, super::Part::Distance | super::Part::Words))
                .count();
            let named = frame.plain.iter().filter(|word| word.starts_with('{')).count();
            // Only a change may leave something out, the number that no longer holds; and a task, all of it.
            let changes = frame.plain.is_empty() || frame.plain.iter().any(|word| word == "make");
            assert!(named == n_holes || changes && named < n_holes, "{:?}", frame.plain);
        }
    }

    #[test]
    fn orders_said_backwards_are_said_plainly() {
        check("Two feet is the closest you should ever get to the kiln", "keep two feet away from the kiln");
        check("neither the loom nor the wheel may be touched", "the loom and the wheel may not be touched");
        check(
            "treat the kiln as though there were a rope one metre around it",
            "keep one metre away from the kiln",
        );
    }

    #[test]
    fn what_only_looks_like_one_is_left_alone() {
        for text in ["two feet is the depth of the pond", "neither do i", "treat the plants with care"] {
            check(text, text);
        }
    }
}
