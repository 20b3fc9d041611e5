//! Following the chain of a whole log, and showing what it holds.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use anyhow::{Context, bail};

use super::{Entry, Event, GENESIS, N_LINE_BYTES_MAX, hash_of, unseal};

/// What an audit log turned out to hold.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AuditReport {
    /// Entries whose chain holds.
    pub n_entries: u64,
    /// Torn lines, each noted by the start after it.
    pub n_torn: u64,
    /// Whether the last line is torn, and not noted yet.
    pub torn_end: bool,
    /// Hash of the last whole line.
    pub last_hash: String,
}

/// An entry whose place in the chain holds.
#[derive(Clone, Debug, PartialEq)]
pub struct AuditedEntry {
    /// Its number in the chain, from 1.
    pub number: u64,
    /// Where its line begins in the file, bytes.
    pub offset: u64,
    /// Its hash.
    pub hash: String,
    /// What it says.
    pub entry: Entry,
}

/// Reads a whole log and follows its chain.
///
/// # Errors
/// With the first line that was changed, dropped, put in between, or is none: its number, its offset in the
/// file, and its hash.
pub fn verify_audit(file: &Path) -> anyhow::Result<AuditReport> {
    read_audit(file, |_| {})
}

/// Reads a whole log, follows its chain, and shows each entry that holds.
///
/// # Errors
/// As [`verify_audit`]; the entries before were shown.
pub fn read_audit(file: &Path, mut show: impl FnMut(AuditedEntry)) -> anyhow::Result<AuditReport> {
    let place = || format!("audit log {}", file.display());
    let reader = File::open(file).with_context(|| format!("open {}", place()))?;
    let mut chain = Chain {
        report: AuditReport { n_entries: 0, n_torn: 0, torn_end: false, last_hash: GENESIS.into() },
        unread: Vec::new(),
    };
    let mut reader = BufReader::new(reader);
    let mut offset = 0;
    for number in 1u64.. {
        let mut bytes = Vec::new();
        let n_bytes = (&mut reader).take(N_LINE_BYTES_MAX as u64).read_until(b'\n', &mut bytes)?;
        if n_bytes == 0 {
            break;
        }
        let is_whole = bytes.pop_if(|byte| *byte == b'\n').is_some();
        let line = FileLine { number, offset, bytes };
        if let Some(entry) = chain.follow(line, is_whole).with_context(place)? {
            show(entry);
        }
        offset += n_bytes as u64;
    }
    match chain.unread.into_iter().next() {
        // A start was killed while it noted the line torn before: both are for the next start to note.
        Some((line, reason)) if !chain.report.torn_end => Err(line.broken(&reason)).with_context(place),
        _ => Ok(chain.report),
    }
}

/// One line of the file, whatever it is.
struct FileLine {
    number: u64,
    offset: u64,
    bytes: Vec<u8>,
}

impl FileLine {
    fn broken(&self, reason: &anyhow::Error) -> anyhow::Error {
        anyhow::anyhow!(
            "line {} at byte {} is broken, its sha256 is {}: {reason:#}",
            self.number,
            self.offset,
            hash_of(&self.bytes)
        )
    }
}

struct Chain {
    report: AuditReport,
    /// Lines that are no entries, until the next entry has said that they are torn.
    unread: Vec<(FileLine, anyhow::Error)>,
}

impl Chain {
    fn follow(&mut self, line: FileLine, is_whole: bool) -> anyhow::Result<Option<AuditedEntry>> {
        let (found, hash) = match unseal(&line.bytes) {
            Ok(read) => read,
            Err(_) if !is_whole => {
                self.report.torn_end = true;
                return Ok(None);
            }
            Err(reason) => {
                self.unread.push((line, reason));
                return Ok(None);
            }
        };
        for (torn, reason) in self.unread.drain(..) {
            let is_noted =
                found.entry.event == Event::Torn && found.entry.note.contains(&hash_of(&torn.bytes));
            if !is_noted {
                return Err(torn.broken(&reason));
            }
            self.report.n_torn += 1;
        }
        let n_wanted = self.report.n_entries + 1;
        let here = || format!("line {} at byte {}, hash {hash}", line.number, line.offset);
        if found.previous != self.report.last_hash {
            let last = &self.report.last_hash;
            bail!("{}: it follows {}, but the entry before has {last}", here(), found.previous);
        }
        if found.n != n_wanted {
            bail!("{}: it is number {}, must be {n_wanted}", here(), found.n);
        }
        self.report.n_entries = n_wanted;
        self.report.last_hash.clone_from(&hash);
        Ok(Some(AuditedEntry { number: n_wanted, offset: line.offset, hash, entry: found.entry }))
    }
}
