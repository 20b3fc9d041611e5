//! Open questions, and which words answer them.
//!
//! A question is known by the id of the instruction that raised it. It is answered by naming that id, or
//! by its own speaker simply saying a label, a part of one that fits no other, or its number. Words that
//! pick nothing are not stretched until they do.

use geometry::Time;
use rules::ReplyOption;

/// Most questions open at once, of different speakers; the oldest gives way.
const N_OPEN_MAX: usize = 8;

/// A question that waits for its answer.
#[derive(Clone, Debug, PartialEq)]
pub struct Question {
    /// Id of the instruction that raised it.
    pub id: String,
    /// Who is asked.
    pub speaker: String,
    /// What had been said.
    pub text: String,
    /// The question, as asked.
    pub question: String,
    /// The answers to pick from.
    pub options: Vec<ReplyOption>,
    /// When it is dropped.
    pub closes_at: Time,
}

/// What words mean to a question.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// The option of this place.
    Pick(usize),
    /// Let it be.
    Dismissed,
    /// Neither: words of their own.
    Words,
}

/// The open questions, oldest first, at most one a speaker.
#[derive(Clone, Debug, Default)]
pub struct Dialogue {
    open: Vec<Question>,
}

impl Dialogue {
    /// Opens a question; the speaker's older one gives way.
    pub fn open(&mut self, question: Question) {
        self.open.retain(|other| other.speaker != question.speaker);
        self.open.push(question);
        let n_over = self.open.len().saturating_sub(N_OPEN_MAX);
        self.open.drain(..n_over);
    }

    /// The question with this id.
    #[must_use]
    pub fn by_id(&self, id: &str) -> Option<&Question> {
        self.open.iter().find(|question| question.id == id)
    }

    /// The question this speaker was asked.
    #[must_use]
    pub fn of_speaker(&self, speaker: &str) -> Option<&Question> {
        self.open.iter().find(|question| question.speaker == speaker)
    }

    /// Closes a question, if it is open.
    pub fn close(&mut self, id: &str) {
        self.open.retain(|question| question.id != id);
    }

    /// Takes out a question that waited too long.
    pub fn take_overdue(&mut self, now: Time) -> Option<Question> {
        let at = self.open.iter().position(|question| question.closes_at <= now)?;
        Some(self.open.remove(at))
    }
}

/// What `text` means to a question with these options.
#[must_use]
pub fn understand(text: &str, options: &[ReplyOption]) -> Answer {
    let said = words(text);
    let labels: Vec<Vec<String>> = options.iter().map(|option| words(&option.label)).collect();
    if let Some(at) = labels.iter().position(|label| *label == said) {
        return Answer::Pick(at);
    }
    let plain = said.join(" ");
    if let Some(at) = labels.iter().position(|label| label.first().is_some_and(|first| agrees(first, &plain)))
    {
        return Answer::Pick(at);
    }
    if DISMISSALS.contains(&plain.as_str()) {
        return Answer::Dismissed;
    }
    // "2" after "2 metres, feet or centimetres?" repeats the number that was in doubt; it picks nothing.
    let is_in_labels = |word: &String| labels.iter().any(|label| label.contains(word));
    if let Some(at) = ordinal(&said).filter(|at| *at < options.len())
        && !(said.len() == 1 && said.first().is_some_and(is_in_labels))
    {
        return Answer::Pick(at);
    }
    let fitting: Vec<usize> = labels
        .iter()
        .enumerate()
        .filter(|(_, label)| !said.is_empty() && said.iter().all(|word| label.contains(word)))
        .map(|(at, _)| at)
        .collect();
    match fitting.as_slice() {
        [only] => Answer::Pick(*only),
        _ => Answer::Words,
    }
}

const DISMISSALS: [&str; 14] = [
    "no",
    "nope",
    "none",
    "neither",
    "none of them",
    "none of these",
    "cancel",
    "cancel that",
    "never mind",
    "nevermind",
    "forget it",
    "leave it",
    "nothing",
    "no thanks",
];
const YES: [&str; 9] = ["yes", "yes please", "yeah", "yep", "ok", "okay", "sure", "do it", "please do"];
const NO: [&str; 3] = ["no", "nope", "no thanks"];

/// Whether `plain` is a yes to a label that begins with "yes", or a no to one with "no".
fn agrees(first_of_label: &str, plain: &str) -> bool {
    (first_of_label == "yes" && YES.contains(&plain)) || (first_of_label == "no" && NO.contains(&plain))
}

/// The place meant by "2", "the second", "option two", "number 2", "the first one".
fn ordinal(said: &[String]) -> Option<usize> {
    const PLACES: [[&str; 3]; 4] =
        [["1", "first", "one"], ["2", "second", "two"], ["3", "third", "three"], ["4", "fourth", "four"]];
    let rest: Vec<&str> = said
        .iter()
        .map(String::as_str)
        .filter(|word| !["the", "option", "number", "answer"].contains(word))
        .collect();
    let word = match rest.as_slice() {
        [word] | [word, "one"] => *word,
        _ => return None,
    };
    PLACES.iter().position(|names| names.contains(&word))
}

/// Lower-case words and numbers; a point between digits stays.
fn words(text: &str) -> Vec<String> {
    text.to_lowercase()
        .split(|c: char| c.is_whitespace() || "!?,;:()\"".contains(c))
        .map(|word| word.trim_matches(|c: char| ".'".contains(c)).to_owned())
        .filter(|word| !word.is_empty())
        .collect()
}

/// The readings of an answer together with what had been said: "stay away from that" and "the rug" give
/// "stay away from the rug". The parser judges which of them says anything.
#[must_use]
pub fn joined(said: &str, answer: &str) -> Vec<String> {
    const PRONOUNS: [&str; 8] = ["that", "it", "this", "there", "them", "those", "these", "here"];
    let answer = answer.trim().trim_end_matches(['.', '!', '?']);
    let parts: Vec<&str> = said.split_whitespace().collect();
    let pronoun = parts.iter().rposition(|part| {
        PRONOUNS.contains(&part.trim_end_matches(|c: char| !c.is_alphanumeric()).to_lowercase().as_str())
    });
    let mut readings = Vec::new();
    if let Some(at) = pronoun {
        let filled: Vec<&str> =
            parts.iter().enumerate().map(|(i, part)| if i == at { answer } else { part }).collect();
        readings.push(filled.join(" "));
    }
    readings.push(format!("{} {answer}", said.trim().trim_end_matches(['.', '!', '?'])));
    readings.retain(|reading| reading.chars().count() <= rules::rule::TEXT_CHARS_MAX);
    readings
}

#[cfg(test)]
mod tests {
    use super::*;
    use rules::{Outcome, Reply};
    use std::time::Duration;

    fn options(labels: &[&str]) -> Vec<ReplyOption> {
        let reply = Reply::of(Outcome::Revoke);
        labels.iter().map(|label| ReplyOption { label: (*label).into(), reply: reply.clone() }).collect()
    }

    #[track_caller]
    fn check(text: &str, labels: &[&str], wanted: Answer) {
        assert_eq!(understand(text, &options(labels)), wanted);
    }

    #[test]
    fn a_label_its_number_or_a_part_that_fits_no_other_picks_it() {
        let units = ["2 metres", "2 feet", "2 centimetres"];
        for text in ["2 feet", "2 Feet.", "feet", "the second", "second one", "option 2", "number two"] {
            check(text, &units, Answer::Pick(1));
        }
        check("0.3 m", &["0.3 m", "3 m"], Answer::Pick(0));
        check("1", &["the red sofa", "the blue sofa"], Answer::Pick(0));
        check("blue", &["the red sofa", "the blue sofa"], Answer::Pick(1));
        check("yeah", &["yes, drop it", "no, keep it"], Answer::Pick(0));
        check("no", &["yes, drop it", "no, keep it"], Answer::Pick(1));
    }

    #[test]
    fn words_that_could_be_several_pick_none() {
        let units = ["2 metres", "2 feet", "2 centimetres"];
        for text in ["2", "4", "the fourth", "sofa", "", "2 metres or feet", "avoid the rug"] {
            check(text, &units, Answer::Words);
        }
        check("sofa", &["the red sofa", "the blue sofa"], Answer::Words);
        check("one", &[], Answer::Words);
    }

    #[test]
    fn a_question_can_be_dismissed() {
        for text in ["never mind", "No.", "cancel", "none of them"] {
            check(text, &["2 metres", "2 feet"], Answer::Dismissed);
        }
    }

    #[test]
    fn an_answer_takes_the_place_of_the_pronoun() {
        assert_eq!(joined("stay away from that.", "the rug!")[0], "stay away from the rug");
        assert_eq!(joined("keep clear of", "the rug"), ["keep clear of the rug"]);
    }

    #[test]
    fn each_speaker_has_one_question_and_it_ends() {
        let mut dialogue = Dialogue::default();
        let ask = |id: &str, speaker: &str, s: u64| Question {
            id: id.into(),
            speaker: speaker.into(),
            text: "that".into(),
            question: "what?".into(),
            options: vec![],
            closes_at: Time::ZERO + Duration::from_secs(s),
        };
        dialogue.open(ask("a", "ann", 30));
        dialogue.open(ask("b", "bob", 40));
        dialogue.open(ask("c", "ann", 50));
        assert!(dialogue.by_id("a").is_none());
        assert_eq!(dialogue.of_speaker("ann").unwrap().id, "c");
        assert_eq!(dialogue.take_overdue(Time::ZERO + Duration::from_secs(39)), None);
        assert_eq!(dialogue.take_overdue(Time::ZERO + Duration::from_secs(40)).unwrap().id, "b");
        for speaker in 0..20 {
            dialogue.open(ask("x", &speaker.to_string(), 60));
        }
        assert_eq!(dialogue.open.len(), N_OPEN_MAX);
    }
}
