//! Whether a scan and the map tell the same story.

use crate::scan_match::Evidence;

/// Points that lie on a surface, among those that lie on one or where nothing should be; people walk about.
const SHARE_MIN: f64 = 0.6;
/// The same where the robot was not expected.
const SHARE_UNEXPECTED_MIN: f64 = 0.75;
/// And among all.
const SHARE_OF_ALL_MIN: f64 = 0.15;
/// Beams that would pass through surfaces, at most.
const THROUGH_MAX: f64 = 0.6;
/// The same where the robot was not expected.
const THROUGH_UNEXPECTED_MAX: f64 = 0.4;
/// What is asked where a lost robot may be: shares as above, and points.
const SHARE_SURE_MIN: f64 = 0.88;
const THROUGH_SURE_MAX: f64 = 0.2;
const SHARE_OF_ALL_SURE_MIN: f64 = 0.75;
const N_SURE_MIN: usize = 30;
/// With fewer points nothing can be told.
const N_MIN: usize = 12;
/// So many scans in a row that do not fit, and the robot is lost.
const N_LOST: u32 = 8;

/// How well the pose is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    /// Scans fit.
    Good,
    /// The last scan or few did not fit; the pose is carried on by what is foreseen.
    Uncertain,
    /// So many did not fit that the pose is not known.
    Lost,
}

/// Whether the two agree; more is asked of a place that nobody expected: most rooms look like themselves when
/// moved or turned a little.
#[must_use]
pub(crate) fn agrees(evidence: &Evidence, is_expected: bool) -> bool {
    let (share_min, through_max) =
        if is_expected { (SHARE_MIN, THROUGH_MAX) } else { (SHARE_UNEXPECTED_MIN, THROUGH_UNEXPECTED_MAX) };
    evidence.n_on_surface >= N_MIN
        && evidence.share() >= share_min
        && evidence.through_share() <= through_max
        && evidence.n_on_surface as f64 >= SHARE_OF_ALL_MIN * evidence.n_points as f64
}

/// Whether the two agree so well that a lost robot may be there: places that look like themselves are many in
/// a whole building.
#[must_use]
pub(crate) fn agrees_surely(evidence: &Evidence) -> bool {
    evidence.n_on_surface >= N_SURE_MIN
        && evidence.share() >= SHARE_SURE_MIN
        && evidence.through_share() <= THROUGH_SURE_MAX
        && evidence.n_on_surface as f64 >= SHARE_OF_ALL_SURE_MIN * evidence.n_points as f64
}

/// Keeps count of scans that do not fit.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Judge {
    n_bad: u32,
}

impl Judge {
    pub(crate) fn standing(&self) -> Standing {
        match self.n_bad {
            0 => Standing::Good,
            1..N_LOST => Standing::Uncertain,
            _ => Standing::Lost,
        }
    }

    /// Scans in a row that did not fit.
    pub(crate) fn n_bad(&self) -> u32 {
        self.n_bad
    }

    pub(crate) fn hear(&mut self, is_good: bool) {
        self.n_bad = if is_good { 0 } else { self.n_bad.saturating_add(1) };
    }

    /// The robot is elsewhere, nobody knows where.
    pub(crate) fn lose(&mut self) {
        self.n_bad = N_LOST;
    }

    /// The robot was found again.
    pub(crate) fn found(&mut self) {
        self.n_bad = 0;
    }
}
