//! The language-model parser: any OpenAI-compatible endpoint, held to the same bar as the offline one.
//!
//! A model is asked; what it writes is parsed strictly, checked against the words that were said, and
//! turned into a reply, mostly a worse-formed one into a question. A model never sets ids, never speaks
//! to the person except in a question, and never lifts a rule that was not spoken of.

mod draft;
mod endpoint;
mod prompt;
mod retry;
mod settings;
#[cfg(test)]
mod tests;

use std::path::Path;
use std::sync::atomic::{AtomicU8, Ordering};

use anyhow::Context;
use geometry::Profile;
use rules::{Reply, Rule};

use crate::decider::{ModelTask, Reading};
use endpoint::Endpoint;
pub use endpoint::Format;
pub use prompt::Prompt;
pub use retry::{CallError, RetryPolicy};
pub use settings::{Authentication, LlmSettings};

/// A parser that asks a language model.
pub struct LlmParser {
    endpoint: Endpoint,
    prompt: Prompt,
    policy: RetryPolicy,
    profile: Profile,
    model: String,
    /// The strongest output format that the server is known to take, as [`Format::rank`].
    format: AtomicU8,
}

impl LlmParser {
    /// A parser for a robot; `folder` is where relative paths start.
    ///
    /// # Errors
    /// When the key or the prompt cannot be read; the message names the variable or the file.
    pub fn new(settings: &LlmSettings, folder: &Path, profile: Profile) -> anyhow::Result<LlmParser> {
        let prompt = match &settings.prompt {
            Some(place) => Prompt::load(&folder.join(place))?,
            None => Prompt::built_in()?,
        };
        let key = settings.key(folder)?;
        Ok(LlmParser {
            endpoint: Endpoint::new(settings, key).context("[language.llm]")?,
            prompt,
            policy: settings.policy(),
            profile,
            model: settings.model.clone(),
            format: AtomicU8::new(Format::Schema.rank()),
        })
    }

    /// Asks the model, again where that may help, and checks what it writes.
    ///
    /// Ends within the time-out and the pauses of every try; never fails but in [`Reading::reply`].
    pub async fn read(&self, task: &ModelTask) -> Reading {
        let mut raw = Vec::new();
        let reply = self.ask(task, &mut raw).await.map_err(|error| error.to_string());
        Reading { reply, parser: self.parser_name(), raw, prompt_sha256: self.prompt.sha256().to_owned() }
    }

    /// Asks for one instruction by itself, with these rules in force; for evaluations.
    pub async fn read_one(&self, text: &str, active: &[Rule]) -> Reading {
        self.read(&ModelTask { text: text.to_owned(), before: None, active: active.to_vec() }).await
    }

    /// `llm:` and the model, as rules carry it.
    #[must_use]
    pub fn parser_name(&self) -> String {
        format!("llm:{}", self.model)
    }

    async fn ask(&self, task: &ModelTask, raw: &mut Vec<String>) -> Result<Reply, CallError> {
        let words = draft::Said::of(task);
        // The gate stands before the call as well: what it holds back no model needs to see.
        if let Some(reply) = words.held_back() {
            return Ok(reply);
        }
        let messages = self.prompt.messages(task, &self.profile);
        let mut failures = Vec::new();
        loop {
            let format = Format::of_rank(self.format.load(Ordering::Relaxed));
            let error = match self.endpoint.complete(&messages, format, raw).await {
                Ok(content) => match draft::read(&content) {
                    Ok(found) => {
                        return Ok(draft::judge(
                            found,
                            &words,
                            &task.active,
                            &self.profile,
                            &self.parser_name(),
                        ));
                    }
                    Err(reason) => CallError::Nonsense(reason),
                },
                Err(error) => error,
            };
            tracing::warn!(model = self.model, %error, n_failures = failures.len() + 1, "language model");
            if let (CallError::FormatRefused(_), Some(weaker)) = (&error, format.weaker()) {
                self.format.store(weaker.rank(), Ordering::Relaxed);
                continue;
            }
            failures.push(error.clone());
            match self.policy.pause_after(&failures) {
                Some(pause) => tokio::time::sleep(pause).await,
                None => return Err(error),
            }
        }
    }
}
