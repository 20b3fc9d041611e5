//! A few metres of the way as one rigid piece.

use std::borrow::Cow;

use geometry::{Point2, Pose2};

use crate::scan_match::{Cloud, FreeGrid, MatchMap};

/// One sub-map.
pub(super) struct Submap {
    /// Where it lies; moves when loops are closed.
    pub(super) map_from_submap: Pose2,
    /// How long the robot's way was when it began, metres.
    pub(super) begun_at_m: f64,
    /// While scans are matched against it.
    map: Option<MatchMap>,
    /// Its surfaces when it is finished.
    cloud: Cloud,
    free: FreeGrid,
    cell_m: f64,
    /// Middle and half size of what it holds, in its own frame, metres.
    middle: Point2,
    reach_m: f64,
}

impl Submap {
    pub(super) fn new(cell_m: f64, map_from_submap: Pose2, begun_at_m: f64) -> Self {
        Submap {
            map_from_submap,
            begun_at_m,
            map: Some(MatchMap::new(cell_m)),
            cloud: Cloud::default(),
            free: FreeGrid::default(),
            cell_m,
            middle: Point2::origin(),
            reach_m: 0.0,
        }
    }

    /// What scans are matched against; `None` when it is finished.
    pub(super) fn map(&self) -> Option<&MatchMap> {
        self.map.as_ref()
    }

    pub(super) fn n_surfels(&self) -> usize {
        self.map.as_ref().map_or(self.cloud.points().len(), MatchMap::n_surfels)
    }

    pub(super) fn is_finished(&self) -> bool {
        self.map.is_none()
    }

    pub(super) fn insert(&mut self, cloud: &Cloud, submap_from_base: Pose2) {
        if let Some(map) = &mut self.map {
            map.insert(cloud, submap_from_base);
        }
    }

    /// Nothing more comes: only the surfaces are kept, without the grids.
    pub(super) fn finish(&mut self) {
        let Some(map) = self.map.take() else { return };
        self.cloud = map.to_cloud();
        self.free = map.free().clone();
        let (mut low, mut high) = (Point2::origin(), Point2::origin());
        for point in self.cloud.points() {
            let at = point.at.cast::<f64>();
            low = low.inf(&at);
            high = high.sup(&at);
        }
        self.middle = nalgebra::center(&low, &high);
        self.reach_m = (high - low).norm() / 2.0;
    }

    /// Its surfaces.
    pub(super) fn cloud(&self) -> Cow<'_, Cloud> {
        self.map.as_ref().map_or(Cow::Borrowed(&self.cloud), |map| Cow::Owned(map.to_cloud()))
    }

    /// What scans are matched against, made anew if it is finished.
    pub(super) fn ready(&self, n_max: usize) -> Cow<'_, MatchMap> {
        self.map.as_ref().map_or_else(|| Cow::Owned(self.rebuilt(n_max)), Cow::Borrowed)
    }

    /// Made anew to be matched against, with at most so many pieces of surface.
    pub(super) fn rebuilt(&self, n_max: usize) -> MatchMap {
        let mut map = MatchMap::new(self.cell_m);
        map.insert(&self.cloud().thinned(n_max), Pose2::IDENTITY);
        map.set_free(self.map.as_ref().map_or(&self.free, MatchMap::free).clone());
        map
    }

    /// Where the middle of what it holds lies in `map`.
    pub(super) fn middle_map(&self) -> Point2 {
        self.map_from_submap.transform(self.middle)
    }

    /// Half the size of what it holds, metres.
    pub(super) fn reach_m(&self) -> f64 {
        self.reach_m
    }
}
