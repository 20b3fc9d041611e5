//! Noun phrases: where a name starts and ends among the items.

mod part;

use crate::item::Item;
use crate::lexicon::Sense;
use crate::noun::{Name, Nouns};
pub(crate) use part::ARTICLES;
use part::{inside, is_all_of_a_name, nounable, word_fits};

/// Most words in a name. More is a sentence that we failed to read, and is asked about.
const WORDS_MAX: usize = 6;
/// Most determiners before a name: "all of the other …".
const DETS_MAX: usize = 4;

/// The name that starts at `at`, and its items.
///
/// `expected` says that the grammar wants a name here (after "near", "avoid"), so that a word with
/// another sense may open it.
#[must_use]
pub fn noun_phrase(items: &[Item], at: usize, expected: bool) -> Option<(Name, usize)> {
    crate::steps::step();
    let mut idx = at;
    let mut universal = false;
    // "around the" is one phrase.
    let mut determined =
        at.checked_sub(1).and_then(|idx| items.get(idx)).is_some_and(|b| b.text.ends_with(" the"));
    while let Some(item) = items.get(idx).filter(|item| item.is(Sense::Det) && idx - at < DETS_MAX) {
        let opens_name = items
            .get(idx + 1)
            .is_some_and(|next| next.is_word() || next.is(Sense::Det) || nounable(items, idx + 1, true))
            || is_all_of_a_name(items, idx + 1, idx + 1, expected);
        // "that" and "those" point by themselves when no noun follows.
        if !opens_name {
            break;
        }
        universal |= ["all", "every", "any", "each"].iter().any(|word| item.text.starts_with(word));
        determined = true;
        idx += 1;
    }
    let words_start = idx;
    while let Some(item) = items.get(idx) {
        let takes = item.is_word() && word_fits(items, idx, words_start)
            || (idx == words_start
                && !item.is_word()
                && nounable(
                    items,
                    idx,
                    determined
                        || (expected
                            && (!item.is_any(&[Sense::Motion, Sense::Hold])
                                || item.text.ends_with("ing")
                                    && items.get(idx + 1).is_some_and(Item::is_word))),
                ))
            || (!item.is_word() && is_all_of_a_name(items, idx, words_start, expected))
            || (idx > words_start
                && !item.is_word()
                && (inside(items, idx)
                    || determined
                        && item.is(Sense::Task)
                        && !item.text.contains(' ')
                        && !matches!(
                            item.text.as_str(),
                            "begin" | "start" | "continue" | "resume" | "finish"
                        )));
        if !takes || idx - words_start >= WORDS_MAX {
            break;
        }
        idx += 1;
    }
    if idx == words_start {
        return pronoun(items, at);
    }
    // "the blue one"
    let pointed = items.get(idx).filter(|item| matches!(item.text.as_str(), "one" | "ones"));
    let mut words: Vec<&str> = items[words_start..idx].iter().flat_map(|item| item.text.split(' ')).collect();
    // "edge of the pool" is about the pool; "pile of boxes" about boxes.
    let mut reference: Vec<&str> = words.clone();
    if let Some(item) = pointed {
        reference.push(&item.text);
        idx += 1;
    }
    // "the nurses' way", "the dog's space": theirs.
    let owned = words.last().is_some_and(|word| word.ends_with('\'') || word.ends_with("'s"));
    if owned
        && items.get(idx).is_some_and(|item| {
            matches!(item.text.as_str(), "way" | "path" | "space" | "personal space" | "own")
        })
    {
        idx += 1;
    }
    while items.get(idx).is_some_and(|item| item.is(Sense::Of)) {
        let Some((inner, n_items)) = inner_words(items, idx + 1) else { break };
        reference.push("of");
        reference.extend(items[idx + 1..idx + 1 + n_items].iter().flat_map(|item| item.text.split(' ')));
        if words.last().is_some_and(|head| Nouns::get().is_part(head)) {
            words = inner;
        }
        idx += 1 + n_items;
    }
    let nouns = Nouns::get();
    let universal = universal
        || words.first().is_some_and(|word| matches!(*word, "everything" | "anything" | "everyone"));
    let name = Name {
        obj: nouns.class_noun(&words),
        reference: reference.join(" "),
        is_pronoun: false,
        is_universal: universal,
        n_words: words.len(),
    };
    Some((name, idx - at))
}

fn inner_words(items: &[Item], at: usize) -> Option<(Vec<&str>, usize)> {
    let mut idx = at;
    while items.get(idx).is_some_and(|item| item.is(Sense::Det)) {
        idx += 1;
    }
    let start = idx;
    while (items.get(idx).is_some_and(|item| item.is_word() && word_fits(items, idx, start))
        || idx == start && nounable(items, idx, true))
        && idx - start < WORDS_MAX
    {
        idx += 1;
    }
    if idx == start {
        None
    } else {
        Some((items[start..idx].iter().flat_map(|item| item.text.split(' ')).collect(), idx - at))
    }
}

fn pronoun(items: &[Item], at: usize) -> Option<(Name, usize)> {
    let item = items.get(at)?;
    let points = item.is(Sense::Pronoun)
        && !(item.is(Sense::Filler) && items.get(at + 1).is_some_and(|next| !next.is(Sense::Copula)));
    points.then(|| (Name { reference: item.text.clone(), is_pronoun: true, ..Name::default() }, 1))
}
