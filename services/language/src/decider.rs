//! What the service decides: instructions in order, one at a time; questions and their answers; the end
//! of rules; when the rule set is published.
//!
//! A change goes to the disk as an output and comes back as an input; only then is it in force, published
//! and acknowledged, in that order. The language model is asked in the same way. Deliberately not here:
//! clocks, files, sockets.

mod answer;
mod housekeeping;
mod record;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;
use std::time::Duration;

use geometry::{Profile, Time};
use proto::{Instruction, InstructionReply, Odometry, PoseEstimate, RuleSet, RulesHeld};
use rules::{Reply, Rule};

use crate::acknowledgement::{Acknowledgements, Progress};
use crate::audit::Entry;
use crate::boot::BootClock;
use crate::config::ParserChoice;
use crate::dialogue::{Dialogue, Question};
use crate::lifetimes::Lifetimes;
use crate::rulebook::Rulebook;
use crate::whereabouts::Whereabouts;

/// Most instructions that wait their turn. Chosen: more than people say while a model thinks.
pub const N_WAITING_MAX: usize = 32;

/// An offline parser: rules in force, profile and words to a reply.
pub type Parse = fn(&[Rule], &Profile, &str) -> Reply;

/// What the decider is told once.
#[derive(Clone, Debug)]
pub struct Setup {
    /// The robot.
    pub profile: Profile,
    /// Most rules in force at once.
    pub n_rules_max: usize,
    /// How long a question waits for its answer.
    pub question_timeout: Duration,
    /// Who turns words into rules.
    pub parser: ParserChoice,
    /// The offline parser.
    pub parse: Parse,
    /// The host's own clock at the start, if it tells.
    pub boot: Option<BootClock>,
}

/// What happened.
#[derive(Debug)]
pub enum Input {
    /// Somebody said something.
    Said(Instruction),
    /// The wheels were heard.
    Odometry(Odometry),
    /// Localisation was heard.
    Pose(PoseEstimate),
    /// A service told which rules it holds.
    Held(RulesHeld),
    /// What was to be stored is, or is not.
    Recorded(Recorded),
    /// The language model was asked, with this result.
    ModelRead(Reading),
    /// Time passed; the wall clock says this, milliseconds since the Unix epoch.
    Tick(u64),
}

/// What is to be done.
#[derive(Clone, Debug, PartialEq)]
pub enum Output {
    /// Publish the rules in force.
    PublishRules(RuleSet),
    /// Publish a reply.
    PublishReply(InstructionReply),
    /// Store, and say whether it is: [`Input::Recorded`].
    Record(Box<Record>),
    /// Ask the language model, and say what came: [`Input::ModelRead`].
    AskModel(ModelTask),
    /// Show how far a service got with the rules.
    Progress(Progress),
    /// Show what is wrong; empty when nothing is any more.
    Trouble(String),
}

/// Something to store: first the book, if there is one, and when that is on the disk the entry.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// The next book.
    pub book: Option<Rulebook>,
    /// The line for the audit log.
    pub entry: Entry,
}

/// How storing went.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recorded {
    /// Whether the book is on the disk; if not, why, and the entry is not written either.
    pub stored: Result<(), String>,
    /// Whether the entry is on the disk; if not, why.
    pub audited: Result<(), String>,
}

/// Words for the language model.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelTask {
    /// What was said.
    pub text: String,
    /// What had been said before, and the question it raised, when this may be its answer.
    pub before: Option<(String, String)>,
    /// The rules in force.
    pub active: Vec<Rule>,
}

/// What the language model made of words.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// A reply that was checked against the words, or why there is none.
    pub reply: Result<Reply, String>,
    /// The parser's name: `llm:` and the model.
    pub parser: String,
    /// What the model wrote, one entry a try.
    pub raw: Vec<String>,
    /// SHA-256 of the prompt, hex.
    pub prompt_sha256: String,
}

impl Reading {
    /// No answer, and why.
    #[must_use]
    pub fn none(reason: &str) -> Reading {
        Reading {
            reply: Err(reason.to_owned()),
            parser: "llm".into(),
            raw: Vec::new(),
            prompt_sha256: String::new(),
        }
    }
}

/// An instruction on its way.
#[derive(Clone, Debug, Default, PartialEq)]
struct Work {
    id: String,
    speaker: String,
    /// As said.
    said: String,
    /// As understood to have been said: with the question it answers.
    text: String,
    parser: String,
    raw: Vec<String>,
    prompt_sha256: String,
    /// Id of the question it names, if it names one.
    answers: String,
    /// The open question that it answers, or may answer.
    question: Option<Question>,
}

/// What is waited for.
#[derive(Clone, Debug)]
enum Busy {
    Idle,
    Reading(Box<Work>),
    Recording(Box<record::Pending>),
}

/// The language service, less the world.
pub struct Decider {
    setup: Setup,
    book: Rulebook,
    /// Highest version and id count ever tried: a commit that failed may be on the disk all the same.
    tried: (u64, u64),
    lifetimes: Lifetimes,
    dialogue: Dialogue,
    whereabouts: Whereabouts,
    acknowledgements: Acknowledgements,
    waiting: VecDeque<Work>,
    busy: Busy,
    n_made_up_ids: u64,
    rules_published: Option<Time>,
    /// No rule is tried to be ended before: the disk refused.
    retry_expiry_at: Time,
    journal_trouble: String,
    audit_trouble: String,
    /// What was last shown.
    trouble: String,
}

impl Decider {
    /// A service with the rules that were in force when it stopped; the wall clock says `unix_ms`.
    #[must_use]
    pub fn new(setup: Setup, book: Rulebook, now: Time, unix_ms: u64) -> Decider {
        Decider {
            tried: (book.version, book.n_ids_given),
            lifetimes: Lifetimes::of(&book, now, unix_ms, setup.boot.clone()),
            setup,
            book,
            dialogue: Dialogue::default(),
            whereabouts: Whereabouts::default(),
            acknowledgements: Acknowledgements::default(),
            waiting: VecDeque::new(),
            busy: Busy::Idle,
            n_made_up_ids: 0,
            rules_published: None,
            retry_expiry_at: now,
            journal_trouble: String::new(),
            audit_trouble: String::new(),
            trouble: String::new(),
        }
    }

    /// Takes one input and says what is to be done, in order.
    pub fn step(&mut self, now: Time, input: Input) -> Vec<Output> {
        let mut outputs = Vec::new();
        match input {
            Input::Said(instruction) => self.queue(now, instruction, &mut outputs),
            Input::Odometry(odometry) => self.whereabouts.hear_odometry(now, &odometry),
            Input::Pose(estimate) => self.whereabouts.hear_pose(now, &estimate),
            Input::Held(held) => {
                let progress = self.acknowledgements.hear(now, &held, self.book.version);
                outputs.extend(progress.map(Output::Progress));
            }
            Input::Recorded(recorded) => self.recorded(now, recorded, &mut outputs),
            Input::ModelRead(reading) => self.model_read(now, reading, &mut outputs),
            Input::Tick(unix_ms) => self.tick(now, unix_ms, &mut outputs),
        }
        // Everything that is begun ends in waiting for the disk or the model, so this goes on only for
        // as long as there is nothing to wait for.
        if matches!(self.busy, Busy::Idle)
            && !self.keep_house(now, &mut outputs)
            && let Some(work) = self.waiting.pop_front()
        {
            self.begin(now, work, &mut outputs);
        }
        outputs
    }

    /// The rules in force.
    #[must_use]
    pub fn book(&self) -> &Rulebook {
        &self.book
    }

    fn queue(&mut self, now: Time, instruction: Instruction, outputs: &mut Vec<Output>) {
        let Instruction { text, speaker, mut id, answers } = instruction;
        if id.is_empty() {
            self.n_made_up_ids += 1;
            id = format!("u{}-{}", self.lifetimes.unix_ms(now), self.n_made_up_ids);
        }
        if self.waiting.len() >= N_WAITING_MAX {
            let question = format!("{N_WAITING_MAX} instructions wait already. Please say it again.");
            outputs.push(Output::PublishReply(InstructionReply {
                id,
                speaker,
                text,
                reply: crate::admission::clarify(&question, vec![]),
                rules_version: self.book.version,
            }));
            return;
        }
        let said = text.trim().to_owned();
        let work = Work { id, speaker, answers, text: said.clone(), said, ..Work::default() };
        self.waiting.push_back(work);
    }

    fn publish_rules(&mut self, now: Time, outputs: &mut Vec<Output>) {
        self.rules_published = Some(now);
        outputs.push(Output::PublishRules(self.book.rule_set()));
    }
}
