//! The last, dumb check before the motors: speed, turn rate, acceleration, age, finiteness.
//!
//! It trusts nobody and knows nothing but the command, its age and the limits it was made with; nothing that
//! arrives at run time can widen them. What breaks a limit is refused whole, never clamped: a command beyond
//! the limits comes from a sender that is wrong, and half a wrong command is not safe. Only speeding up is
//! limited instead of refused, because a delayed tick makes an honest sender jump. Braking is never limited.
//!
//! Deliberately not here: maps, rules, poses. The clever guard is `control`; it shares no code with this one.

use std::time::Duration;

use geometry::{Time, Twist};

/// What the motors may be told. Every number is a hard limit of the base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EnvelopeLimits {
    /// Largest speed, m/s, forwards.
    pub speed_m_s_max: f64,
    /// Largest speed backwards, m/s; 0 forbids reverse.
    pub reverse_m_s_max: f64,
    /// Largest turn rate either way, rad/s.
    pub yaw_rate_rad_s_max: f64,
    /// Largest growth of the speed, m/s².
    pub accel_m_s2_max: f64,
    /// Largest growth of the turn rate, rad/s²; infinite for a base that limits it itself.
    pub yaw_accel_rad_s2_max: f64,
    /// Largest age of a command.
    pub command_age_max: Duration,
}

/// Limits that no base has.
#[derive(Clone, Debug, PartialEq)]
pub struct LimitError {
    /// The key as written in the configuration.
    pub key: &'static str,
    /// The value found, SI units.
    pub value: f64,
    /// Smallest value allowed.
    pub low: f64,
    /// Largest value allowed.
    pub high: f64,
}

impl std::fmt::Display for LimitError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let LimitError { key, value, low, high } = self;
        write!(f, "{key} = {value}, must be within {low} to {high}")
    }
}

impl std::error::Error for LimitError {}

/// Why the motors are told to stand still.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Stop {
    /// No command has come.
    NoCommand,
    /// The command is older than the limit.
    Stale,
    /// The command was issued after now, or now ran backwards: the clock cannot be trusted.
    Clock,
    /// A number of the command is NaN or infinite.
    NotFinite,
    /// Faster than the limit, either way.
    TooFast,
    /// Turning faster than the limit, either way.
    TurningTooFast,
}

/// What was done with a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Verdict {
    /// Passed as it came.
    Passed,
    /// Passed, its growth held to the limits of acceleration.
    Eased,
    /// Refused: the motors get zero.
    Stop(Stop),
}

/// The envelope of one base.
#[derive(Clone, Debug)]
pub struct Envelope {
    limits: EnvelopeLimits,
    last: Twist,
    last_at: Option<Time>,
}

impl Envelope {
    /// An envelope with limits that never change.
    ///
    /// # Errors
    /// [`LimitError`] names the first number outside its range.
    pub fn new(limits: EnvelopeLimits) -> Result<Envelope, LimitError> {
        for (key, value, low, high) in [
            ("speed_m_s_max", limits.speed_m_s_max, 0.01, 5.0),
            ("reverse_m_s_max", limits.reverse_m_s_max, 0.0, 1.0),
            ("yaw_rate_rad_s_max", limits.yaw_rate_rad_s_max, 0.01, 10.0),
            ("accel_m_s2_max", limits.accel_m_s2_max, 0.01, 20.0),
            ("yaw_accel_rad_s2_max", limits.yaw_accel_rad_s2_max, 0.01, f64::INFINITY),
            ("command_age_max", limits.command_age_max.as_secs_f64(), 0.01, 1.0),
        ] {
            // Written so that NaN fails.
            if !(low..=high).contains(&value) {
                return Err(LimitError { key, value, low, high });
            }
        }
        Ok(Envelope { limits, last: Twist::ZERO, last_at: None })
    }

    /// What the motors are told now, for the newest command and the time it was issued, on this host's clock.
    pub fn check(&mut self, now: Time, command: Option<(Twist, Time)>) -> (Twist, Verdict) {
        let seconds = match self.last_at {
            Some(last_at) if now < last_at => return self.stopped(Stop::Clock),
            // After a pause no more is gained than within the life of one command.
            Some(last_at) => now.since(last_at).min(self.limits.command_age_max).as_secs_f64(),
            None => 0.0,
        };
        self.last_at = Some(now);
        let Some((wanted, issued)) = command else { return self.stopped(Stop::NoCommand) };
        if let Some(stop) = self.refusal(now, wanted, issued) {
            return self.stopped(stop);
        }
        let sent = Twist {
            speed_m_s: eased(self.last.speed_m_s, wanted.speed_m_s, self.limits.accel_m_s2_max * seconds),
            yaw_rate_rad_s: eased(
                self.last.yaw_rate_rad_s,
                wanted.yaw_rate_rad_s,
                self.limits.yaw_accel_rad_s2_max * seconds,
            ),
        };
        self.last = sent;
        (sent, if sent == wanted { Verdict::Passed } else { Verdict::Eased })
    }

    fn refusal(&self, now: Time, wanted: Twist, issued: Time) -> Option<Stop> {
        let limits = &self.limits;
        let forwards_or_back = -limits.reverse_m_s_max..=limits.speed_m_s_max;
        if issued > now {
            Some(Stop::Clock)
        } else if now.since(issued) > limits.command_age_max {
            Some(Stop::Stale)
        } else if !wanted.is_finite() {
            Some(Stop::NotFinite)
        } else if !forwards_or_back.contains(&wanted.speed_m_s) {
            Some(Stop::TooFast)
        } else if wanted.yaw_rate_rad_s.abs() > limits.yaw_rate_rad_s_max {
            Some(Stop::TurningTooFast)
        } else {
            None
        }
    }

    fn stopped(&mut self, stop: Stop) -> (Twist, Verdict) {
        self.last = Twist::ZERO;
        (Twist::ZERO, Verdict::Stop(stop))
    }
}

/// A value that may shrink at once and grow by at most `growth`; to change sign it first shrinks to zero.
fn eased(last: f64, wanted: f64, growth: f64) -> f64 {
    let from = if last.signum() == wanted.signum() { last.abs() } else { 0.0 };
    // Infinite growth in no time at all is NaN; it means no limit.
    let most = if growth.is_nan() { f64::INFINITY } else { from + growth };
    wanted.clamp(-most, most)
}

#[cfg(test)]
mod tests;
