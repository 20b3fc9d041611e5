//! How far a suite is: a bar on a terminal, else a line a trial.

use std::io::IsTerminal;
use std::sync::atomic::{AtomicUsize, Ordering};

use indicatif::{ProgressBar, ProgressStyle};

use crate::outcome::Outcome;

/// Tells how far a suite is, on standard error.
pub struct Progress {
    n_all: usize,
    n_done: AtomicUsize,
    n_failed: AtomicUsize,
    bar: Option<ProgressBar>,
}

impl Progress {
    /// Of so many trials, some of which were played before.
    #[must_use]
    pub fn new(n_all: usize, n_before: usize) -> Self {
        let bar = std::io::stderr().is_terminal().then(|| {
            let bar = ProgressBar::new(n_all as u64).with_position(n_before as u64);
            let style = ProgressStyle::with_template("{bar:30} {pos}/{len} trials, {eta} left, {msg}");
            // The template above is sound; a plain bar is as good.
            bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
        });
        if bar.is_none() {
            eprintln!("{n_all} trials, {n_before} played before");
        }
        Progress { n_all, n_done: AtomicUsize::new(n_before), n_failed: AtomicUsize::new(0), bar }
    }

    /// One more is played.
    pub fn done(&self, key: &str, outcome: Outcome) {
        let n_done = self.n_done.fetch_add(1, Ordering::Relaxed) + 1;
        let failed = usize::from(outcome != Outcome::Success);
        let n_failed = self.n_failed.fetch_add(failed, Ordering::Relaxed) + failed;
        match &self.bar {
            Some(bar) => {
                bar.set_message(format!("{n_failed} not successes; {key}"));
                bar.inc(1);
            }
            None => eprintln!("{n_done}/{} {key} {outcome:?}", self.n_all),
        }
    }

    /// All are played.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
