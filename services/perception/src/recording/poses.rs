//! Numbers of poses and cameras out of text.

use anyhow::{Context, ensure};
use geometry::Pose3;
use nalgebra::{Matrix3, Quaternion, Translation3, UnitQuaternion, Vector3};

/// A rotation whose columns are off unit length or a right angle by more than this is none. Recorded poses
/// are rounded, and some trackers let them drift by a thousandth.
const ROTATION_ERROR_MAX: f64 = 0.02;
/// Coordinates beyond this are no room, metres.
const POSITION_MAX_M: f64 = 1e5;

/// A pose from a 4×4 matrix, row by row.
///
/// # Errors
/// When it is not sixteen finite numbers, or no rigid motion.
pub(super) fn from_matrix(text: &str) -> anyhow::Result<Pose3> {
    let m: [f64; 16] = numbers(text)?;
    let [a, b, c, x, d, e, f, y, g, h, i, z, p, q, r, s] = m;
    ensure!(
        p.abs() < 1e-6 && q.abs() < 1e-6 && r.abs() < 1e-6 && (s - 1.0).abs() < 1e-6,
        "last row of the pose is {p} {q} {r} {s}, must be 0 0 0 1"
    );
    let rotation = Matrix3::new(a, b, c, d, e, f, g, h, i);
    let off = (rotation.transpose() * rotation - Matrix3::identity()).abs().max();
    ensure!(
        off <= ROTATION_ERROR_MAX && rotation.determinant() > 0.0,
        "rotation of the pose is off by {off:.3}, at most {ROTATION_ERROR_MAX}"
    );
    let nearest = UnitQuaternion::from_matrix_eps(&rotation, 1e-12, 100, UnitQuaternion::identity());
    posed(Vector3::new(x, y, z), nearest)
}

/// A pose from `tx ty tz qx qy qz qw`.
///
/// # Errors
/// When it is not seven finite numbers, or no unit quaternion.
pub(super) fn from_quaternion_line(line: &str) -> anyhow::Result<Pose3> {
    let [x, y, z, i, j, k, w]: [f64; 7] = numbers(line)?;
    let quaternion = Quaternion::new(w, i, j, k);
    let norm = quaternion.norm();
    ensure!((norm - 1.0).abs() <= ROTATION_ERROR_MAX, "quaternion of length {norm:.3}, must be 1");
    posed(Vector3::new(x, y, z), UnitQuaternion::from_quaternion(quaternion))
}

/// Focal lengths and principal point from a 3×3 camera matrix, row by row.
///
/// # Errors
/// When it is not nine finite numbers, or the camera has skew.
pub(super) fn camera_matrix(text: &str) -> anyhow::Result<[f64; 4]> {
    let [fx, skew, cx, _, fy, cy, _, _, one]: [f64; 9] = numbers(text)?;
    ensure!(skew == 0.0 && one == 1.0, "camera matrix has skew {skew} and scale {one}, must be 0 and 1");
    Ok([fx, fy, cx, cy])
}

fn posed(position: Vector3<f64>, rotation: UnitQuaternion<f64>) -> anyhow::Result<Pose3> {
    let far_m = position.amax();
    ensure!(far_m <= POSITION_MAX_M, "position of the pose is {far_m} m away, at most {POSITION_MAX_M}");
    Ok(Pose3::from_parts(Translation3::from(position), rotation))
}

fn numbers<const N: usize>(text: &str) -> anyhow::Result<[f64; N]> {
    let mut found = Vec::with_capacity(N);
    for word in text.split_whitespace().take(N + 1) {
        let value: f64 = word.parse().with_context(|| format!("{word:?} is no number"))?;
        ensure!(value.is_finite(), "{word} is not finite");
        found.push(value);
    }
    let n = found.len();
    found.try_into().map_err(|_| anyhow::anyhow!("{n} numbers or more, {N} wanted"))
}
