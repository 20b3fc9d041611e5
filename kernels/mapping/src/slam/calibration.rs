//! What odometry gets wrong always: its share of the way, and its turn for each metre.
//!
//! Wheels that are larger than configured, or differ, err the same way on every metre. Two scalar Kalman
//! filters learn both from the motion that scans show, as far as scans show it: along a corridor they tell
//! nothing of the way, and what was learned before carries the pose on.

use geometry::Pose2;

/// What is not believed of an odometry, however wrong scans say it is: share of the way, radians for each metre.
const SHARE_MAX: f64 = 0.25;
const TURN_MAX_RAD_M: f64 = 0.2;
const ASIDE_MAX_RAD: f64 = 0.1;
/// How far the way's direction may be off, radians: one deviation.
const ASIDE_RAD: f64 = 0.03;
/// How well matching tells a motion at best, metres and radians.
const NOISE_M: f64 = 0.03;
const NOISE_RAD: f64 = 0.012;
/// The errors may change with the floor: variance that comes back with each metre, share² and (rad/m)².
const FORGET_SHARE2_M: f64 = 1e-5;
const FORGET_TURN2_M: f64 = 2e-6;
/// Motions shorter than this tell nothing, metres.
const WAY_MIN_M: f64 = 0.02;
/// Surprises beyond so many deviations are slips or mistakes, not calibration.
const DEVIATIONS_MAX: f64 = 3.0;

/// A value that is being learned.
#[derive(Clone, Copy, Debug)]
struct Learned {
    value: f64,
    variance: f64,
}

impl Learned {
    fn hear(&mut self, seen: f64, noise: f64) {
        let variance = self.variance + noise;
        let off = seen - self.value;
        if off * off > DEVIATIONS_MAX * DEVIATIONS_MAX * variance {
            return;
        }
        let gain = self.variance / variance;
        self.value += gain * off;
        self.variance *= 1.0 - gain;
    }
}

/// What has been learned of an odometry.
#[derive(Clone, Copy, Debug)]
pub(super) struct Calibration {
    /// True way over told way, less one.
    share: Learned,
    /// True turn less told turn, for each told metre.
    turn_rad_m: Learned,
    /// Direction of the true way less that of the told one, radians: half of a turn that was not told, or a
    /// LiDAR that is not mounted as configured.
    aside_rad: Learned,
    /// Variances at the start: what the configuration allows for.
    start: [f64; 2],
}

impl Calibration {
    /// Nothing is learned yet; deviations as configured.
    pub(super) fn new(share: f64, turn_rad_m: f64) -> Self {
        let start = [share * share, turn_rad_m * turn_rad_m];
        Calibration {
            share: Learned { value: 0.0, variance: start[0] },
            turn_rad_m: Learned { value: 0.0, variance: start[1] },
            aside_rad: Learned { value: 0.0, variance: ASIDE_RAD * ASIDE_RAD },
            start,
        }
    }

    /// What odometry meant.
    pub(super) fn corrected(&self, told: &Pose2) -> Pose2 {
        let way_m = told.position().coords.norm();
        let (scale, turn_rad) = (1.0 + self.share.value, self.turn_rad_m.value * way_m);
        let (sin, cos) = self.aside_rad.value.sin_cos();
        let (x_m, y_m) = (scale * told.x_m, scale * told.y_m);
        Pose2::new(cos * x_m - sin * y_m, sin * x_m + cos * y_m, told.yaw_rad + turn_rad)
    }

    /// Deviations that are left: share of the way, radians for each metre.
    pub(super) fn deviations(&self) -> (f64, f64) {
        (self.share.variance.sqrt(), self.turn_rad_m.variance.sqrt())
    }

    /// Learns from what odometry told and what scans found; `variance` is how well they did: along the way
    /// (m²), in heading (rad²) and aside (m²).
    pub(super) fn learn(&mut self, told: &Pose2, found: &Pose2, variance: [f64; 3]) {
        let way_m = told.position().coords.norm();
        if way_m < WAY_MIN_M {
            return;
        }
        let along_m = found.position().coords.dot(&told.position().coords) / way_m;
        let turn_rad = geometry::angle::wrapped(found.yaw_rad - told.yaw_rad);
        let (off, to) = (told.position().coords, found.position().coords);
        let aside_rad = (off.x * to.y - off.y * to.x).atan2(off.dot(&to));
        let way2 = way_m * way_m;
        self.aside_rad.hear(aside_rad, (NOISE_M * NOISE_M + variance[2]) / way2);
        self.share.hear(along_m / way_m - 1.0, (NOISE_M * NOISE_M + variance[0]) / way2);
        self.turn_rad_m.hear(turn_rad / way_m, (NOISE_RAD * NOISE_RAD + variance[1]) / way2);
        self.share.value = self.share.value.clamp(-SHARE_MAX, SHARE_MAX);
        self.aside_rad.value = self.aside_rad.value.clamp(-ASIDE_MAX_RAD, ASIDE_MAX_RAD);
        self.turn_rad_m.value = self.turn_rad_m.value.clamp(-TURN_MAX_RAD_M, TURN_MAX_RAD_M);
        self.share.variance = (self.share.variance + FORGET_SHARE2_M * way_m).min(self.start[0]);
        self.turn_rad_m.variance = (self.turn_rad_m.variance + FORGET_TURN2_M * way_m).min(self.start[1]);
    }
}
