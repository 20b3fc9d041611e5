//! What waits for the disk, and what happens once it is there: the order that keeps acknowledged rules safe.

use std::time::Duration;

use geometry::Time;
use proto::InstructionReply;
use rules::{Outcome, Reply, ReplyOption};

use super::{Busy, Decider, Output, Record, Recorded, Work};
use crate::admission::clarify;
use crate::audit::{Entry, Event};
use crate::dialogue::Question;
use crate::rulebook::Rulebook;

/// How long after a refusal of the disk rules are tried to be ended again. Chosen: a full disk is not
/// cured within a second, and a rule that ends late is safe.
const EXPIRY_RETRY: Duration = Duration::from_secs(5);

/// A change, or just words, on the way to the disk.
#[derive(Clone, Debug)]
pub(super) struct Pending {
    event: Event,
    work: Work,
    reply: Option<Reply>,
    book: Option<Rulebook>,
}

impl Decider {
    /// Has a reply stored, with the book it leads to; both take effect when the disk has them.
    pub(super) fn record(
        &mut self,
        now: Time,
        event: Event,
        work: Work,
        reply: Option<Reply>,
        book: Option<Rulebook>,
        outputs: &mut Vec<Output>,
    ) {
        let (mut book, reply) = self.renumbered(book, reply);
        if let Some(book) = &mut book {
            self.lifetimes.stamp(book, now);
        }
        let after = book.as_ref().unwrap_or(&self.book);
        let entry = Entry {
            id: work.id.clone(),
            speaker: work.speaker.clone(),
            text: work.said.clone(),
            parser: work.parser.clone(),
            prompt_sha256: work.prompt_sha256.clone(),
            raw: work.raw.clone(),
            reply: reply.clone(),
            version_before: self.book.version,
            version_after: after.version,
            rules: after.kept.iter().map(|kept| kept.rule.id.clone()).collect(),
            ..Entry::bare(self.lifetimes.unix_ms(now), event, String::new())
        };
        if let Some(book) = &book {
            self.tried = (self.tried.0.max(book.version), self.tried.1.max(book.n_ids_given));
        }
        outputs.push(Output::Record(Box::new(Record { book: book.clone(), entry })));
        self.busy = Busy::Recording(Box::new(Pending { event, work, reply, book }));
    }

    /// Moves version and ids past those of commits that failed: what failed may be on the disk all the
    /// same, and after a kill it would be read back.
    fn renumbered(&self, book: Option<Rulebook>, reply: Option<Reply>) -> (Option<Rulebook>, Option<Reply>) {
        let (Some(mut book), Some(mut reply)) = (book.clone(), reply.clone()) else { return (book, reply) };
        let (version_tried, n_ids_tried) = self.tried;
        book.version = book.version.max(version_tried + 1);
        let n_new = reply.specs.len();
        if n_ids_tried > self.book.n_ids_given && n_new > 0 {
            let n_older = book.kept.len().saturating_sub(n_new);
            for (kept, spec) in book.kept.iter_mut().skip(n_older).zip(&mut reply.specs) {
                book.n_ids_given = book.n_ids_given.max(n_ids_tried) + 1;
                kept.rule.id = format!("s{}", book.n_ids_given);
                spec.id.clone_from(&kept.rule.id);
            }
        }
        (Some(book), Some(reply))
    }

    /// The disk has answered.
    pub(super) fn recorded(&mut self, now: Time, recorded: Recorded, outputs: &mut Vec<Output>) {
        let pending = match std::mem::replace(&mut self.busy, Busy::Idle) {
            Busy::Recording(pending) => pending,
            other => {
                // An answer that nobody waits for.
                self.busy = other;
                return;
            }
        };
        if let Err(reason) = recorded.stored {
            self.not_stored(now, *pending, &reason, outputs);
            return;
        }
        // A rule is kept and said even when the log of it is lost: it protects.
        self.audit_trouble =
            recorded.audited.err().map(|reason| format!("audit log: {reason}")).unwrap_or_default();
        let Pending { event, work, reply, book } = *pending;
        if let Some(book) = book {
            self.journal_trouble.clear();
            let is_new = book.version != self.book.version;
            self.lifetimes.take(&book, now);
            self.book = book;
            if is_new {
                self.publish_rules(now, outputs);
            }
        }
        let Some(reply) = reply else { return };
        if matches!(event, Event::Replied | Event::NotStored) {
            self.update_dialogue(now, &work, &reply);
        }
        outputs.push(Output::PublishReply(InstructionReply {
            id: work.id,
            speaker: work.speaker,
            text: work.text,
            reply,
            rules_version: self.book.version,
        }));
    }

    fn update_dialogue(&mut self, now: Time, work: &Work, reply: &Reply) {
        if let Some(question) = &work.question
            && matches!(reply.outcome, Outcome::Accept | Outcome::Revoke)
        {
            self.dialogue.close(&question.id);
        }
        if let (Outcome::Clarify, Some(question)) = (reply.outcome, &reply.question) {
            self.dialogue.open(Question {
                id: work.id.clone(),
                speaker: work.speaker.clone(),
                text: work.text.clone(),
                question: question.clone(),
                options: reply.options.clone(),
                closes_at: now + self.setup.question_timeout,
            });
        }
    }

    /// Nothing changed: a person is asked, and can say "try again"; what nobody said is tried later.
    fn not_stored(&mut self, now: Time, pending: Pending, reason: &str, outputs: &mut Vec<Output>) {
        self.journal_trouble = format!("rules cannot be stored: {reason}");
        self.retry_expiry_at = now + EXPIRY_RETRY;
        let Pending { event, work, reply, book } = pending;
        let Some(reply) = reply.filter(|_| event == Event::Replied && book.is_some()) else { return };
        let again = ReplyOption { label: "try again".into(), reply };
        let question = clarify("I could not store that, so nothing changed. Shall I try again?", vec![again]);
        self.record(now, Event::NotStored, work, Some(question), None, outputs);
    }
}
