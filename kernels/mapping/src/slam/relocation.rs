//! Finding a lost robot again: its scan is looked for in one sub-map after the other, anywhere and at any
//! heading.

use std::f64::consts::PI;

use geometry::Pose2;

use super::{Slam, agreement, motion};
use crate::scan_match::{self, Candidate, Cloud, Prior, Window};

/// Share of a scan that must lie on a sub-map's surfaces for the robot to be there.
const SHARE_MIN: f64 = 0.75;
/// So many places are compared, and the best must be better than the next by this much: places that look
/// alike are none.
const N_PLACES: usize = 3;
const MARGIN: f64 = 0.1;
/// With fewer points no place is told from another.
const N_POINTS_MIN: usize = 40;
/// Most pieces of surface of a sub-map that is looked into.
const N_REBUILT_MAX: usize = 5000;
/// Farthest from a sub-map's middle that is looked, metres: bounds the time.
const SHIFT_MAX_M: f64 = 20.0;

impl Slam {
    /// Looks into one sub-map for a lost robot, another one with each scan; true when it is found, and the map
    /// goes on from there.
    pub(super) fn look_everywhere(&mut self, cloud: &Cloud, foreseen: &motion::Foreseen) -> bool {
        self.advance(self.present_from_base * foreseen.last_from_now);
        if cloud.points().len() < N_POINTS_MIN {
            return false;
        }
        let idx = (self.n_scans % self.submaps.len() as u64) as usize;
        let submap = &self.submaps[idx];
        let rebuilt;
        let map = match submap.map() {
            Some(map) => map,
            None => {
                rebuilt = submap.rebuilt(N_REBUILT_MAX);
                &rebuilt
            }
        };
        let middle = submap.map_from_submap.inverse().transform(submap.middle_map());
        let guess = Pose2::new(middle.x, middle.y, 0.0);
        let shift_m = submap.reach_m().clamp(2.0, SHIFT_MAX_M);
        let prior = Prior { map_from_scan: guess, shift_m: 10.0 * shift_m, turn_rad: 10.0 };
        let window = Window { shift_m, turn_rad: PI };
        let places = scan_match::candidates(map, cloud, &prior, window, N_PLACES);
        let other = places.get(1).map_or(f64::NEG_INFINITY, |other| other.score);
        let is_sure = |c: &&Candidate| {
            c.found.inlier_share >= SHARE_MIN
                && c.score >= other + MARGIN
                && agreement::agrees(&c.evidence, false)
        };
        let Some(found) = places.first().filter(is_sure).map(|c| c.found) else { return false };
        let map_from_base = submap.map_from_submap * found.map_from_scan;
        self.graph.tie(idx, self.submaps.len(), found.map_from_scan);
        self.begin_at(map_from_base);
        self.motion.forget();
        self.judge.found();
        true
    }
}
