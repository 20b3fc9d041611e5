//! How far a trajectory is off a reference, relatively: over every stretch of a given length of the
//! reference's way, the motion found against the motion that was.

use geometry::Pose2;

/// Errors over stretches of one length.
#[derive(Clone, Debug, PartialEq)]
pub struct RelativeErrors {
    /// Length of the stretches, metres of the reference's way.
    pub length_m: f64,
    /// Of each stretch, ascending, metres.
    pub shift_m: Vec<f64>,
    /// Of each stretch, ascending, degrees.
    pub turn_deg: Vec<f64>,
    /// Share of the stretches that keep both limits.
    pub share_within: f64,
}

/// A stretch must end within this share of its length beyond it: sparse scans jump.
const BEYOND_MAX: f64 = 1.0;

impl RelativeErrors {
    /// Compares two trajectories of equally many poses; `None` stands for a pose that is not known.
    /// `limit` is metres and degrees.
    #[must_use]
    pub fn of(
        found: &[Option<Pose2>],
        reference: &[Option<Pose2>],
        length_m: f64,
        limit: (f64, f64),
    ) -> Self {
        let pairs: Vec<(Pose2, Pose2)> =
            found.iter().zip(reference).filter_map(|(f, r)| Some(((*f)?, (*r)?))).collect();
        let mut way_m = Vec::with_capacity(pairs.len());
        let mut length_so_far_m = 0.0;
        for (idx, (_, here)) in pairs.iter().enumerate() {
            if let Some((_, last)) = idx.checked_sub(1).and_then(|before| pairs.get(before)) {
                length_so_far_m += (here.position() - last.position()).norm();
            }
            way_m.push(length_so_far_m);
        }
        let (mut shift_m, mut turn_deg, mut n_within) = (Vec::new(), Vec::new(), 0_usize);
        for (&begun_m, (found_from, true_from)) in way_m.iter().zip(&pairs) {
            let end = way_m.partition_point(|m| *m < begun_m + length_m - 1e-9);
            let (Some((found_to, true_to)), Some(end_m)) = (pairs.get(end), way_m.get(end)) else { break };
            if end_m - begun_m > length_m * (1.0 + BEYOND_MAX) {
                continue;
            }
            let moved = found_from.inverse() * *found_to;
            let truly = true_from.inverse() * *true_to;
            let off = truly.inverse() * moved;
            let (shift, turn) = (off.position().coords.norm(), off.yaw_rad.abs().to_degrees());
            n_within += usize::from(shift <= limit.0 && turn <= limit.1);
            shift_m.push(shift);
            turn_deg.push(turn);
        }
        let share_within = n_within as f64 / shift_m.len().max(1) as f64;
        shift_m.sort_by(f64::total_cmp);
        turn_deg.sort_by(f64::total_cmp);
        RelativeErrors { length_m, shift_m, turn_deg, share_within }
    }
}

/// The value below which a share of ascending values lies; NaN of none.
#[must_use]
pub fn quantile(ascending: &[f64], share: f64) -> f64 {
    let last = ascending.len().saturating_sub(1);
    ascending.get((share * last as f64).round() as usize).copied().unwrap_or(f64::NAN)
}

/// The mean; NaN of none.
#[must_use]
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The root of the mean square: what is far off counts more. NaN of none.
#[must_use]
pub fn root_mean_square(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}
