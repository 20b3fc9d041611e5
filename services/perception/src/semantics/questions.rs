//! One question to the models at a time, and what becomes of it.

use std::sync::Arc;
use std::time::Duration;

use geometry::Time;

use super::frame::Frame;
use super::keyframes::Keyframes;
use super::models::{Answer, Ask};
use super::searches::Searches;

/// An answer that is this much later than a model's patience will not come.
const ANSWER_GRACE: Duration = Duration::from_secs(1);

/// A question that is under way.
#[derive(Clone, Debug)]
struct Asking {
    ask: Ask,
    is_live: bool,
    since: Time,
    /// What it was asked for has changed: the answer is of no use.
    is_void: bool,
}

/// Asks, and judges the answers.
#[derive(Clone, Debug)]
pub struct Questions {
    /// What is searched for.
    pub searches: Searches,
    patience: Duration,
    asking: Option<Asking>,
    /// Whether the last question about a live frame, or any since, was answered.
    models_answer: bool,
    n_asks: u64,
}

impl Questions {
    /// Nothing asked yet; a model is given `patience` for an answer.
    #[must_use]
    pub fn new(patience: Duration) -> Self {
        let searches = Searches::default();
        Questions { searches, patience, asking: None, models_answer: false, n_asks: 0 }
    }

    /// Whether a question is under way.
    #[must_use]
    pub fn is_asking(&self) -> bool {
        self.asking.is_some()
    }

    /// The next question, if there is one; takes the live frame when it is about that.
    pub fn ask(&mut self, now: Time, live: &mut Option<Arc<Frame>>, keyframes: &Keyframes) -> Option<Ask> {
        // The past is asked about once, so not in vain: the models must have answered about the present.
        let past = self.models_answer.then_some(keyframes);
        let query = self.searches.next(live.as_ref(), past)?;
        if query.is_live {
            *live = None;
        }
        self.n_asks += 1;
        let ask = Ask { id: self.n_asks, frame: query.frame, phrases: query.phrases };
        self.asking = Some(Asking { ask: ask.clone(), is_live: query.is_live, since: now, is_void: false });
        Some(ask)
    }

    /// Takes in an answer: the question with it when it is good, nothing when it is of no use any more.
    ///
    /// # Errors
    /// In words, when the models fail.
    pub fn hear(
        &mut self,
        ask_id: u64,
        answer: Result<Box<Answer>, String>,
    ) -> Result<Option<(Ask, Box<Answer>)>, String> {
        let Some(asking) = self.asking.take_if(|asking| asking.ask.id == ask_id) else { return Ok(None) };
        if asking.is_void {
            return Ok(None);
        }
        match answer.and_then(|answer| answer.check(&asking.ask).map(|()| answer)) {
            Ok(answer) => {
                self.models_answer = true;
                Ok(Some((asking.ask, answer)))
            }
            // A host may have forgotten an old frame; that it knows the present one is what counts.
            Err(_) if !asking.is_live => Ok(None),
            Err(reason) => {
                self.models_answer = false;
                Err(reason)
            }
        }
    }

    /// Gives up a question that was lost; whether there was one.
    pub fn give_up_overdue(&mut self, now: Time) -> bool {
        let patience = self.patience + ANSWER_GRACE;
        let is_lost = self.asking.take_if(|asking| now.since(asking.since) > patience).is_some();
        self.models_answer &= !is_lost;
        is_lost
    }

    /// Begins anew: what was found is worth nothing, and an answer under way is of no use.
    pub fn restart(&mut self) {
        if let Some(asking) = &mut self.asking {
            asking.is_void = true;
        }
        self.searches.restart();
    }
}
