//! Finding a lost robot again: its scan is looked for in one sub-map after the other, anywhere and at any
//! heading, and the one place that stands out among all of them is believed when the next scan fits there too.
//! One that is in doubt is looked for in the same way, while it is followed where it seems to be.

use std::f64::consts::PI;

use geometry::Pose2;

use super::{Place, Slam, Sweep, Verdict, agreement, motion};
use crate::scan_match::{self, Candidate, Cloud, Evidence, Prior, Window};

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
/// A map that is being made lacks things, and more of them come into view the farther the robot goes from one scan
/// to the next: so much of a scan may speak against a place for each metre and radian, and be no reason for doubt.
const NEWS_SHARE_M: f64 = 0.3;
const NEWS_SHARE_RAD: f64 = 0.3;

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
        self.look_into_next(cloud);
        false
    }

    /// Doubts the place where a scan was found if it fits worse than scans used to, and looks for a better one, in
    /// one sub-map with each scan; true when it is found, and the map goes on from there.
    pub(super) fn weigh(&mut self, cloud: &Cloud, last_from_now: &Pose2, share: f64) -> bool {
        let was_open = self.doubt.is_open();
        let news = NEWS_SHARE_M * last_from_now.position().coords.norm()
            + NEWS_SHARE_RAD * last_from_now.yaw_rad.abs();
        self.doubt.hear(share, news);
        if !(was_open && self.doubt.is_open()) {
            // Nothing is to be looked for; the first one that fits badly may be a passer-by.
            self.sweep = Sweep::default();
            return false;
        }
        self.sweep.carry(*last_from_now);
        let Some(map) = self.submaps[self.present].map().filter(|_| cloud.points().len() >= N_POINTS_MIN)
        else {
            return false;
        };
        let score = Evidence::of(map, cloud, self.present_from_base).score();
        let here = Place { map_from_base: self.map_from_base(), score, part: self.present };
        match self.sweep.compare(&here, self.submaps.len()) {
            Verdict::NotYet => self.look_into_next(cloud),
            Verdict::Here => self.doubt.dismiss(share),
            Verdict::There(place) if self.settle_at(&place, cloud) => return true,
            // It stays in doubt, and is looked for again.
            Verdict::There(_) | Verdict::Unknown => {}
        }
        false
    }

    fn look_into_next(&mut self, cloud: &Cloud) {
        let idx = self.sweep.next_part(self.submaps.len());
        let Some(submap) = self.submaps.get(idx) else { return };
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
        self.doubt.close();
        true
    }
}
