//! A map and a pose from laser scans: matching against sub-maps, loops closed over sub-maps.
//!
//! Each scan is matched against the present sub-map, a few metres of the way, starting from where odometry
//! (or, without it, the motion so far) says it should lie. Two sub-maps overlap at any time, so that the next
//! one is half full when it is needed. A finished sub-map is looked for in older ones near it; what is found
//! becomes a constraint, and the sub-maps move until all constraints agree. The scans move with the sub-map
//! they belong to, and the base map is drawn anew from them, a few scans at a time.
//!
//! A scan that contradicts the map is not put into it. Several in a row, and the robot is *lost*: that is
//! said, nothing is mapped, and the scans are looked for in all sub-maps until they are found.
//!
//! Deliberately not here: clocks, files, and what a pose is used for.

use geometry::Pose2;

use crate::base_map::{BaseMapConfig, BaseMapError, BaseMapper, Scan};
use crate::scan_match::{self, Cloud, Match, MatchMap, Prior, Window};

mod agreement;
mod drawing;
mod graph;
mod loops;
mod motion;
mod relocation;
mod submap;

pub use agreement::Standing;
pub use motion::{MotionConfig, MotionModel};

pub(crate) use agreement::{Agreement, Judge};
use drawing::{Drawing, Keyframe};
use graph::Graph;
use loops::Loops;
use submap::Submap;

/// A match that fits worse than this is tried again in a wider window, ...
const SHARE_WIDEN: f64 = 0.55;
/// ... which must find this much more to be believed, ...
const SHARE_GAIN: f64 = 0.1;
/// ... or this much against the word of odometry.
const SHARE_GAIN_ODOMETRY: f64 = 0.25;
/// How much wider, and at least how wide.
const WIDER: f64 = 3.0;
const WIDE_SHIFT_M: f64 = 1.0;
const WIDE_TURN_RAD: f64 = 0.6;
/// A map that moved under the robot by more than this fits no more with what was built on it: metres, radians.
const JUMP_M: f64 = 0.3;
const JUMP_RAD: f64 = 0.1;
/// Log-odds below which a cell of the base map is surely free: three beams passed.
const FREE_LOG_ODDS: f32 = -1.0;
/// Every how many-th scan a loop is looked for, if any waits: it takes as long as many scans.
const LOOP_PERIOD: u64 = 3;
/// A sub-map with more pieces of surface than this is full.
const N_SURFELS_MAX: usize = 20_000;

/// How a map is made of scans.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlamConfig {
    /// Where the LiDAR sits.
    pub base_from_lidar: Pose2,
    /// Side of a cell that scans are matched in, metres.
    pub cell_m: f64,
    /// Returns are matched up to this range, metres.
    pub range_used_m: f64,
    /// A scan is put into the map after this way, metres, ...
    pub keyframe_shift_m: f64,
    /// ... or after this turn, radians.
    pub keyframe_turn_rad: f64,
    /// A new sub-map begins after this way, metres; each lasts twice as long.
    pub submap_length_m: f64,
    /// How motion is foreseen.
    pub motion: MotionConfig,
    /// How the base map is drawn.
    pub base_map: BaseMapConfig,
    /// Radius of the robot, metres: where it starts, nothing else can be, and no beam will ever show it.
    pub radius_m: f64,
}

impl Default for SlamConfig {
    fn default() -> Self {
        SlamConfig {
            base_from_lidar: Pose2::IDENTITY,
            cell_m: 0.05,
            range_used_m: 30.0,
            keyframe_shift_m: 0.2,
            keyframe_turn_rad: 0.15,
            submap_length_m: 5.0,
            motion: MotionConfig::default(),
            base_map: BaseMapConfig::default(),
            radius_m: 0.0,
        }
    }
}

/// A pose that moves with its sub-map when loops are closed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Anchor {
    submap_idx: usize,
    submap_from_base: Pose2,
}

/// What one scan did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Located {
    /// The pose, as it is known now.
    pub map_from_base: Pose2,
    /// The same, to be asked for again later: see [`Slam::pose`].
    pub anchor: Anchor,
    /// How well it is known.
    pub standing: Standing,
    /// Share of the scan that lies on the map's surfaces, 0 to 1.
    pub inlier_share: f64,
    /// The map moved under the robot, by a loop that was closed or a place that was found again: what was built
    /// on its old pose does not fit.
    pub has_jumped: bool,
}

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
    graph: Graph,
    loops: Loops,
    drawing: Drawing,
    n_scans: u64,
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
            graph: Graph::default(),
            loops: Loops::default(),
            drawing: Drawing::new(config.base_from_lidar, mapper, start),
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
        let last_from_now = last_from_now.filter(Pose2::is_finite);
        self.n_scans += 1;
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
            self.follow(&cloud, &foreseen)
        };
        let inlier_share = found.map_or(0.0, |found| found.inlier_share);
        let is_fit = self.last_keyframe.is_none() || has_jumped || found.is_some();
        if is_fit && self.judge.standing() == Standing::Good {
            self.keep(scan, &cloud)?;
        }
        if self.judge.standing() == Standing::Good && self.n_scans.is_multiple_of(LOOP_PERIOD) {
            let gap = self.close_a_loop();
            has_jumped |= gap.position().coords.norm() > JUMP_M || gap.yaw_rad.abs() > JUMP_RAD;
        }
        self.drawing.catch_up(&self.submaps)?;
        Ok(Located {
            map_from_base: self.map_from_base(),
            anchor: Anchor { submap_idx: self.present, submap_from_base: self.present_from_base },
            standing: self.judge.standing(),
            inlier_share,
            has_jumped,
        })
    }

    /// Where an anchor is by what is known now.
    #[must_use]
    pub fn pose(&self, anchor: &Anchor) -> Pose2 {
        let submap = self.submaps.get(anchor.submap_idx);
        submap.map_or(Pose2::IDENTITY, |s| s.map_from_submap) * anchor.submap_from_base
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

    /// Looks for all loops that wait to be looked for and draws the whole map, however long it takes.
    ///
    /// # Errors
    /// [`BaseMapError`] when the map would become too large.
    pub fn finish(&mut self) -> Result<(), BaseMapError> {
        self.loops.finish_submap(&self.submaps, self.present);
        while self.loops.is_waiting() {
            self.close_a_loop();
        }
        if self.graph.settle(&mut self.submaps) {
            self.drawing.draw_anew();
        }
        self.drawing.draw_all(&self.submaps)
    }

    /// Gives up finding the old map again: a new one begins here, loosely tied to the old, and the robot is not
    /// lost any more.
    pub fn begin_anew(&mut self) {
        let map_from_base = self.map_from_base();
        let last = self.submaps.len() - 1;
        let last_from_base = self.submaps[last].map_from_submap.inverse() * map_from_base;
        self.graph.tie_loosely(last, last + 1, last_from_base);
        self.begin_at(map_from_base);
        self.judge = Judge::default();
    }

    /// A sub-map that nothing leads on to begins here.
    fn begin_at(&mut self, map_from_base: Pose2) {
        for submap in &mut self.submaps[self.present..] {
            submap.finish();
        }
        self.present = self.submaps.len();
        self.present_from_base = Pose2::IDENTITY;
        self.last_keyframe = None;
        self.submaps.push(Submap::new(self.config.cell_m, map_from_base, self.way_m));
    }

    /// Matches a scan near where it is foreseen; `None` when it does not fit, and the foreseen pose holds.
    fn follow(&mut self, cloud: &Cloud, foreseen: &motion::Foreseen) -> Option<Match> {
        let prior = Prior {
            map_from_scan: self.present_from_base * foreseen.last_from_now,
            shift_m: foreseen.shift_m,
            turn_rad: foreseen.turn_rad,
        };
        let last = self.present_from_base;
        let map = self.submaps[self.present].map();
        let found = map.and_then(|map| find_in_wider_windows(map, cloud, &prior, foreseen));
        let pose = found.map_or(prior.map_from_scan, |found| found.map_from_scan);
        let map_from_base = self.submaps[self.present].map_from_submap * pose;
        let log_odds = self.drawing.mapper().log_odds();
        let is_free = |at| log_odds.at(map_from_base.transform(at)).is_some_and(|l| *l < FREE_LOG_ODDS);
        let agreement = Agreement::of(cloud, map, pose, is_free);
        let is_good = agreement.is_good(foreseen.expects(&(last.inverse() * pose)));
        self.judge.hear(is_good);
        if !is_good {
            // Going on as before is a guess that gets worse with each scan; odometry is none.
            if foreseen.is_odometry {
                self.advance(prior.map_from_scan);
            }
            self.motion.forget();
            return None;
        }
        self.motion.learn(&last, &pose, foreseen);
        self.advance(pose);
        found
    }

    fn advance(&mut self, present_from_base: Pose2) {
        let step = self.present_from_base.inverse() * present_from_base;
        self.way_m += step.position().coords.norm();
        self.present_from_base = present_from_base;
    }

    /// Puts a scan into the map, if the base has moved since the last one that was.
    fn keep(&mut self, scan: &Scan<'_>, cloud: &Cloud) -> Result<(), BaseMapError> {
        if let Some(last) = self.last_keyframe {
            let off = last.inverse() * self.present_from_base;
            let is_near = off.position().coords.norm() < self.config.keyframe_shift_m
                && off.yaw_rad.abs() < self.config.keyframe_turn_rad;
            if is_near {
                return Ok(());
            }
        }
        let keyframe = Keyframe::new(scan, self.present, self.present_from_base);
        self.drawing.add(keyframe, &self.submaps)?;
        let map_from_base = self.map_from_base();
        for submap in &mut self.submaps[self.present..] {
            let submap_from_base = submap.map_from_submap.inverse() * map_from_base;
            submap.insert(cloud, submap_from_base);
        }
        self.last_keyframe = Some(self.present_from_base);
        self.turn_over();
        Ok(())
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
    fn close_a_loop(&mut self) -> Pose2 {
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

/// Matches in the window, and in wider ones when little fits.
fn find_in_wider_windows(
    map: &MatchMap,
    cloud: &Cloud,
    prior: &Prior,
    foreseen: &motion::Foreseen,
) -> Option<Match> {
    let window = foreseen.window();
    let near = scan_match::find(map, cloud, prior, window)?;
    if near.inlier_share >= SHARE_WIDEN {
        return Some(near);
    }
    let widest = foreseen.widest();
    let wider = Window {
        shift_m: (window.shift_m * WIDER).clamp(WIDE_SHIFT_M, widest.shift_m),
        turn_rad: (window.turn_rad * WIDER).clamp(WIDE_TURN_RAD, widest.turn_rad),
    };
    if wider.shift_m <= window.shift_m && wider.turn_rad <= window.turn_rad {
        return Some(near);
    }
    let loose = Prior { shift_m: wider.shift_m, turn_rad: wider.turn_rad, ..*prior };
    let far = scan_match::find(map, cloud, &loose, wider)?;
    let gain = if foreseen.is_odometry { SHARE_GAIN_ODOMETRY } else { SHARE_GAIN };
    Some(if far.inlier_share > near.inlier_share + gain { far } else { near })
}
