//! Finding a lost robot again: its scan is looked for in one sub-map after the other, anywhere and at any
//! heading, and the one place that stands out among all of them is believed when the next scan fits there too.

use std::f64::consts::PI;

use geometry::Pose2;

use super::sweep::Place;
use super::{Slam, agreement, motion};
use crate::scan_match::{self, Candidate, Cloud, Prior, Window};

/// So many places of each sub-map are compared.
const N_PLACES: usize = 12;
/// When all have been looked at, the robot has moved on, by odometry at best: so far the place may be off.
const NEAR: Window = Window { shift_m: 0.5, turn_rad: 0.3 };
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
        self.sweep.carry(foreseen.last_from_now);
        if cloud.points().len() < N_POINTS_MIN {
            return false;
        }
        let n_parts = self.submaps.len();
        if let Some(place) = self.sweep.decide(n_parts) {
            return self.settle_at(&place, cloud);
        }
        let idx = self.sweep.next_part(n_parts);
        let Some(submap) = self.submaps.get(idx) else { return false };
        let map = submap.ready(N_REBUILT_MAX);
        let middle = submap.map_from_submap.inverse().transform(submap.middle_map());
        let shift_m = submap.reach_m().clamp(2.0, SHIFT_MAX_M);
        let window = Window { shift_m, turn_rad: PI };
        let anywhere = Prior {
            map_from_scan: Pose2::new(middle.x, middle.y, 0.0),
            shift_m: 10.0 * shift_m,
            turn_rad: 10.0,
        };
        let places = scan_match::candidates(&map, cloud, &anywhere, window, N_PLACES);
        self.sweep.look(idx, submap.map_from_submap, &places);
        false
    }

    /// Goes on at a place, if the scan fits there.
    fn settle_at(&mut self, place: &Place, cloud: &Cloud) -> bool {
        let Some(submap) = self.submaps.get(place.part) else { return false };
        let map = submap.ready(N_REBUILT_MAX);
        let expected = Prior {
            map_from_scan: submap.map_from_submap.inverse() * place.map_from_base,
            shift_m: NEAR.shift_m,
            turn_rad: NEAR.turn_rad,
        };
        let places = scan_match::candidates(&map, cloud, &expected, NEAR, 1);
        let is_sure = |c: &&Candidate| agreement::agrees_surely(&c.evidence);
        let Some(found) = places.first().filter(is_sure).map(|c| c.found) else { return false };
        let map_from_base = submap.map_from_submap * found.map_from_scan;
        drop(map);
        self.graph.tie(place.part, self.submaps.len(), found.map_from_scan);
        self.begin_at(map_from_base);
        self.motion.forget();
        self.judge.found();
        true
    }
}
