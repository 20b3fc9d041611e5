//! The journal: the rulebook on the disk, in one redb file.
//!
//! A commit is one durable transaction, so that a kill at any instant leaves the old book or the new one.
//! A file that is there but cannot be read is an error with its name: the robot must not forget its rules
//! in silence. Deliberately not here: when to commit.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use redb::{Database, ReadableDatabase, TableDefinition};
use serde::{Deserialize, Serialize};

use crate::rulebook::Rulebook;

/// Version of what the table holds.
const FORMAT: u32 = 1;
const TABLE: TableDefinition<'_, &str, &[u8]> = TableDefinition::new("heedway-language");
const KEY: &str = "rulebook";

/// The open journal. One process at a time can have it.
pub struct Journal {
    file: PathBuf,
    database: Database,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Page {
    format: u32,
    book: Rulebook,
}

impl Journal {
    /// Opens the journal and reads the book; a first start makes it, with an empty book of version 1.
    ///
    /// # Errors
    /// When the file is damaged, of another format, in use by another process, or cannot be made.
    pub fn open(file: &Path) -> anyhow::Result<(Journal, Rulebook)> {
        let is_there = file.try_exists().with_context(|| format!("look for journal {}", file.display()))?;
        if !is_there {
            make(file).with_context(|| format!("make journal {}", file.display()))?;
        }
        let journal = Journal::read(file)
            .with_context(|| format!("open journal {}, nothing was changed", file.display()))?;
        Ok(journal)
    }

    fn read(file: &Path) -> anyhow::Result<(Journal, Rulebook)> {
        // Without this check a damaged file may surface much later, as a panic.
        let database = redb::Builder::new().set_check_integrity_on_open(true).open(file)?;
        let page: Page = {
            let table = database.begin_read()?.open_table(TABLE)?;
            let Some(bytes) = table.get(KEY)? else { bail!("it holds no rulebook") };
            serde_json::from_slice(bytes.value()).context("read rulebook")?
        };
        if page.format != FORMAT {
            bail!("format {}, this program reads {FORMAT}", page.format);
        }
        Ok((Journal { file: file.to_owned(), database }, page.book))
    }

    /// Replaces the book. On return it is on the disk.
    ///
    /// # Errors
    /// When the disk refuses; the old book is then still the one on it.
    pub fn commit(&self, book: &Rulebook) -> anyhow::Result<()> {
        write(&self.database, book).with_context(|| format!("write journal {}", self.file.display()))
    }
}

/// Makes the file under another name first: a kill halfway must not leave a half-made journal, which
/// would look damaged at the next start.
fn make(file: &Path) -> anyhow::Result<()> {
    let folder = match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    std::fs::create_dir_all(folder)?;
    let mut draft = file.as_os_str().to_owned();
    draft.push(".new");
    let draft = PathBuf::from(draft);
    if draft.exists() {
        std::fs::remove_file(&draft)?;
    }
    let database = Database::create(&draft)?;
    write(&database, &Rulebook::default())?;
    drop(database);
    std::fs::rename(&draft, file)?;
    // The new name itself must survive a power cut.
    std::fs::File::open(folder)?.sync_all()?;
    Ok(())
}

fn write(database: &Database, book: &Rulebook) -> anyhow::Result<()> {
    let bytes = serde_json::to_vec(&Page { format: FORMAT, book: book.clone() })?;
    let mut transaction = database.begin_write()?;
    transaction.set_durability(redb::Durability::Immediate)?;
    transaction.open_table(TABLE)?.insert(KEY, bytes.as_slice())?;
    transaction.commit()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rules::{Relation, Rule};

    fn book() -> Rulebook {
        let desk = Rule { ttl_s: Some(60), ..Rule::exclusion(Relation::Beneath, "standing desk") };
        Rulebook::default().changed(&[], vec![desk], "ann", 1_000)
    }

    #[test]
    fn a_first_start_has_an_empty_book_of_version_1() {
        let folder = tempfile::tempdir().unwrap();
        let (_, first) = Journal::open(&folder.path().join("state/rules.redb")).unwrap();
        assert_eq!(first, Rulebook::default());
    }

    #[test]
    fn what_was_committed_is_there_after_a_kill() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("rules.redb");
        let (journal, _) = Journal::open(&file).unwrap();
        journal.commit(&book()).unwrap();
        // As a kill leaves it: the bytes on the disk, never closed.
        let killed = folder.path().join("killed.redb");
        std::fs::copy(&file, &killed).unwrap();
        let (_, found) = Journal::open(&killed).unwrap();
        assert_eq!(found, book());
    }

    #[test]
    fn a_half_made_journal_is_made_anew() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("rules.redb.new"), "half").unwrap();
        assert!(Journal::open(&folder.path().join("rules.redb")).is_ok());
    }

    #[test]
    fn a_damaged_journal_is_an_error_that_names_the_file_and_is_left_as_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("rules.redb");
        for damage in [&b""[..], b"garbage", &[0u8; 4096]] {
            std::fs::write(&file, damage).unwrap();
            let error = format!("{:#}", Journal::open(&file).err().unwrap());
            assert!(error.contains("rules.redb"), "{error}");
            assert_eq!(std::fs::read(&file).unwrap(), damage);
        }
    }

    #[test]
    fn two_processes_cannot_have_one_journal() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("rules.redb");
        let held = Journal::open(&file).unwrap();
        assert!(Journal::open(&file).is_err());
        drop(held);
        assert!(Journal::open(&file).is_ok());
    }
}
