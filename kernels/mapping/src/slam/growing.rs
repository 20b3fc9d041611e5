//! How the map grows: scans that are kept, sub-maps that follow each other, tears that are mended, loops that
//! are closed.

use geometry::Pose2;

use super::drawing::Keyframe;
use super::seams::Seam;
use super::submap::Submap;
use super::{Judge, Located, Slam, Unsure, graph};
use crate::base_map::{BaseMapError, Scan};
use crate::scan_match::Cloud;

/// A sub-map with more pieces of surface than this is full.
const N_SURFELS_MAX: usize = 20_000;
/// Most scans that are held back while the robot's place is in doubt; what comes then is not mapped.
const N_HELD_MAX: usize = 50;

impl Slam {
    /// Gives up finding this scan, the one that was taken in last, in the map: a new piece of map begins with it
    /// where it is foreseen, and is tied to the old when it is found there. The robot is not lost any more.
    ///
    /// # Errors
    /// [`BaseMapError`] when the scan cannot be.
    pub fn begin_anew(&mut self, scan: &Scan<'_>) -> Result<Located, BaseMapError> {
        scan.check()?;
        let map_from_base = self.map_from_base() * self.unsure.ahead;
        let (old, new) = (self.present, self.submaps.len());
        let old_from_base = self.submaps[old].map_from_submap.inverse() * map_from_base;
        let Unsure { shift_m, turn_rad, .. } = self.unsure;
        self.graph.tie_loosely(old, new, old_from_base, (shift_m, turn_rad));
        self.begin_at(map_from_base);
        self.seams.push(Seam::new(old, new, shift_m, turn_rad));
        self.judge = Judge::default();
        self.doubt.close();
        self.unsure = Unsure::default();
        let cloud = Cloud::of_scan(scan, self.config.base_from_lidar, self.config.range_used_m);
        self.keep(scan, &cloud);
        Ok(self.located(0.0, true))
    }

    /// A sub-map that nothing leads on to begins here.
    pub(super) fn begin_at(&mut self, map_from_base: Pose2) {
        for idx in self.present..self.submaps.len() {
            self.submaps[idx].finish();
            self.loops.finish_submap(&self.submaps, idx);
        }
        self.present = self.submaps.len();
        self.present_from_base = Pose2::IDENTITY;
        self.last_keyframe = None;
        self.drop_held();
        self.submaps.push(Submap::new(self.config.cell_m, map_from_base, self.way_m));
    }

    /// Puts a scan into the map, if the base has moved since the last one that was.
    pub(super) fn keep(&mut self, scan: &Scan<'_>, cloud: &Cloud) -> bool {
        if let Some(last) = self.last_keyframe {
            let off = last.inverse() * self.present_from_base;
            let is_near = off.position().coords.norm() < self.config.keyframe_shift_m
                && off.yaw_rad.abs() < self.config.keyframe_turn_rad;
            if is_near {
                return false;
            }
        }
        let keyframe = Keyframe::new(scan, self.present, self.present_from_base, self.told.take());
        self.told = Some(Pose2::IDENTITY);
        self.last_keyframe = Some(self.present_from_base);
        self.held.push((keyframe, cloud.clone()));
        if self.doubt.is_open() {
            if self.held.len() > N_HELD_MAX {
                self.held.pop();
                self.told = None;
            }
            return false;
        }
        for (keyframe, cloud) in std::mem::take(&mut self.held) {
            let map_from_base = keyframe.map_from_base(&self.submaps);
            self.drawing.add(keyframe, &self.submaps);
            for submap in &mut self.submaps[self.present..] {
                let submap_from_base = submap.map_from_submap.inverse() * map_from_base;
                submap.insert(&cloud, submap_from_base);
            }
        }
        let has_jumped = self.mend_a_seam();
        self.turn_over();
        has_jumped
    }

    /// The scans that were held back were taken elsewhere, or nobody knows where.
    pub(super) fn drop_held(&mut self) {
        if !self.held.is_empty() {
            self.drawing.skip(self.held.len());
            self.held.clear();
            self.told = None;
        }
    }

    /// Looks for the newest piece of the map in what was before the tear, when it is time; true when that
    /// moved the robot.
    fn mend_a_seam(&mut self) -> bool {
        let present = self.present;
        let Some(seam) = self.seams.last_mut().filter(|s| s.new + 1 >= present) else { return false };
        if !seam.hear() {
            return false;
        }
        let seam = *seam;
        let Some(constraint) = seam.look(&self.submaps) else { return false };
        self.seams.pop();
        self.mend(&seam, constraint)
    }

    pub(super) fn mend(&mut self, seam: &Seam, constraint: graph::Constraint) -> bool {
        self.graph.mend(seam.old, seam.new, constraint);
        let has_moved = self.graph.settle(&mut self.submaps);
        if has_moved {
            self.drawing.draw_anew();
        }
        has_moved
    }

    /// Begins the next sub-map, and leaves the present one, when the way says so.
    fn turn_over(&mut self) {
        let newest = self.submaps.len() - 1;
        let is_long = self.way_m - self.submaps[newest].begun_at_m >= self.config.submap_length_m;
        let is_full = self.submaps[newest].n_surfels() > N_SURFELS_MAX;
        if !(is_long || is_full) {
            return;
        }
        let map_from_base = self.map_from_base();
        if newest > self.present {
            self.submaps[self.present].finish();
            self.loops.finish_submap(&self.submaps, self.present);
            let newer_from_base = self.submaps[newest].map_from_submap.inverse() * map_from_base;
            self.last_keyframe = Some(newer_from_base);
            self.present = newest;
            self.present_from_base = newer_from_base;
        }
        self.graph.tie(newest, newest + 1, self.submaps[newest].map_from_submap.inverse() * map_from_base);
        self.submaps.push(Submap::new(self.config.cell_m, map_from_base, self.way_m));
        // What is seen from here is in both: the next one is not empty when its first scan comes.
        let latest = self.drawing.latest_cloud(self.config.range_used_m);
        if let (Some(cloud), Some(submap)) = (latest, self.submaps.last_mut()) {
            submap.insert(&cloud, Pose2::IDENTITY);
        }
    }

    /// Looks for one loop that waits; returns how far the robot's pose moved.
    pub(super) fn close_a_loop(&mut self) -> Pose2 {
        let before = self.map_from_base();
        let Some(constraint) = self.loops.look(&self.submaps) else { return Pose2::IDENTITY };
        self.loops.closed(&self.submaps);
        let is_news = self.graph.add_loop(constraint, &self.submaps);
        if is_news && self.graph.settle(&mut self.submaps) {
            self.drawing.draw_anew();
        }
        before.inverse() * self.map_from_base()
    }
}
