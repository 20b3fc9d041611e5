//! The one place that reads a clock.

use std::time::{Instant, SystemTime, UNIX_EPOCH};

use geometry::Time;

/// This process's monotonic clock, and the host's wall clock for stamps.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    start: Instant,
}

impl Clock {
    /// A clock that starts now.
    #[allow(clippy::disallowed_methods, reason = "this is the one place that reads a clock")]
    #[must_use]
    pub fn start() -> Self {
        Clock { start: Instant::now() }
    }

    /// Time since the clock's start, monotonic.
    #[must_use]
    pub fn now(&self) -> Time {
        Time::ZERO + self.start.elapsed()
    }

    /// Nanoseconds since the Unix epoch, by the host's wall clock: for stamps, which order data and never
    /// prove it new.
    #[allow(clippy::disallowed_methods, reason = "this is the one place that reads a clock")]
    #[must_use]
    pub fn stamp_ns(&self) -> u64 {
        let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        u64::try_from(since_epoch.as_nanos()).unwrap_or(u64::MAX)
    }
}
