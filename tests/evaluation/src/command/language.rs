//! `heedway-eval language`: how well a parser understands the paper's kinds of instructions, with its outputs.
//!
//! The parser is the service's own, with its gate, checks, retries and fallback; the model's raw outputs go
//! to `language.jsonl`, the table to `language.md`.

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use clap::Args;
use heedway_language::ParserChoice;
use heedway_language::lone::LoneParser;

use crate::language::cases::{read_cases, score_cases};
use crate::language::{ask_all, instructions, table};
use crate::setup::profile;

/// Arguments of `heedway-eval language`.
#[derive(Args, Debug)]
pub struct Arguments {
    /// Who parses: offline, llm or llm-then-offline.
    #[arg(long, default_value_t = ParserChoice::Offline)]
    parser: ParserChoice,
    /// Where the language model is told: a language service's configuration. Without it the environment
    /// tells: HEEDWAY_LLM_BASE_URL, HEEDWAY_LLM_MODEL and, where one is needed, HEEDWAY_LLM_KEY.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Sentences of your own with what is right for each, one JSON object a line as in
    /// `tests/evaluation/language/heldout.jsonl`; each is read once and compared.
    #[arg(long, value_name = "FILE", conflicts_with = "times")]
    cases: Option<PathBuf>,
    /// How often each instruction is asked.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u8).range(1..=100))]
    times: u8,
    /// Folder for `language.jsonl` and `language.md`.
    #[arg(long, default_value = "target/evaluation")]
    out: PathBuf,
}

/// Asks, and writes what came of it.
///
/// # Errors
/// When no model is configured, or a file cannot be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    std::fs::create_dir_all(&arguments.out)
        .with_context(|| format!("create {} (--out)", arguments.out.display()))?;
    let parser = LoneParser::new(arguments.parser, arguments.config.as_deref(), profile(1)?)?;
    if let Some(path) = &arguments.cases {
        let cases = read_cases(path)?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let words = runtime.block_on(score_cases(&parser, &cases)).to_string();
        std::io::stdout().write_all(words.as_bytes()).context("write the score")?;
        return Ok(ExitCode::SUCCESS);
    }
    let instructions = instructions()?;
    let place = arguments.out.join("language.jsonl");
    let mut file = std::fs::File::create(&place).with_context(|| format!("create {}", place.display()))?;
    let mut written = Ok(());
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let tries = runtime.block_on(ask_all(&parser, &instructions, usize::from(arguments.times), |one| {
        eprintln!("{:?} {} {}/{}: {}", one.verdict, one.text, one.attempt, arguments.times, one.reply.say);
        // Every try is on the disk before the next is asked: a model may take minutes.
        if written.is_ok() {
            written = serde_json::to_string(one)
                .map_err(anyhow::Error::from)
                .and_then(|line| Ok(writeln!(file, "{line}")?));
        }
    }));
    written.with_context(|| format!("write {}", place.display()))?;
    let words =
        format!("Parser: `{}`, {} times each.\n\n{}", arguments.parser, arguments.times, table(&tries));
    std::fs::write(arguments.out.join("language.md"), &words).context("write language.md")?;
    std::io::stdout().write_all(words.as_bytes()).context("write the table")?;
    Ok(ExitCode::SUCCESS)
}
