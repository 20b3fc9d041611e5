//! What is kept of one run, for the table and the picture.

use std::collections::BTreeMap;

use geometry::{Pose2, Twist};
use proto::{BaseMap, FilterStatus, ObjectMap, Truth};

use super::judge::{Finding, Judge};
use crate::hearing::Heard;

/// One moment of a run, from the ground truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Seconds since the goal was given.
    pub time_s: f64,
    /// Where the robot was.
    pub map_from_base: Pose2,
    /// How it moved.
    pub twist: Twist,
}

/// One run.
#[derive(Clone, Debug)]
pub struct Record {
    /// The run's name, `without` or `with`.
    pub name: &'static str,
    /// Every moment since the goal was given.
    pub moments: Vec<Moment>,
    /// When the goal was reached and the robot at rest, seconds since it was given.
    pub reached_s: Option<f64>,
    /// Collisions, by the truth.
    pub n_collisions: u64,
    /// Least distance of the hull to an obstacle, metres.
    pub clearance_m_min: f64,
    /// Whether the rule was kept, by the truth.
    pub judge: Judge,
    /// The last base map.
    pub base_map: Option<BaseMap>,
    /// The last region of each rule.
    pub regions: BTreeMap<String, ObjectMap>,
    /// Time the filter took, each tick since the goal, microseconds.
    used_us: Vec<u64>,
    /// Late ticks when the goal was given, and now.
    n_late: Option<(u64, u64)>,
    /// The truth's time when the goal was given, seconds.
    start_s: Option<f64>,
    driving: bool,
}

impl Record {
    /// An empty record.
    #[must_use]
    pub fn new(name: &'static str, judge: Judge) -> Self {
        Record {
            name,
            moments: Vec::new(),
            reached_s: None,
            n_collisions: 0,
            clearance_m_min: f64::INFINITY,
            judge,
            base_map: None,
            regions: BTreeMap::new(),
            used_us: Vec::new(),
            n_late: None,
            start_s: None,
            driving: false,
        }
    }

    /// The goal has been given: from here on the run counts.
    pub fn start(&mut self) {
        self.driving = true;
    }

    /// The goal is reached at the last moment seen.
    pub fn reached(&mut self) {
        self.reached_s = self.moments.last().map(|moment| moment.time_s);
    }

    /// Takes in what was heard.
    pub fn hear(&mut self, heard: &Heard) {
        match heard {
            Heard::BaseMap(map) => self.base_map = Some(map.message.clone()),
            Heard::ObjectMap(map) => {
                self.regions.insert(map.message.rule_id.clone(), map.message.clone());
            }
            Heard::Truth(truth) => self.see(&truth.message),
            Heard::Filter(status) if self.driving => self.count_tick(&status.message),
            _ => {}
        }
    }

    fn see(&mut self, truth: &Truth) {
        self.n_collisions = truth.n_collisions;
        if !self.driving {
            return;
        }
        let time_s = truth.time_s - *self.start_s.get_or_insert(truth.time_s);
        self.clearance_m_min = self.clearance_m_min.min(truth.clearance_m);
        self.judge.see(time_s, truth);
        self.moments.push(Moment { time_s, map_from_base: truth.map_from_base, twist: truth.twist });
    }

    fn count_tick(&mut self, status: &FilterStatus) {
        self.used_us.push(status.used_us);
        let (first, _) = self.n_late.unwrap_or((status.n_late, status.n_late));
        self.n_late = Some((first, status.n_late));
    }

    /// Seconds since the goal was given, by the truth.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        self.moments.last().map_or(0.0, |moment| moment.time_s)
    }

    /// Length of the path, metres.
    #[must_use]
    pub fn path_m(&self) -> f64 {
        let steps = self.moments.iter().zip(self.moments.iter().skip(1));
        steps.map(|(a, b)| (b.map_from_base.position() - a.map_from_base.position()).norm()).sum()
    }

    /// Time the filter took in a tick, milliseconds: the `share`-th part of the ticks took no longer.
    #[must_use]
    pub fn filter_ms(&self, share: f64) -> Option<f64> {
        let mut sorted = self.used_us.clone();
        sorted.sort_unstable();
        let rank = (share.clamp(0.0, 1.0) * sorted.len() as f64).ceil() as usize;
        sorted.get(rank.saturating_sub(1)).map(|us| *us as f64 / 1000.0)
    }

    /// Ticks of the filter that came too late, and ticks that were reported.
    #[must_use]
    pub fn late_ticks(&self) -> (u64, usize) {
        (self.n_late.map_or(0, |(first, last)| last.saturating_sub(first)), self.used_us.len())
    }

    /// Whether the rule was kept.
    #[must_use]
    pub fn finding(&self) -> Finding {
        self.judge.finding()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn latencies_are_ranked_and_not_interpolated() {
        let mut record = Record::new("with", Judge::default());
        assert_eq!(record.filter_ms(0.5), None);
        record.used_us = (1..=100).rev().map(|n| n * 1000).collect();
        assert_eq!(record.filter_ms(0.5), Some(50.0));
        assert_eq!(record.filter_ms(0.99), Some(99.0));
        assert_eq!(record.filter_ms(1.0), Some(100.0));
    }

    #[test]
    fn a_path_is_as_long_as_its_steps() {
        let mut record = Record::new("with", Judge::default());
        let moment = |x, y| Moment { time_s: 0.0, map_from_base: Pose2::new(x, y, 0.0), twist: Twist::ZERO };
        record.moments = vec![moment(0.0, 0.0), moment(3.0, 4.0), moment(3.0, 5.0)];
        assert!((record.path_m() - 6.0).abs() < 1e-12);
    }
}
