//! `heedway audit`: what was said and what came of it, and whether the log still holds.

use std::collections::VecDeque;
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use clap::Args;
use heedway_language::LanguageSettings;
use heedway_language::audit::{AuditReport, AuditedEntry, Event, read_audit};
use serde_json::json;

/// Arguments of `heedway audit`.
///
/// Exit codes: 0 the chain holds, 1 it is broken or cannot be read.
#[derive(Args, Debug)]
#[command(group = clap::ArgGroup::new("log").required(true).args(["file", "config"]))]
pub struct Arguments {
    /// The audit log.
    #[arg(value_name = "FILE")]
    file: Option<PathBuf>,
    /// The language service's configuration, which names the log.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Only follow the chain; show no entries.
    #[arg(long)]
    verify: bool,
    /// Only the last so many entries.
    #[arg(long, value_name = "N")]
    last: Option<usize>,
    /// JSON lines instead of words: number, offset, hash and entry.
    #[arg(long)]
    json: bool,
}

/// Shows the entries of a log and follows its chain.
///
/// # Errors
/// With the first broken line: its number, its offset in the file, and its hash. What holds was shown.
pub fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let file = place(arguments)?;
    let mut out = std::io::stdout().lock();
    let mut kept: VecDeque<String> = VecDeque::new();
    let report = read_audit(&file, |entry| {
        if arguments.verify {
            return;
        }
        let line = if arguments.json { as_json(&entry) } else { as_words(&entry) };
        match arguments.last {
            Some(n) => {
                kept.push_back(line);
                kept.drain(..kept.len().saturating_sub(n));
            }
            // A reader that has gone away, as `head` does, is no reason to stop following the chain.
            None => drop(writeln!(out, "{line}")),
        }
    });
    kept.into_iter().for_each(|line| drop(writeln!(out, "{line}")));
    let report = report?;
    if arguments.json {
        let sum = json!({"n_entries": report.n_entries, "n_torn": report.n_torn,
                         "torn_end": report.torn_end, "last_hash": report.last_hash});
        writeln!(out, "{sum}").context("write")?;
    } else {
        writeln!(out, "{}", summary(&report)).context("write")?;
    }
    Ok(ExitCode::SUCCESS)
}

fn place(arguments: &Arguments) -> anyhow::Result<PathBuf> {
    match (&arguments.file, &arguments.config) {
        (Some(file), _) => Ok(file.clone()),
        (None, Some(config)) => {
            let loaded = service::config::load::<LanguageSettings>(config)?;
            Ok(loaded.folder.join(loaded.settings.audit_file()))
        }
        (None, None) => anyhow::bail!("name a log, or --config"),
    }
}

fn summary(report: &AuditReport) -> String {
    let torn = match (report.n_torn, report.torn_end) {
        (0, false) => String::new(),
        (n, false) => format!(", {n} torn by kills and noted"),
        (n, true) => format!(", {n} torn by kills and noted, and the last line torn now"),
    };
    format!("{} entries, the chain holds{torn}; last hash {}", report.n_entries, report.last_hash)
}

fn as_json(found: &AuditedEntry) -> String {
    let AuditedEntry { number, offset, hash, entry } = found;
    json!({"number": number, "offset": offset, "hash": hash, "entry": entry}).to_string()
}

/// One entry in a few lines: when, what, who, the words, what was said to them.
fn as_words(found: &AuditedEntry) -> String {
    let entry = &found.entry;
    let event = match entry.event {
        Event::Started => "started",
        Event::Replied => "replied",
        Event::Expired => "expired",
        Event::QuestionDropped => "question dropped",
        Event::ClockSet => "clock set",
        Event::NotStored => "not stored",
        Event::Torn => "torn line noted",
    };
    let versions = if entry.version_before == entry.version_after {
        format!("rules {}", entry.version_after)
    } else {
        format!("rules {} -> {}", entry.version_before, entry.version_after)
    };
    let mut text = format!("#{} {} {event}, {versions}", found.number, utc(entry.unix_ms));
    if !entry.rules.is_empty() {
        text.push_str(&format!(" ({})", entry.rules.join(" ")));
    }
    let mut line = |label: &str, words: &str| {
        if !words.is_empty() {
            text.push_str(&format!("\n    {label}: {}", one_line(words)));
        }
    };
    line("who", &entry.speaker);
    line("said", &entry.text);
    line("parser", &entry.parser);
    line("prompt", &entry.prompt_sha256);
    entry.raw.iter().for_each(|raw| line("model wrote", raw));
    if let Some(reply) = &entry.reply {
        line(&format!("{:?}", reply.outcome).to_lowercase(), &reply.say);
    }
    line("note", &entry.note);
    text
}

/// Control characters in what people or models wrote must not reach the terminal.
fn one_line(words: &str) -> String {
    words.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

/// A time in UTC: `2026-11-22 05:24:49.123Z`.
fn utc(unix_ms: u64) -> String {
    let (days, ms) = (unix_ms / 86_400_000, unix_ms % 86_400_000);
    // Days since 1970 to a date: years begin in March here, so that the leap day is a year's last.
    let since_0000 = days + 719_468;
    let era = since_0000 / 146_097;
    let day_of_era = since_0000 % 146_097;
    let year_of_era = (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    let year = year_of_era + era * 400 + u64::from(month <= 2);
    let (hour, minute, second) = (ms / 3_600_000, ms / 60_000 % 60, ms / 1000 % 60);
    format!("{year:04}-{month:02}-{day:02} {hour:02}:{minute:02}:{second:02}.{:03}Z", ms % 1000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_is_told_in_utc() {
        assert_eq!(utc(0), "1970-01-01 00:00:00.000Z");
        assert_eq!(utc(951_782_399_999), "2000-02-28 23:59:59.999Z");
        assert_eq!(utc(951_782_400_000), "2000-02-29 00:00:00.000Z");
        assert_eq!(utc(1_795_325_089_123), "2026-11-22 05:24:49.123Z");
        assert_eq!(utc(4_107_542_400_000), "2100-03-01 00:00:00.000Z");
    }

    #[test]
    fn what_a_model_wrote_cannot_steer_the_terminal() {
        assert_eq!(one_line("a\u{1b}[2Jb\nc"), "a [2Jb c");
    }
}
