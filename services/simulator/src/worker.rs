//! A thread that makes one sensor's pictures, so that the loop which drives the base never waits for one.
//!
//! Jobs are taken only when the thread is idle, and the newest result replaces one that nobody has
//! fetched: both ends are bounded.

use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::Context;

/// A thread that turns jobs into results, one at a time. It ends when this is dropped.
pub struct Worker<J, R> {
    jobs: SyncSender<J>,
    result: Arc<Mutex<Option<R>>>,
}

impl<J: Send + 'static, R: Send + 'static> Worker<J, R> {
    /// Starts the thread.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn start(name: &str, mut work: impl FnMut(J) -> R + Send + 'static) -> anyhow::Result<Self> {
        // Room for none: a job is handed over, or not taken at all.
        let (jobs, waiting) = sync_channel::<J>(0);
        let result: Arc<Mutex<Option<R>>> = Arc::default();
        let slot = Arc::clone(&result);
        std::thread::Builder::new()
            .name(name.to_owned())
            .spawn(move || {
                for job in waiting {
                    let made = work(job);
                    *slot.lock().unwrap_or_else(PoisonError::into_inner) = Some(made);
                }
            })
            .with_context(|| format!("start thread {name}"))?;
        Ok(Worker { jobs, result })
    }

    /// Gives the thread a job; `false` when it is still busy, and the job is gone.
    #[must_use]
    pub fn offer(&self, job: J) -> bool {
        self.jobs.try_send(job).is_ok()
    }

    /// The newest result, once.
    #[must_use]
    pub fn fetch(&self) -> Option<R> {
        self.result.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}
