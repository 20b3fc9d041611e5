//! `[language]`: where rules are kept, how many there may be, and who parses.

use std::path::PathBuf;
use std::time::Duration;

use geometry::Profile;
use proto::rule_set::N_RULES_MAX;
use proto::{Invalid, codec};
use serde::{Deserialize, Serialize};

use crate::llm::LlmSettings;

/// Who turns words into rules.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ParserChoice {
    /// The offline parser.
    #[default]
    Offline,
    /// The language model; when it cannot be reached, a question.
    Llm,
    /// The language model; when it cannot be reached or writes nonsense, the offline parser.
    LlmThenOffline,
}

/// The `[language]` section.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LanguageSettings {
    /// The journal of rules; relative to the folder of the configuration.
    pub journal: PathBuf,
    /// The audit log; beside the journal, with the ending `audit.jsonl`, when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub audit: Option<PathBuf>,
    /// Most rules in force at once.
    #[serde(default = "default_n_rules_max")]
    pub n_rules_max: usize,
    /// How long a question waits for its answer, seconds.
    #[serde(default = "default_question_timeout_s")]
    pub question_timeout_s: f64,
    /// Who turns words into rules.
    #[serde(default)]
    pub parser: ParserChoice,
    /// The language model; needed unless the parser is `offline`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub llm: Option<LlmSettings>,
}

/// As many as the paper's filter was measured with.
fn default_n_rules_max() -> usize {
    16
}

/// Chosen: long enough to read a question and answer it, short enough that a stray "1" later means nothing.
fn default_question_timeout_s() -> f64 {
    30.0
}

impl LanguageSettings {
    /// The audit log's place; relative to the folder of the configuration.
    #[must_use]
    pub fn audit_file(&self) -> PathBuf {
        self.audit.clone().unwrap_or_else(|| self.journal.with_extension("audit.jsonl"))
    }

    /// How long a question waits for its answer.
    #[must_use]
    pub fn question_timeout(&self) -> Duration {
        Duration::from_secs_f64(self.question_timeout_s.clamp(0.0, 3600.0))
    }
}

impl service::Settings for LanguageSettings {
    const SECTION: &'static str = "language";

    fn check(&self, _: &Profile) -> Result<(), Invalid> {
        if self.journal.as_os_str().is_empty() {
            return Err(Invalid::new("journal", "empty", "the path of a file"));
        }
        if self.audit_file() == self.journal {
            let found = self.journal.display();
            return Err(Invalid::new("audit", found, "another file than the journal"));
        }
        codec::within("n_rules_max", self.n_rules_max as f64, 1.0, N_RULES_MAX as f64)?;
        codec::within("question_timeout_s", self.question_timeout_s, 1.0, 3600.0)?;
        match (&self.llm, self.parser) {
            (None, ParserChoice::Llm | ParserChoice::LlmThenOffline) => Err(Invalid::new(
                "llm",
                "missing",
                "a section `[language.llm]`, unless parser is \"offline\"",
            )),
            (Some(llm), _) => llm.check(),
            (None, ParserChoice::Offline) => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use service::Settings;

    #[track_caller]
    fn check(text: &str, wanted: Result<(), &[&str]>) {
        let read = serde_json::from_str::<LanguageSettings>(text).map_err(|e| e.to_string());
        let found =
            read.and_then(|settings| settings.check(&Profile::sim()).map_err(|invalid| invalid.to_string()));
        match (found, wanted) {
            (Ok(()), Ok(())) => {}
            (Err(said), Err(words)) => {
                for word in words {
                    assert!(said.contains(word), "{said:?} does not name {word:?}");
                }
            }
            (found, wanted) => panic!("{found:?}, wanted {wanted:?}"),
        }
    }

    #[test]
    fn a_journal_is_all_that_must_be_named() {
        check(r#"{"journal": "rules.redb"}"#, Ok(()));
        check("{}", Err(&["journal"]));
    }

    #[test]
    fn an_error_names_key_value_and_limit() {
        check(r#"{"journal": "a", "n_rules_max": 0}"#, Err(&["n_rules_max", "0", "1 to 256"]));
        check(r#"{"journal": "a", "n_rules_max": 257}"#, Err(&["n_rules_max", "257", "1 to 256"]));
        check(r#"{"journal": "a", "question_timeout_s": 0.5}"#, Err(&["question_timeout_s", "0.5", "1 to"]));
        check(r#"{"journal": "a", "audit": "a"}"#, Err(&["audit", "journal"]));
        check(r#"{"journal": "a", "parser": "llm"}"#, Err(&["llm", "missing"]));
        check(r#"{"journal": "a", "parser": "oracle"}"#, Err(&["oracle", "llm_then_offline"]));
        check(r#"{"journal": "a", "speed": 1}"#, Err(&["speed", "unknown"]));
    }

    #[test]
    fn the_audit_log_lies_beside_the_journal() {
        let settings: LanguageSettings = serde_json::from_str(r#"{"journal": "state/rules.redb"}"#).unwrap();
        assert_eq!(settings.audit_file(), PathBuf::from("state/rules.audit.jsonl"));
    }
}
