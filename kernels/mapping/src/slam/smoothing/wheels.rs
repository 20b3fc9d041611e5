//! What an odometry was worth, by all of the way at once: what it always gets wrong, and how far it errs beyond.
//!
//! Told by medians over all motions between kept scans: slips and scans that were matched wrongly count as one each.

use geometry::Pose2;
use geometry::angle::wrapped;

/// Motions shorter than this tell nothing of what is always wrong, metres.
const WAY_MIN_M: f64 = 0.05;
/// With fewer motions, nothing is told of it.
const N_MIN: usize = 20;
/// How far scans err themselves between two poses: along, aside, metres; turned, radians.
const SCANS_ERR: [f64; 3] = [0.012, 0.012, 0.004];
/// Deviations that nobody believes to be smaller: metres and radians, and for each metre of the way.
const ERR_MIN: [f64; 3] = [0.004, 0.004, 0.002];
const ERR_MIN_M: [f64; 3] = [0.004, 0.004, 0.002];
/// Deviations while nothing is told: of a poor differential drive.
const ERR_UNTOLD: [f64; 3] = [0.1, 0.1, 0.07];
/// A deviation over the median of absolute values.
const DEVIATION_OF_MEDIAN: f64 = 1.4826;

/// An odometry, calibrated.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wheels {
    /// True way over told way.
    scale: f64,
    /// Direction of the true way less that of the told one, radians.
    aside_rad: f64,
    /// True turn less told turn, for each metre.
    turn_rad_m: f64,
    /// Deviations of the motion over a metre: along and aside, metres; turned, radians.
    err: [f64; 3],
}

impl Wheels {
    /// What `told`, the motion to each pose from the one before, was worth if the poses are right.
    pub(super) fn fit(told: &[Option<Pose2>], poses: &[Pose2]) -> Self {
        let mut motions: Vec<(Pose2, Pose2)> = Vec::new();
        for ((last, now), told) in poses.iter().zip(poses.iter().skip(1)).zip(told.iter().skip(1)) {
            motions.extend(told.map(|told| (told, last.inverse() * *now)));
        }
        let (mut shares, mut asides, mut turns) = (Vec::new(), Vec::new(), Vec::new());
        for (told, found) in &motions {
            let (way, truly) = (told.position().coords, found.position().coords);
            let way_m = way.norm();
            if way_m > WAY_MIN_M {
                shares.push(way.dot(&truly) / (way_m * way_m));
                asides.push((way.x * truly.y - way.y * truly.x).atan2(way.dot(&truly)));
                turns.push(wrapped(found.yaw_rad - told.yaw_rad) / way_m);
            }
        }
        let mut wheels = Wheels { scale: 1.0, aside_rad: 0.0, turn_rad_m: 0.0, err: ERR_UNTOLD };
        if shares.len() < N_MIN {
            return wheels;
        }
        (wheels.scale, wheels.aside_rad, wheels.turn_rad_m) =
            (median(&mut shares), median(&mut asides), median(&mut turns));
        let mut off: [Vec<f64>; 3] = Default::default();
        for (told, found) in motions.iter().filter(|(told, _)| way_m(told) > WAY_MIN_M) {
            let missed = wheels.meant(told).inverse() * *found;
            let missed = [missed.x_m, missed.y_m, missed.yaw_rad];
            for (off, missed) in off.iter_mut().zip(missed) {
                off.push(missed.abs() / way_m(told).sqrt());
            }
        }
        for (axis, off) in off.iter_mut().enumerate() {
            let deviation = DEVIATION_OF_MEDIAN * median(off);
            wheels.err[axis] = (deviation * deviation - SCANS_ERR[axis].powi(2)).max(0.0).sqrt();
        }
        wheels
    }

    /// What odometry meant by a motion.
    pub(super) fn meant(&self, told: &Pose2) -> Pose2 {
        let (sin, cos) = self.aside_rad.sin_cos();
        let (x_m, y_m) = (self.scale * told.x_m, self.scale * told.y_m);
        let yaw_rad = told.yaw_rad + self.turn_rad_m * way_m(told);
        Pose2::new(cos * x_m - sin * y_m, sin * x_m + cos * y_m, yaw_rad)
    }

    /// Its deviations: along and aside, metres; turned, radians.
    pub(super) fn deviations(&self, told: &Pose2) -> [f64; 3] {
        let way_m = way_m(told);
        std::array::from_fn(|axis| ERR_MIN[axis] + self.err[axis].max(ERR_MIN_M[axis]) * way_m.sqrt())
    }
}

fn way_m(told: &Pose2) -> f64 {
    told.position().coords.norm()
}

/// The middle value; 0 of none.
fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_wheels_always_get_wrong_is_no_error_and_what_they_get_wrong_by_chance_is() {
        let step = |idx: usize| Pose2::new(0.5, 0.0, 0.3 * (idx as f64).sin());
        let mut poses = vec![Pose2::IDENTITY];
        for idx in 0..200 {
            poses.push(poses[idx] * step(idx));
        }
        let told_by = |slip: f64| -> Vec<Option<Pose2>> {
            let told = |idx: usize| {
                let slipped = 1.05 + slip * (7.3 * idx as f64).sin();
                Pose2::new(0.5 * slipped, 0.0, step(idx).yaw_rad + 0.02)
            };
            std::iter::once(None).chain((0..200).map(|idx| Some(told(idx)))).collect()
        };
        let steady = Wheels::fit(&told_by(0.0), &poses);
        let off = steady.meant(&Pose2::new(0.525, 0.0, 0.02));
        assert!((off.x_m - 0.5).abs() < 1e-6 && off.y_m.abs() < 1e-6 && off.yaw_rad.abs() < 1e-6, "{off:?}");
        let [along, ..] = steady.deviations(&Pose2::new(0.5, 0.0, 0.0));
        assert!(along < 0.01, "{along}");
        let [along, aside, _] = Wheels::fit(&told_by(0.2), &poses).deviations(&Pose2::new(0.5, 0.0, 0.0));
        assert!(along > 0.05 && aside < 0.02, "{along} {aside}");
    }
}
