//! The base map, drawn from kept scans at the poses of their sub-maps, and drawn anew when those move.

use geometry::{Point2, Pose2};

use super::config::SlamConfig;
use super::smoothing;
use super::submap::Submap;
use crate::base_map::{BaseMapError, BaseMapper, Scan};
use crate::scan_match::Cloud;

/// So many kept scans are drawn anew with each scan that is not kept itself: one takes a tenth of a millisecond
/// or two.
const N_AT_ONCE: usize = 3;
/// Most scans kept, some 30 MB; beyond, every second one is let go.
const N_KEPT_MAX: usize = 20_000;

/// A scan that was put into the map.
pub(super) struct Keyframe {
    submap_idx: usize,
    submap_from_base: Pose2,
    /// Where it lies by all that was seen before and after, when that has been asked for.
    smoothed: Option<Pose2>,
    /// Which of all scans that were ever kept this is.
    nth: u64,
    /// The motion since the one before, as odometry told it.
    told: Option<Pose2>,
    ranges_m: Box<[f32]>,
    angle_min_rad: f64,
    angle_increment_rad: f64,
    range_min_m: f64,
    range_max_m: f64,
    no_return_is_free: bool,
}

impl Keyframe {
    /// `told` is the motion since the one before, as odometry told it.
    pub(super) fn new(
        scan: &Scan<'_>,
        submap_idx: usize,
        submap_from_base: Pose2,
        told: Option<Pose2>,
    ) -> Self {
        Keyframe {
            submap_idx,
            submap_from_base,
            smoothed: None,
            nth: 0,
            told,
            ranges_m: scan.ranges_m.into(),
            angle_min_rad: scan.angle_min_rad,
            angle_increment_rad: scan.angle_increment_rad,
            range_min_m: scan.range_min_m,
            range_max_m: scan.range_max_m,
            no_return_is_free: scan.no_return_is_free,
        }
    }

    fn scan(&self) -> Scan<'_> {
        Scan {
            ranges_m: &self.ranges_m,
            angle_min_rad: self.angle_min_rad,
            angle_increment_rad: self.angle_increment_rad,
            range_min_m: self.range_min_m,
            range_max_m: self.range_max_m,
            no_return_is_free: self.no_return_is_free,
        }
    }

    fn map_from_submap(&self, submaps: &[Submap]) -> Pose2 {
        submaps.get(self.submap_idx).map_or(Pose2::IDENTITY, |s| s.map_from_submap)
    }

    /// Where it was matched.
    pub(super) fn map_from_base(&self, submaps: &[Submap]) -> Pose2 {
        self.map_from_submap(submaps) * self.submap_from_base
    }

    /// Where it lies by all that is known.
    fn map_from_smoothed(&self, submaps: &[Submap]) -> Pose2 {
        self.map_from_submap(submaps) * self.smoothed.unwrap_or(self.submap_from_base)
    }

    /// It lies here by all that was seen.
    pub(super) fn move_to(&mut self, map_from_base: &Pose2, submaps: &[Submap]) {
        self.smoothed = Some(self.map_from_submap(submaps).inverse() * *map_from_base);
    }

    pub(super) fn submap_idx(&self) -> usize {
        self.submap_idx
    }

    pub(super) fn told(&self) -> Option<Pose2> {
        self.told
    }
}

/// The base map and what it is drawn from.
pub(super) struct Drawing {
    base_from_lidar: Pose2,
    /// Where the robot began, and its radius, metres.
    start: (Point2, f64),
    kept: Vec<Keyframe>,
    n_ever: u64,
    mapper: BaseMapper,
    /// A map that is being drawn anew, and how many kept scans are in it.
    coming: Option<(BaseMapper, usize)>,
    /// The poses have changed since it was begun: another one must follow.
    is_coming_old: bool,
    n_not_drawn: u64,
    /// A scan has just been drawn, which is enough at once.
    has_drawn: bool,
}

impl Drawing {
    pub(super) fn new(base_from_lidar: Pose2, mapper: BaseMapper, start: (Point2, f64)) -> Self {
        Drawing {
            base_from_lidar,
            start,
            kept: Vec::new(),
            n_ever: 0,
            mapper,
            coming: None,
            is_coming_old: false,
            n_not_drawn: 0,
            has_drawn: false,
        }
    }

    pub(super) fn mapper(&self) -> &BaseMapper {
        &self.mapper
    }

    /// Scans that could not be drawn: the map would have become too large.
    pub(super) fn n_not_drawn(&self) -> u64 {
        self.n_not_drawn
    }

    /// Draws a scan and keeps it. One that would make the map too large is not drawn, and counted: the pose
    /// is known all the same.
    pub(super) fn add(&mut self, keyframe: Keyframe, submaps: &[Submap]) {
        let drawn = draw(&mut self.mapper, &keyframe, self.base_from_lidar, submaps);
        self.n_not_drawn += u64::from(drawn.is_err());
        self.has_drawn = true;
        if self.kept.len() >= N_KEPT_MAX {
            let mut is_odd = false;
            self.kept.retain(|_| {
                is_odd = !is_odd;
                is_odd
            });
            // Its count means nothing any more.
            if self.coming.take().is_some() {
                self.draw_anew();
            }
        }
        self.n_ever += 1;
        self.kept.push(Keyframe { nth: self.n_ever, ..keyframe });
    }

    /// So many scans will never be kept; poses were told as if they would.
    pub(super) fn skip(&mut self, n: usize) {
        self.n_ever += n as u64;
    }

    /// Number of scans that were ever kept: which one was the last.
    pub(super) fn n_ever(&self) -> u64 {
        self.n_ever
    }

    /// Where a pose lies by what was seen later that was matched at `map_from_base` when `nth` scans had been
    /// kept: it moves as the kept scans before and after it did, the nearer one more.
    pub(super) fn moved(&self, map_from_base: Pose2, nth: u64, submaps: &[Submap]) -> Pose2 {
        let after = self.kept.partition_point(|keyframe| keyframe.nth <= nth);
        let near = |idx: Option<usize>| {
            let keyframe = idx.and_then(|idx| self.kept.get(idx))?;
            keyframe.smoothed?;
            let off = keyframe.map_from_base(submaps).inverse() * map_from_base;
            let far = off.position().coords.norm() + off.yaw_rad.abs();
            Some((far, keyframe.map_from_smoothed(submaps) * off))
        };
        let Some((far_before, before)) = near(after.checked_sub(1)) else { return map_from_base };
        let (far_after, after) = near(Some(after)).unwrap_or((f64::INFINITY, before));
        let share = if far_before > 0.0 { far_before / (far_before + far_after) } else { 0.0 };
        before.towards(&after, share)
    }

    /// Moves the kept scans to where all that was seen says they were taken.
    pub(super) fn smooth(&mut self, submaps: &[Submap], torn: &[usize], config: &SlamConfig) {
        let cloud_of =
            |keyframe: &Keyframe| Cloud::of_scan(&keyframe.scan(), self.base_from_lidar, config.range_used_m);
        smoothing::smooth(&mut self.kept, submaps, torn, config.cell_m, cloud_of);
    }

    /// The surfaces that the scan kept last shows, in its base.
    pub(super) fn latest_cloud(&self, range_used_m: f64) -> Option<Cloud> {
        let latest = self.kept.last()?;
        Some(Cloud::of_scan(&latest.scan(), self.base_from_lidar, range_used_m))
    }

    /// The poses have changed: a new map is begun, and takes the old one's place when it is complete.
    /// One that is being drawn is finished first: a map that is a little off is better than an old one.
    pub(super) fn draw_anew(&mut self) {
        if self.coming.is_some() {
            self.is_coming_old = true;
            return;
        }
        self.is_coming_old = false;
        let mut blank = self.mapper.blank();
        // It lies in the old map, which has the same room.
        let _ = blank.free_disc(self.start.0, self.start.1);
        self.coming = Some((blank, 0));
    }

    /// Draws a few more scans of a map that is being drawn anew.
    pub(super) fn catch_up(&mut self, submaps: &[Submap]) {
        if std::mem::take(&mut self.has_drawn) {
            return;
        }
        let Some((mut mapper, n_drawn)) = self.coming.take() else { return };
        let until = (n_drawn + N_AT_ONCE).min(self.kept.len());
        for keyframe in &self.kept[n_drawn..until] {
            let drawn = draw(&mut mapper, keyframe, self.base_from_lidar, submaps);
            self.n_not_drawn += u64::from(drawn.is_err());
        }
        if until == self.kept.len() {
            self.mapper = mapper;
            if self.is_coming_old {
                self.draw_anew();
            }
        } else {
            self.coming = Some((mapper, until));
        }
    }

    /// Draws a map that is being drawn anew to its end.
    pub(super) fn draw_all(&mut self, submaps: &[Submap]) {
        while self.coming.is_some() {
            self.catch_up(submaps);
        }
    }
}

fn draw(
    mapper: &mut BaseMapper,
    keyframe: &Keyframe,
    base_from_lidar: Pose2,
    submaps: &[Submap],
) -> Result<(), BaseMapError> {
    mapper.integrate(&keyframe.scan(), keyframe.map_from_smoothed(submaps) * base_from_lidar)
}
