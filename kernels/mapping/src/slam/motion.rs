//! Where the next scan is expected, and how far off that may be.
//!
//! With odometry: where it says, less what it is known to get wrong, give or take a share of the way. Without:
//! the way and the turn are foreseen each by whatever has been nearest lately: the same again, as far ahead as
//! usual, or none. Either way the expected error follows what matching found: an odometry that is worse than
//! configured is given a wider window, not believed.

use geometry::Pose2;
use geometry::angle::wrapped;

use super::calibration::Calibration;
use crate::scan_match::Window;

/// Windows reach this far at most, metres and radians.
const SHIFT_MAX_M: f64 = 2.5;
const TURN_MAX_RAD: f64 = 1.9;
/// Windows reach so many deviations, ...
const N_DEVIATIONS: f64 = 3.0;
/// ... and at least this far.
const SHIFT_MIN_M: f64 = 0.15;
const TURN_MIN_RAD: f64 = 0.06;
/// Weight of the newest error.
const NEWEST: f64 = 0.2;
/// More scans that did not fit widen a window no further.
const N_MISSES_MAX: u32 = 2;
/// Against odometry, windows reach this far at most.
const SHIFT_ODOMETRY_MAX_M: f64 = 1.2;
const TURN_ODOMETRY_MAX_RAD: f64 = 0.7;
/// Most that errors beyond the configured ones widen a window.
const SURPRISE_MAX: f64 = 10.0;
/// A calibrated odometry still slips: share of the way, radians for each metre.
const SLIP_SHARE: f64 = 0.03;
const SLIP_RAD_M: f64 = 0.02;
/// A deviation is this much more than the mean of errors.
const DEVIATION_OF_MEAN: f64 = 1.25;
/// Without odometry, nobody knows when a robot that stands goes on, or turns again: the deviation is at least
/// this share of the longest way and the widest turn lately, ...
const SHARE_OF_LONGEST: f64 = 0.4;
/// ... and lately fades by this share with each scan.
const KEPT_OF_LONGEST: f64 = 0.95;
/// How far the next scan may be off when nothing is known of the motion, metres and radians.
const UNKNOWN_SHIFT_M: f64 = 0.6;
const UNKNOWN_TURN_RAD: f64 = 0.4;

/// How far odometry may be off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionConfig {
    /// Standard deviation of the way, share of it.
    pub shift_share: f64,
    /// And what is always added, metres.
    pub shift_m: f64,
    /// Standard deviation of the heading, radians for each metre.
    pub turn_rad_m: f64,
    /// Share of the turn.
    pub turn_share: f64,
    /// And what is always added, radians.
    pub turn_rad: f64,
}

impl Default for MotionConfig {
    /// Twice what a poor differential drive does: 10 % of the way, 4° for each metre.
    fn default() -> Self {
        MotionConfig { shift_share: 0.1, shift_m: 0.02, turn_rad_m: 0.07, turn_share: 0.1, turn_rad: 0.01 }
    }
}

/// What is expected of the next scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Foreseen {
    /// The motion since the last one.
    pub last_from_now: Pose2,
    /// Standard deviation of x and of y, metres.
    pub shift_m: f64,
    /// Standard deviation of the heading, radians.
    pub turn_rad: f64,
    /// What odometry said.
    pub(super) told: Option<Pose2>,
}

impl Foreseen {
    /// Odometry said so.
    pub(super) fn is_odometry(&self) -> bool {
        self.told.is_some()
    }

    /// The same after so many scans in a row that did not fit: their errors add up.
    #[must_use]
    pub(crate) fn after_misses(self, n: u32) -> Self {
        let more = 1.0 + f64::from(n.min(N_MISSES_MAX));
        Foreseen { shift_m: self.shift_m * more, turn_rad: self.turn_rad * more, ..self }
    }

    /// The same with at least these deviations, metres and radians.
    #[must_use]
    pub(crate) fn no_surer_than(self, shift_m: f64, turn_rad: f64) -> Self {
        Foreseen { shift_m: self.shift_m.max(shift_m), turn_rad: self.turn_rad.max(turn_rad), ..self }
    }

    /// Where to look.
    #[must_use]
    pub fn window(&self) -> Window {
        let largest = self.widest();
        Window {
            shift_m: (N_DEVIATIONS * self.shift_m).clamp(SHIFT_MIN_M, largest.shift_m),
            turn_rad: (N_DEVIATIONS * self.turn_rad).clamp(TURN_MIN_RAD, largest.turn_rad),
        }
    }

    /// Whether a motion that was found is one that could be expected.
    #[must_use]
    pub(crate) fn expects(&self, last_from_now: &Pose2) -> bool {
        let off = self.last_from_now.inverse() * *last_from_now;
        off.position().coords.norm() <= N_DEVIATIONS * self.shift_m.max(SHIFT_MIN_M / N_DEVIATIONS)
            && off.yaw_rad.abs() <= N_DEVIATIONS * self.turn_rad.max(TURN_MIN_RAD / N_DEVIATIONS)
    }

    /// The largest window there is.
    #[must_use]
    pub(super) fn widest(&self) -> Window {
        if self.is_odometry() {
            Window { shift_m: SHIFT_ODOMETRY_MAX_M, turn_rad: TURN_ODOMETRY_MAX_RAD }
        } else {
            Window { shift_m: SHIFT_MAX_M, turn_rad: TURN_MAX_RAD }
        }
    }
}

/// One way to foresee a number or a vector, and its mean error lately.
#[derive(Clone, Copy, Debug)]
struct Guess<T> {
    value: T,
    error: f64,
}

impl<T: Copy> Guess<T> {
    fn hear(&mut self, error: f64) {
        self.error += NEWEST * (error - self.error);
    }

    fn better(self, other: Self) -> Self {
        if other.error < self.error { other } else { self }
    }
}

/// Foresees motion.
#[derive(Clone, Debug)]
pub struct MotionModel {
    config: MotionConfig,
    /// Ways: none, the last one again, straight ahead as far as usual. Metres.
    ways: [Guess<[f64; 2]>; 3],
    /// Turns: none, the last one again. Radians.
    turns: [Guess<f64>; 2],
    /// Longest way and widest turn lately, metres and radians.
    longest: [f64; 2],
    calibration: Calibration,
    /// How many times odometry's errors are larger than expected.
    surprise: f64,
}

impl MotionModel {
    /// A model of a robot at rest.
    #[must_use]
    pub fn new(config: MotionConfig) -> Self {
        MotionModel {
            config,
            ways: [Guess { value: [0.0; 2], error: UNKNOWN_SHIFT_M }; 3],
            turns: [Guess { value: 0.0, error: UNKNOWN_TURN_RAD }; 2],
            longest: [0.0; 2],
            calibration: Calibration::new(config.shift_share, config.turn_rad_m),
            surprise: 1.0,
        }
    }

    /// What to expect, by odometry's motion since the last scan if there is any.
    #[must_use]
    pub fn foresee(&self, told: Option<Pose2>) -> Foreseen {
        let MotionConfig { shift_m, turn_share, turn_rad, .. } = self.config;
        if let Some(told) = told {
            let (way_m, turned_rad) = (told.position().coords.norm(), told.yaw_rad.abs());
            let (share, turn_rad_m) = self.calibration.deviations();
            return Foreseen {
                last_from_now: self.calibration.corrected(&told),
                shift_m: (shift_m + share.hypot(SLIP_SHARE) * way_m) * self.surprise,
                turn_rad: (turn_rad + turn_rad_m.hypot(SLIP_RAD_M) * way_m + turn_share * turned_rad)
                    * self.surprise,
                told: Some(told),
            };
        }
        let [none, again, usual] = self.ways;
        let (way, turn) = (none.better(again).better(usual), self.turns[0].better(self.turns[1]));
        Foreseen {
            last_from_now: Pose2::new(way.value[0], way.value[1], turn.value),
            shift_m: shift_m + (DEVIATION_OF_MEAN * way.error).max(SHARE_OF_LONGEST * self.longest[0]),
            turn_rad: turn_rad + (DEVIATION_OF_MEAN * turn.error).max(SHARE_OF_LONGEST * self.longest[1]),
            told: None,
        }
    }

    /// The last scan told nothing: without odometry, the next one may be anywhere around.
    pub fn forget(&mut self) {
        for way in &mut self.ways {
            way.error = way.error.max(UNKNOWN_SHIFT_M);
        }
        for turn in &mut self.turns {
            turn.error = turn.error.max(UNKNOWN_TURN_RAD);
        }
    }

    /// Learns where the robot really went, from poses in one frame; `variance` is how well that is known, along
    /// the way (m²), in heading (rad²), and aside (m²).
    pub fn learn(&mut self, last: &Pose2, now: &Pose2, foreseen: &Foreseen, variance: [f64; 3]) {
        let found = last.inverse() * *now;
        for way in &mut self.ways {
            way.hear((found.x_m - way.value[0]).hypot(found.y_m - way.value[1]));
        }
        for turn in &mut self.turns {
            turn.hear(wrapped(found.yaw_rad - turn.value).abs());
        }
        for (longest, found) in
            self.longest.iter_mut().zip([found.position().coords.norm(), found.yaw_rad.abs()])
        {
            *longest = found.max(KEPT_OF_LONGEST * *longest);
        }
        let [_, again, usual] = &mut self.ways;
        again.value = [found.x_m, found.y_m];
        usual.value[0] += NEWEST * (found.x_m - usual.value[0]);
        self.turns[1].value = found.yaw_rad;
        if let Some(told) = foreseen.told {
            let off = foreseen.last_from_now.inverse() * found;
            let shift = off.position().coords.norm() / foreseen.shift_m;
            let turn = off.yaw_rad.abs() / foreseen.turn_rad;
            // Of what was expected with the surprise so far.
            let found_surprise = shift.max(turn) * self.surprise;
            self.surprise += NEWEST * (found_surprise - self.surprise);
            self.surprise = self.surprise.clamp(1.0, SURPRISE_MAX);
            self.calibration.learn(&told, &found, variance);
        }
    }
}
