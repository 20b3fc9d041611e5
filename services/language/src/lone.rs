//! Sentences without a robot: the service's parsers, asked one sentence at a time, for evaluations.
//!
//! Who is asked, and who answers when the model gives no answer, is decided as the service decides it;
//! dialogue, admission and storage are deliberately absent.

use std::fmt;
use std::path::Path;
use std::str::FromStr;

use anyhow::Context;
use geometry::Profile;
use rules::{Reply, Rule};

use crate::admission::clarify;
use crate::config::{LanguageSettings, ParserChoice};
use crate::llm::{LlmParser, LlmSettings};

/// What came of one sentence.
#[derive(Clone, Debug)]
pub struct LoneReading {
    /// The reply.
    pub reply: Reply,
    /// Who answered: `offline` or `llm:MODEL`.
    pub parser: String,
    /// Everything the model wrote, try by try; empty where none was asked.
    pub raw: Vec<String>,
    /// Why the model gave no answer, if it was asked and gave none.
    pub failure: Option<String>,
}

/// A parser for sentences that nobody said to a robot.
pub struct LoneParser {
    profile: Profile,
    model: Option<LlmParser>,
    falls_back: bool,
}

impl LoneParser {
    /// The chosen parser. A model is told by the section `[language.llm]` of the file, or else by the
    /// environment.
    ///
    /// # Errors
    /// When a model is chosen and none is configured, or its key or prompt cannot be read.
    pub fn new(choice: ParserChoice, config: Option<&Path>, profile: Profile) -> anyhow::Result<LoneParser> {
        if choice == ParserChoice::Offline {
            return Ok(LoneParser { profile, model: None, falls_back: true });
        }
        let Some(file) = config else {
            let settings = LlmSettings::from_environment()?;
            return LoneParser::of_settings(choice, &settings, Path::new("."), profile);
        };
        let loaded = service::config::load::<LanguageSettings>(file)?;
        let settings = loaded.settings.llm;
        let settings = settings.with_context(|| format!("{}: no section [language.llm]", file.display()))?;
        LoneParser::of_settings(choice, &settings, &loaded.folder, profile)
    }

    /// The chosen parser with this model; `folder` is where relative paths start.
    ///
    /// # Errors
    /// When the key or the prompt cannot be read.
    pub fn of_settings(
        choice: ParserChoice,
        settings: &LlmSettings,
        folder: &Path,
        profile: Profile,
    ) -> anyhow::Result<LoneParser> {
        let model = match choice {
            ParserChoice::Offline => None,
            ParserChoice::Llm | ParserChoice::LlmThenOffline => {
                Some(LlmParser::new(settings, folder, profile.clone())?)
            }
        };
        Ok(LoneParser { profile, model, falls_back: choice != ParserChoice::Llm })
    }

    /// Whose limits hold.
    #[must_use]
    pub fn profile(&self) -> &Profile {
        &self.profile
    }

    /// Reads one sentence with these rules in force; a model that fails leads to the fallback or a question.
    pub async fn read(&self, text: &str, active: &[Rule]) -> LoneReading {
        let offline = || utterance::parse(active, &self.profile, text);
        let by_grammar =
            |raw, failure| LoneReading { reply: offline(), parser: "offline".into(), raw, failure };
        let Some(model) = &self.model else { return by_grammar(Vec::new(), None) };
        let reading = model.read_one(text, active).await;
        match reading.reply {
            Ok(reply) => LoneReading { reply, parser: reading.parser, raw: reading.raw, failure: None },
            Err(reason) if self.falls_back => by_grammar(reading.raw, Some(reason)),
            Err(reason) => {
                let question = format!("The language model gave no answer: {reason}. Please say it again.");
                LoneReading {
                    reply: clarify(&question, vec![]),
                    parser: reading.parser,
                    raw: reading.raw,
                    failure: Some(reason),
                }
            }
        }
    }
}

/// The names on a command line.
const NAMES: [(&str, ParserChoice); 3] = [
    ("offline", ParserChoice::Offline),
    ("llm", ParserChoice::Llm),
    ("llm-then-offline", ParserChoice::LlmThenOffline),
];

impl FromStr for ParserChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<ParserChoice, String> {
        let found = NAMES.iter().find(|(name, _)| *name == text).map(|(_, choice)| *choice);
        found.ok_or_else(|| format!("{text:?} is none of {}", NAMES.map(|(name, _)| name).join(", ")))
    }
}

impl fmt::Display for ParserChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = NAMES.iter().find(|(_, choice)| choice == self).map_or("", |(name, _)| name);
        f.write_str(name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_parser_has_a_name_on_the_command_line() {
        for (name, choice) in NAMES {
            assert_eq!(name.parse(), Ok(choice));
            assert_eq!(choice.to_string(), name);
        }
        assert!("oracle".parse::<ParserChoice>().is_err_and(|why| why.contains("llm-then-offline")));
    }
}
