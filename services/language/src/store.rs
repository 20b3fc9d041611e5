//! The disk: first the journal, then the audit log.

use std::path::Path;

use crate::audit::{Audit, Entry, Event};
use crate::decider::{Record, Recorded};
use crate::journal::Journal;
use crate::rulebook::Rulebook;

/// Both files, open.
pub struct Store {
    journal: Journal,
    audit: Audit,
}

impl Store {
    /// Opens both, reads the book, and notes the start in the audit log.
    ///
    /// # Errors
    /// When either cannot be opened; the message names the file.
    pub fn open(journal: &Path, audit: &Path, unix_ms: u64) -> anyhow::Result<(Store, Rulebook)> {
        let (journal, book) = Journal::open(journal)?;
        let mut audit = Audit::open(audit, unix_ms)?;
        audit.append(&Entry {
            version_before: book.version,
            version_after: book.version,
            rules: book.kept.iter().map(|kept| kept.rule.id.clone()).collect(),
            ..Entry::bare(unix_ms, Event::Started, String::new())
        })?;
        Ok((Store { journal, audit }, book))
    }

    /// Stores the book, if there is one, and then the entry.
    pub fn record(&mut self, record: &Record) -> Recorded {
        if let Some(book) = &record.book
            && let Err(reason) = self.journal.commit(book)
        {
            let not_tried = "the journal refused".to_owned();
            return Recorded { stored: Err(format!("{reason:#}")), audited: Err(not_tried) };
        }
        let audited = self.audit.append(&record.entry).map_err(|reason| format!("{reason:#}"));
        Recorded { stored: Ok(()), audited }
    }
}
