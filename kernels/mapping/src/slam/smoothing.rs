//! Every kept scan against those around it, before and after: the last word on where they were taken.
//!
//! While the robot drives, a scan is matched once, against what was seen before it, and what odometry got wrong
//! at that moment stays in the map. When all has been seen, scans are matched in pairs, near ones along the way and
//! ones from other times at the same place, and the pairs and odometry settle together, each as far as it is sure.
//!
//! Takes a few milliseconds for each kept scan: for maps that are finished, not for a robot that drives.

use geometry::{Pose2, angle::wrapped};

use super::drawing::Keyframe;
use super::graph::{Constraint, optimise};
use super::submap::Submap;
use crate::scan_match::{Cloud, Evidence, MatchMap, Prior, refine};

mod wheels;

use wheels::Wheels;

/// A scan is matched against the first one that lies at least so far on along the way, metres.
const GAPS_M: [f64; 5] = [0.0, 1.0, 2.0, 4.0, 8.0];
/// Scans from another time are those whose ways lie so far apart, metres, ...
const OTHER_TIME_M: f64 = 15.0;
/// ... taken this near and with as much turned, metres and radians.
const OTHER_SHIFT_M: f64 = 2.5;
const OTHER_TURN_RAD: f64 = 1.0;
/// So many of those for each scan, the nearest.
const N_OTHERS: usize = 3;
/// How far a pair may be off before, metres and radians: one deviation.
const OFF_M: f64 = 0.15;
const OFF_RAD: f64 = 0.05;
/// Pairs that would move by more deviations than this are not believed.
const DEVIATIONS2_MAX: f64 = 6.0;
/// Of the points of a pair that say anything, the share that must speak for it.
const SHARE_MIN: f64 = 0.7;
/// And of all points, the share that must lie on surfaces.
const SHARE_OF_ALL_MIN: f64 = 0.15;
/// Best that a pair is believed, metres and radians.
const PAIR_SHIFT_M: f64 = 0.02;
const PAIR_TURN_RAD: f64 = 0.004;
/// Where nothing ties a scan, it stays at the one before as it was, give or take: metres and radians.
const LOOSE_M: f64 = 0.5;
const LOOSE_RAD: f64 = 0.2;
/// The pairs are matched anew from where they settled.
const N_ROUNDS: usize = 2;

/// Moves kept scans to where all that was seen says they were taken. `torn` are the first sub-maps of pieces that
/// were not found in what was before: nothing is matched across.
pub(super) fn smooth(
    kept: &mut [Keyframe],
    submaps: &[Submap],
    torn: &[usize],
    cell_m: f64,
    cloud_of: impl Fn(&Keyframe) -> Cloud,
) {
    let before: Vec<Pose2> = kept.iter().map(|k| k.map_from_base(submaps)).collect();
    let mut poses = before.clone();
    let clouds: Vec<Cloud> = kept.iter().map(cloud_of).collect();
    let pieces: Vec<usize> =
        kept.iter().map(|k| torn.iter().filter(|first| **first <= k.submap_idx()).count()).collect();
    let pairs = pairs_of(&before, &pieces);
    let told: Vec<Option<Pose2>> = kept.iter().map(Keyframe::told).collect();
    for _ in 0..N_ROUNDS {
        let wheels = Wheels::fit(&told, &poses);
        let mut constraints = matched(&pairs, &clouds, &poses, cell_m);
        constraints.extend(chain_of(&before, &told, &wheels));
        optimise(&constraints, &mut poses);
    }
    for (keyframe, pose) in kept.iter_mut().zip(&poses) {
        keyframe.move_to(pose, submaps);
    }
}

/// Ties each scan to the one before: loosely as it was, and as odometry tells.
fn chain_of(before: &[Pose2], told: &[Option<Pose2>], wheels: &Wheels) -> Vec<Constraint> {
    let mut constraints = Vec::new();
    for (idx, (last, now)) in before.iter().zip(before.iter().skip(1)).enumerate() {
        let as_it_was = last.inverse() * *now;
        constraints.push(Constraint::loose(idx, idx + 1, as_it_was, (LOOSE_M, LOOSE_RAD)));
        if let Some(Some(told)) = told.get(idx + 1) {
            let deviations = wheels.deviations(told);
            constraints.push(Constraint::told(idx, idx + 1, wheels.meant(told), deviations));
        }
    }
    constraints
}

/// Pairs of scans that may see the same: for each, its partners further on along the way.
fn pairs_of(poses: &[Pose2], pieces: &[usize]) -> Vec<Vec<usize>> {
    let mut way_m = Vec::with_capacity(poses.len());
    let mut so_far_m = 0.0;
    for (idx, pose) in poses.iter().enumerate() {
        if let Some(last) = idx.checked_sub(1).and_then(|before| poses.get(before)) {
            so_far_m += (pose.position() - last.position()).norm();
        }
        way_m.push(so_far_m);
    }
    let mut pairs = Vec::with_capacity(poses.len());
    for (first, pose) in poses.iter().enumerate() {
        let mut partners: Vec<usize> = Vec::new();
        for gap_m in GAPS_M {
            let from_m = way_m[first] + gap_m;
            let second = way_m.partition_point(|m| *m < from_m).max(first + 1);
            if second < poses.len() && !partners.contains(&second) {
                partners.push(second);
            }
        }
        let later = way_m.partition_point(|m| *m < way_m[first] + OTHER_TIME_M);
        let mut others: Vec<(f64, usize)> = poses
            .iter()
            .enumerate()
            .skip(later)
            .filter(|(_, other)| wrapped(other.yaw_rad - pose.yaw_rad).abs() < OTHER_TURN_RAD)
            .map(|(second, other)| ((other.position() - pose.position()).norm(), second))
            .filter(|(off_m, _)| *off_m < OTHER_SHIFT_M)
            .collect();
        others.sort_by(|a, b| a.0.total_cmp(&b.0));
        partners.extend(others.iter().take(N_OTHERS).map(|(_, second)| *second));
        partners.retain(|second| pieces[first] == pieces[*second]);
        pairs.push(partners);
    }
    pairs
}

/// What the pairs say, from where they are.
fn matched(pairs: &[Vec<usize>], clouds: &[Cloud], poses: &[Pose2], cell_m: f64) -> Vec<Constraint> {
    let mut constraints = Vec::new();
    for (first, partners) in pairs.iter().enumerate() {
        if partners.is_empty() {
            continue;
        }
        let mut map = MatchMap::new(cell_m);
        map.insert(&clouds[first], Pose2::IDENTITY);
        for &second in partners {
            let cloud = &clouds[second];
            let expected = Prior {
                map_from_scan: poses[first].inverse() * poses[second],
                shift_m: OFF_M,
                turn_rad: OFF_RAD,
            };
            let found = refine::refine(&map, cloud, expected.map_from_scan, &expected);
            let evidence = Evidence::of_points(&map, cloud, found.map_from_scan);
            let is_seen = evidence.share() >= SHARE_MIN
                && evidence.n_on_surface as f64 >= SHARE_OF_ALL_MIN * evidence.n_points as f64
                && expected.squared_deviations(&found.map_from_scan) <= DEVIATIONS2_MAX;
            if is_seen {
                let best = (PAIR_SHIFT_M, PAIR_TURN_RAD);
                constraints.push(Constraint::no_better_than(first, second, &found, best));
            }
        }
    }
    constraints
}
