//! A scan as points with normals, thinned where beams lie close together.

use geometry::{Point2, Pose2};
use nalgebra::{Point2 as PointN, Vector2};

use crate::base_map::Scan;

/// Points nearer together than this tell the same, metres.
const SPACING_M: f32 = 0.04;
/// A surface's direction is taken over this much of it either way, metres, and at least from the two
/// neighbouring beams.
const NORMAL_REACH_M: f32 = 0.12;
/// Most beams either way that a normal looks at.
const N_NORMAL_BEAMS: usize = 12;
/// Neighbouring beams farther apart than this many times their spacing on a facing wall lie on different things.
const GAP_SPACINGS: f32 = 6.0;
/// And never nearer than this, metres: noise.
const GAP_MIN_M: f32 = 0.1;
/// Between points farther apart than this, metres, not more than this was seen.
const GAP_LENGTH_M: f32 = 0.3;
/// Thickness over length, squared, above which points make no line.
const THICKNESS_MAX: f32 = 0.08;

/// A point on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CloudPoint {
    /// Where, metres.
    pub at: PointN<f32>,
    /// Unit normal, towards the sensor; zero when the surface's direction is not known.
    pub normal: Vector2<f32>,
}

/// The points of one scan (or of many), in one frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cloud {
    points: Vec<CloudPoint>,
    /// Where the sensor was, if there was one.
    eye: Option<PointN<f32>>,
}

impl Cloud {
    /// The returns of a scan up to `range_used_m`, in `base`. Beams without a measurement, NaN among them, are
    /// left out.
    #[must_use]
    pub fn of_scan(scan: &Scan<'_>, base_from_lidar: Pose2, range_used_m: f64) -> Self {
        let (low_m, high_m) = (scan.range_min_m.max(1e-3), scan.range_max_m.min(range_used_m));
        let mut raw = Vec::with_capacity(scan.ranges_m.len());
        for (idx, &range_m) in scan.ranges_m.iter().enumerate() {
            let range_m = f64::from(range_m);
            // NaN is in no range.
            if !(low_m..=high_m).contains(&range_m) {
                continue;
            }
            let angle_rad =
                base_from_lidar.yaw_rad + scan.angle_min_rad + idx as f64 * scan.angle_increment_rad;
            let (sin, cos) = angle_rad.sin_cos();
            let at = Point2::new(base_from_lidar.x_m + range_m * cos, base_from_lidar.y_m + range_m * sin);
            raw.push((at.cast::<f32>(), range_m as f32));
        }
        let eye = base_from_lidar.position().cast::<f32>();
        let step_rad = scan.angle_increment_rad.abs() as f32;
        let mut points: Vec<CloudPoint> = Vec::with_capacity(raw.len());
        for idx in 0..raw.len() {
            let at = raw[idx].0;
            if points.last().is_some_and(|last| (last.at - at).norm_squared() < SPACING_M * SPACING_M) {
                continue;
            }
            points.push(CloudPoint { at, normal: normal_at(&raw, idx, step_rad, eye) });
        }
        Cloud { points, eye: Some(eye) }
    }

    /// A cloud of given points.
    #[must_use]
    pub fn from_points(points: Vec<CloudPoint>) -> Self {
        Cloud { points, eye: None }
    }

    /// Where the sensor was; `None` when the points were not seen from one place.
    #[must_use]
    pub fn eye(&self) -> Option<PointN<f32>> {
        self.eye
    }

    /// The points.
    #[must_use]
    pub fn points(&self) -> &[CloudPoint] {
        &self.points
    }

    /// The same cloud with at most `n_max` points, spread evenly over the order they are in.
    #[must_use]
    pub fn thinned(&self, n_max: usize) -> Self {
        let n = self.points.len();
        if n <= n_max {
            return self.clone();
        }
        Cloud { points: (0..n_max).map(|idx| self.points[idx * n / n_max]).collect(), eye: self.eye }
    }

    /// At most `n_max` points, spread evenly over the length of what was seen: near things are seen by many
    /// beams and tell no more than far ones.
    #[must_use]
    pub fn spread(&self, n_max: usize) -> Vec<PointN<f32>> {
        let gap_m = |pair: &[CloudPoint]| match pair {
            [a, b] => (b.at - a.at).norm().min(GAP_LENGTH_M),
            _ => 0.0,
        };
        let length_m: f32 = self.points.windows(2).map(gap_m).sum();
        let spacing_m = length_m / n_max.max(1) as f32;
        let Some(first) = self.points.first() else { return Vec::new() };
        let (mut spread, mut since_m) = (vec![first.at], 0.0);
        for pair in self.points.windows(2) {
            since_m += gap_m(pair);
            if let [_, point] = pair
                && since_m >= spacing_m
            {
                since_m -= spacing_m;
                spread.push(point.at);
            }
        }
        spread.truncate(n_max);
        spread
    }
}

/// The normal of the line through a point and its neighbours on the same thing.
fn normal_at(raw: &[(PointN<f32>, f32)], idx: usize, step_rad: f32, eye: PointN<f32>) -> Vector2<f32> {
    let (here, range_m) = raw[idx];
    let gap_m = (GAP_SPACINGS * range_m * step_rad).max(GAP_MIN_M);
    let (mut n, mut sum, mut squares) = (1.0_f32, Vector2::zeros(), [0.0_f32; 3]);
    let mut take = |other: PointN<f32>| {
        let off = other - here;
        n += 1.0;
        sum += off;
        squares[0] += off.x * off.x;
        squares[1] += off.x * off.y;
        squares[2] += off.y * off.y;
    };
    let mut walk = |others: &mut dyn Iterator<Item = PointN<f32>>| {
        let mut last = here;
        for (nth, other) in others.take(N_NORMAL_BEAMS).enumerate() {
            let is_apart = (other - last).norm() > gap_m;
            if is_apart || (nth >= 2 && (other - here).norm() > NORMAL_REACH_M) {
                break;
            }
            take(other);
            last = other;
        }
    };
    walk(&mut raw[idx + 1..].iter().map(|p| p.0));
    walk(&mut raw[..idx].iter().rev().map(|p| p.0));
    if n < 3.0 {
        return Vector2::zeros();
    }
    let mean = sum / n;
    let (xx, xy, yy) = (
        squares[0] / n - mean.x * mean.x,
        squares[1] / n - mean.x * mean.y,
        squares[2] / n - mean.y * mean.y,
    );
    // Eigenvalues of the 2×2 covariance.
    let (middle, half) = ((xx + yy) / 2.0, ((xx - yy) / 2.0).hypot(xy));
    if middle + half < 1e-6 || (middle - half) > THICKNESS_MAX * (middle + half) {
        return Vector2::zeros();
    }
    let along_rad = 0.5 * (2.0 * xy).atan2(xx - yy);
    let normal = Vector2::new(-along_rad.sin(), along_rad.cos());
    if normal.dot(&(eye - here)) < 0.0 { -normal } else { normal }
}
