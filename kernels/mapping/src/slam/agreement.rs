//! Whether a scan and the map tell the same story.

use geometry::{Point2, Pose2};

use crate::base_map::BaseMapper;
use crate::scan_match::{Cloud, MatchMap};

/// Log-odds below which a cell of the base map is surely free: three beams passed.
const FREE: f32 = -1.0;
/// Points that lie on a surface, among those that lie on one or where nothing should be; people walk about.
const SHARE_MIN: f64 = 0.6;
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
pub(super) struct Agreement {
    n_points: usize,
    n_on_surface: usize,
    /// In cells that beams have passed through.
    n_in_free: usize,
}

impl Agreement {
    pub(super) fn of(
        cloud: &Cloud,
        map: Option<&MatchMap>,
        map_from_scan: Pose2,
        base_map: &BaseMapper,
        base_map_from_scan: Pose2,
    ) -> Self {
        let log_odds = base_map.log_odds();
        let (mut n_on_surface, mut n_in_free) = (0, 0);
        for point in cloud.points() {
            let at = Point2::new(point.at.x.into(), point.at.y.into());
            if map.is_some_and(|map| map.is_on_surface(map_from_scan.transform(at))) {
                n_on_surface += 1;
            } else if log_odds.at(base_map_from_scan.transform(at)).is_some_and(|l| *l < FREE) {
                n_in_free += 1;
            }
        }
        Agreement { n_points: cloud.points().len(), n_on_surface, n_in_free }
    }

    pub(super) fn is_good(&self) -> bool {
        let n_told = (self.n_on_surface + self.n_in_free) as f64;
        let n_on_surface = self.n_on_surface as f64;
        self.n_on_surface >= N_MIN
            && n_on_surface >= SHARE_MIN * n_told
            && n_on_surface >= SHARE_OF_ALL_MIN * self.n_points as f64
    }
}

/// Keeps count of scans that do not fit.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Judge {
    n_bad: u32,
}

impl Judge {
    pub(super) fn standing(&self) -> Standing {
        match self.n_bad {
            0 => Standing::Good,
            1..N_LOST => Standing::Uncertain,
            _ => Standing::Lost,
        }
    }

    /// Scans in a row that did not fit.
    pub(super) fn n_bad(&self) -> u32 {
        self.n_bad
    }

    pub(super) fn hear(&mut self, agreement: &Agreement) {
        self.n_bad = if agreement.is_good() { 0 } else { self.n_bad.saturating_add(1) };
    }

    /// The robot was found again.
    pub(super) fn found(&mut self) {
        self.n_bad = 0;
    }
}
