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
mod dense;
pub mod evidence;
pub mod free;
pub mod map;
mod placement;
mod pyramid;
pub mod refine;
mod shifts;
mod tiles;

pub use cloud::{Cloud, CloudPoint};
pub use evidence::Evidence;
pub use free::FreeGrid;
pub use map::MatchMap;
pub use refine::Prior;

use correlate::{Care, Places};

/// So many places are found, and so many for each that is wanted, before any is looked at closely: heat alone
/// knows nothing of free space.
const N_PLACES_MIN: usize = 14;
const N_PLACES_EACH: usize = 3;
/// A place whose heat is this share of the likeliest's is nearly as likely.
const RIVAL_SHARE_MIN: f32 = 0.75;
/// A glance is not enough when there are more of them.
const N_RIVALS_MAX: usize = 3;

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

/// A place that a scan may lie at, looked at closely.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// The exact place.
    pub found: Match,
    /// What speaks for it and against it.
    pub evidence: Evidence,
    /// Both in one number, less what it loses for being unexpected.
    pub score: f64,
}

/// Finds a scan in a map around a guess.
///
/// `None` when the scan or the map is empty.
#[must_use]
pub fn find(map: &MatchMap, cloud: &Cloud, guess: &Prior, window: Window) -> Option<Match> {
    let places = correlate::search(map, cloud, guess, window, 1);
    places.first().map(|place| refine::refine(map, cloud, place.map_from_scan, guess))
}

/// The places that a scan may lie at, at most `n_max`, the likeliest first.
#[must_use]
pub fn candidates(
    map: &MatchMap,
    cloud: &Cloud,
    guess: &Prior,
    window: Window,
    n_max: usize,
) -> Vec<Candidate> {
    let mut places: Vec<(f64, Pose2)> =
        correlate::search(map, cloud, guess, window, N_PLACES_MIN.max(N_PLACES_EACH * n_max))
            .iter()
            .map(|place| (rough_score(map, cloud, guess, &place.map_from_scan), place.map_from_scan))
            .collect();
    places.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut candidates: Vec<Candidate> = places
        .iter()
        .take(n_max)
        .map(|(_, place)| candidate(map, cloud, guess, refine::refine(map, cloud, *place, guess)))
        .collect();
    candidates.sort_by(|a, b| b.score.total_cmp(&a.score));
    candidates
}

/// The place that a glance over the whole window is enough for: the best of the few likeliest, which satisfies
/// `is_clear` when they are looked at closely. `None` says nothing of the scan.
#[must_use]
pub fn at_a_glance(
    map: &MatchMap,
    cloud: &Cloud,
    guess: &Prior,
    window: Window,
    is_clear: impl Fn(&Candidate) -> bool,
) -> Option<Candidate> {
    let mut places = Places::new(map, cloud, guess, window, Care::GLANCE, N_PLACES_MIN)?;
    let closely = |place: &Pose2| candidate(map, cloud, guess, refine::refine(map, cloud, *place, guess));
    let likeliest = closely(&places.next(RIVAL_SHARE_MIN)?.map_from_scan);
    if !is_clear(&likeliest) {
        return None;
    }
    let rivals: Vec<Pose2> = std::iter::from_fn(|| places.next(RIVAL_SHARE_MIN))
        .take(N_RIVALS_MAX + 1)
        .map(|place| place.map_from_scan)
        .collect();
    if rivals.len() > N_RIVALS_MAX {
        return None;
    }
    let all = std::iter::once(likeliest).chain(rivals.iter().map(closely));
    all.max_by(|a, b| a.score.total_cmp(&b.score)).filter(is_clear)
}

/// What points alone say of a place that is known to a cell.
fn rough_score(map: &MatchMap, cloud: &Cloud, guess: &Prior, place: &Pose2) -> f64 {
    Evidence::of_points(map, cloud, *place).score() - correlate::loss(guess.squared_deviations(place))
}

/// A match, looked at closely.
#[must_use]
pub fn candidate(map: &MatchMap, cloud: &Cloud, guess: &Prior, found: Match) -> Candidate {
    let evidence = Evidence::of(map, cloud, found.map_from_scan);
    Candidate {
        found,
        evidence,
        score: evidence.score() - correlate::loss(guess.squared_deviations(&found.map_from_scan)),
    }
}

#[cfg(test)]
mod tests;
