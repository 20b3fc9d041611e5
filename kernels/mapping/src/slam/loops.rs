//! Finding finished sub-maps in older ones.
//!
//! A whole sub-map is looked for, not a scan: metres of wall and furniture are alike nowhere else. What is
//! found must lie on the old surfaces for the most part wherever the two overlap, and both ways.

use std::collections::VecDeque;

use super::graph::Constraint;
use super::submap::Submap;
use crate::scan_match::{self, Evidence, Match, Prior, Window};

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
/// So many places are compared.
const N_PLACES: usize = 3;
/// At least so many of the old one's points must lie on the new one's surfaces.
const N_BACK_MIN: usize = 40;
/// How sure a loop must be.
const SURENESS: Sureness = Sureness { share_min: 0.7, told_min: 0.4, margin: 0.02 };

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
        let prior =
            Prior { map_from_scan: guess, shift_m: window.shift_m / 2.0, turn_rad: window.turn_rad / 2.0 };
        let found = find_piece(old, new, &prior, window, SURENESS)?;
        Some(Constraint::of_match(older, finished, &found))
    }

    /// A loop was closed.
    pub(super) fn closed(&mut self, submaps: &[Submap]) {
        self.closed_at_m = submaps.last().map_or(0.0, |s| s.begun_at_m);
    }
}

/// How sure one must be that a piece was found in another.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sureness {
    /// Of the points that say anything, the share that must speak for it, both ways.
    pub(super) share_min: f64,
    /// Share of the points that must say anything.
    pub(super) told_min: f64,
    /// How much better it must be than anywhere else.
    pub(super) margin: f64,
}

/// Looks for one sub-map in another one; `None` unless it is found surely. Both ways: what the old one shows
/// where the new one looked must be in the new one too.
pub(super) fn find_piece(
    old: &Submap,
    new: &Submap,
    prior: &Prior,
    window: Window,
    sureness: Sureness,
) -> Option<Match> {
    let cloud = new.cloud().thinned(N_POINTS_MAX);
    let old_map = old.rebuilt(N_REBUILT_MAX);
    let places = scan_match::candidates(&old_map, &cloud, prior, window, N_PLACES);
    let best = places.first()?;
    let is_fit = |evidence: &Evidence| {
        evidence.share() >= sureness.share_min
            && evidence.n_told() as f64 >= sureness.told_min * evidence.n_points as f64
    };
    let other = places.get(1).map_or(f64::NEG_INFINITY, |other| other.score);
    if !is_fit(&best.evidence) || best.score < other + sureness.margin {
        return None;
    }
    let new_map = new.rebuilt(N_REBUILT_MAX);
    let old_cloud = old.cloud().thinned(N_POINTS_MAX);
    let back = Evidence::of_points(&new_map, &old_cloud, best.found.map_from_scan.inverse());
    (back.share() >= sureness.share_min && back.n_on_surface >= N_BACK_MIN).then_some(best.found)
}
