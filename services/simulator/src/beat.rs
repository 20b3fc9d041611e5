//! Something that happens at a steady rate, by whatever clock it is shown.

use std::time::Duration;

use geometry::Time;

/// Something that happens at a steady rate.
#[derive(Clone, Copy, Debug)]
pub struct Beat {
    period: Duration,
    next: Time,
    n: u64,
}

impl Beat {
    /// It is due at once, and from then on `rate_hz` times a second; slower than every 100 s is not known.
    #[must_use]
    pub fn new(rate_hz: f64, now: Time) -> Self {
        Beat { period: Duration::from_secs_f64(1.0 / rate_hz.max(0.01)), next: now, n: 0 }
    }

    /// Whether it should have happened by now.
    #[must_use]
    pub fn is_due(&self, now: Time) -> bool {
        now >= self.next
    }

    /// It has happened; what was missed is not made up for.
    pub fn done(&mut self, now: Time) {
        let late = now.since(self.next) >= self.period;
        self.next = if late { now + self.period } else { self.next + self.period };
        self.n += 1;
    }

    /// How often it has happened.
    #[must_use]
    pub fn n(&self) -> u64 {
        self.n
    }

    /// Whether it is due; then it has happened.
    pub fn take(&mut self, now: Time) -> bool {
        let is_due = self.is_due(now);
        if is_due {
            self.done(now);
        }
        is_due
    }
}
