//! When rules end, by a clock that nobody can set, and the deadlines by which the journal keeps it.
//!
//! A rule must never end early. While the service runs, its own monotonic clock decides, so that setting
//! the host's clock changes nothing; the deadlines in the journal are written anew when that happens.
//! Over a restart only the wall clock knows how long the service was away: a clock that went back gives a
//! rule at most its whole lifetime again.

use std::collections::BTreeMap;
use std::time::Duration;

use geometry::Time;

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
}

impl Lifetimes {
    /// Those of a book read at `now`, when the wall clock says `unix_ms`.
    #[must_use]
    pub fn of(book: &Rulebook, now: Time, unix_ms: u64) -> Lifetimes {
        let mut lifetimes =
            Lifetimes { ends: BTreeMap::new(), wall_at: now, wall_unix_ms: unix_ms, clock_was_set: false };
        lifetimes.take(book, now);
        lifetimes
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
        let since_ms = u64::try_from(now.since(self.wall_at).as_millis()).unwrap_or(u64::MAX);
        self.wall_unix_ms.saturating_add(since_ms)
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
                let left_ms = u64::try_from(end.since(now).as_millis()).unwrap_or(u64::MAX);
                // One more, since what is left was cut to whole milliseconds.
                kept.deadline_unix_ms = Some(self.unix_ms(now).saturating_add(left_ms).saturating_add(1));
            }
        }
        Some(next)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rules::{Relation, Rule};

    fn s(seconds: u64) -> Time {
        Time::ZERO + Duration::from_secs(seconds)
    }

    /// One rule for a minute, said when the wall clock read 1000 s.
    fn book() -> Rulebook {
        let rug = Rule { ttl_s: Some(60), ..Rule::exclusion(Relation::On, "rug") };
        Rulebook::default().changed(&[], vec![rug], "", 1_000_000)
    }

    #[track_caller]
    fn check(lifetimes: &Lifetimes, last_alive: Time, ended: Time) {
        assert!(lifetimes.ended(last_alive).is_empty());
        assert_eq!(lifetimes.ended(ended), ["s1"]);
    }

    #[test]
    fn a_rule_ends_after_its_lifetime_and_not_before() {
        check(&Lifetimes::of(&book(), s(5), 1_000_000), s(64), s(65));
    }

    #[test]
    fn time_away_counts() {
        check(&Lifetimes::of(&book(), s(5), 1_040_000), s(24), s(25));
        check(&Lifetimes::of(&book(), s(5), 2_000_000), s(4), s(5));
    }

    #[test]
    fn a_wall_clock_that_went_back_gives_at_most_the_whole_lifetime() {
        check(&Lifetimes::of(&book(), s(5), 0), s(64), s(65));
    }

    #[test]
    fn setting_the_clock_neither_ends_nor_prolongs_a_rule_and_the_journal_is_told() {
        let (mut book, mut lifetimes) = (book(), Lifetimes::of(&book(), s(0), 1_000_000));
        lifetimes.hear_wall_clock(s(10), 1_010_500);
        assert_eq!(lifetimes.rewritten(&book, s(10)), None);
        lifetimes.hear_wall_clock(s(20), 9_000_000);
        book = lifetimes.rewritten(&book, s(20)).unwrap();
        assert_eq!(book.kept[0].deadline_unix_ms, Some(9_040_001));
        assert_eq!(lifetimes.rewritten(&book, s(20)), None);
        lifetimes.take(&book, s(20));
        check(&lifetimes, s(59), s(60));
        // And over a restart at that moment.
        check(&Lifetimes::of(&book, s(0), 9_000_000), s(40), s(41));
    }
}
