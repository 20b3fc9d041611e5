//! What a scan at a pose says for the pose and against it.
//!
//! For it: points on surfaces of the map. Against it: points where beams have passed before and nothing stood,
//! and beams that would have to pass through surfaces. Points where nobody has looked yet say nothing: a robot
//! that comes around a corner sees many of them.

use geometry::Pose2;
use nalgebra::Vector2;

use super::cloud::Cloud;
use super::map::MatchMap;
use super::placement::Placement;

/// So many beams of a scan are followed through the map.
const N_BEAMS_MAX: usize = 60;
/// Beams are followed from this far, ...
const BEAM_BEGIN_M: f32 = 0.3;
/// ... to this far, ...
const BEAM_LENGTH_MAX_M: f32 = 12.0;
/// ... and not within this much of their ends, metres.
const SHORT_OF_END_M: f32 = 0.4;
/// A surface that a beam meets more steeply than this (cosine with the normal) is passed through; along others
/// it may graze.
const STEEP_MIN: f32 = 0.5;
/// A surface is this thick either way, metres.
const HALF_THICK_M: f32 = 0.04;
/// A piece of surface reaches this far along itself, metres.
const REACH_M: f32 = 0.08;

/// What a point where nobody has looked yet counts, and what a beam that would pass through a surface does:
/// glass is seen through.
const UNTOLD_WEIGHT: f64 = 0.3;
const THROUGH_WEIGHT: f64 = 0.6;

/// Counts of a scan's points and beams at a pose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Evidence {
    /// Points of the scan.
    pub n_points: usize,
    /// Of them, on surfaces of the map.
    pub n_on_surface: usize,
    /// Of them, where beams have passed before.
    pub n_in_free: usize,
    /// Beams that were followed, ...
    pub n_beams: usize,
    /// ... and those that would pass through a surface.
    pub n_through: usize,
}

impl Evidence {
    /// Counts a scan's points, without following its beams.
    #[must_use]
    pub fn of_points(map: &MatchMap, cloud: &Cloud, map_from_scan: Pose2) -> Self {
        let placed = Placement::new(map_from_scan);
        let (mut n_on_surface, mut n_in_free) = (0, 0);
        for point in cloud.points() {
            let at = placed.point(point.at);
            if map.is_on_surface(at) {
                n_on_surface += 1;
            } else if map.free().is_free(at) {
                n_in_free += 1;
            }
        }
        Evidence { n_points: cloud.points().len(), n_on_surface, n_in_free, n_beams: 0, n_through: 0 }
    }

    /// Counts points and beams. A cloud that knows of no eye has no beams.
    #[must_use]
    pub fn of(map: &MatchMap, cloud: &Cloud, map_from_scan: Pose2) -> Self {
        let mut evidence = Evidence::of_points(map, cloud, map_from_scan);
        let Some(eye) = cloud.eye() else { return evidence };
        let placed = Placement::new(map_from_scan);
        let eye = placed.point(eye);
        let each = cloud.points().len().div_ceil(N_BEAMS_MAX).max(1);
        for point in cloud.points().iter().step_by(each) {
            let way = placed.point(point.at) - eye;
            let length_m = way.norm();
            let until_m = (length_m - SHORT_OF_END_M).min(BEAM_LENGTH_MAX_M);
            if until_m <= BEAM_BEGIN_M {
                continue;
            }
            let direction = way / length_m;
            evidence.n_beams += 1;
            evidence.n_through += usize::from(is_blocked(map, eye, direction, until_m));
        }
        evidence
    }

    /// Points that say something.
    #[must_use]
    pub fn n_told(&self) -> usize {
        self.n_on_surface + self.n_in_free
    }

    /// Share of the points that say something which speak for the pose; 0 when none does.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.n_on_surface as f64 / self.n_told().max(1) as f64
    }

    /// Share of the beams that would pass through a surface.
    #[must_use]
    pub fn through_share(&self) -> f64 {
        self.n_through as f64 / self.n_beams.max(1) as f64
    }

    /// All in one number: 1 is all for it. What says nothing counts a little, or standing still would win
    /// wherever something new is seen.
    #[must_use]
    pub fn score(&self) -> f64 {
        let n_untold = self.n_points - self.n_told();
        let sum = self.n_on_surface as f64 - self.n_in_free as f64 + UNTOLD_WEIGHT * n_untold as f64;
        sum / self.n_points.max(1) as f64 - THROUGH_WEIGHT * self.through_share()
    }
}

/// Whether a beam passes through a surface of the map.
fn is_blocked(map: &MatchMap, eye: nalgebra::Point2<f32>, direction: Vector2<f32>, until_m: f32) -> bool {
    let step_m = map.cell_m() as f32;
    let n_steps = ((until_m - BEAM_BEGIN_M) / step_m) as usize;
    (0..=n_steps).any(|nth| {
        let at = eye + direction * (BEAM_BEGIN_M + nth as f32 * step_m);
        map.nearest(at).is_some_and(|surface| {
            let off = at - surface.at;
            surface.normal.dot(&direction).abs() > STEEP_MIN
                && surface.normal.dot(&off).abs() < HALF_THICK_M
                && off.norm_squared() < REACH_M * REACH_M
        })
    })
}
