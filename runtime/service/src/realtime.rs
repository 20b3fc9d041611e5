//! Work that must be on time: on a thread that no usual thread of the machine can hold up.
//!
//! Under the usual scheduling (`SCHED_OTHER`) a thread that wakes may wait for whoever runs, milliseconds, however
//! nice that one is. Under `SCHED_FIFO` it does not. That takes a privilege (`LimitRTPRIO=` of a systemd unit, or
//! `CAP_SYS_NICE`); without it the work is done all the same, by the usual scheduling, and the log says so.

use std::future::Future;

use anyhow::Context;
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy, unix,
};
use tokio::runtime::{Builder, Runtime};

/// The last priority of `SCHED_FIFO`; higher ones come first. 0 is the usual scheduling.
pub const PRIORITY_MAX: u8 = 99;

/// Does some work on a thread of its own, scheduled by `SCHED_FIFO` with `priority`; by the usual scheduling when that
/// is 0 or not allowed.
///
/// # Errors
/// When the thread cannot be started or the work panics.
pub async fn on_time<F>(priority: u8, work: F) -> anyhow::Result<F::Output>
where
    F: Future<Output: Send> + Send + 'static,
{
    // `zenoh` needs the multi-threaded scheduler; one thread does the work.
    let runtime = Builder::new_multi_thread()
        .worker_threads(1)
        .thread_name("on-time")
        .enable_time()
        .on_thread_start(move || come_first(priority))
        .build()
        .context("start a thread")?;
    let runtime = EndsBesides(Some(runtime));
    let Some(running) = &runtime.0 else { anyhow::bail!("the thread has ended") };
    running.spawn(work).await.context("work on time")
}

/// Puts the calling thread under `SCHED_FIFO`, or says that it may not be.
fn come_first(priority: u8) {
    if priority == 0 {
        return;
    }
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    let value = ThreadPriorityValue::try_from(priority).unwrap_or(ThreadPriorityValue::MAX);
    let set = unix::set_thread_priority_and_policy(
        unix::thread_native_id(),
        ThreadPriority::Crossplatform(value),
        policy,
    );
    match set {
        Ok(()) => tracing::info!(priority, "real-time scheduling"),
        Err(error) => {
            tracing::warn!(priority, %error, "no real-time scheduling: may be late when the CPU is short");
        }
    }
}

/// A runtime that may be dropped where nobody may wait.
struct EndsBesides(Option<Runtime>);

impl Drop for EndsBesides {
    fn drop(&mut self) {
        if let Some(runtime) = self.0.take() {
            runtime.shutdown_background();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use thread_priority::NormalThreadSchedulePolicy;

    const USUAL: ThreadSchedulePolicy = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Other);

    async fn policy_of_work(priority: u8) -> ThreadSchedulePolicy {
        on_time(priority, async { unix::thread_schedule_policy() }).await.unwrap().unwrap()
    }

    #[tokio::test]
    async fn only_the_work_comes_first_where_that_is_allowed_and_it_is_done_where_not() {
        let first = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
        let allowed = std::thread::spawn(move || {
            come_first(1);
            unix::thread_schedule_policy().unwrap() == first
        });
        let allowed = allowed.join().unwrap();
        if !allowed {
            println!("real-time scheduling is not allowed here: tested is that the work is done without");
        }
        assert_eq!(policy_of_work(1).await, if allowed { first } else { USUAL });
        assert_eq!(policy_of_work(0).await, USUAL);
        assert_eq!(unix::thread_schedule_policy().unwrap(), USUAL);
    }

    #[tokio::test]
    async fn work_that_is_given_up_or_panics_takes_nobody_with_it() {
        let waiting = on_time(0, std::future::pending::<()>());
        assert!(tokio::time::timeout(std::time::Duration::ZERO, waiting).await.is_err());
        assert!(on_time(0, async { assert!(std::hint::black_box(false), "on purpose") }).await.is_err());
    }
}
