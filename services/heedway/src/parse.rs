//! `heedway parse`: sentences without a robot, JSON lines in and out, for evaluation.

use std::io::{BufRead, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, bail};
use clap::{Args, ValueEnum};
use geometry::Profile;
use heedway_language::ParserChoice;
use heedway_language::lone::LoneParser;
use rules::template::FiveFields;
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
    /// Who parses: offline (the grammar that is built in), llm (a language model; a question when it gives no
    /// answer) or llm-then-offline (the grammar when the model gives no answer).
    #[arg(long, default_value_t = ParserChoice::Offline)]
    parser: ParserChoice,
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

/// One line in.
#[derive(Debug, Deserialize)]
struct Sentence {
    id: serde_json::Value,
    /// The rules in force; see [`in_force`].
    #[serde(default)]
    context: Option<Vec<serde_json::Value>>,
    text: String,
}

/// A rule in force: as it is, as a log of a dialogue wraps it (`{"active": rule}`), or in the paper's five fields.
fn in_force(mut value: serde_json::Value, profile: &Profile) -> anyhow::Result<Rule> {
    if let Some(active) = value.get_mut("active") {
        value = active.take();
    }
    if value.get("relation").is_some() {
        return Ok(serde_json::from_value::<Rule>(value)?);
    }
    let id = value.as_object_mut().and_then(|fields| fields.remove("id"));
    let id = id.and_then(|id| Some(id.as_str()?.to_owned())).unwrap_or_default();
    let fields: FiveFields = serde_json::from_value(value)?;
    Ok(Rule { id, ..fields.into_rule(profile) })
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
/// A line that cannot be read is told on standard error and the next one is read; the exit code is then 1.
///
/// # Errors
/// When input or output break, or no language model is told of.
pub fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let profile = match arguments.profile {
        ProfileName::Sim => Profile::sim(),
        ProfileName::Turtlebot2 => Profile::turtlebot2(),
    };
    let (lines, mut out) = (std::io::stdin().lock(), std::io::stdout().lock());
    let parser = LoneParser::new(arguments.parser, arguments.config.as_deref(), profile.clone())?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let read = |context: &[Rule], words: &str| runtime.block_on(parser.read(words, context)).reply;
    Ok(exit_code(parse_lines(lines, &mut out, &profile, read)?))
}

/// Says on standard error which lines could not be read.
fn exit_code(unread: Vec<anyhow::Error>) -> ExitCode {
    for reason in &unread {
        eprintln!("heedway: {reason:#}");
    }
    if unread.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Answers each line that can be read; why the others could not.
fn parse_lines(
    lines: impl BufRead,
    out: &mut impl Write,
    profile: &Profile,
    parser: impl Fn(&[Rule], &str) -> Reply,
) -> anyhow::Result<Vec<anyhow::Error>> {
    let mut unread = Vec::new();
    for (idx, line) in lines.split(b'\n').enumerate() {
        let place = || format!("standard input, line {}", idx + 1);
        let line = line.with_context(place)?;
        if line.iter().all(u8::is_ascii_whitespace) {
            continue;
        }
        match parse_line(&line, profile, &parser).with_context(place) {
            Ok(parsed) => {
                serde_json::to_writer(&mut *out, &parsed)?;
                out.write_all(b"\n").context("write")?;
            }
            Err(reason) => unread.push(reason),
        }
    }
    Ok(unread)
}

fn parse_line(
    line: &[u8],
    profile: &Profile,
    parser: impl Fn(&[Rule], &str) -> Reply,
) -> anyhow::Result<Parsed> {
    if line.len() > N_LINE_BYTES_MAX {
        bail!("{} bytes, at most {N_LINE_BYTES_MAX}", line.len());
    }
    let Sentence { id, context, text } = serde_json::from_slice(line)?;
    let context = context.unwrap_or_default().into_iter().enumerate();
    let context = context
        .map(|(k, value)| in_force(value, profile).with_context(|| format!("rule {} of the context", k + 1)))
        .collect::<anyhow::Result<Vec<Rule>>>()?;
    let Reply { outcome, specs, revoked, question, say, .. } = parser(&context, &text);
    Ok(Parsed { id, outcome, specs, revoked, question, say })
}

#[cfg(test)]
mod tests {
    use heedway_language::admission::clarify;

    use super::*;

    /// What cannot be read of a text, and the answers to the rest; each answer says what it was asked, and under
    /// which rules.
    fn answer(text: &str) -> (Vec<String>, Vec<serde_json::Value>) {
        let mut out = Vec::new();
        let parser = |context: &[Rule], words: &str| {
            let rules: Vec<&str> = context.iter().map(|rule| rule.id.as_str()).collect();
            clarify(&format!("{words} {}", rules.join(",")), vec![])
        };
        let unread = parse_lines(text.as_bytes(), &mut out, &Profile::sim(), parser).unwrap();
        let out = String::from_utf8(out).unwrap();
        (
            unread.iter().map(|reason| format!("{reason:#}")).collect(),
            out.lines().map(|line| serde_json::from_str(line).unwrap()).collect(),
        )
    }

    #[test]
    fn each_line_is_answered_with_its_id() {
        let (unread, lines) = answer(
            "{\"id\":\"a\",\"context\":[],\"text\":\"one\"}\n\n{\"id\":7,\"context\":null,\"text\":\"two\"}",
        );
        assert_eq!((unread.len(), lines.len()), (0, 2));
        assert_eq!((&lines[0]["id"], &lines[0]["question"]), (&"a".into(), &"one ".into()));
        assert_eq!((&lines[1]["id"], &lines[1]["outcome"]), (&7.into(), &"clarify".into()));
        for key in ["specs", "revoked", "question", "say"] {
            assert!(lines[0].get(key).is_some(), "{key} is missing");
        }
    }

    #[test]
    fn a_line_that_cannot_be_read_is_named_and_the_next_one_is_answered() {
        let (unread, lines) = answer("{\"id\":1,\"text\":\"one\"}\nnonsense\n{\"id\":2,\"text\":\"two\"}");
        assert_eq!((unread.len(), lines.len()), (1, 2));
        assert!(unread[0].contains("line 2"), "{unread:?}");
    }

    #[test]
    fn a_rule_in_force_may_be_whole_wrapped_or_in_the_papers_five_fields() {
        let whole = r#"{"id":"s1","type":"exclusion","relation":"near","obj":"rug"}"#;
        let five = r#"{"id":"s3","type":"kinematic","obj":"bed","buffer":1,"vel max":0.4}"#;
        let (unread, lines) =
            answer(&format!(r#"{{"id":1,"context":[{whole},{{"active":{whole}}},{five}],"text":""}}"#));
        assert_eq!((unread.len(), &lines[0]["question"]), (0, &" s1,s1,s3".into()));
        let (unread, _) = answer(r#"{"id":1,"context":[{"id":"s1","obj":"rug","buffer_m":0.3}],"text":""}"#);
        assert!(unread.is_empty(), "{unread:?}");
        let (unread, _) = answer(r#"{"id":1,"context":[{"obj":"rug","ttl_s":60}],"text":""}"#);
        assert!(unread[0].contains("ttl_s"), "what is not understood is not dropped: {unread:?}");
        let wrong = r#"{"type":"exclusion","relation":"nigh","obj":"rug"}"#;
        let (unread, _) = answer(&format!(r#"{{"id":1,"context":[{whole},{wrong}],"text":""}}"#));
        assert!(unread[0].contains("rule 2") && unread[0].contains("nigh"), "{unread:?}");
    }
}
