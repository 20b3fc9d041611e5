//! Where a scan fits into what was seen before: 2D scan matching against a map of small pieces of surface.
//!
//! In two steps. [`correlate`](correlate::search) tries every pose of a window, by branch and bound over a
//! pyramid of the map, so that a guess that is a metre or half a turn off does no harm (after Olson, ICRA
//! 2009, and Hess et al., ICRA 2016). [`refine`](refine::refine) then moves the scan onto the surfaces by
//! Gauss–Newton on distances to their tangents, far below the size of a cell. Everything is in one frame,
//! the map's own.
//!
//! Deliberately not here: what to do with a match (`slam`), and time.

use geometry::Pose2;

pub mod cloud;
pub mod correlate;
pub mod map;
pub mod refine;

pub use cloud::{Cloud, CloudPoint};
pub use map::MatchMap;
pub use refine::Prior;

/// How far around a guess is looked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// Either way along x and along y, metres.
    pub shift_m: f64,
    /// Either way in heading, radians.
    pub turn_rad: f64,
}

/// A scan's place in a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Match {
    /// Where the scan's frame lies in the map's.
    pub map_from_scan: Pose2,
    /// Share of the scan's points that lie on a surface of the map, 0 to 1.
    pub inlier_share: f64,
    /// Number of those points.
    pub n_inliers: usize,
    /// Information about x, y (1/m²) and heading (1/rad²) in the map's frame, from the surfaces alone: small
    /// along a corridor.
    pub information: nalgebra::Matrix3<f64>,
}

/// Finds a scan in a map around a guess.
///
/// `None` when the scan or the map is empty.
#[must_use]
pub fn find(map: &MatchMap, cloud: &Cloud, guess: &Prior, window: Window) -> Option<Match> {
    let coarse = correlate::search(map, cloud, guess.map_from_scan, window)?;
    Some(refine::refine(map, cloud, coarse.map_from_scan, guess))
}

#[cfg(test)]
mod tests;
