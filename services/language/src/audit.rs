//! The audit log: one JSON line a reply, each carrying the hash of the line before, appended only.
//!
//! A line is its entry followed by `"hash"`, the SHA-256 of the entry's own bytes, which include the
//! hash of the previous line: no line can be changed, dropped or put in between without breaking the
//! chain. (Lines cut off at the end cannot be told from lines never written.) A line torn by a power
//! cut is kept as it is, and the next start says so in a line of its own.

mod verify;

use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use rules::Reply;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

pub use verify::{AuditReport, AuditedEntry, read_audit, verify_audit};

/// What the first line follows.
const GENESIS: &str = "0000000000000000000000000000000000000000000000000000000000000000";
/// `,"hash":"` + 64 digits + `"}`.
const N_SEAL_BYTES: usize = 9 + 64 + 2;
/// Longest line: a reply at its wire limit, the raw outputs of a model, and room.
const N_LINE_BYTES_MAX: usize = 4 * 1024 * 1024;

/// What happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Event {
    /// The service started, with the rules named in `rules`.
    Started,
    /// An instruction was answered.
    Replied,
    /// Rules came to their end.
    Expired,
    /// A question got no answer in time.
    QuestionDropped,
    /// The host's clock was set; deadlines were written anew.
    ClockSet,
    /// A change could not be stored, and was not made.
    NotStored,
    /// The line before this one is torn.
    Torn,
}

/// One line, less its place in the chain.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// When, milliseconds since the Unix epoch, by the host's clock.
    pub unix_ms: u64,
    /// What happened.
    pub event: Event,
    /// The instruction's id.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub id: String,
    /// Who said it.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub speaker: String,
    /// The words.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub text: String,
    /// Who parsed it.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub parser: String,
    /// SHA-256 of the model's prompt, when a model was asked.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub prompt_sha256: String,
    /// What the model wrote, one entry a try, as it came.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub raw: Vec<String>,
    /// The reply.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reply: Option<Reply>,
    /// Version of the rules before.
    pub version_before: u64,
    /// Version of the rules after.
    pub version_after: u64,
    /// Ids of the rules in force after.
    pub rules: Vec<String>,
    /// What else there is to say: why storing failed, or the hash of a torn line.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub note: String,
}

#[derive(Serialize, Deserialize)]
struct Line {
    n: u64,
    previous: String,
    #[serde(flatten)]
    entry: Entry,
}

/// The open log.
pub struct Audit {
    file: PathBuf,
    out: File,
    n_lines: u64,
    previous: String,
}

impl Audit {
    /// Opens the log, or makes it, and goes on with its chain. A torn last line is noted in the log.
    ///
    /// # Errors
    /// When it cannot be read or written, or its last line is no line of an audit log.
    pub fn open(file: &Path, unix_ms: u64) -> anyhow::Result<Audit> {
        Audit::go_on(file, unix_ms).with_context(|| format!("open audit log {}", file.display()))
    }

    fn go_on(file: &Path, unix_ms: u64) -> anyhow::Result<Audit> {
        if let Some(folder) = file.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            std::fs::create_dir_all(folder)?;
        }
        let mut out = OpenOptions::new().create(true).read(true).append(true).open(file)?;
        let tail = tail(&mut out)?;
        let (n_lines, previous) = tail.last.unwrap_or((0, GENESIS.to_owned()));
        let mut audit = Audit { file: file.to_owned(), out, n_lines, previous };
        if !tail.torn.is_empty() {
            if !tail.ends_whole {
                audit.out.write_all(b"\n")?;
            }
            audit.append(&torn_entry(unix_ms, &tail.torn))?;
        } else if !tail.ends_whole {
            // All of the last line is there but its end.
            audit.out.write_all(b"\n")?;
        }
        Ok(audit)
    }

    /// Appends a line. On return it is on the disk.
    ///
    /// # Errors
    /// When the disk refuses.
    pub fn append(&mut self, entry: &Entry) -> anyhow::Result<()> {
        let line = Line { n: self.n_lines + 1, previous: self.previous.clone(), entry: entry.clone() };
        let (sealed, hash) = seal(&line)?;
        self.write(&sealed).with_context(|| format!("write audit log {}", self.file.display()))?;
        self.n_lines += 1;
        self.previous = hash;
        Ok(())
    }

    fn write(&mut self, sealed: &str) -> anyhow::Result<()> {
        // One write, so that a kill between the line and its end cannot happen.
        let n_bytes = self.out.metadata()?.len();
        let written = self.out.write_all(sealed.as_bytes()).and_then(|()| self.out.sync_data());
        if written.is_err() {
            // A full disk may have taken half of it: what follows must not be glued to that half.
            let _ = self.out.set_len(n_bytes);
        }
        Ok(written?)
    }
}

impl Entry {
    /// An entry about no instruction.
    #[must_use]
    pub fn bare(unix_ms: u64, event: Event, note: String) -> Entry {
        Entry {
            unix_ms,
            event,
            id: String::new(),
            speaker: String::new(),
            text: String::new(),
            parser: String::new(),
            prompt_sha256: String::new(),
            raw: Vec::new(),
            reply: None,
            version_before: 0,
            version_after: 0,
            rules: Vec::new(),
            note,
        }
    }
}

fn torn_entry(unix_ms: u64, torn: &[Vec<u8>]) -> Entry {
    let hashes: Vec<String> = torn.iter().map(|line| hash_of(line)).collect();
    Entry::bare(unix_ms, Event::Torn, format!("torn, sha256 {}", hashes.join(" ")))
}

fn hash_of(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The line with its hash and end of line, and the hash.
fn seal(line: &Line) -> anyhow::Result<(String, String)> {
    let mut text = serde_json::to_string(line)?;
    let hash = hash_of(text.as_bytes());
    text.pop();
    text.push_str(&format!(",\"hash\":\"{hash}\"}}\n"));
    Ok((text, hash))
}

/// The line and its hash, once the hash fits.
fn unseal(bytes: &[u8]) -> anyhow::Result<(Line, String)> {
    let text = std::str::from_utf8(bytes).context("not UTF-8")?;
    let at = text.len().checked_sub(N_SEAL_BYTES).context("too short")?;
    let (body, seal) = text.split_at_checked(at).context("no hash at its end")?;
    let hash = seal
        .strip_prefix(",\"hash\":\"")
        .and_then(|rest| rest.strip_suffix("\"}"))
        .context("no hash at its end")?;
    let body = format!("{body}}}");
    let found = hash_of(body.as_bytes());
    if found != hash {
        bail!("its hash is {hash}, its content has {found}");
    }
    Ok((serde_json::from_str(&body).context("not an entry")?, found))
}

/// The end of a log.
struct Tail {
    /// Number and hash of the last good line.
    last: Option<(u64, String)>,
    /// What follows it, torn.
    torn: Vec<Vec<u8>>,
    /// Whether the file ends with an end of line.
    ends_whole: bool,
}

fn tail(out: &mut File) -> anyhow::Result<Tail> {
    // The end of four longest lines holds the last good one and what kills in a row may have torn.
    let n_bytes_read = 4 * N_LINE_BYTES_MAX as u64;
    let start = out.metadata()?.len().saturating_sub(n_bytes_read);
    out.seek(SeekFrom::Start(start))?;
    let mut end = Vec::new();
    Read::take(&mut *out, n_bytes_read).read_to_end(&mut end)?;
    let mut tail =
        Tail { last: None, torn: Vec::new(), ends_whole: end.last().is_none_or(|byte| *byte == b'\n') };
    for line in end.split(|byte| *byte == b'\n').rev().filter(|line| !line.is_empty()) {
        if let Ok((line, hash)) = unseal(line) {
            tail.last = Some((line.n, hash));
            break;
        }
        tail.torn.insert(0, line.to_vec());
    }
    // One torn line may be all there is, after a kill at the very first; more are somebody's other file.
    if tail.last.is_none() && tail.torn.len() > 1 {
        bail!("it holds lines, and none of them is one of an audit log");
    }
    Ok(tail)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(text: &str) -> Entry {
        Entry { text: text.into(), ..Entry::bare(7, Event::Replied, String::new()) }
    }

    fn written(texts: &[&str]) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("audit.jsonl");
        let mut audit = Audit::open(&file, 1).unwrap();
        for text in texts {
            audit.append(&entry(text)).unwrap();
        }
        (folder, file)
    }

    #[test]
    fn a_log_that_was_only_appended_to_holds() {
        let (_folder, file) = written(&["stay off the rug", "\"quoted\" ünïcode \n line"]);
        Audit::open(&file, 2).unwrap().append(&entry("after a restart")).unwrap();
        let report = verify_audit(&file).unwrap();
        assert_eq!((report.n_entries, report.n_torn, report.torn_end), (3, 0, false));
    }

    #[test]
    fn a_line_that_was_changed_dropped_or_moved_is_found() {
        let (_folder, file) = written(&["one", "two", "three"]);
        let good = std::fs::read_to_string(&file).unwrap();
        let lines: Vec<&str> = good.lines().collect();
        for (bad, number) in [
            (good.replace("two", "tw0"), "line 2 at byte"),
            ([lines[0], lines[2], ""].join("\n"), "line 2"),
            ([lines[1], lines[0], lines[2], ""].join("\n"), "line 1"),
            ([lines[1], lines[2], ""].join("\n"), "line 1"),
            ([lines[0], lines[0], lines[1], ""].join("\n"), "line 2"),
            ([lines[0], "what is this", lines[1], ""].join("\n"), "line 2 at byte"),
            ([lines[0], "what is this", ""].join("\n"), "line 2 at byte"),
        ] {
            std::fs::write(&file, bad).unwrap();
            let error = format!("{:#}", verify_audit(&file).unwrap_err());
            assert!(error.contains(number) && error.contains("audit.jsonl"), "{error}");
            assert!(error.contains("sha256") || error.contains("hash"), "{error}");
        }
    }

    #[test]
    fn entries_are_shown_with_number_offset_and_hash_up_to_the_first_broken_one() {
        let (_folder, file) = written(&["one", "two", "three"]);
        let mut seen = Vec::new();
        let report = read_audit(&file, |found| seen.push(found)).unwrap();
        let text = std::fs::read_to_string(&file).unwrap();
        let offsets: Vec<u64> = text.match_indices("{\"n\":").map(|(at, _)| at as u64).collect();
        assert_eq!(seen.iter().map(|found| found.offset).collect::<Vec<_>>(), offsets);
        assert_eq!(seen.iter().map(|found| found.number).collect::<Vec<_>>(), [1, 2, 3]);
        assert_eq!((seen[2].entry.text.as_str(), &seen[2].hash), ("three", &report.last_hash));
        std::fs::write(&file, text.replace("three", "thr33")).unwrap();
        seen.clear();
        let error = format!("{:#}", read_audit(&file, |found| seen.push(found)).unwrap_err());
        assert_eq!(seen.len(), 2);
        assert!(error.contains(&format!("line 3 at byte {}", offsets[2])), "{error}");
    }

    #[test]
    fn a_line_torn_by_a_power_cut_is_reported_and_the_chain_goes_on() {
        let (_folder, file) = written(&["one", "two"]);
        let good = std::fs::read(&file).unwrap();
        let first_line = good.iter().position(|byte| *byte == b'\n').unwrap() + 1;
        for n_bytes in [first_line + 1, first_line + 40, good.len() - 2] {
            std::fs::write(&file, &good[..n_bytes]).unwrap();
            let report = verify_audit(&file).unwrap();
            assert!(report.torn_end && report.n_entries == 1);
            Audit::open(&file, 2).unwrap().append(&entry("three")).unwrap();
            let report = verify_audit(&file).unwrap();
            assert_eq!((report.n_entries, report.n_torn, report.torn_end), (3, 1, false));
        }
    }

    #[test]
    fn a_line_that_lost_only_its_end_is_whole() {
        let (_folder, file) = written(&["one"]);
        let good = std::fs::read(&file).unwrap();
        std::fs::write(&file, &good[..good.len() - 1]).unwrap();
        assert!(!verify_audit(&file).unwrap().torn_end);
        Audit::open(&file, 2).unwrap().append(&entry("two")).unwrap();
        assert_eq!(verify_audit(&file).unwrap().n_entries, 2);
    }

    #[test]
    fn a_kill_while_noting_a_torn_line_is_survived() {
        let (_folder, file) = written(&["one"]);
        let good = std::fs::read_to_string(&file).unwrap();
        std::fs::write(&file, format!("{good}{{\"n\":2\n{{\"n\":2,\"prev")).unwrap();
        assert!(verify_audit(&file).unwrap().torn_end);
        drop(Audit::open(&file, 2).unwrap());
        let report = verify_audit(&file).unwrap();
        assert_eq!((report.n_entries, report.n_torn, report.torn_end), (2, 2, false));
    }

    #[test]
    fn somebody_else_s_file_is_not_written_to() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("notes.txt");
        std::fs::write(&file, "dear diary\ntoday\n").unwrap();
        assert!(format!("{:#}", Audit::open(&file, 1).err().unwrap()).contains("notes.txt"));
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "dear diary\ntoday\n");
    }
}
