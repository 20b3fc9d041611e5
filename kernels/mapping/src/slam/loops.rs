//! Finding finished sub-maps in older ones.
//!
//! A whole sub-map is looked for, not a scan: metres of wall and furniture are alike nowhere else. What is
//! found must lie on the old surfaces for the most part wherever the two overlap, and both ways.

use std::collections::VecDeque;

use geometry::Pose2;

use super::graph::Constraint;
use super::submap::Submap;
use crate::scan_match::{self, Cloud, Prior, Window};

/// Sub-maps this near in order share scans or their neighbours do; there is nothing to learn.
const N_NEIGHBOURS: usize = 2;
/// At most so many older ones are looked into for each finished one, the nearest first.
const N_CANDIDATES_MAX: usize = 2;
/// Most points that a sub-map is looked for with.
const N_POINTS_MAX: usize = 500;
/// Most pieces of surface of a sub-map that is looked into.
const N_REBUILT_MAX: usize = 1500;
/// How far the pose may have drifted since the last loop: for each metre of the way, and at most.
const DRIFT_M_M: f64 = 0.03;
const DRIFT_RAD_M: f64 = 0.01;
const DRIFT_MIN_M: f64 = 0.4;
const DRIFT_MIN_RAD: f64 = 0.08;
const DRIFT_MAX_M: f64 = 6.0;
const DRIFT_MAX_RAD: f64 = 0.7;
/// Share of points within the overlap that must lie on the other's surfaces.
const SHARE_MIN: f64 = 0.65;
/// A point this near to a surface, metres, lies within the overlap.
const OVERLAP_M: f64 = 0.5;
/// The overlap must hold at least this share of the points: corners that look alike are everywhere.
const OVERLAP_MIN: f64 = 0.35;

/// Looks for loops, one candidate at a time.
#[derive(Default)]
pub(super) struct Loops {
    /// (finished, older) that may overlap.
    waiting: VecDeque<(usize, usize)>,
    /// How long the way was at the last loop, metres.
    closed_at_m: f64,
}

impl Loops {
    pub(super) fn is_waiting(&self) -> bool {
        !self.waiting.is_empty()
    }

    /// A sub-map is finished: older ones near it are to be looked into.
    pub(super) fn finish_submap(&mut self, submaps: &[Submap], finished: usize) {
        let Some(new) = submaps.get(finished).filter(|s| s.is_finished()) else { return };
        let reach_m = self.window(new).shift_m;
        let n_old = finished.saturating_sub(N_NEIGHBOURS);
        let mut near: Vec<(f64, usize)> = submaps[..n_old]
            .iter()
            .enumerate()
            .filter(|(_, old)| old.is_finished())
            .map(|(idx, old)| ((old.middle_map() - new.middle_map()).norm(), idx))
            .filter(|(off_m, idx)| *off_m < reach_m + 0.7 * (submaps[*idx].reach_m() + new.reach_m()))
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near.truncate(N_CANDIDATES_MAX);
        self.waiting.extend(near.into_iter().map(|(_, idx)| (finished, idx)));
    }

    /// How far a finished sub-map may have drifted since the last loop.
    fn window(&self, new: &Submap) -> Window {
        let way_m = (new.begun_at_m - self.closed_at_m).max(0.0);
        Window {
            shift_m: (DRIFT_MIN_M + DRIFT_M_M * way_m).min(DRIFT_MAX_M),
            turn_rad: (DRIFT_MIN_RAD + DRIFT_RAD_M * way_m).min(DRIFT_MAX_RAD),
        }
    }

    /// Looks into one candidate.
    pub(super) fn look(&mut self, submaps: &[Submap]) -> Option<Constraint> {
        let (finished, older) = self.waiting.pop_front()?;
        let (new, old) = (submaps.get(finished)?, submaps.get(older)?);
        let window = self.window(new);
        let guess = old.map_from_submap.inverse() * new.map_from_submap;
        let prior = Prior { map_from_scan: guess, shift_m: window.shift_m, turn_rad: window.turn_rad };
        let cloud = new.cloud().thinned(N_POINTS_MAX);
        let old_map = old.rebuilt(N_REBUILT_MAX);
        let found = scan_match::find(&old_map, &cloud, &prior, window)?;
        if found.inlier_share < OVERLAP_MIN * SHARE_MIN {
            return None;
        }
        // Both ways: what the old one shows where the new one looked must be in the new one too.
        let there = share_in_overlap(&old_map, &cloud, found.map_from_scan);
        let back_map = new.rebuilt(N_REBUILT_MAX);
        let old_cloud = old.cloud().thinned(N_POINTS_MAX);
        let back = share_in_overlap(&back_map, &old_cloud, found.map_from_scan.inverse());
        let is_sure = there.is_some_and(|s| s >= SHARE_MIN) && back.is_some_and(|s| s >= SHARE_MIN);
        is_sure.then_some(Constraint::of_match(older, finished, &found))
    }

    /// A loop was closed.
    pub(super) fn closed(&mut self, submaps: &[Submap]) {
        self.closed_at_m = submaps.last().map_or(0.0, |s| s.begun_at_m);
    }
}

/// Share of a cloud's points on surfaces of a map, among those that have any of it near; `None` when too few do.
fn share_in_overlap(map: &scan_match::MatchMap, cloud: &Cloud, map_from_cloud: Pose2) -> Option<f64> {
    let (mut n_overlap, mut n_on_surface) = (0, 0);
    for point in cloud.points() {
        let at = map_from_cloud.transform(point.at.cast::<f64>());
        if map.is_near_surface(at, OVERLAP_M) {
            n_overlap += 1;
            n_on_surface += usize::from(map.is_on_surface(at));
        }
    }
    let is_enough = n_overlap as f64 >= OVERLAP_MIN * cloud.points().len() as f64;
    is_enough.then(|| f64::from(n_on_surface as u32) / f64::from(n_overlap as u32))
}
