//! When rules end, by a clock that nobody can set, and what the journal keeps of it.
//!
//! A rule must never end early. While the service runs, its own monotonic clock decides, so that setting
//! the host's clock changes nothing. Over a restart of the service the host's uptime decides, which
//! cannot be set either. Over a restart of the host only the wall clock is there, and it may have been set:
//! then a rule goes on with what was left of it when the journal was last written, so that it may end
//! late but not early, and somebody is asked whether it is still needed.

use std::collections::BTreeMap;
use std::time::Duration;

use geometry::Time;

use crate::boot::{self, BootClock};
use crate::rulebook::Rulebook;

/// How far the wall clock may drift from the monotonic one before it counts as set, milliseconds.
/// Chosen: well above what NTP slews in a minute, well below what a lifetime is told in.
const STEP_MS: u64 = 2_000;

/// When each rule with a lifetime ends, and what the wall clock says.
#[derive(Clone, Debug)]
pub struct Lifetimes {
    ends: BTreeMap<String, Time>,
    wall_at: Time,
    wall_unix_ms: u64,
    clock_was_set: bool,
    /// The host's own clock, and when it was read.
    boot: Option<(Time, BootClock)>,
    /// Rules of which nobody can tell how much of their time is over.
    doubtful: Vec<String>,
}

impl Lifetimes {
    /// Those of a book read at `now`, when the wall clock says `unix_ms` and the host's own clock `boot`.
    #[must_use]
    pub fn of(book: &Rulebook, now: Time, unix_ms: u64, boot: Option<BootClock>) -> Lifetimes {
        let away_ms = match (&book.written, &boot) {
            (Some(written), Some(boot)) if written.boot_id == boot.boot_id => {
                // What was written may be a step of the clock too early.
                Some(boot.uptime_ms.saturating_sub(written.uptime_ms + boot::STEP_MS))
            }
            _ => None,
        };
        let mut lifetimes = Lifetimes {
            ends: BTreeMap::new(),
            wall_at: now,
            wall_unix_ms: unix_ms,
            clock_was_set: false,
            boot: boot.map(|boot| (now, boot)),
            doubtful: Vec::new(),
        };
        for kept in &book.kept {
            let Some(ttl_s) = kept.rule.ttl_s else { continue };
            let whole_ms = ttl_s.saturating_mul(1000);
            let left_ms = kept.left_ms.unwrap_or(whole_ms).min(whole_ms).saturating_sub(away_ms.unwrap_or(0));
            lifetimes.ends.insert(kept.rule.id.clone(), now + Duration::from_millis(left_ms));
            if away_ms.is_none() {
                lifetimes.doubtful.push(kept.rule.id.clone());
            }
        }
        // What is left now must be written down: else each restart would give it again.
        lifetimes.clock_was_set = !lifetimes.doubtful.is_empty();
        lifetimes
    }

    /// Rules of which nobody can tell how much of their time is over; they are told once.
    #[must_use]
    pub fn take_doubtful(&mut self) -> Vec<String> {
        std::mem::take(&mut self.doubtful)
    }

    /// Notes in a book what is left of each rule, and by which clock.
    pub fn stamp(&self, book: &mut Rulebook, now: Time) {
        book.written = self.boot.as_ref().map(|(read_at, boot)| BootClock {
            boot_id: boot.boot_id.clone(),
            uptime_ms: boot.uptime_ms.saturating_add(whole_ms(now.since(*read_at))),
        });
        for kept in &mut book.kept {
            let known = self.ends.get(&kept.rule.id).map(|end| whole_ms(end.since(now)).saturating_add(1));
            kept.left_ms = kept.rule.ttl_s.map(|ttl_s| known.unwrap_or_else(|| ttl_s.saturating_mul(1000)));
        }
    }

    /// Takes over a book: rules known before keep their end, new ones get theirs from their deadline.
    pub fn take(&mut self, book: &Rulebook, now: Time) {
        let unix_ms = self.unix_ms(now);
        let known = std::mem::take(&mut self.ends);
        for kept in &book.kept {
            let (Some(deadline), Some(ttl_s)) = (kept.deadline_unix_ms, kept.rule.ttl_s) else { continue };
            let left_ms = deadline.saturating_sub(unix_ms).min(ttl_s.saturating_mul(1000));
            let end = known.get(&kept.rule.id).copied().unwrap_or(now + Duration::from_millis(left_ms));
            self.ends.insert(kept.rule.id.clone(), end);
        }
    }

    /// Reads the wall clock.
    pub fn hear_wall_clock(&mut self, now: Time, unix_ms: u64) {
        self.clock_was_set |= unix_ms.abs_diff(self.unix_ms(now)) > STEP_MS;
        (self.wall_at, self.wall_unix_ms) = (now, unix_ms);
    }

    /// What the wall clock says, milliseconds since the Unix epoch.
    #[must_use]
    pub fn unix_ms(&self, now: Time) -> u64 {
        self.wall_unix_ms.saturating_add(whole_ms(now.since(self.wall_at)))
    }

    /// Ids of the rules that are at their end.
    #[must_use]
    pub fn ended(&self, now: Time) -> Vec<String> {
        self.ends.iter().filter(|(_, end)| **end <= now).map(|(id, _)| id.clone()).collect()
    }

    /// The id of the rule that ends first.
    #[must_use]
    pub fn first_to_end(&self) -> Option<&str> {
        self.ends.iter().min_by_key(|(_, end)| **end).map(|(id, _)| id.as_str())
    }

    /// The book with its deadlines told by a clock that was set since; none when that is not needed.
    /// The rules and their version stay.
    #[must_use]
    pub fn rewritten(&mut self, book: &Rulebook, now: Time) -> Option<Rulebook> {
        if !std::mem::take(&mut self.clock_was_set) || self.ends.is_empty() {
            return None;
        }
        let mut next = book.clone();
        for kept in &mut next.kept {
            if let Some(end) = self.ends.get(&kept.rule.id) {
                let left_ms = whole_ms(end.since(now));
                // One more, since what is left was cut to whole milliseconds.
                kept.deadline_unix_ms = Some(self.unix_ms(now).saturating_add(left_ms).saturating_add(1));
            }
        }
        Some(next)
    }
}

fn whole_ms(duration: Duration) -> u64 {
    u64::try_from(duration.as_millis()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rules::{Relation, Rule};

    fn s(seconds: u64) -> Time {
        Time::ZERO + Duration::from_secs(seconds)
    }

    fn boot(boot_id: &str, uptime_s: u64) -> Option<BootClock> {
        Some(BootClock { boot_id: boot_id.into(), uptime_ms: uptime_s * 1000 })
    }

    /// One rule for a minute, said when the wall clock read 1000 s and the host was up for 500 s.
    fn book() -> Rulebook {
        let rug = Rule { ttl_s: Some(60), ..Rule::exclusion(Relation::On, "rug") };
        let mut book = Rulebook::default().changed(&[], vec![rug], "", 1_000_000);
        Lifetimes::of(&Rulebook::default(), s(0), 1_000_000, boot("a", 500)).stamp(&mut book, s(0));
        book
    }

    /// `last_alive` and `ended` are a tenth of a second around the end.
    #[track_caller]
    fn check(lifetimes: &Lifetimes, ends_s: u64) {
        let tenth = Duration::from_millis(100);
        assert!(lifetimes.ended(s(ends_s - 1)).is_empty());
        assert_eq!(lifetimes.ended(s(ends_s) + tenth), ["s1"]);
    }

    #[test]
    fn a_rule_ends_after_its_lifetime_and_not_before() {
        check(&Lifetimes::of(&book(), s(5), 1_000_000, boot("a", 500)), 65);
    }

    #[test]
    fn time_away_counts_by_the_hosts_own_clock_whatever_the_wall_clock_says() {
        for unix_ms in [0, 1_040_000, 9_000_000_000] {
            let mut lifetimes = Lifetimes::of(&book(), s(5), unix_ms, boot("a", 540));
            check(&lifetimes, 25);
            assert!(lifetimes.take_doubtful().is_empty());
        }
        assert_eq!(Lifetimes::of(&book(), s(5), 0, boot("a", 561)).ended(s(5)), ["s1"]);
    }

    #[test]
    fn after_a_restart_of_the_host_what_was_left_is_kept_and_doubted() {
        for (unix_ms, clock) in [(1_010_000, boot("b", 3)), (9_000_000_000, boot("b", 3)), (0, None)] {
            let mut lifetimes = Lifetimes::of(&book(), s(5), unix_ms, clock);
            check(&lifetimes, 65);
            assert_eq!(lifetimes.take_doubtful(), ["s1"]);
            assert!(lifetimes.take_doubtful().is_empty());
        }
    }

    #[test]
    fn what_is_left_is_written_down_at_once_so_that_restarts_in_a_row_do_not_add_up() {
        let mut book = book();
        let mut lifetimes = Lifetimes::of(&book, s(0), 1_000_000, boot("b", 3));
        book = lifetimes.rewritten(&book, s(40)).unwrap();
        lifetimes.stamp(&mut book, s(40));
        check(&Lifetimes::of(&book, s(0), 1_000_000, boot("c", 3)), 20);
        check(&Lifetimes::of(&book, s(0), 1_000_000, boot("b", 53)), 10);
    }

    #[test]
    fn setting_the_clock_neither_ends_nor_prolongs_a_rule_and_the_journal_is_told() {
        let (mut book, mut lifetimes) = (book(), Lifetimes::of(&book(), s(0), 1_000_000, boot("a", 500)));
        lifetimes.hear_wall_clock(s(10), 1_010_500);
        assert_eq!(lifetimes.rewritten(&book, s(10)), None);
        lifetimes.hear_wall_clock(s(20), 9_000_000);
        book = lifetimes.rewritten(&book, s(20)).unwrap();
        let deadline_unix_ms = book.kept[0].deadline_unix_ms.unwrap();
        assert!((9_040_000..9_040_100).contains(&deadline_unix_ms), "{deadline_unix_ms}");
        assert_eq!(lifetimes.rewritten(&book, s(20)), None);
        lifetimes.stamp(&mut book, s(20));
        lifetimes.take(&book, s(20));
        check(&lifetimes, 60);
        // And over a restart at that moment.
        check(&Lifetimes::of(&book, s(0), 9_000_000, boot("a", 520)), 40);
    }
}
