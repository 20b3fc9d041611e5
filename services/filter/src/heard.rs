//! A message as it came in, and whether it may be believed: order, and stamps from the future.

use std::time::Duration;

use geometry::Time;
use proto::{Header, Invalid};

/// Stamps farther ahead than this are of a clock that cannot be trusted.
pub const FUTURE_STAMP_MAX: Duration = Duration::from_millis(50);

/// Silence after which a publisher that starts over, its clock set back, is believed again.
const NEW_RUN_AFTER: Duration = Duration::from_secs(1);

/// A message, with the receiver's two clocks at its receipt.
#[derive(Clone, Debug)]
pub struct Heard<M> {
    /// The message, decoded and checked.
    pub message: M,
    /// When it came, by this process's monotonic clock: ages are counted from here.
    pub at: Time,
    /// When it came, by this host's wall clock, nanoseconds since the Unix epoch.
    pub wall_ns: u64,
}

/// What a new header means beside the last one believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// The next of the same run of the publisher.
    Next,
    /// The first of a new run of the publisher.
    NewRun,
    /// Heard already, or overtaken.
    Old,
}

/// The last header believed on one key.
#[derive(Clone, Copy, Debug, Default)]
pub struct Thread {
    last: Option<(Header, Time)>,
}

impl Thread {
    /// Judges a header heard at `at`; unless it is [`Order::Old`] it becomes the last one.
    pub fn follow(&mut self, header: Header, at: Time) -> Order {
        let order = match self.last {
            None => Order::NewRun,
            // Latched values are heard again whenever a service comes alive.
            Some((last, _)) if header == last => Order::Old,
            Some((last, _)) if header.seq > last.seq => {
                // The count goes on and the stamp goes back: a new run that has overtaken the old count.
                if header.stamp_ns >= last.stamp_ns { Order::Next } else { Order::NewRun }
            }
            // A count that goes back is an echo of the past, or a restart: then the stamp goes on.
            Some((last, _)) if header.stamp_ns > last.stamp_ns => Order::NewRun,
            Some((_, last_at)) if at.since(last_at) > NEW_RUN_AFTER => Order::NewRun,
            Some(_) => Order::Old,
        };
        if order != Order::Old {
            self.last = Some((header, at));
        }
        order
    }
}

/// Refuses a stamp that lies in the future of the receiver's wall clock.
///
/// # Errors
/// [`Invalid`] says how far ahead, and the limit.
pub fn not_from_the_future(header: &Header, wall_ns: u64) -> Result<(), Invalid> {
    let ahead = Duration::from_nanos(header.stamp_ns.saturating_sub(wall_ns));
    if ahead > FUTURE_STAMP_MAX {
        let found = format!("{:.1} ms in the future", ahead.as_secs_f64() * 1e3);
        return Err(Invalid::new("stamp_ns", found, "at most 50 ms ahead"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;

    #[track_caller]
    fn check(last: (u64, u64), next: (u64, u64), silence_ms: u64, wanted: Order) {
        let mut thread = Thread::default();
        let header = |(seq, stamp_ns)| Header { seq, stamp_ns, echo: 0 };
        assert_eq!(thread.follow(header(last), Time::ZERO), Order::NewRun);
        let at = Time::ZERO + Duration::from_millis(silence_ms);
        assert_eq!(thread.follow(header(next), at), wanted);
    }

    #[test]
    fn what_was_heard_is_told_from_what_is_new_and_from_a_restart() {
        check((7, 5 * S), (8, 6 * S), 20, Order::Next);
        check((7, 5 * S), (7, 5 * S), 20, Order::Old);
        check((7, 5 * S), (7, 5 * S), 60_000, Order::Old);
        check((7, 5 * S), (8, 5 * S), 20, Order::Next);
        check((7, 5 * S), (8, 4 * S), 20, Order::NewRun);
        check((7, 5 * S), (6, 4 * S), 20, Order::Old);
        check((7, 5 * S), (1, 6 * S), 20, Order::NewRun);
        check((7, 5 * S), (1, 4 * S), 20, Order::Old);
        check((7, 5 * S), (1, 4 * S), 1001, Order::NewRun);
    }

    #[test]
    fn a_stamp_may_be_fifty_milliseconds_ahead_and_no_more() {
        let header = Header { seq: 1, stamp_ns: S + 50_000_000, echo: 0 };
        assert!(not_from_the_future(&header, S).is_ok());
        assert!(not_from_the_future(&header, S - 1).is_err());
        assert!(not_from_the_future(&header, 9 * S).is_ok());
    }
}
