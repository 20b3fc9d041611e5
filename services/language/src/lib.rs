//! Free text to typed rules, or a question back.
//!
//! The decider says what is to be done ([`decider`]); this file does it: the network, the disk, the
//! language model. A rule is on the disk before anyone hears that it was accepted.

pub mod acknowledgement;
pub mod admission;
pub mod audit;
pub mod boot;
pub mod config;
pub mod decider;
pub mod dialogue;
pub mod journal;
pub mod lifetimes;
pub mod llm;
pub mod lone;
pub mod rulebook;
pub mod store;
pub mod whereabouts;

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use anyhow::Context;
use proto::{Instruction, InstructionReply, RuleSet, topics};
use service::{Clock, Counters, Inbox, Life, Publisher, Slot};

pub use audit::{AuditReport, verify_audit};
pub use config::{LanguageSettings, ParserChoice};

use decider::{Decider, Input, N_WAITING_MAX, Output, Reading, Record, Setup};
use llm::LlmParser;
use store::Store;

/// How often the decider is told the time. Chosen: a rule may end this much late, never early.
const TICK: Duration = Duration::from_millis(100);

/// Runs the service until it is asked to stop.
///
/// # Errors
/// When the journal or the audit log cannot be opened, or the network refuses.
pub async fn serve(life: Life, settings: LanguageSettings) -> anyhow::Result<()> {
    let model = match &settings.llm {
        Some(llm) => Some(Arc::new(LlmParser::new(llm, &life.folder, life.profile.clone())?)),
        None => None,
    };
    let unix_ms = unix_ms(life.clock);
    let (journal, audit) = (life.folder.join(&settings.journal), life.folder.join(settings.audit_file()));
    let (store, book) = tokio::task::spawn_blocking(move || Store::open(&journal, &audit, unix_ms))
        .await
        .context("open the store")??;
    tracing::info!(version = book.version, n_rules = book.kept.len(), "rules read");

    let setup = Setup {
        profile: life.profile.clone(),
        n_rules_max: settings.n_rules_max,
        question_timeout: settings.question_timeout(),
        parser: settings.parser,
        parse: utterance::parse,
        boot: boot::BootClock::read(),
    };
    let mut decider = Decider::new(setup, book, life.clock.now(), unix_ms);
    let inbox = Inbox::new();
    let hands = Hands {
        rules: life.bus.publisher(&topics::RULES).await?,
        replies: life.bus.publisher(&topics::REPLY).await?,
        store: Arc::new(Mutex::new(store)),
        model,
        results: Arc::new(inbox.slot(4)),
        counters: life.counters.clone(),
    };
    // In this order, whoever hears the rules can speak; what is said waits until they are out.
    subscribe(&life, &inbox).await?;
    hands.perform_all(decider.step(life.clock.now(), Input::Tick(unix_ms)));
    life.ready().await?;

    let mut tick = tokio::time::interval(TICK);
    tick.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    loop {
        let input = tokio::select! {
            input = inbox.next() => input,
            _ = tick.tick() => Input::Tick(self::unix_ms(life.clock)),
            () = life.stopped() => return Ok(()),
        };
        hands.perform_all(decider.step(life.clock.now(), input));
    }
}

async fn subscribe(life: &Life, inbox: &Inbox<Input>) -> anyhow::Result<()> {
    let bus = &life.bus;
    bus.subscribe_decoded(
        &topics::INSTRUCTION,
        inbox,
        N_WAITING_MAX,
        Instruction::from_payload,
        |received| Input::Said(received.message),
    )
    .await?;
    bus.subscribe(&topics::RULES_HELD, inbox, 32, |received| Input::Held(received.message)).await?;
    bus.subscribe(&topics::ODOMETRY, inbox, 1, |received| Input::Odometry(received.message)).await?;
    bus.subscribe(&topics::POSE, inbox, 1, |received| Input::Pose(received.message)).await
}

fn unix_ms(clock: Clock) -> u64 {
    clock.stamp_ns() / 1_000_000
}

/// What performs the decider's outputs.
struct Hands {
    rules: Publisher<RuleSet>,
    replies: Publisher<InstructionReply>,
    store: Arc<Mutex<Store>>,
    model: Option<Arc<LlmParser>>,
    /// Where the disk and the model put their answers.
    results: Arc<Slot<Input>>,
    counters: Counters,
}

impl Hands {
    fn perform_all(&self, outputs: Vec<Output>) {
        outputs.into_iter().for_each(|output| self.perform(output));
    }

    fn perform(&self, output: Output) {
        match output {
            Output::PublishRules(rules) => self.warn(self.rules.put(&rules), "rules not published"),
            Output::PublishReply(reply) => {
                tracing::info!(
                    id = reply.id, speaker = reply.speaker, text = reply.text, outcome = ?reply.reply.outcome,
                    version = reply.rules_version, say = reply.reply.say, "replied"
                );
                self.warn(self.replies.put(&reply), "reply not published");
            }
            Output::Record(record) => self.record(record),
            Output::AskModel(task) => {
                let (model, results) = (self.model.clone(), Arc::clone(&self.results));
                tokio::spawn(async move {
                    let reading = match model {
                        Some(model) => model.read(&task).await,
                        // The configuration was checked for one; the decider waits for an answer all the same.
                        None => Reading::none("none is configured"),
                    };
                    results.push(Input::ModelRead(reading));
                });
            }
            Output::Progress(progress) => tracing::info!(
                service = progress.service,
                version = progress.version,
                n_usable = progress.n_usable,
                n_rules = progress.n_rules,
                "rules held"
            ),
            Output::Trouble(words) => self.counters.trouble(&words),
        }
    }

    /// The decider has at most one record under way, so that the order on the disk is its order.
    fn record(&self, record: Box<Record>) {
        let (store, results) = (Arc::clone(&self.store), Arc::clone(&self.results));
        tokio::task::spawn_blocking(move || {
            let recorded = store.lock().unwrap_or_else(PoisonError::into_inner).record(&record);
            results.push(Input::Recorded(recorded));
        });
    }

    fn warn(&self, done: anyhow::Result<()>, what: &'static str) {
        if let Err(reason) = done {
            tracing::warn!(reason = format!("{reason:#}"), "{what}");
        }
    }
}
