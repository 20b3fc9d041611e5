//! What a service knows of its own health: counts of what it rejected and dropped, and its trouble.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use proto::{DroppedCount, RejectedCount};

/// Shared counters of one process.
#[derive(Clone, Default)]
pub struct Counters {
    inner: Arc<Mutex<Counts>>,
}

#[derive(Default)]
struct Counts {
    rejected: BTreeMap<String, (u64, String)>,
    dropped: BTreeMap<String, u64>,
    trouble: String,
}

impl Counters {
    /// Counts a payload that was no valid message. Logged the first time, then at each power of two, so
    /// that a flood of garbage cannot flood the log.
    pub fn rejected(&self, key: &str, reason: &str) {
        let mut counts = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        let entry = counts.rejected.entry(key.to_owned()).or_default();
        entry.0 += 1;
        entry.1 = reason.chars().take(500).collect();
        let n_rejected = entry.0;
        drop(counts);
        if n_rejected.is_power_of_two() {
            tracing::warn!(key, n_rejected, reason, "rejected");
        }
    }

    /// Counts a message that gave way to a newer one.
    pub fn dropped(&self, key: &str) {
        let mut counts = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        *counts.dropped.entry(key.to_owned()).or_default() += 1;
    }

    /// Says what is wrong; empty when nothing is any more. Logged when it changes.
    pub fn trouble(&self, words: &str) {
        let mut counts = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        if counts.trouble != words {
            words.clone_into(&mut counts.trouble);
            drop(counts);
            if words.is_empty() {
                tracing::info!("trouble over");
            } else {
                tracing::warn!(trouble = words, "trouble");
            }
        }
    }

    /// What was rejected, what was dropped, and what is wrong.
    #[must_use]
    pub fn snapshot(&self) -> (Vec<RejectedCount>, Vec<DroppedCount>, String) {
        let counts = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        let rejected = counts.rejected.iter().map(|(key, (count, last_reason))| RejectedCount {
            key: key.clone(),
            count: *count,
            last_reason: last_reason.clone(),
        });
        let dropped =
            counts.dropped.iter().map(|(key, count)| DroppedCount { key: key.clone(), count: *count });
        (rejected.collect(), dropped.collect(), counts.trouble.clone())
    }
}
