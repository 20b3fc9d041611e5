//! A map and a pose from laser scans: matching against sub-maps, loops closed over sub-maps.
//!
//! Each scan is matched against the present sub-map, a few metres of the way, starting from where odometry
//! (or, without it, the motion so far) says it should lie. Two sub-maps overlap at any time, so that the next
//! one is half full when it is needed. A finished sub-map is looked for in older ones near it; what is found
//! becomes a constraint, and the sub-maps move until all constraints agree. The scans move with the sub-map
//! they belong to, and the base map is drawn anew from them, a few scans at a time.
//!
//! A scan that contradicts the map is not put into it. Several in a row, and the robot is *lost*: that is
//! said, nothing is mapped, and the scans are looked for in all sub-maps until they are found. A scan that fits, but
//! worse than scans used to, may have been taken elsewhere: it is held back, and looked for in the same way, until
//! scans fit as usual or no better place was found.
//!
//! Deliberately not here: clocks, files, and what a pose is used for.

use geometry::Pose2;

use crate::base_map::{BaseMapError, BaseMapper, Scan};
use crate::scan_match::Cloud;

mod agreement;
mod calibration;
mod config;
mod doubt;
mod drawing;
mod following;
mod graph;
mod growing;
mod located;
mod loops;
mod motion;
mod relocation;
mod seams;
mod smoothing;
mod submap;
mod sweep;

pub use agreement::Standing;
pub use config::SlamConfig;
pub use located::{Anchor, Located};
pub use motion::{MotionConfig, MotionModel};

pub(crate) use agreement::{Judge, agrees_surely};
pub(crate) use doubt::Doubt;
pub(crate) use following::{Followed, follow};
pub(crate) use sweep::{Place, Sweep, Verdict};

use drawing::{Drawing, Keyframe};
use graph::Graph;
use loops::Loops;
use seams::Seam;
use submap::Submap;

/// A map that moved under the robot by more than this fits no more with what was built on it: metres, radians.
const JUMP_M: f64 = 0.3;
const JUMP_RAD: f64 = 0.1;
/// No robot gets farther between two scans, metres.
const LEAP_MAX_M: f64 = 20.0;
/// Every how many-th scan a loop is looked for, if any waits: it takes as long as many scans.
const LOOP_PERIOD: u64 = 3;

/// Simultaneous localisation and mapping.
pub struct Slam {
    config: SlamConfig,
    motion: MotionModel,
    judge: Judge,
    submaps: Vec<Submap>,
    /// Index of the sub-map that is matched against; the one after it, if any, is the next.
    present: usize,
    present_from_base: Pose2,
    /// Where the last scan went into the map, in the present sub-map, and how long the way was there.
    last_keyframe: Option<Pose2>,
    way_m: f64,
    /// The motion since then, as odometry told it.
    told: Option<Pose2>,
    graph: Graph,
    loops: Loops,
    drawing: Drawing,
    /// Tears that are not mended yet.
    seams: Vec<Seam>,
    /// How far the pose may be off since the last scan that fitted.
    unsure: Unsure,
    doubt: Doubt,
    /// Scans that will go into the map if they were taken where they seem to be.
    held: Vec<(Keyframe, Cloud)>,
    sweep: Sweep,
    n_scans: u64,
}

/// What is not known since the last scan that fitted.
#[derive(Clone, Copy, Debug)]
struct Unsure {
    /// Deviations, metres and radians.
    shift_m: f64,
    turn_rad: f64,
    /// The motion that was foreseen and not gone, for want of odometry.
    ahead: Pose2,
}

impl Default for Unsure {
    fn default() -> Self {
        Unsure { shift_m: 0.1, turn_rad: 0.05, ahead: Pose2::IDENTITY }
    }
}

/// Whether a robot can have moved like this between two scans; if not, nothing is known of it.
pub(crate) fn is_motion(last_from_now: &Pose2) -> bool {
    last_from_now.is_finite() && last_from_now.position().coords.norm() <= LEAP_MAX_M
}

impl Slam {
    /// A map that begins where `map_from_base` is.
    ///
    /// # Errors
    /// [`BaseMapError`] when the base map's configuration or the pose cannot be.
    pub fn new(config: SlamConfig, map_from_base: Pose2) -> Result<Self, BaseMapError> {
        if !map_from_base.is_finite() {
            return Err(BaseMapError::Pose);
        }
        let start = (map_from_base.position(), config.radius_m);
        let mut mapper = BaseMapper::new(config.base_map, start.0)?;
        mapper.free_disc(start.0, start.1)?;
        Ok(Slam {
            motion: MotionModel::new(config.motion),
            judge: Judge::default(),
            submaps: vec![Submap::new(config.cell_m, map_from_base, 0.0)],
            present: 0,
            present_from_base: Pose2::IDENTITY,
            last_keyframe: None,
            way_m: 0.0,
            told: None,
            graph: Graph::default(),
            loops: Loops::default(),
            drawing: Drawing::new(config.base_from_lidar, mapper, start),
            seams: Vec::new(),
            unsure: Unsure::default(),
            doubt: Doubt::default(),
            held: Vec::new(),
            sweep: Sweep::default(),
            config,
            n_scans: 0,
        })
    }

    /// Takes in one scan. `last_from_now` is how the base moved since the last one, by odometry; `None` when
    /// that is not known.
    ///
    /// # Errors
    /// [`BaseMapError`] when the scan cannot be or the map would become too large; nothing changes then.
    pub fn step(&mut self, scan: &Scan<'_>, last_from_now: Option<Pose2>) -> Result<Located, BaseMapError> {
        scan.check()?;
        let last_from_now = last_from_now.filter(is_motion);
        self.n_scans += 1;
        self.told = self.told.zip(last_from_now).map(|(so_far, last_from_now)| so_far * last_from_now);
        let cloud = Cloud::of_scan(scan, self.config.base_from_lidar, self.config.range_used_m);
        let foreseen = self.motion.foresee(last_from_now).after_misses(self.judge.n_bad());
        let mut has_jumped = false;
        let found = if self.last_keyframe.is_none() {
            // The very first scan: nothing to compare with.
            None
        } else if self.judge.standing() == Standing::Lost {
            has_jumped = self.look_everywhere(&cloud, &foreseen);
            None
        } else {
            let last = self.present_from_base;
            let followed = self.follow(&cloud, &foreseen);
            has_jumped = followed.is_some_and(|followed| {
                self.weigh(&cloud, &(last.inverse() * followed.pose), followed.share)
            });
            followed
        };
        let inlier_share = found.map_or(0.0, |found| found.inlier_share);
        let is_fit = self.last_keyframe.is_none() || has_jumped || found.is_some();
        if is_fit && self.judge.standing() == Standing::Good {
            has_jumped |= self.keep(scan, &cloud);
        }
        if self.judge.standing() == Standing::Good && self.n_scans.is_multiple_of(LOOP_PERIOD) {
            let gap = self.close_a_loop();
            has_jumped |= gap.position().coords.norm() > JUMP_M || gap.yaw_rad.abs() > JUMP_RAD;
        }
        self.drawing.catch_up(&self.submaps);
        Ok(self.located(inlier_share, has_jumped))
    }

    fn located(&self, inlier_share: f64, has_jumped: bool) -> Located {
        Located {
            map_from_base: self.map_from_base(),
            anchor: Anchor {
                submap_idx: self.present,
                submap_from_base: self.present_from_base,
                nth_kept: self.drawing.n_ever() + self.held.len() as u64,
            },
            standing: match self.judge.standing() {
                Standing::Good if self.doubt.is_open() => Standing::Uncertain,
                standing => standing,
            },
            is_in_doubt: self.judge.standing() == Standing::Good && self.doubt.is_open(),
            inlier_share,
            has_jumped,
        }
    }

    /// Where an anchor is by what is known now.
    #[must_use]
    pub fn pose(&self, anchor: &Anchor) -> Pose2 {
        let submap = self.submaps.get(anchor.submap_idx);
        let matched = submap.map_or(Pose2::IDENTITY, |s| s.map_from_submap) * anchor.submap_from_base;
        self.drawing.moved(matched, anchor.nth_kept, &self.submaps)
    }

    /// The pose that is known now.
    #[must_use]
    pub fn map_from_base(&self) -> Pose2 {
        self.submaps[self.present].map_from_submap * self.present_from_base
    }

    /// The base map. After a loop was closed it takes some scans until all of it has followed.
    #[must_use]
    pub fn base_map(&self) -> &BaseMapper {
        self.drawing.mapper()
    }

    /// Number of loops closed so far.
    #[must_use]
    pub fn n_loops(&self) -> usize {
        self.graph.n_loops()
    }

    /// Number of tears that are not mended: places where the map goes on where it was only guessed.
    #[must_use]
    pub fn n_torn(&self) -> usize {
        self.seams.len()
    }

    /// Scans that were not drawn into the base map, which would have become too large.
    #[must_use]
    pub fn n_not_drawn(&self) -> u64 {
        self.drawing.n_not_drawn()
    }

    /// Looks for all that waits to be looked for, lays every kept scan where all that was seen before and after
    /// says that it was taken, and draws the whole map, however long it takes: some milliseconds for each kept scan.
    pub fn finish(&mut self) {
        for seam in std::mem::take(&mut self.seams) {
            match seam.look(&self.submaps) {
                Some(constraint) => _ = self.mend(&seam, constraint),
                None => self.seams.push(seam),
            }
        }
        self.loops.finish_submap(&self.submaps, self.present);
        while self.loops.is_waiting() {
            self.close_a_loop();
        }
        self.graph.settle(&mut self.submaps);
        let torn: Vec<usize> = self.seams.iter().map(|seam| seam.new).collect();
        self.drawing.smooth(&self.submaps, &torn, &self.config);
        self.drawing.draw_anew();
        self.drawing.draw_all(&self.submaps);
    }

    /// Matches a scan near where it is foreseen; `None` when it does not fit, and the foreseen pose holds.
    fn follow(&mut self, cloud: &Cloud, foreseen: &motion::Foreseen) -> Option<Followed> {
        let last = self.present_from_base;
        let map = self.submaps[self.present].map();
        let found = map.and_then(|map| follow(map, cloud, &last, foreseen, foreseen.window()));
        let is_good = found.is_some_and(|found| found.is_good);
        self.judge.hear(is_good);
        let Some(found) = found.filter(|found| found.is_good) else {
            self.unsure.shift_m += foreseen.shift_m;
            self.unsure.turn_rad += foreseen.turn_rad;
            if foreseen.is_odometry() {
                self.advance(last * foreseen.last_from_now);
            } else {
                // Going on as before is a guess that gets worse with each scan.
                self.unsure.ahead = foreseen.last_from_now;
            }
            self.motion.forget();
            return None;
        };
        self.unsure = Unsure::default();
        self.motion.learn(&last, &found.pose, foreseen, found.variance);
        self.advance(found.pose);
        Some(found)
    }

    fn advance(&mut self, present_from_base: Pose2) {
        let step = self.present_from_base.inverse() * present_from_base;
        self.way_m += step.position().coords.norm();
        self.present_from_base = present_from_base;
    }
}
