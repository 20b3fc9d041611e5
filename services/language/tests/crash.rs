//! Kills at any instant: the journal and the audit log of a process that is killed while it writes.
//!
//! The writer is this test's own binary, started again. It says each version once it is on the disk.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    clippy::disallowed_methods,
    reason = "a test may fail loudly"
)]

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use heedway_language::audit::{Entry, Event, verify_audit};
use heedway_language::decider::Record;
use heedway_language::journal::Journal;
use heedway_language::store::Store;
use rules::{Relation, Rule};

const FOLDER: &str = "HEEDWAY_CRASH_FOLDER";
/// Kills; each falls at another instant of a write.
const N_KILLS: u64 = 40;

/// Writes books without end, and says each version once it is acknowledged.
#[test]
fn writes_until_it_is_killed_when_it_is_told_where() {
    let Ok(folder) = std::env::var(FOLDER) else { return };
    let folder = Path::new(&folder);
    let (journal, audit) = (folder.join("rules.redb"), folder.join("rules.audit.jsonl"));
    let (mut store, mut book) = Store::open(&journal, &audit, 1).unwrap();
    loop {
        let rule = Rule { ttl_s: Some(60), ..Rule::exclusion(Relation::On, "rug") };
        let oldest: Vec<String> = book.active().iter().take(1).map(|rule| rule.id.clone()).collect();
        let revoked = if book.kept.len() >= 8 { oldest } else { vec![] };
        book = book.changed(&revoked, vec![rule], "ann", 1);
        let entry = Entry { version_after: book.version, ..Entry::bare(1, Event::Replied, String::new()) };
        let recorded = store.record(&Record { book: Some(book.clone()), entry });
        assert!(recorded.stored.is_ok() && recorded.audited.is_ok());
        println!("version {}", book.version);
        std::io::stdout().flush().unwrap();
    }
}

#[test]
fn a_kill_at_any_instant_loses_no_version_that_was_acknowledged() {
    let folder = tempfile::tempdir().unwrap();
    let journal = folder.path().join("rules.redb");
    let mut last_version = 0;
    for kill in 0..N_KILLS {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "writes_until_it_is_killed_when_it_is_told_where", "--nocapture"])
            .env(FOLDER, folder.path())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let mut acknowledged = last_version;
        let version_of =
            |line: &str| line.rsplit_once("version ").and_then(|(_, number)| number.parse::<u64>().ok());
        // Some writes, and then a part of one: steps of a golden ratio of 8 ms cover it evenly.
        let mut n_to_see = 1 + kill % 5;
        while n_to_see > 0 {
            let line = lines.next().unwrap().unwrap();
            if let Some(version) = version_of(&line) {
                acknowledged = version;
                n_to_see -= 1;
            }
        }
        let part = Duration::from_micros(kill * 4_944 % 8_000);
        let start = Instant::now();
        while start.elapsed() < part {
            std::hint::spin_loop();
        }
        child.kill().unwrap();
        child.wait().unwrap();
        // What it still said before it was killed was acknowledged too.
        for line in lines.map_while(Result::ok) {
            acknowledged = version_of(&line).unwrap_or(acknowledged);
        }
        let (opened, book) = Journal::open(&journal).unwrap();
        drop(opened);
        assert!(book.version >= acknowledged, "kill {kill}: {} after {acknowledged}", book.version);
        assert!(book.version >= last_version, "kill {kill}: went back");
        assert_eq!(book.kept.len() as u64, (book.version - 1).min(8), "kill {kill}: {book:?}");
        last_version = book.version;
    }
    let report = verify_audit(&folder.path().join("rules.audit.jsonl")).unwrap();
    assert!(report.n_entries >= N_KILLS, "{report:?}");
}
