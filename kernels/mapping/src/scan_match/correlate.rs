//! The best places in a window, however bad the guess: all of it is looked at, coarsely, and what may be good is
//! looked at more finely, by branch and bound.
//!
//! A place's score is the mean heat of the scan's points there, less what it loses for lying far from where it was
//! expected. Several places are told when several look alike: which of them it is, others must say.

use std::collections::BinaryHeap;

use geometry::Pose2;

use super::cloud::Cloud;
use super::map::MatchMap;
use super::shifts::{Node, Shifts};
use super::{Prior, Window};

/// How closely a window is looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Care {
    /// Points of the scan that are compared, at most.
    pub(super) n_points: usize,
    /// Every how many-th heading is.
    pub(super) turns: f64,
}

impl Care {
    /// Enough to find a scan wherever it is.
    pub const FULL: Care = Care { n_points: 64, turns: 1.0 };
    /// Enough where it fits like nowhere else, in a third of the time.
    pub const GLANCE: Care = Care { n_points: 32, turns: 2.0 };
}

/// Blocks that are looked into at most for each place that is wanted. After that the most promising ones are
/// followed straight down.
const N_NODES_EACH: usize = 150;
/// Most that a place loses for being unexpected, as a share of the best heat, ...
const LOSS_MAX: f64 = 0.3;
/// ... half of it at this many squared deviations.
const LOSS_HALF: f64 = 9.0;
/// Places that score less than this share of the best are not told.
const SCORE_SHARE_MIN: f32 = 0.6;

/// What a place loses for lying so many squared deviations from where it was expected.
#[must_use]
pub fn loss(squared_deviations: f64) -> f64 {
    LOSS_MAX * squared_deviations / (squared_deviations + LOSS_HALF)
}

/// A place found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Where the scan's frame lies in the map's, to a cell and a step of heading.
    pub map_from_scan: Pose2,
    /// Mean heat of its points, 0 to 1, less its loss.
    pub score: f64,
}

/// The best places within `window` of what is expected, at most `n_max`, the best first; none when there is
/// nothing to match.
#[must_use]
pub fn search(map: &MatchMap, cloud: &Cloud, prior: &Prior, window: Window, n_max: usize) -> Vec<Place> {
    let Some(mut places) = Places::new(map, cloud, prior, window, Care::FULL, n_max) else {
        return Vec::new();
    };
    let mut found: Vec<Place> = std::iter::from_fn(|| places.next(SCORE_SHARE_MIN)).collect();
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    found
}

/// The best places, looked for one by one.
pub struct Places<'a> {
    shifts: Shifts<'a>,
    queue: BinaryHeap<Node>,
    found: Vec<Node>,
    n_looked_into: usize,
    n_max: usize,
}

impl<'a> Places<'a> {
    /// At most `n_max` places; `None` when there is nothing to match.
    pub fn new(
        map: &'a MatchMap,
        cloud: &Cloud,
        prior: &Prior,
        window: Window,
        care: Care,
        n_max: usize,
    ) -> Option<Self> {
        if map.n_surfels() == 0 || cloud.points().is_empty() || !prior.map_from_scan.is_finite() {
            return None;
        }
        let shifts = Shifts::new(map, cloud, prior, window, care);
        let queue = BinaryHeap::from(shifts.promising());
        Some(Places { shifts, queue, found: Vec::new(), n_looked_into: 0, n_max })
    }

    /// The best of those not told yet, unless it scores less than this share of the first.
    pub fn next(&mut self, share_min: f32) -> Option<Place> {
        let least = self.found.first().map_or(f32::NEG_INFINITY, |first| share_min * first.bound);
        while self.found.len() < self.n_max {
            let best = *self.queue.peek().filter(|best| best.bound >= least)?;
            self.queue.pop();
            if self.is_told(&best) {
                continue;
            }
            let place = if best.level == 0 {
                best
            } else {
                self.n_looked_into += 1;
                if self.n_looked_into < N_NODES_EACH * self.n_max {
                    self.queue.extend(self.shifts.parts(&best));
                    continue;
                }
                self.shifts.straight_down(best)
            };
            if !self.is_told(&place) {
                self.found.push(place);
                return Some(self.shifts.place(&place));
            }
        }
        None
    }

    fn is_told(&self, node: &Node) -> bool {
        self.found.iter().any(|found| self.shifts.is_same(found, node))
    }
}
