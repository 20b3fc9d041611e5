//! What time brings: the rule set again each second, rules at their end, questions without an answer.

use std::time::Duration;

use geometry::Time;
use rules::{Outcome, Reply, ReplyOption, english};

use super::{Decider, Output, Work};
use crate::admission::{clarify, revocation};
use crate::audit::Event;

/// How often the rule set is repeated, so that a lost one heals. [`proto::topics::RULES`] says so.
const RULES_PERIOD: Duration = Duration::from_secs(1);

impl Decider {
    pub(super) fn tick(&mut self, now: Time, unix_ms: u64, outputs: &mut Vec<Output>) {
        self.lifetimes.hear_wall_clock(now, unix_ms);
        if self.rules_published.is_none_or(|at| now.since(at) >= RULES_PERIOD) {
            self.publish_rules(now, outputs);
        }
        let behind = self.acknowledgements.behind(now, self.book.version);
        let trouble = [self.journal_trouble.as_str(), self.audit_trouble.as_str(), behind.as_str()]
            .into_iter()
            .filter(|words| !words.is_empty())
            .collect::<Vec<_>>()
            .join("; ");
        if trouble != self.trouble {
            self.trouble.clone_from(&trouble);
            outputs.push(Output::Trouble(trouble));
        }
    }

    /// Begins the next thing that is due by time alone; false when there is none.
    pub(super) fn keep_house(&mut self, now: Time, outputs: &mut Vec<Output>) -> bool {
        let doubtful = self.lifetimes.take_doubtful();
        if !doubtful.is_empty() {
            self.ask_about(now, &doubtful, outputs);
            return true;
        }
        if now >= self.retry_expiry_at {
            let ended = self.lifetimes.ended(now);
            if !ended.is_empty() {
                self.end(now, ended, outputs);
                return true;
            }
            if let Some(book) = self.lifetimes.rewritten(&self.book, now) {
                self.record(now, Event::ClockSet, Work::default(), None, Some(book), outputs);
                return true;
            }
        }
        // An answer that waits its turn came in time.
        if self.waiting.is_empty()
            && let Some(question) = self.dialogue.take_overdue(now)
        {
            let say =
                format!("I heard no answer to \u{201c}{}\u{201d}, so nothing changed.", question.question);
            let reply = Reply { say, ..Reply::of(Outcome::Clarify) };
            let work = Work {
                id: question.id,
                speaker: question.speaker,
                said: question.text.clone(),
                text: question.text,
                ..Work::default()
            };
            self.record(now, Event::QuestionDropped, work, Some(reply), None, outputs);
            return true;
        }
        false
    }

    /// After a restart of the host nobody can tell how long it was off: the rules stay, and somebody is asked.
    fn ask_about(&mut self, now: Time, doubtful: &[String], outputs: &mut Vec<Output>) {
        let kept: Vec<_> = self.book.kept.iter().filter(|kept| doubtful.contains(&kept.rule.id)).collect();
        let names: Vec<String> = kept.iter().map(|kept| english::status(&kept.rule)).collect();
        let names = english::and_list(&names);
        let question = format!(
            "I was switched off and cannot tell for how long. I go on with: {names}. Is that still needed?"
        );
        let keep = revocation(vec![], "All rules stay until their time is over.".into());
        let drop = revocation(doubtful.to_vec(), format!("I no longer heed: {names}."));
        let options = vec![
            ReplyOption { label: "yes, keep it".into(), reply: keep },
            ReplyOption { label: "no, drop it".into(), reply: drop },
        ];
        let first = kept.first();
        let work = Work {
            id: format!("after-restart-{}", self.lifetimes.unix_ms(now)),
            speaker: first.map(|kept| kept.speaker.clone()).unwrap_or_default(),
            text: first.map(|kept| kept.rule.text.clone()).unwrap_or_default(),
            ..Work::default()
        };
        self.record(now, Event::Replied, work, Some(clarify(&question, options)), None, outputs);
    }

    fn end(&mut self, now: Time, ended: Vec<String>, outputs: &mut Vec<Output>) {
        let gone: Vec<_> = self.book.kept.iter().filter(|kept| ended.contains(&kept.rule.id)).collect();
        let names: Vec<String> = gone.iter().map(|kept| english::status(&kept.rule)).collect();
        let say = format!("Its time is over, I no longer heed: {}.", english::and_list(&names));
        let first = gone.first();
        let work = Work {
            id: format!("end-of-{}", ended.join("-")).chars().take(120).collect(),
            speaker: first.map(|kept| kept.speaker.clone()).unwrap_or_default(),
            text: first.map(|kept| kept.rule.text.clone()).unwrap_or_default(),
            ..Work::default()
        };
        let book = self.book.changed(&ended, vec![], "", self.lifetimes.unix_ms(now));
        self.record(now, Event::Expired, work, Some(revocation(ended, say)), Some(book), outputs);
    }
}
