//! Following the chain of a whole log.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use anyhow::{Context, bail};

use super::{Event, GENESIS, N_LINE_BYTES_MAX, hash_of, unseal};

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

/// Reads a whole log and follows its chain.
///
/// # Errors
/// With the first line that was changed, dropped, put in between, or is none.
pub fn verify_audit(file: &Path) -> anyhow::Result<AuditReport> {
    let reader = File::open(file).with_context(|| format!("open audit log {}", file.display()))?;
    let mut chain = Chain {
        report: AuditReport { n_entries: 0, n_torn: 0, torn_end: false, last_hash: GENESIS.into() },
        unread: Vec::new(),
    };
    let mut reader = BufReader::new(reader);
    for number in 1u64.. {
        let mut line = Vec::new();
        let n_bytes = (&mut reader).take(N_LINE_BYTES_MAX as u64).read_until(b'\n', &mut line)?;
        if n_bytes == 0 {
            break;
        }
        let is_whole = line.pop_if(|byte| *byte == b'\n').is_some();
        chain
            .follow(&line, is_whole)
            .with_context(|| format!("audit log {}, line {number}", file.display()))?;
    }
    match chain.unread.pop() {
        // A start was killed while it noted the line torn before: both are for the next start to note.
        Some((_, reason)) if !chain.report.torn_end => {
            Err(reason.context(format!("audit log {}, last line", file.display())))
        }
        _ => Ok(chain.report),
    }
}

struct Chain {
    report: AuditReport,
    /// Lines that are no entries, until the next entry has said that they are torn.
    unread: Vec<(Vec<u8>, anyhow::Error)>,
}

impl Chain {
    fn follow(&mut self, bytes: &[u8], is_whole: bool) -> anyhow::Result<()> {
        let (line, hash) = match unseal(bytes) {
            Ok(read) => read,
            Err(_) if !is_whole => {
                self.report.torn_end = true;
                return Ok(());
            }
            Err(reason) => {
                self.unread.push((bytes.to_vec(), reason));
                return Ok(());
            }
        };
        for (torn, reason) in self.unread.drain(..) {
            let is_noted = line.entry.event == Event::Torn && line.entry.note.contains(&hash_of(&torn));
            if !is_noted {
                return Err(reason.context("a line before"));
            }
            self.report.n_torn += 1;
        }
        if line.previous != self.report.last_hash {
            bail!("it follows {}, but the line before is {}", line.previous, self.report.last_hash);
        }
        let n_wanted = self.report.n_entries + 1;
        if line.n != n_wanted {
            bail!("it is number {}, must be {n_wanted}", line.n);
        }
        self.report.n_entries = n_wanted;
        self.report.last_hash = hash;
        Ok(())
    }
}
