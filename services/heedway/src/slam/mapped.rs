//! A log on its way through the map.

use geometry::Pose2;
use mapping::base_map::Scan;
use mapping::slam::{Anchor, Located, Slam, SlamConfig, Standing};

use super::carmen::{LaserLine, LaserScan};
use super::wheels::{Drift, Wheels};

/// Nearer readings are of the robot itself or of nothing, metres.
const RANGE_MIN_M: f64 = 0.05;
/// So many scans in a row that do not fit, and a new piece of map begins: with odometry, which carries on, ...
const N_MISSES_MAX: u32 = 3;
/// ... and without: nothing ties what follows to what was.
const N_MISSES_MAX_WITHOUT: u32 = 1;

/// What became of the log's lines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Counts {
    /// Lines that could not be read.
    pub(super) n_bad: usize,
    /// Scans that could not be.
    pub(super) n_refused: usize,
    /// Scans that did not fit the map, or so badly that they were in doubt.
    pub(super) n_uncertain: usize,
    /// Times that a new piece of map was begun.
    pub(super) n_lost: usize,
}

/// A map that is being made of a log.
pub(super) struct Mapped {
    clock: service::Clock,
    slam: Slam,
    wheels: Option<Wheels>,
    /// Of each laser line; a bad one is where the one before it was.
    anchors: Vec<Option<Anchor>>,
    milliseconds: Vec<f64>,
    counts: Counts,
    n_misses: u32,
}

impl Mapped {
    /// An empty map; without odometry no pose of the log is looked at.
    pub(super) fn new(uses_odometry: bool, drift: Drift) -> anyhow::Result<Self> {
        Ok(Mapped {
            clock: service::Clock::start(),
            slam: Slam::new(SlamConfig::default(), Pose2::IDENTITY)?,
            wheels: uses_odometry.then(|| Wheels::new(drift)),
            anchors: Vec::new(),
            milliseconds: Vec::new(),
            counts: Counts::default(),
            n_misses: 0,
        })
    }

    pub(super) fn slam(&self) -> &Slam {
        &self.slam
    }

    pub(super) fn counts(&self) -> Counts {
        self.counts
    }

    /// How long each scan took, in order.
    pub(super) fn milliseconds(&self) -> &[f64] {
        &self.milliseconds
    }

    pub(super) fn take_in(&mut self, line: &LaserLine) {
        let last_anchor = self.anchors.last().copied().flatten();
        let LaserLine::Scan(scan) = line else {
            self.counts.n_bad += 1;
            self.anchors.push(last_anchor);
            return;
        };
        let last_from_now = self.wheels.as_mut().and_then(|wheels| wheels.since_last(scan));
        let begun = self.clock.now();
        let located = self.locate(scan, last_from_now);
        self.milliseconds.push(self.clock.now().since(begun).as_secs_f64() * 1e3);
        self.anchors.push(located.map_or(last_anchor, |located| Some(located.anchor)));
    }

    /// Takes in a scan; `None` when it cannot be.
    fn locate(&mut self, scan: &LaserScan, last_from_now: Option<Pose2>) -> Option<Located> {
        let scan = borrowed(scan);
        let Ok(located) = self.slam.step(&scan, last_from_now) else {
            self.counts.n_refused += 1;
            return None;
        };
        self.counts.n_uncertain += usize::from(located.standing != Standing::Good);
        if located.standing == Standing::Good || located.is_in_doubt {
            self.n_misses = 0;
            return Some(located);
        }
        self.n_misses += 1;
        let most = if last_from_now.is_some() { N_MISSES_MAX } else { N_MISSES_MAX_WITHOUT };
        if self.n_misses < most {
            return Some(located);
        }
        // Nobody is there to drive it back: what follows is mapped on its own until it is found in the old.
        self.counts.n_lost += 1;
        self.n_misses = 0;
        self.slam.begin_anew(&scan).ok()
    }

    /// The log has ended.
    pub(super) fn finish(&mut self) {
        self.slam.finish();
    }

    /// Where the laser was at each laser line, by all that is known now.
    pub(super) fn trajectory(&self) -> Vec<Pose2> {
        self.anchors.iter().map(|anchor| anchor.map_or(Pose2::IDENTITY, |a| self.slam.pose(&a))).collect()
    }
}

fn borrowed(scan: &LaserScan) -> Scan<'_> {
    Scan {
        ranges_m: &scan.ranges_m,
        angle_min_rad: scan.angle_min_rad,
        angle_increment_rad: scan.angle_step_rad,
        range_min_m: RANGE_MIN_M,
        range_max_m: scan.range_max_m,
        no_return_is_free: false,
    }
}
