//! What can go wrong with a call, and whether trying again may help.

use std::fmt;
use std::time::Duration;

/// Longest pause between two tries. Chosen: a person waits. A server that asks for more is not asked again.
const PAUSE_MAX: Duration = Duration::from_secs(8);
/// Most answers that are no answer before the model is given up: it is not going to learn.
const N_NONSENSE_MAX: usize = 2;

/// Why a call gave no draft.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CallError {
    /// The key is not good, with the HTTP status.
    Unauthorised(u16),
    /// Too many calls; the server may have said how long to wait.
    TooMany(Option<Duration>),
    /// The server failed, with the HTTP status.
    Server(u16),
    /// The output format is not taken, with the HTTP status.
    FormatRefused(u16),
    /// The server does not take the call at all, with the HTTP status.
    Rejected(u16),
    /// No answer in time.
    TimedOut(Duration),
    /// No connection, or it broke.
    Unreachable(String),
    /// The answer is longer than is read, with the limit in bytes.
    Oversized(usize),
    /// An answer that is no draft: cut off, no JSON, against the schema.
    Nonsense(String),
}

impl fmt::Display for CallError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            CallError::Unauthorised(status) => write!(f, "status {status}, the key is not accepted"),
            CallError::TooMany(Some(pause)) => {
                write!(f, "status 429, the server asks to wait {} s", pause.as_secs_f64())
            }
            CallError::TooMany(None) => write!(f, "status 429, too many calls"),
            CallError::Server(status) => write!(f, "status {status}, the server failed"),
            CallError::FormatRefused(status) => write!(f, "status {status}, the output format is not taken"),
            CallError::Rejected(status) => write!(f, "status {status}, the call is not taken"),
            CallError::TimedOut(limit) => write!(f, "no answer within {} s", limit.as_secs_f64()),
            CallError::Unreachable(reason) => write!(f, "not reachable: {reason}"),
            CallError::Oversized(limit) => write!(f, "an answer of more than {limit} bytes"),
            CallError::Nonsense(reason) => write!(f, "not an answer: {reason}"),
        }
    }
}

impl std::error::Error for CallError {}

impl CallError {
    fn is_nonsense(&self) -> bool {
        matches!(self, CallError::Nonsense(_) | CallError::Oversized(_))
    }

    fn may_pass(&self) -> bool {
        match self {
            CallError::Unauthorised(_) | CallError::Rejected(_) | CallError::FormatRefused(_) => false,
            CallError::TooMany(_)
            | CallError::Server(_)
            | CallError::TimedOut(_)
            | CallError::Unreachable(_)
            | CallError::Oversized(_)
            | CallError::Nonsense(_) => true,
        }
    }
}

/// When to try again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RetryPolicy {
    /// How many tries may follow the first.
    pub n_retries: usize,
    /// Pause before the second try; it doubles from try to try.
    pub first_pause: Duration,
}

impl RetryPolicy {
    /// How long to wait after these failures before the next try; none to give up.
    #[must_use]
    pub fn pause_after(&self, failures: &[CallError]) -> Option<Duration> {
        let last = failures.last()?;
        let n_nonsense = failures.iter().filter(|failure| failure.is_nonsense()).count();
        if failures.len() > self.n_retries || !last.may_pass() || n_nonsense >= N_NONSENSE_MAX {
            return None;
        }
        let doublings = u32::try_from(failures.len().saturating_sub(1)).unwrap_or(u32::MAX).min(16);
        let pause = self.first_pause.saturating_mul(1 << doublings).min(PAUSE_MAX);
        match last {
            CallError::TooMany(Some(asked)) if *asked > PAUSE_MAX => None,
            CallError::TooMany(Some(asked)) => Some(pause.max(*asked)),
            _ => Some(pause),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(failures: &[CallError], wanted_s: Option<f64>) {
        let policy = RetryPolicy { n_retries: 4, first_pause: Duration::from_millis(500) };
        assert_eq!(policy.pause_after(failures), wanted_s.map(Duration::from_secs_f64));
    }

    #[test]
    fn pauses_double_up_to_a_limit_and_tries_end() {
        let down = || CallError::Server(503);
        check(&[down()], Some(0.5));
        check(&[down(), down()], Some(1.0));
        check(&[down(), CallError::TimedOut(Duration::ZERO), down(), down()], Some(4.0));
        check(&[down(), down(), down(), down(), down()], None);
        let patient = RetryPolicy { n_retries: 9, first_pause: Duration::from_secs(5) };
        assert_eq!(patient.pause_after(&[down(), down()]), Some(PAUSE_MAX));
    }

    #[test]
    fn the_server_s_own_pause_is_kept_or_the_server_is_left_alone() {
        let asked = |seconds| CallError::TooMany(Some(Duration::from_secs(seconds)));
        check(&[asked(3)], Some(3.0));
        check(&[asked(0)], Some(0.5));
        check(&[asked(8)], Some(8.0));
        check(&[asked(9)], None);
        check(&[CallError::TooMany(None)], Some(0.5));
    }

    #[test]
    fn what_will_not_pass_is_not_tried_again() {
        check(&[CallError::Unauthorised(401)], None);
        check(&[CallError::Rejected(404)], None);
        check(&[CallError::Nonsense("a".into())], Some(0.5));
        check(&[CallError::Nonsense("a".into()), CallError::Oversized(10)], None);
        check(&[CallError::Nonsense("a".into()), CallError::Server(500)], Some(1.0));
        check(&[], None);
    }
}
