//! The exact place, by Gauss–Newton on distances to tangents.

use geometry::Pose2;
use geometry::angle::wrapped;
use nalgebra::{Matrix3, Point2, Vector2, Vector3};

use super::Match;
use super::cloud::Cloud;
use super::map::MatchMap;
use super::placement::Placement;

/// Most steps; four to six are usual.
const N_STEPS_MAX: usize = 15;
/// Residuals of this size, metres, count a quarter; it falls from the first to the second while steps go on.
const SCALE_M: [f32; 2] = [0.12, 0.04];
/// Each step narrows the scale to this share.
const SCALE_STEP: f32 = 0.7;
/// A point this near to a surface, metres, lies on it.
const INLIER_M: f32 = 0.1;
/// A surface seen from the other side is another one: least cosine between normals.
const COSINE_MIN: f32 = 0.3;
/// Standard deviation of a residual, metres, as far as neighbouring points are concerned: their errors are
/// not independent, so it is more than a LiDAR's noise.
const NOISE_M: f64 = 0.1;
/// Weight of a point whose surface has no known direction, on each axis.
const ROUND_WEIGHT: f32 = 0.3;

/// What is believed before a scan is looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// Where the scan is expected.
    pub map_from_scan: Pose2,
    /// Standard deviation of x and of y, metres.
    pub shift_m: f64,
    /// Standard deviation of the heading, radians.
    pub turn_rad: f64,
}

impl Prior {
    /// How far a pose is from the expected one, in deviations, squared.
    #[must_use]
    pub fn squared_deviations(&self, map_from_scan: &Pose2) -> f64 {
        let off = self.map_from_scan.inverse() * *map_from_scan;
        (off.position().coords.norm() / self.shift_m.max(1e-3)).powi(2)
            + (off.yaw_rad / self.turn_rad.max(1e-4)).powi(2)
    }
}

/// Moves a scan from `start` onto the surfaces of the map; where they do not tell, the prior does.
#[must_use]
pub fn refine(map: &MatchMap, cloud: &Cloud, start: Pose2, prior: &Prior) -> Match {
    let mut pose = start;
    let mut scale_m = SCALE_M[0];
    let mut sums = Sums::at(map, cloud, pose, scale_m);
    for _ in 0..N_STEPS_MAX {
        let step = sums.step(pose, prior);
        pose = Pose2::new(pose.x_m + step.x, pose.y_m + step.y, pose.yaw_rad + step.z);
        let is_still = step.x.abs() < 5e-4 && step.y.abs() < 5e-4 && step.z.abs() < 1e-4;
        if is_still && scale_m <= SCALE_M[1] {
            break;
        }
        scale_m = (scale_m * SCALE_STEP).max(SCALE_M[1]);
        sums = Sums::at(map, cloud, pose, scale_m);
    }
    let n = cloud.points().len().max(1);
    let information = sums.hessian / (NOISE_M * NOISE_M);
    Match {
        map_from_scan: pose,
        inlier_share: sums.n_inliers as f64 / n as f64,
        n_inliers: sums.n_inliers,
        information,
    }
}

/// The normal equations at one pose, about the scan's own origin.
struct Sums {
    hessian: Matrix3<f64>,
    gradient: Vector3<f64>,
    n_inliers: usize,
}

impl Sums {
    fn at(map: &MatchMap, cloud: &Cloud, pose: Pose2, scale_m: f32) -> Self {
        let placed = Placement::new(pose);
        let here = Point2::new(pose.x_m as f32, pose.y_m as f32);
        // Single precision: a few hundred terms of a few metres.
        let (mut h, mut g) = ([0.0_f32; 6], [0.0_f32; 3]);
        let mut n_inliers = 0;
        let mut add = |direction: Vector2<f32>, arm: Vector2<f32>, off_m: f32, weight: f32| {
            let turn = direction.y * arm.x - direction.x * arm.y;
            h[0] += weight * direction.x * direction.x;
            h[1] += weight * direction.x * direction.y;
            h[2] += weight * direction.x * turn;
            h[3] += weight * direction.y * direction.y;
            h[4] += weight * direction.y * turn;
            h[5] += weight * turn * turn;
            g[0] += weight * off_m * direction.x;
            g[1] += weight * off_m * direction.y;
            g[2] += weight * off_m * turn;
        };
        for point in cloud.points() {
            let at = placed.point(point.at);
            let Some(surface) = map.nearest(at) else { continue };
            let normal = placed.direction(point.normal);
            let has_two = surface.normal != Vector2::zeros() && normal != Vector2::zeros();
            if has_two && surface.normal.dot(&normal) < COSINE_MIN {
                continue;
            }
            let (off, arm) = (at - surface.at, at - here);
            let off_m =
                if surface.normal == Vector2::zeros() { off.norm() } else { surface.normal.dot(&off) };
            n_inliers += usize::from(off_m.abs() <= INLIER_M);
            // Geman–McClure.
            let share = scale_m * scale_m / (scale_m * scale_m + off_m * off_m);
            let weight = share * share;
            if surface.normal == Vector2::zeros() {
                add(Vector2::x(), arm, off.x, weight * ROUND_WEIGHT);
                add(Vector2::y(), arm, off.y, weight * ROUND_WEIGHT);
            } else {
                add(surface.normal, arm, off_m, weight);
            }
        }
        let [xx, xy, xt, yy, yt, tt] = h.map(f64::from);
        Sums {
            hessian: Matrix3::new(xx, xy, xt, xy, yy, yt, xt, yt, tt),
            gradient: Vector3::new(g[0].into(), g[1].into(), g[2].into()),
            n_inliers,
        }
    }

    /// The step that the surfaces and the prior agree on.
    fn step(&self, pose: Pose2, prior: &Prior) -> Vector3<f64> {
        let weight = |deviation: f64| (NOISE_M / deviation.max(1e-3)).powi(2);
        let weights = Vector3::new(weight(prior.shift_m), weight(prior.shift_m), weight(prior.turn_rad));
        let off = Vector3::new(
            pose.x_m - prior.map_from_scan.x_m,
            pose.y_m - prior.map_from_scan.y_m,
            wrapped(pose.yaw_rad - prior.map_from_scan.yaw_rad),
        );
        let hessian = self.hessian + Matrix3::from_diagonal(&weights);
        let gradient = self.gradient + weights.component_mul(&off);
        hessian.cholesky().map_or(Vector3::zeros(), |factors| -factors.solve(&gradient))
    }
}
