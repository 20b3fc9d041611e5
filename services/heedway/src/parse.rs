//! `heedway parse`: sentences without a robot, JSON lines in and out, for evaluation.

use std::io::{BufRead, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail};
use clap::{Args, ValueEnum};
use geometry::Profile;
use heedway_language::LanguageSettings;
use heedway_language::admission::clarify;
use heedway_language::llm::{LlmParser, LlmSettings};
use rules::{Outcome, Reply, Rule};
use serde::{Deserialize, Serialize};

/// Longest line, bytes.
const N_LINE_BYTES_MAX: usize = 256 * 1024;

/// Arguments of `heedway parse`.
#[derive(Args, Debug)]
pub struct Arguments {
    /// Whose limits hold.
    #[arg(long, value_enum, default_value_t = ProfileName::Sim)]
    profile: ProfileName,
    /// Who parses.
    #[arg(long, value_enum, default_value_t = ParserName::Offline)]
    parser: ParserName,
    /// Where the language model is told: a language service's configuration. Without it the environment
    /// tells: HEEDWAY_LLM_BASE_URL, HEEDWAY_LLM_MODEL and, where one is needed, HEEDWAY_LLM_KEY.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
}

/// A profile that is built in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ProfileName {
    Sim,
    Turtlebot2,
}

/// Who parses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ParserName {
    /// The grammar that is built in.
    Offline,
    /// A language model; a question when it gives no answer.
    Llm,
    /// A language model; the grammar when it gives no answer.
    LlmThenOffline,
}

/// One line in.
#[derive(Debug, Deserialize)]
struct Sentence {
    id: serde_json::Value,
    #[serde(default)]
    context: Vec<InForce>,
    text: String,
}

/// A rule in force: as it is, or as a log of a dialogue wraps it.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum InForce {
    /// `{"active": rule}`.
    Wrapped {
        /// The rule.
        active: Box<Rule>,
    },
    /// The rule itself.
    Plain(Box<Rule>),
}

impl InForce {
    fn into_rule(self) -> Rule {
        match self {
            InForce::Wrapped { active: rule } | InForce::Plain(rule) => *rule,
        }
    }
}

/// One line out.
#[derive(Debug, Serialize)]
struct Parsed {
    id: serde_json::Value,
    outcome: Outcome,
    specs: Vec<Rule>,
    revoked: Vec<String>,
    question: Option<String>,
    say: String,
}

/// Reads sentences from standard input until its end and writes what they mean.
///
/// # Errors
/// When a line cannot be read, or no language model is told of; lines before it are answered.
pub fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let profile = match arguments.profile {
        ProfileName::Sim => Profile::sim(),
        ProfileName::Turtlebot2 => Profile::turtlebot2(),
    };
    let (lines, mut out) = (std::io::stdin().lock(), std::io::stdout().lock());
    let offline = |context: &[Rule], words: &str| utterance::parse(context, &profile, words);
    if arguments.parser == ParserName::Offline {
        parse_lines(lines, &mut out, offline)?;
        return Ok(ExitCode::SUCCESS);
    }
    let model = model(arguments.config.as_deref(), &profile)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let falls_back = arguments.parser == ParserName::LlmThenOffline;
    let parser = |context: &[Rule], words: &str| match runtime.block_on(model.read_one(words, context)).reply
    {
        Ok(reply) => reply,
        Err(_) if falls_back => offline(context, words),
        Err(reason) => {
            clarify(&format!("The language model gave no answer: {reason}. Please say it again."), vec![])
        }
    };
    parse_lines(lines, &mut out, parser)?;
    Ok(ExitCode::SUCCESS)
}

/// The language model that the configuration names, or else the environment.
fn model(config: Option<&Path>, profile: &Profile) -> anyhow::Result<LlmParser> {
    let Some(file) = config else {
        let settings = LlmSettings::from_environment()?;
        return LlmParser::new(&settings, Path::new("."), profile.clone());
    };
    let loaded = service::config::load::<LanguageSettings>(file)?;
    let settings = loaded.settings.llm;
    let settings = settings.with_context(|| format!("{}: no section [language.llm]", file.display()))?;
    LlmParser::new(&settings, &loaded.folder, profile.clone())
}

fn parse_lines(
    lines: impl BufRead,
    out: &mut impl Write,
    parser: impl Fn(&[Rule], &str) -> Reply,
) -> anyhow::Result<()> {
    for (idx, line) in lines.split(b'\n').enumerate() {
        let place = || format!("standard input, line {}", idx + 1);
        let line = line.with_context(place)?;
        if line.len() > N_LINE_BYTES_MAX {
            bail!("{}: {} bytes, at most {N_LINE_BYTES_MAX}", place(), line.len());
        }
        if line.iter().all(u8::is_ascii_whitespace) {
            continue;
        }
        let sentence: Sentence = serde_json::from_slice(&line).with_context(place)?;
        let context: Vec<Rule> = sentence.context.into_iter().map(InForce::into_rule).collect();
        let reply = parser(&context, &sentence.text);
        let parsed = Parsed {
            id: sentence.id,
            outcome: reply.outcome,
            specs: reply.specs,
            revoked: reply.revoked,
            question: reply.question,
            say: reply.say,
        };
        serde_json::to_writer(&mut *out, &parsed)?;
        out.write_all(b"\n").context("write")?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answer(text: &str) -> (anyhow::Result<()>, String) {
        let mut out = Vec::new();
        let parser = |_: &[Rule], words: &str| Reply {
            outcome: Outcome::Refuse,
            specs: vec![],
            revoked: vec![],
            question: None,
            options: vec![],
            reason: None,
            say: words.to_owned(),
        };
        let end = parse_lines(text.as_bytes(), &mut out, parser);
        (end, String::from_utf8(out).unwrap())
    }

    #[test]
    fn each_line_is_answered_with_its_id() {
        let (end, out) =
            answer("{\"id\":\"a\",\"context\":[],\"text\":\"one\"}\n\n{\"id\":7,\"text\":\"two\"}");
        end.unwrap();
        let lines: Vec<serde_json::Value> =
            out.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        assert_eq!(lines.len(), 2);
        assert_eq!((&lines[0]["id"], &lines[0]["say"]), (&"a".into(), &"one".into()));
        assert_eq!((&lines[1]["id"], &lines[1]["outcome"]), (&7.into(), &"refuse".into()));
        for key in ["specs", "revoked", "question"] {
            assert!(lines[0].get(key).is_some(), "{key} is missing");
        }
    }

    #[test]
    fn a_bad_line_is_named_after_the_good_ones_are_answered() {
        let (end, out) = answer("{\"id\":1,\"text\":\"one\"}\nnonsense\n");
        assert!(format!("{:#}", end.unwrap_err()).contains("line 2"));
        assert_eq!(out.lines().count(), 1);
    }
}
