//! From one scan to the next: where a scan lies in a map, given where the last one lay and what is foreseen.
//!
//! When little is unsure the scan is moved onto the surfaces from where it is foreseen, and that is that. When
//! it does not fit there, or much is unsure, all places around are looked at, and what speaks for each of them
//! and against it decides. Without odometry much is always unsure, and most scans fit one place or a few and no
//! other: that is seen at a glance, with half of the points and of the headings, over all of the same window.

use geometry::Pose2;
use nalgebra::Matrix3;

use super::agreement::{agrees, agrees_surely};
use super::motion::Foreseen;
use crate::scan_match::{self, Candidate, Cloud, Evidence, MatchMap, Prior, Window, refine};

/// Where no more than this is unsure, metres and radians, the scan is first tried where it is foreseen.
const DIRECT_SHIFT_M: f64 = 0.2;
const DIRECT_TURN_RAD: f64 = 0.15;
/// Share of the scan that must lie on surfaces then, ...
const DIRECT_INLIERS_MIN: f64 = 0.6;
/// ... more where no odometry says so, ...
const DIRECT_INLIERS_ALONE_MIN: f64 = 0.8;
/// ... and of what says anything, what speaks for it, ...
const DIRECT_SHARE_MIN: f64 = 0.85;
/// ... and it must lie within this many squared deviations.
const DIRECT_DEVIATIONS2_MAX: f64 = 6.0;
/// Where no odometry says anything, a glance is enough when this share of the scan lies on surfaces, ...
const CLEAR_INLIERS_MIN: f64 = 0.6;
/// ... this share of what says anything speaks for it, ...
const CLEAR_SHARE_MIN: f64 = 0.85;
/// ... and no more than this share of the beams would pass through surfaces.
const CLEAR_THROUGH_MAX: f64 = 0.3;
/// So many places are looked at closely.
const N_CANDIDATES: usize = 4;
/// How much wider a window is made when nothing fits, and at least how wide.
const WIDER: f64 = 3.0;
const WIDE_SHIFT_M: f64 = 1.0;
const WIDE_TURN_RAD: f64 = 0.6;
/// A place in the wider window must be better by this much, or by this much against the word of odometry.
const GAIN_MIN: f64 = 0.05;
const GAIN_ODOMETRY_MIN: f64 = 0.2;
/// Where more than this is unsure, metres and radians, a place must stand out to be believed: ...
const UNSURE_SHIFT_M: f64 = 0.3;
const UNSURE_TURN_RAD: f64 = 0.3;
/// ... by this share of the scan on surfaces, or by this much against any other.
const OUTSTANDING_INLIERS: f64 = 0.5;
const OUTSTANDING_GAP: f64 = 0.2;
/// Information below which surfaces say nothing: 1/m², 1/rad².
const INFORMATION_MIN: f64 = 1.0;

/// Where a scan was found.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Followed {
    /// The pose, in the map.
    pub(crate) pose: Pose2,
    /// Share of the scan on surfaces.
    pub(crate) inlier_share: f64,
    /// Of the points that say anything, the share that speaks for the place.
    pub(crate) share: f64,
    /// Scan and map agree there.
    pub(crate) is_good: bool,
    /// How well surfaces tell the motion: variance along the way (m²), of the heading (rad²), and aside (m²).
    pub(crate) variance: [f64; 3],
}

/// Looks for a scan in a map, from `last`, the pose of the scan before. `None` when map or scan is empty.
pub(crate) fn follow(
    map: &MatchMap,
    cloud: &Cloud,
    last: &Pose2,
    foreseen: &Foreseen,
    window: Window,
) -> Option<Followed> {
    let prior = Prior {
        map_from_scan: *last * foreseen.last_from_now,
        shift_m: foreseen.shift_m,
        turn_rad: foreseen.turn_rad,
    };
    let expects = |pose: &Pose2| foreseen.expects(&(last.inverse() * *pose));
    let followed = |candidate: &Candidate, is_good: bool| {
        let pose = candidate.found.map_from_scan;
        Followed {
            pose,
            inlier_share: candidate.found.inlier_share,
            share: candidate.evidence.share(),
            is_good,
            variance: variance_of(&candidate.found.information, last, &pose),
        }
    };
    let inliers_min = if foreseen.is_odometry() { DIRECT_INLIERS_MIN } else { DIRECT_INLIERS_ALONE_MIN };
    if let Some(direct) = directly(map, cloud, &prior, inliers_min) {
        return Some(followed(&direct, true));
    }
    let is_good = |candidate: &Candidate| {
        let is_expected = expects(&candidate.found.map_from_scan);
        // Against the word of odometry, only what is sure.
        if foreseen.is_odometry() && !is_expected {
            agrees_surely(&candidate.evidence)
        } else {
            agrees(&candidate.evidence, is_expected)
        }
    };
    let is_unsure = foreseen.shift_m > UNSURE_SHIFT_M || foreseen.turn_rad > UNSURE_TURN_RAD;
    let is_clear = |candidate: &Candidate| is_clear(candidate) && expects(&candidate.found.map_from_scan);
    if is_unsure
        && !foreseen.is_odometry()
        && let Some(clear) = scan_match::at_a_glance(map, cloud, &prior, window, is_clear)
    {
        return Some(followed(&clear, true));
    }
    let near = scan_match::candidates(map, cloud, &prior, window, N_CANDIDATES);
    let best = near.iter().find(|c| is_good(c));
    if let Some(best) = best.filter(|best| !is_unsure || stands_out(best, &near)) {
        return Some(followed(best, true));
    }
    let widest = foreseen.widest();
    let wider = Window {
        shift_m: (window.shift_m * WIDER).max(WIDE_SHIFT_M).min(widest.shift_m),
        turn_rad: (window.turn_rad * WIDER).max(WIDE_TURN_RAD).min(widest.turn_rad),
    };
    let is_wider = wider.shift_m > window.shift_m || wider.turn_rad > window.turn_rad;
    let near = near.first();
    if is_wider {
        let loose = Prior { shift_m: wider.shift_m / 2.0, turn_rad: wider.turn_rad / 2.0, ..prior };
        let gain = if foreseen.is_odometry() { GAIN_ODOMETRY_MIN } else { GAIN_MIN };
        let floor = near.map_or(f64::NEG_INFINITY, |near| near.score + gain);
        let far = scan_match::candidates(map, cloud, &loose, wider, N_CANDIDATES);
        let best = far.iter().find(|c| c.score >= floor && is_good(c));
        if let Some(best) = best.filter(|best| stands_out(best, &far)) {
            return Some(followed(best, true));
        }
    }
    near.map(|near| followed(near, false))
}

/// Whether a place is more than the best of many: most of the scan lies on surfaces there, or no other place
/// comes near.
fn stands_out(best: &Candidate, all: &[Candidate]) -> bool {
    let is_other = |c: &&Candidate| c.found.map_from_scan != best.found.map_from_scan;
    let other = all.iter().filter(is_other).map(|c| c.score).fold(f64::NEG_INFINITY, f64::max);
    best.found.inlier_share >= OUTSTANDING_INLIERS || best.score >= other + OUTSTANDING_GAP
}

/// Whether so much speaks for a place, and so little against it, that only what looks like it at a glance needs to be
/// compared with it.
fn is_clear(candidate: &Candidate) -> bool {
    candidate.found.inlier_share >= CLEAR_INLIERS_MIN
        && candidate.evidence.share() >= CLEAR_SHARE_MIN
        && candidate.evidence.through_share() <= CLEAR_THROUGH_MAX
}

/// The scan where it is foreseen, moved onto the surfaces; `None` when too much is unsure or it does not fit.
fn directly(map: &MatchMap, cloud: &Cloud, prior: &Prior, inliers_min: f64) -> Option<Candidate> {
    if prior.shift_m > DIRECT_SHIFT_M || prior.turn_rad > DIRECT_TURN_RAD {
        return None;
    }
    let found = refine::refine(map, cloud, prior.map_from_scan, prior);
    let evidence = Evidence::of_points(map, cloud, found.map_from_scan);
    let is_sure = found.inlier_share >= inliers_min
        && evidence.share() >= DIRECT_SHARE_MIN
        && prior.squared_deviations(&found.map_from_scan) <= DIRECT_DEVIATIONS2_MAX
        && agrees(&evidence, true);
    is_sure.then(|| Candidate { found, evidence, score: evidence.score() })
}

/// Variance along the way between two poses, of the heading, and aside of the way.
fn variance_of(information: &Matrix3<f64>, last: &Pose2, now: &Pose2) -> [f64; 3] {
    let told = information + Matrix3::identity() * INFORMATION_MIN;
    let covariance = told.try_inverse().unwrap_or_else(|| Matrix3::identity() / INFORMATION_MIN);
    let way = now.position() - last.position();
    let way_m = way.norm();
    if way_m < 1e-6 {
        return [1.0, covariance[(2, 2)], 1.0];
    }
    let along = nalgebra::Vector3::new(way.x / way_m, way.y / way_m, 0.0);
    let aside = nalgebra::Vector3::new(-along.y, along.x, 0.0);
    [along.dot(&(covariance * along)), covariance[(2, 2)], aside.dot(&(covariance * aside))]
}
