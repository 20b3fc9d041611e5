//! Slips of the fingers, put right only towards words that mean something to the grammar.
//!
//! An object's name is put right only when two letters changed places or one is doubled or
//! dropped in a common noun, and the reply says so.

use strsim::osa_distance;

use crate::lexicon::Lexicon;
use crate::noun::Nouns;
use crate::text::Token;

/// Longest word looked at. Chosen: no trigger word is longer.
const CHARS_MAX: usize = 16;
/// Most words put right in one utterance; beyond that it is no slip.
const FIXES_MAX: usize = 4;
/// Most unknown words looked at: names are unknown too, but a text of nothing else holds no slip.
const TRIES_MAX: usize = 16;

/// A noun as typed and as taken: ("stiars", "stairs").
pub type Slip = (String, String);

/// The tokens with slips put right, and which nouns were among them; none when nothing was.
#[must_use]
pub fn put_right(tokens: &[Token]) -> Option<(Vec<Token>, Vec<Slip>)> {
    let lexicon = Lexicon::get();
    let nouns = Nouns::get();
    let mut out = tokens.to_vec();
    let mut told = Vec::new();
    let (mut n_fixes, mut n_tries) = (0, 0);
    // After an article or a word we do not know, a name is likelier than a slip: "fume hood".
    let mut in_name = false;
    for token in &mut out {
        let word = token.text.clone();
        let after_name = std::mem::replace(&mut in_name, false);
        let n_chars = word.chars().count();
        let unknown = !lexicon.knows(&word) && !nouns.knows(&word) && !token.is_mark();
        in_name = unknown || nouns.knows(&word) || lexicon.is_article(&word);
        if !unknown
            || !(4..=CHARS_MAX).contains(&n_chars)
            || word.starts_with(|c: char| c.is_ascii_digit())
            || n_fixes == FIXES_MAX
            || n_tries == TRIES_MAX
        {
            continue;
        }
        n_tries += 1;
        if let Some(noun) = noun_for(&word) {
            told.push((word, noun.clone()));
            token.text = noun;
        } else if let Some(trigger) = trigger_for(&word).filter(|_| !after_name) {
            token.text = trigger;
            in_name = false;
        } else {
            continue;
        }
        n_fixes += 1;
    }
    if n_fixes == 0 { None } else { Some((out, told)) }
}

fn noun_for(word: &str) -> Option<String> {
    // A slip changes the length by one at most, and seldom the first letter.
    let first = word.bytes().next();
    let could_be = |noun: &&String| {
        let (one, two) = (noun.bytes().next(), noun.as_bytes().get(1).copied());
        noun.len().abs_diff(word.len()) <= 1 && (one == first || two == first)
    };
    Nouns::get().common().iter().filter(could_be).find(|noun| is_slip(word, noun)).cloned()
}

fn trigger_for(word: &str) -> Option<String> {
    // They are sorted: those with the same first letter stand together.
    let first = word.chars().next()?;
    let all = Lexicon::get().spellings();
    let start = all.partition_point(|known| known.chars().next() < Some(first));
    let same_letter = all.iter().skip(start).take_while(|known| known.starts_with(first));
    let mut close =
        same_letter.filter(|known| known.len().abs_diff(word.len()) <= 1 && osa_distance(word, known) == 1);
    let found = close.next()?;
    // Two candidates are a guess, unless they are forms of one word.
    let same_word = close.all(|other| other.starts_with(found.as_str()) || found.starts_with(other.as_str()));
    same_word.then(|| found.clone())
}

/// Two neighbours swapped, or one letter doubled or dropped inside a word of six letters or more.
fn is_slip(word: &str, noun: &str) -> bool {
    if osa_distance(word, noun) != 1 {
        return false;
    }
    let swapped = word.len() == noun.len() && {
        let (mut a, mut b): (Vec<char>, Vec<char>) = (word.chars().collect(), noun.chars().collect());
        a.sort_unstable();
        b.sort_unstable();
        a == b
    };
    swapped || (word.len() != noun.len() && noun.len() >= 6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(text: &str, fixed: Option<&str>) {
        let tokens = crate::text::tokens(text, Lexicon::get());
        let found = put_right(&tokens)
            .map(|(tokens, _)| tokens.iter().map(|t| t.text.clone()).collect::<Vec<_>>().join(" "));
        assert_eq!(found.as_deref(), fixed, "{text}");
    }

    #[test]
    fn triggers_and_common_nouns_are_put_right() {
        check("aviod the rug", Some("avoid the rug"));
        check("dont go beneeth it", Some("do not go beneath it"));
        check("avoid the stiars", Some("avoid the stairs"));
        check("stay out of the kichen", Some("stay out of the kitchen"));
    }

    #[test]
    fn other_names_are_left_alone() {
        check("avoid the grill", None);
        check("avoid the lever", None);
        check("avoid the zorb", None);
    }
}
