//! Where the next scan is expected, and how far off that may be.
//!
//! With odometry: where it says, give or take a share of the way. Without: where the motion so far leads, or
//! where the robot was, whichever has been nearer lately. Either way the expected error follows what matching
//! found: an odometry that is worse than configured is given a wider window, not believed.

use geometry::Pose2;

use crate::scan_match::Window;

/// Windows reach this far at most, metres and radians.
const SHIFT_MAX_M: f64 = 2.5;
const TURN_MAX_RAD: f64 = 1.75;
/// Windows reach so many deviations, ...
const N_DEVIATIONS: f64 = 3.0;
/// ... and at least this far.
const SHIFT_MIN_M: f64 = 0.15;
const TURN_MIN_RAD: f64 = 0.06;
/// Weight of the newest error.
const NEWEST: f64 = 0.3;
/// More scans that did not fit widen a window no further.
const N_MISSES_MAX: u32 = 2;
/// Against odometry, windows reach this far at most.
const SHIFT_ODOMETRY_MAX_M: f64 = 1.2;
const TURN_ODOMETRY_MAX_RAD: f64 = 0.7;
/// Most that errors beyond the configured ones widen a window.
const SURPRISE_MAX: f64 = 10.0;

/// When nothing is known of the motion, it is looked for widely.
const UNKNOWN: Errors = Errors { shift_m: 0.6, turn_rad: 0.5 };

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
    /// Odometry said so.
    pub(super) is_odometry: bool,
}

impl Foreseen {
    /// The same after so many scans in a row that did not fit: their errors add up.
    #[must_use]
    pub(crate) fn after_misses(self, n: u32) -> Self {
        let more = 1.0 + f64::from(n.min(N_MISSES_MAX));
        Foreseen { shift_m: self.shift_m * more, turn_rad: self.turn_rad * more, ..self }
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
        if self.is_odometry {
            Window { shift_m: SHIFT_ODOMETRY_MAX_M, turn_rad: TURN_ODOMETRY_MAX_RAD }
        } else {
            Window { shift_m: SHIFT_MAX_M, turn_rad: TURN_MAX_RAD }
        }
    }
}

/// Lately seen errors of one way to foresee.
#[derive(Clone, Copy, Debug)]
struct Errors {
    shift_m: f64,
    turn_rad: f64,
}

impl Errors {
    fn hear(&mut self, off: &Pose2) {
        self.shift_m += NEWEST * (off.position().coords.norm() - self.shift_m);
        self.turn_rad += NEWEST * (off.yaw_rad.abs() - self.turn_rad);
    }

    /// In metres, as seen on something three metres away.
    fn size_m(&self) -> f64 {
        self.shift_m + 3.0 * self.turn_rad
    }
}

/// Foresees motion.
#[derive(Clone, Debug)]
pub struct MotionModel {
    config: MotionConfig,
    /// The last motion that was found.
    last: Pose2,
    /// Of going on as before, and of standing still.
    going_on: Errors,
    standing: Errors,
    /// How many times odometry's errors are larger than configured.
    surprise: f64,
}

impl MotionModel {
    /// A model of a robot at rest.
    #[must_use]
    pub fn new(config: MotionConfig) -> Self {
        MotionModel { config, last: Pose2::IDENTITY, going_on: UNKNOWN, standing: UNKNOWN, surprise: 1.0 }
    }

    /// What to expect, by odometry's motion since the last scan if there is any.
    #[must_use]
    pub fn foresee(&self, last_from_now: Option<Pose2>) -> Foreseen {
        let MotionConfig { shift_share, shift_m, turn_rad_m, turn_share, turn_rad } = self.config;
        if let Some(last_from_now) = last_from_now {
            let (way_m, turned_rad) = (last_from_now.position().coords.norm(), last_from_now.yaw_rad.abs());
            return Foreseen {
                last_from_now,
                shift_m: (shift_m + shift_share * way_m) * self.surprise,
                turn_rad: (turn_rad + turn_rad_m * way_m + turn_share * turned_rad) * self.surprise,
                is_odometry: true,
            };
        }
        let goes_on = self.going_on.size_m() < self.standing.size_m();
        let (last_from_now, errors) =
            if goes_on { (self.last, self.going_on) } else { (Pose2::IDENTITY, self.standing) };
        Foreseen {
            last_from_now,
            shift_m: shift_m + errors.shift_m,
            turn_rad: turn_rad + errors.turn_rad,
            is_odometry: false,
        }
    }

    /// The last scan told nothing: without odometry, the next one may be anywhere around.
    pub fn forget(&mut self) {
        self.last = Pose2::IDENTITY;
        self.going_on = UNKNOWN;
        self.standing = UNKNOWN;
    }

    /// Learns where the robot really went, from poses in one frame.
    pub fn learn(&mut self, last: &Pose2, now: &Pose2, foreseen: &Foreseen) {
        let last_from_now = last.inverse() * *now;
        self.going_on.hear(&(self.last.inverse() * last_from_now));
        self.standing.hear(&last_from_now);
        self.last = last_from_now;
        if foreseen.is_odometry {
            let off = foreseen.last_from_now.inverse() * last_from_now;
            let shift = off.position().coords.norm() / foreseen.shift_m;
            let turn = off.yaw_rad.abs() / foreseen.turn_rad;
            // Of what was expected with the surprise so far.
            let found = shift.max(turn) * self.surprise;
            self.surprise += NEWEST * (found - self.surprise);
            self.surprise = self.surprise.clamp(1.0, SURPRISE_MAX);
        }
    }
}
