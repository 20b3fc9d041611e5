//! Whether a scan and the map tell the same story.

use geometry::{Point2, Pose2};

use crate::scan_match::{Cloud, MatchMap};

/// Points that lie on a surface, among those that lie on one or where nothing should be; people walk about.
const SHARE_MIN: f64 = 0.6;
/// The same where the robot was not expected.
const SHARE_UNEXPECTED_MIN: f64 = 0.85;
/// And among all.
const SHARE_OF_ALL_MIN: f64 = 0.15;
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

/// Counts of a scan's points at a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Agreement {
    n_points: usize,
    n_on_surface: usize,
    /// In cells that beams have passed through.
    n_in_free: usize,
}

impl Agreement {
    /// `is_free` tells whether a point of the scan's frame lies where nothing should be.
    pub(crate) fn of(
        cloud: &Cloud,
        map: Option<&MatchMap>,
        map_from_scan: Pose2,
        is_free: impl Fn(Point2) -> bool,
    ) -> Self {
        let (mut n_on_surface, mut n_in_free) = (0, 0);
        for point in cloud.points() {
            let at = Point2::new(point.at.x.into(), point.at.y.into());
            if map.is_some_and(|map| map.is_on_surface(map_from_scan.transform(at))) {
                n_on_surface += 1;
            } else if is_free(at) {
                n_in_free += 1;
            }
        }
        Agreement { n_points: cloud.points().len(), n_on_surface, n_in_free }
    }

    /// Whether the two agree; more is asked of a place that nobody expected: most rooms look like themselves
    /// when moved or turned a little.
    pub(crate) fn is_good(&self, is_expected: bool) -> bool {
        let share_min = if is_expected { SHARE_MIN } else { SHARE_UNEXPECTED_MIN };
        let n_told = (self.n_on_surface + self.n_in_free) as f64;
        let n_on_surface = self.n_on_surface as f64;
        self.n_on_surface >= N_MIN
            && n_on_surface >= share_min * n_told
            && n_on_surface >= SHARE_OF_ALL_MIN * self.n_points as f64
    }
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

    /// The robot was found again.
    pub(crate) fn found(&mut self) {
        self.n_bad = 0;
    }
}
