//! Words as they were meant: letters held down, counts, "then" for "than", "'s" for "is", compounds.

use super::Token;
use crate::lexicon::{Lexicon, Sense};
use crate::speech::{Speech, speech};

/// "One, never …. Two, …": words that count what is said.
pub(super) fn without_counts(tokens: Vec<Token>) -> Vec<Token> {
    let counts = |at: usize| {
        let opens = at
            .checked_sub(1)
            .and_then(|idx| tokens.get(idx))
            .is_none_or(|b| matches!(b.text.as_str(), "." | ":" | ";"));
        let word = tokens.get(at).map_or("", |token| token.text.as_str());
        let pauses = tokens.get(at + 1).is_some_and(|next| matches!(next.text.as_str(), "," | ":" | "-"));
        opens
            && pauses
            && matches!(
                word,
                "one"
                    | "two"
                    | "three"
                    | "four"
                    | "first"
                    | "second"
                    | "third"
                    | "firstly"
                    | "secondly"
                    | "thirdly"
                    | "lastly"
                    | "finally"
                    | "next"
            )
    };
    let n_tokens = tokens.len();
    let kept: Vec<bool> = (0..n_tokens).map(|at| !(counts(at) || at > 0 && counts(at - 1))).collect();
    tokens.into_iter().zip(kept).filter_map(|(token, keep)| keep.then_some(token)).collect()
}

/// "closer then two feet": a slip that nobody hears.
pub(super) fn than_for_then(mut tokens: Vec<Token>) -> Vec<Token> {
    for at in 1..tokens.len() {
        let compares = matches!(
            tokens[at - 1].text.as_str(),
            "closer"
                | "nearer"
                | "faster"
                | "slower"
                | "quicker"
                | "further"
                | "farther"
                | "more"
                | "less"
                | "higher"
                | "lower"
                | "greater"
        );
        if compares && tokens[at].text == "then" {
            "than".clone_into(&mut tokens[at].text);
        }
    }
    tokens
}

/// "away form the bed", "not under it nor behind it", "for the first ten minutes": words that stand for others.
pub(super) fn function_words(tokens: Vec<Token>, lexicon: &Lexicon) -> Vec<Token> {
    let mut out: Vec<Token> = Vec::with_capacity(tokens.len());
    let mut is_negated = false;
    for (at, token) in tokens.iter().enumerate() {
        let before = out.last().map_or("", |before: &Token| before.text.as_str());
        let next = tokens.get(at + 1).map_or("", |next| next.text.as_str());
        is_negated |= matches!(token.text.as_str(), "not" | "never");
        is_negated &= !matches!(token.text.as_str(), "." | "neither");
        let place = || {
            lexicon.senses_at(&tokens, at + 1).is_some_and(|(senses, _)| {
                senses.iter().any(|sense| {
                    matches!(
                        sense,
                        Sense::PrepOn
                            | Sense::PrepNear
                            | Sense::PrepUnder
                            | Sense::PrepBehind
                            | Sense::PrepBetween
                    )
                })
            })
        };
        let text = match token.text.as_str() {
            "form"
                if matches!(next, "the" | "my" | "any" | "a" | "it" | "them" | "all") && before != "the" =>
            {
                "from"
            }
            "nor" if is_negated && place() => "or",
            _ => token.text.as_str(),
        };
        let counts = |idx: usize| {
            tokens.get(idx).is_some_and(|next| {
                next.text.starts_with(|c: char| c.is_ascii_digit())
                    || crate::number::is_number_word(&next.text)
            })
        };
        let opens_time = before == "for" && token.text == "the" && next == "first" && counts(at + 2)
            || token.text == "first" && at > 1 && tokens[at - 1].text == "the" && before == "for";
        // "he planted them himself"
        let is_emphatic =
            matches!(token.text.as_str(), "himself" | "herself" | "itself" | "themselves" | "ourselves");
        if !opens_time && !is_emphatic {
            out.push(Token { text: text.to_owned(), glued: token.glued });
        }
    }
    out
}

/// "the rug's gone", "its still wet": an "is" when a state follows, else a possessor.
pub(super) fn split_short_is(tokens: Vec<Token>, lexicon: &Lexicon) -> Vec<Token> {
    let mut out = Vec::with_capacity(tokens.len());
    for (at, token) in tokens.iter().enumerate() {
        let noun = match token.text.as_str() {
            "its" => Some("it"),
            text => text.strip_suffix("'s"),
        };
        match noun.filter(|_| state_follows(&tokens, at + 1, lexicon)) {
            Some(noun) => out.extend([noun, "is"].map(|word| Token { text: word.to_owned(), glued: false })),
            None => out.push(token.clone()),
        }
    }
    out
}

/// Whether what starts at `at` is said of a thing rather than owned by it.
fn state_follows(tokens: &[Token], at: usize, lexicon: &Lexicon) -> bool {
    let phrase = lexicon.senses_at(tokens, at);
    let is_state = phrase
        .is_some_and(|(senses, _)| senses.iter().any(|sense| sense.is_state() || *sense == Sense::Allow));
    let leads_to_state = tokens.get(at).is_some_and(|next| lexicon.leads_to_state(&next.text));
    // "the stove's hot so keep away", but "the cat's hot meal".
    let n_tokens = phrase.map_or(1, |(_, n)| n);
    let word_after = tokens
        .get(at + n_tokens)
        .is_some_and(|after| !after.is_mark() && lexicon.senses_at(tokens, at + n_tokens).is_none());
    // "the sign's out", "the lead's trailing across the landing": no owner owns these.
    let place = |sense: &Sense| {
        matches!(sense, Sense::PrepOn | Sense::PrepNear | Sense::PrepUnder | Sense::PrepBehind)
    };
    let leads_to_place = phrase.is_some_and(|(senses, _)| senses.iter().any(place));
    let told = tokens.get(at).is_some_and(|next| !matches!(next.text.as_str(), "left" | "right"))
        && tokens.get(at).is_some_and(|next| {
            matches!(speech(&next.text), Speech::Participle | Speech::Adjective | Speech::Verb) && !word_after
                || speech(&next.text) == Speech::Adverb
                || next.text.ends_with("ing") && phrase.is_none() && !word_after
                || matches!(
                    next.text.as_str(),
                    "out" | "off" | "where" | "gone" | "back" | "away" | "here" | "there"
                )
        });
    is_state && (n_tokens > 1 || !word_after)
        || leads_to_place
        || told
        || leads_to_state
        || tokens.get(at).is_some_and(|next| lexicon.is_state_word(&next.text)) && !word_after
}

/// "pleeease", "shhhhh", "sooo": a letter held down, when that leads to a word we know.
pub(super) fn shortened(word: &str, lexicon: &Lexicon) -> Option<String> {
    let chars: Vec<char> = word.chars().collect();
    let is_run = |at: usize| at >= 2 && chars[at] == chars[at - 1] && chars[at] == chars[at - 2];
    if lexicon.knows(word) || !chars[0].is_alphabetic() || !(2..chars.len()).any(is_run) {
        return None;
    }
    let twice: String = (0..chars.len()).filter(|at| !is_run(*at)).map(|at| chars[at]).collect();
    let mut once: Vec<char> = chars.clone();
    once.dedup();
    let once: String = once.into_iter().collect();
    let known = |word: &String| lexicon.knows(word) || lexicon.written_out(word).is_some();
    [twice, once].into_iter().find(known)
}

/// "30-centimetre" and "off-limits" fall apart; "walk-in" stays one word.
pub(super) fn push_compound(token: &Token, lexicon: &Lexicon, out: &mut Vec<Token>) {
    let parts: Vec<&str> = token.text.split('-').filter(|part| !part.is_empty()).collect();
    let phrase = parts.join(" ");
    let splits = lexicon.is_phrase(&phrase)
        || parts.iter().any(|part| crate::number::is_number_word(part))
        || parts.first().is_some_and(|part| part.starts_with(|c: char| c.is_ascii_digit()));
    if splits {
        out.extend(parts.iter().map(|part| Token { text: (*part).to_owned(), glued: false }));
    } else {
        out.push(token.clone());
    }
}
