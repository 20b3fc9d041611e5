//! From an instruction to a reply: the answer to an open question, or words for a parser.

use geometry::Time;
use rules::{Outcome, RefuseReason, Reply};

use super::{Busy, Decider, ModelTask, Output, Reading, Work};
use crate::admission::{Admission, Words, clarify, refuse, revocation};
use crate::audit::Event;
use crate::config::ParserChoice;
use crate::dialogue::{self, Answer};

const OFFLINE: &str = "offline";

impl Decider {
    /// Begins with one instruction.
    pub(super) fn begin(&mut self, now: Time, mut work: Work, outputs: &mut Vec<Output>) {
        work.parser = OFFLINE.to_owned();
        // On the raw words, whoever parses them and whatever they answer.
        if utterance::gate::is_unsafe(&work.said).is_some() {
            self.conclude(now, work, refuse(RefuseReason::Unsafe, ""), outputs);
            return;
        }
        work.question = if work.answers.is_empty() {
            self.dialogue.of_speaker(&work.speaker).cloned()
        } else {
            self.dialogue.by_id(&work.answers).cloned()
        };
        if !work.answers.is_empty() && work.question.is_none() {
            let question = "That question is no longer open. What should I heed?";
            self.conclude(now, work, clarify(question, vec![]), outputs);
            return;
        }
        let Some(question) = work.question.clone() else {
            self.parse(now, work, outputs);
            return;
        };
        match dialogue::understand(&work.said, &question.options) {
            Answer::Dismissed => {
                self.dialogue.close(&question.id);
                let say = "Never mind, then. Nothing changed.".to_owned();
                self.conclude(now, work, revocation(vec![], say), outputs);
            }
            Answer::Pick(at) => match question.options.get(at) {
                Some(option)
                    if option.reply.outcome == Outcome::Clarify && option.reply.options.is_empty() =>
                {
                    // A label without a reply behind it, as models offer: its words are parsed.
                    work.text = option.label.clone();
                    self.parse(now, work, outputs);
                }
                Some(option) => {
                    work.text = format!("{} ({})", question.text, option.label);
                    self.conclude(now, work, option.reply.clone(), outputs);
                }
                None => self.parse(now, work, outputs),
            },
            Answer::Words => self.parse(now, work, outputs),
        }
    }

    fn parse(&mut self, now: Time, work: Work, outputs: &mut Vec<Output>) {
        if self.setup.parser == ParserChoice::Offline {
            self.parse_offline(now, work, outputs);
            return;
        }
        let before =
            work.question.as_ref().map(|question| (question.text.clone(), question.question.clone()));
        outputs.push(Output::AskModel(ModelTask {
            text: work.text.clone(),
            before,
            active: self.book.active(),
        }));
        self.busy = Busy::Reading(Box::new(work));
    }

    fn parse_offline(&mut self, now: Time, mut work: Work, outputs: &mut Vec<Output>) {
        let active = self.book.active();
        let read = |words: &str| (self.setup.parse)(&active, &self.setup.profile, words);
        let alone = read(&work.text);
        let says_something = |reply: &Reply| matches!(reply.outcome, Outcome::Accept | Outcome::Revoke);
        // "2 metres" alone would change the newest rule; as an answer it belongs to what was said before.
        let is_change = alone.outcome == Outcome::Accept && !alone.revoked.is_empty();
        let stands_alone = says_something(&alone) && !is_change;
        if let Some(question) = &work.question
            && (!stands_alone || (!work.answers.is_empty() && alone.outcome != Outcome::Revoke))
            && alone.reason != Some(RefuseReason::Unsafe)
        {
            let together = dialogue::joined(&question.text, &work.text)
                .into_iter()
                .map(|words| (read(&words), words))
                .find(|(reply, words)| says_something(reply) && utterance::gate::is_unsafe(words).is_none());
            if let Some((reply, words)) = together {
                work.text = words;
                self.conclude(now, work, reply, outputs);
                return;
            }
        }
        self.conclude(now, work, alone, outputs);
    }

    pub(super) fn model_read(&mut self, now: Time, reading: Reading, outputs: &mut Vec<Output>) {
        let mut work = match std::mem::replace(&mut self.busy, Busy::Idle) {
            Busy::Reading(work) => *work,
            other => {
                // An answer that nobody waits for.
                self.busy = other;
                return;
            }
        };
        work.raw = reading.raw;
        work.prompt_sha256 = reading.prompt_sha256;
        match reading.reply {
            Ok(reply) => {
                work.parser = reading.parser;
                if let Some(question) = &work.question {
                    work.text = format!("{} ({})", question.text, work.text);
                }
                self.conclude(now, work, reply, outputs);
            }
            Err(_) if self.setup.parser == ParserChoice::LlmThenOffline => {
                self.parse_offline(now, work, outputs);
            }
            Err(reason) => {
                work.parser = reading.parser;
                let question = format!("The language model gave no answer I can use ({reason}). Try again?");
                self.conclude(now, work, clarify(&question, vec![]), outputs);
            }
        }
    }

    /// Judges the reply and has it stored.
    pub(super) fn conclude(&mut self, now: Time, work: Work, reply: Reply, outputs: &mut Vec<Output>) {
        let admission = Admission {
            book: &self.book,
            profile: &self.setup.profile,
            n_rules_max: self.setup.n_rules_max,
            first_to_end: self.lifetimes.first_to_end(),
            anchor: self.whereabouts.anchor(now),
        };
        let words = Words {
            text: &work.text,
            speaker: &work.speaker,
            parser: &work.parser,
            unix_ms: self.lifetimes.unix_ms(now),
        };
        let verdict = admission.judge(reply, &words);
        self.record(now, Event::Replied, work, Some(verdict.reply), verdict.book, outputs);
    }
}
