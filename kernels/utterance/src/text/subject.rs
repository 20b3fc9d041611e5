//! The robot spoken of as somebody else: "the agent must …", "it should …" become "you must …".
//!
//! One early rewriting, so that every frame of the grammar that knows "you" knows the others too. "it" is the
//! robot only as the subject of a demand that a thing cannot be under, and only when no thing could be meant.

use super::Token;
use crate::lexicon::{GOING, Lexicon, Sense};
use crate::speech::{Speech, speech};

/// Names that only the robot bears.
const OWN: [&str; 6] = ["agent", "robot", "bot", "rover", "droid", "roomba"];
/// Names that others bear too: the robot when they must do something.
const SHARED: [&str; 5] = ["machine", "vehicle", "player", "character", "unit"];
const MODALS: [&str; 10] =
    ["should", "must", "may", "can", "shall", "could", "might", "ought", "cannot", "would"];
/// What a subject of the third person takes, and what "you" takes in its place.
const AGREEMENT: [(&str, &str); 36] = [
    ("is", "are"),
    ("was", "were"),
    ("has", "have"),
    ("does", "do"),
    ("needs", "need"),
    ("wants", "want"),
    ("goes", "go"),
    ("passes", "pass"),
    ("crosses", "cross"),
    ("approaches", "approach"),
    ("reaches", "reach"),
    ("touches", "touch"),
    ("gets", "get"),
    ("comes", "come"),
    ("drives", "drive"),
    ("moves", "move"),
    ("enters", "enter"),
    ("nears", "near"),
    ("turns", "turn"),
    ("walks", "walk"),
    ("travels", "travel"),
    ("rolls", "roll"),
    ("runs", "run"),
    ("rotates", "rotate"),
    ("leaves", "leave"),
    ("sees", "see"),
    ("drops", "drop"),
    ("stays", "stay"),
    ("keeps", "keep"),
    ("avoids", "avoid"),
    ("navigates", "navigate"),
    ("heads", "head"),
    ("steps", "step"),
    ("slows", "slow"),
    ("starts", "start"),
    ("stops", "stop"),
];

/// The tokens with the robot spoken to rather than of.
pub(super) fn spoken_to(tokens: Vec<Token>, lexicon: &Lexicon) -> Vec<Token> {
    let mut out: Vec<Token> = Vec::with_capacity(tokens.len());
    // What "it" can mean so far.
    let (mut own_named, mut thing_named) = (false, false);
    let mut at = 0;
    while let Some(token) = tokens.get(at) {
        let n_name = own_name(&tokens, at, lexicon);
        let is_it = n_name == 0
            && token.text == "it"
            && (own_named || !thing_named)
            && (is_demand(&tokens, at + 1, lexicon) || is_case(&tokens, at, lexicon, own_named));
        if n_name > 0 || is_it {
            own_named |= n_name > 0;
            at += n_name.max(1);
            out.push(Token { text: "you".to_owned(), glued: false });
            agree(&tokens, &mut at, &mut out);
            continue;
        }
        own_named |= OWN.contains(&token.text.as_str());
        thing_named |= !token.is_mark()
            && !OWN.contains(&token.text.as_str())
            && lexicon.senses_at(&tokens, at).is_none()
            && speech(&token.text) == Speech::MayName
            && at > 0;
        out.push(token.clone());
        at += 1;
    }
    out
}

fn word(tokens: &[Token], at: usize) -> &str {
    tokens.get(at).map_or("", |token| token.text.as_str())
}

/// How many tokens at `at` name the robot; 0 when none do.
fn own_name(tokens: &[Token], at: usize, lexicon: &Lexicon) -> usize {
    let leads = usize::from(matches!(word(tokens, at), "the" | "this" | "our" | "my" | "an" | "a" | "your"));
    let n_kinds = usize::from(matches!(word(tokens, at + leads), "little" | "cleaning" | "delivery"));
    let name_at = at + leads + n_kinds;
    let name = word(tokens, name_at);
    let before = at.checked_sub(1).map_or("", |idx| word(tokens, idx));
    let after = name_at + 1;
    let n_tokens = after - at;
    if matches!(before, "no" | "any" | "other" | "another" | "every" | "each" | "the" | "a") {
        return 0;
    }
    let acts = is_demand(tokens, after, lexicon);
    if OWN.contains(&name) {
        let is_subject = acts
            || MODALS.contains(&word(tokens, after))
            || AGREEMENT.iter().any(|(third, _)| *third == word(tokens, after))
            || matches!(word(tokens, after), "never" | "not");
        let is_let = leads > 0 && matches!(before, "let" | "want" | "allow" | "allowing" | "letting");
        let is_gap = leads > 0 && before == "between" && word(tokens, after) == "and";
        if is_subject || is_let || is_gap { n_tokens } else { 0 }
    } else if SHARED.contains(&name) && acts && leads > 0 {
        n_tokens
    } else {
        0
    }
}

/// Whether a demand on somebody who moves starts at `at`: "should not go", "has to keep".
fn is_demand(tokens: &[Token], at: usize, lexicon: &Lexicon) -> bool {
    let n_modal = match (word(tokens, at), word(tokens, at + 1)) {
        ("has" | "needs" | "is" | "ought", "to") => 2,
        ("is", "not" | "never") if word(tokens, at + 2) == "to" => 3,
        ("is", "not" | "never") if word(tokens, at + 3) == "to" => 4,
        ("is", "forbidden" | "allowed" | "free" | "permitted" | "prohibited") => 3,
        ("does", "not") if matches!(word(tokens, at + 2), "need" | "have") => 4,
        (modal, _) if MODALS.contains(&modal) => 1,
        _ => return false,
    };
    let mut verb = at + n_modal;
    while matches!(
        word(tokens, verb),
        "not" | "never" | "always" | "only" | "also" | "ever" | "just" | "please"
    ) {
        verb += 1;
    }
    // What only somebody who moves is told.
    const ACTS: [&str; 14] = [
        "keep", "stay", "remain", "leave", "maintain", "avoid", "lose", "give", "take", "slow", "move", "go",
        "stop", "halt",
    ];
    // "it should stay closed" is said of a door.
    if matches!(word(tokens, verb), "stay" | "remain" | "keep")
        && !lexicon.is_state_word(word(tokens, verb + 1))
        && !matches!(speech(word(tokens, verb + 1)), Speech::Adjective | Speech::Participle)
    {
        return true;
    }
    if matches!(word(tokens, verb), "be" | "stay" | "remain" | "keep" | "fall" | "break" | "get") {
        return word(tokens, verb) == "be"
            && matches!(
                word(tokens, verb + 1),
                "careful" | "cautious" | "extra" | "within" | "closer" | "nearer"
            )
            || word(tokens, verb) == "get"
                && matches!(word(tokens, verb + 1), "close" | "near" | "closer" | "to");
    }
    let senses = lexicon.senses_at(tokens, verb).map_or(&[][..], |(senses, _)| senses);
    ACTS.contains(&word(tokens, verb))
        || senses.iter().any(|sense| {
            GOING.contains(sense) || matches!(sense, Sense::Slow | Sense::Crawl | Sense::Avoid | Sense::Turn)
        })
}

/// Whether "it" at `at` is who comes to a place: "when it passes the tv".
fn is_case(tokens: &[Token], at: usize, lexicon: &Lexicon, own_named: bool) -> bool {
    let before = at.checked_sub(1).map_or("", |idx| word(tokens, idx));
    let asks =
        matches!(before, "when" | "whenever" | "while" | "if" | "once" | "as" | "before" | "where" | "until");
    let near = |idx: usize| {
        lexicon.senses_at(tokens, idx).is_some_and(|(senses, _)| senses.contains(&Sense::PrepNear))
            || matches!(word(tokens, idx), "on" | "under" | "near" | "close" | "within" | "in" | "inside")
    };
    let verb = word(tokens, at + 1);
    let moves = verb != "is"
        && verb != "does"
        && verb != "has"
        && AGREEMENT.iter().any(|(third, _)| *third == verb)
        && tokens.get(at + 3).is_some_and(|token| !token.is_mark());
    asks && own_named && (moves || verb == "is" && near(at + 2)) || asks && at == 1 && moves
}

/// Writes out what follows "you" as "you" takes it.
fn agree(tokens: &[Token], at: &mut usize, out: &mut Vec<Token>) {
    if let Some((_, second)) = AGREEMENT.iter().find(|(third, _)| *third == word(tokens, *at)) {
        out.push(Token { text: (*second).to_owned(), glued: false });
        *at += 1;
    }
}

#[cfg(test)]
mod tests {
    use crate::text::tests::check_read_as as check;

    #[test]
    fn the_robot_in_the_third_person_is_spoken_to() {
        check("The agent must not enter the pool", "you must not enter the pool");
        check("our robot has to keep off the lawn", "you have to keep off the lawn");
        check("It should leave a foot around the vase", "you should leave a foot around the vase");
        check("The vehicle shall never cross the tape", "you shall never cross the tape");
        check("slow the bot down when it passes the tv", "slow the bot down when you pass the tv");
        check("the bot slows down when it passes the tv", "you slow down when you pass the tv");
    }

    #[test]
    fn a_thing_in_the_third_person_stays_a_thing() {
        for text in [
            "it should stay closed",
            "the vase is old , it must not be touched",
            "keep away from the machine",
            "avoid the robot arm",
            "the dog is shy , when it passes the door stop",
        ] {
            check(text, text);
        }
    }
}
