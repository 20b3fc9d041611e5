//! The last safe command, and what the motors may have of it: last command + envelope + now → motors.

use std::collections::VecDeque;
use std::time::Duration;

use envelope::{Envelope, Stop, Verdict};
use geometry::{Time, Twist};
use proto::{BaseFault, Invalid, SafeCommand, topics};

/// Stamps farther ahead than this are of a clock that cannot be trusted.
pub const FUTURE_STAMP_MAX: Duration = Duration::from_millis(50);

/// How long the times of sent odometry are kept; a thought older than this is too old anyway.
const N_ODOMETRY_KEPT: usize = 128;

/// What the motors get, and why.
#[derive(Clone, Debug, PartialEq)]
pub struct Kept {
    /// The set-point for the motors.
    pub command: Twist,
    /// Why the guard holds or changes the command; empty when it does not.
    pub reason: String,
    /// Whether the guard holds the robot at zero.
    pub stopped: bool,
}

/// Holds the last safe command and judges it anew at each turn of the loop.
///
/// A command's age is counted twice: from its receipt, and from when the odometry that it answers was
/// sent (its echo). So a link that delays everything steadily does not make old thoughts look fresh.
pub struct Keeper {
    envelope: Envelope,
    last: Option<Taken>,
    odometry_sent: VecDeque<(u64, Time)>,
    thought_age_max: Duration,
}

#[derive(Clone, Copy, Debug)]
struct Taken {
    twist: Twist,
    at: Time,
    thought_at: Time,
    seq: u64,
    stamp_ns: u64,
}

impl Keeper {
    /// A keeper without a command: the motors get zero.
    #[must_use]
    pub fn new(envelope: Envelope) -> Self {
        let age_max = |topic: &proto::Topic| topic.age_max.unwrap_or_default();
        // The filter may think with odometry as old as its own limit allows.
        let thought_age_max = age_max(&topics::SAFE) + age_max(&topics::ODOMETRY);
        Keeper { envelope, last: None, odometry_sent: VecDeque::new(), thought_age_max }
    }

    /// Notes when an odometry message left.
    pub fn odometry_sent(&mut self, seq: u64, at: Time) {
        if self.odometry_sent.len() == N_ODOMETRY_KEPT {
            self.odometry_sent.pop_front();
        }
        self.odometry_sent.push_back((seq, at));
    }

    /// Takes a safe command that came at `at`; `wall_ns` is the host's wall clock at that moment.
    ///
    /// # Errors
    /// When it is out of order, stamped in the future, or answers odometry that was never sent; the
    /// command held before stays, and ages.
    pub fn take(&mut self, command: &SafeCommand, at: Time, wall_ns: u64) -> Result<(), Invalid> {
        let header = command.header;
        let ahead_ns = header.stamp_ns.saturating_sub(wall_ns);
        let future_max = FUTURE_STAMP_MAX.as_nanos();
        if u128::from(ahead_ns) > future_max {
            let found = format!("{} ms in the future", ahead_ns / 1_000_000);
            return Err(Invalid::new("stamp_ns", found, "at most 50 ms ahead"));
        }
        if let Some(last) = self.last
            && header.stamp_ns <= last.stamp_ns
        {
            let found = format!("stamped no later than command {}", last.seq);
            return Err(Invalid::new("header", found, "newer than the last"));
        }
        let Some(thought_at) = self.sent_at(header.echo) else {
            let found = format!("odometry {}", header.echo);
            return Err(Invalid::new("echo", found, "of odometry sent within the last seconds"));
        };
        self.last =
            Some(Taken { twist: command.twist, at, thought_at, seq: header.seq, stamp_ns: header.stamp_ns });
        Ok(())
    }

    /// Sequence number of the safe command last taken; 0 when there was none.
    #[must_use]
    pub fn last_seq(&self) -> u64 {
        self.last.map_or(0, |taken| taken.seq)
    }

    /// What the motors get now.
    pub fn motors(&mut self, now: Time, fault: Option<BaseFault>) -> Kept {
        if let Some(fault) = fault {
            let (command, _) = self.envelope.check(now, None);
            return Kept { command, reason: format!("base fault: {fault:?}").to_lowercase(), stopped: true };
        }
        let fresh = self.last.filter(|taken| now.since(taken.thought_at) <= self.thought_age_max);
        let (command, verdict) = self.envelope.check(now, fresh.map(|taken| (taken.twist, taken.at)));
        let stopped = matches!(verdict, Verdict::Stop(_));
        let reason = match (self.last, fresh) {
            (None, _) => "no safe command yet".to_owned(),
            (Some(taken), None) => format!(
                "safe command answers odometry {} ms old, at most {} ms",
                now.since(taken.thought_at).as_millis(),
                self.thought_age_max.as_millis()
            ),
            (Some(taken), Some(_)) => words(verdict, now.since(taken.at)),
        };
        Kept { command, reason, stopped }
    }

    fn sent_at(&self, seq: u64) -> Option<Time> {
        self.odometry_sent.iter().find(|(sent, _)| *sent == seq).map(|(_, at)| *at)
    }
}

/// What an operator reads; empty when the command passes.
fn words(verdict: Verdict, age: Duration) -> String {
    let limit = topics::SAFE.age_max.unwrap_or_default();
    match verdict {
        Verdict::Passed | Verdict::Eased => String::new(),
        Verdict::Stop(Stop::NoCommand) => "no safe command".to_owned(),
        Verdict::Stop(Stop::Stale) => {
            format!("safe command {} ms old, at most {} ms", age.as_millis(), limit.as_millis())
        }
        Verdict::Stop(Stop::Clock) => "the clock ran backwards".to_owned(),
        Verdict::Stop(Stop::NotFinite) => "safe command is not finite".to_owned(),
        Verdict::Stop(Stop::TooFast) => "safe command is faster than the robot may be".to_owned(),
        Verdict::Stop(Stop::TurningTooFast) => "safe command turns faster than the robot may".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use envelope::EnvelopeLimits;
    use proto::Header;

    const WALL_NS: u64 = 1_000_000_000_000;

    fn keeper() -> Keeper {
        let limits = EnvelopeLimits {
            speed_m_s_max: 1.5,
            yaw_rate_rad_s_max: 1.0,
            reverse_m_s_max: 0.0,
            accel_m_s2_max: 3.0,
            yaw_accel_rad_s2_max: f64::INFINITY,
            command_age_max: Duration::from_millis(150),
        };
        Keeper::new(Envelope::new(limits).unwrap())
    }

    fn ms(t: u64) -> Time {
        Time::ZERO + Duration::from_millis(t)
    }

    fn command(seq: u64, t_ms: u64, echo: u64) -> SafeCommand {
        SafeCommand {
            header: Header { seq, stamp_ns: WALL_NS + t_ms * 1_000_000, echo },
            twist: Twist::new(0.1, 0.0),
        }
    }

    /// Odometry 1 is sent at 900 ms, a command answers it at `taken_ms`; what holds at `now_ms`?
    #[track_caller]
    fn check(taken_ms: u64, now_ms: u64, stopped: bool, reason: &str) {
        let mut keeper = keeper();
        keeper.odometry_sent(1, ms(900));
        keeper.take(&command(1, taken_ms, 1), ms(taken_ms), WALL_NS + taken_ms * 1_000_000).unwrap();
        // The envelope lets the speed rise only from turn to turn.
        keeper.motors(ms(taken_ms), None);
        let kept = keeper.motors(ms(now_ms), None);
        assert_eq!(kept.stopped, stopped, "{kept:?}");
        assert!(kept.reason.contains(reason), "{kept:?}");
        assert_eq!(kept.stopped, kept.command == Twist::ZERO, "{kept:?}");
    }

    #[test]
    fn without_a_command_the_motors_get_zero() {
        let kept = keeper().motors(ms(10), None);
        assert_eq!((kept.command, kept.stopped), (Twist::ZERO, true));
        assert!(kept.reason.contains("no safe command"));
    }

    #[test]
    fn a_command_holds_up_to_its_limit_and_not_one_millisecond_longer() {
        check(905, 1055, false, "");
        check(905, 1056, true, "150");
    }

    #[test]
    fn a_fresh_command_from_an_old_thought_stops_the_robot() {
        check(1100, 1150, false, "");
        check(1100, 1151, true, "251 ms old, at most 250 ms");
    }

    #[test]
    fn a_base_fault_stops_the_robot_whatever_the_command() {
        let mut keeper = keeper();
        keeper.odometry_sent(1, ms(900));
        keeper.take(&command(1, 905, 1), ms(905), WALL_NS + 905_000_000).unwrap();
        let kept = keeper.motors(ms(910), Some(BaseFault::Bumper));
        assert_eq!((kept.command, kept.stopped), (Twist::ZERO, true));
        assert!(kept.reason.contains("bumper"));
    }

    #[test]
    fn commands_out_of_order_from_the_future_or_about_unknown_odometry_are_refused() {
        let mut keeper = keeper();
        keeper.odometry_sent(7, ms(900));
        let wall = |t_ms: u64| WALL_NS + t_ms * 1_000_000;
        assert!(keeper.take(&command(1, 905, 7), ms(905), wall(905)).is_ok());
        assert_eq!(keeper.take(&command(2, 905, 7), ms(906), wall(906)).unwrap_err().field, "header");
        assert!(keeper.take(&command(3, 960, 7), ms(910), wall(910)).is_ok(), "50 ms ahead is allowed");
        assert_eq!(keeper.take(&command(4, 971, 7), ms(920), wall(920)).unwrap_err().field, "stamp_ns");
        assert_eq!(keeper.take(&command(5, 970, 8), ms(970), wall(970)).unwrap_err().field, "echo");
        assert_eq!(keeper.last_seq(), 3);
    }
}
