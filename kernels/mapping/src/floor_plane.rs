//! Where the floor is in a recording whose world knows no up: from the depth images alone.
//!
//! Many pixels see level surfaces: floor, table tops, seats. Their normals agree, and that is *up*; the lowest
//! of these surfaces that is large is the *floor*. A robot does not need this, its camera is bolted on. Not
//! here: what to do when the floor is not in view; a table alone is taken for it.

use geometry::{CameraIntrinsics, Point3};
use nalgebra::{Matrix3, Unit, Vector3};

use crate::image::DepthFrame;

/// Over how many pixels to each side a normal is measured.
const REACH_PX: usize = 6;
/// Depth that jumps more than this, relative to depth, to one of the ends is an edge and has no normal.
const JUMP_MAX: f64 = 0.12;
/// A level surface may be off the first guess of up by this, radians: a camera held askew or tilted.
const GUESS_RAD: f64 = 0.9;
/// Normals within this of each other are of parallel surfaces, radians.
const PARALLEL_RAD: f64 = 0.14;
/// Most directions that are tried as up.
const N_TRIED_MAX: usize = 400;
/// Height of a bin when heights are counted, metres.
const BIN_M: f64 = 0.02;
/// The floor shows at least this share of what the largest level surface shows.
const SHARE_MIN: f64 = 0.08;
/// Fewest patches that can be a floor.
const N_PATCHES_MIN: usize = 40;
/// What belongs to the floor lies within this of it, metres.
const THICKNESS_M: f64 = 0.05;

/// A piece of surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// Where it is, in `world`.
    pub point: Point3,
    /// Where it looks, in `world`; towards the camera.
    pub normal: Unit<Vector3<f64>>,
}

/// A floor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FloorPlane {
    /// Up, in `world`.
    pub up: Unit<Vector3<f64>>,
    /// Height of the floor along `up`, metres.
    pub height_m: f64,
    /// Share of all patches that lie on it.
    pub share: f64,
}

/// Patches of a frame, one for each `stride_px`-th pixel that has a normal; the frame's `map` is `world` here.
#[must_use]
pub fn patches(frame: &DepthFrame<'_>, stride_px: usize, max_m: f64) -> Vec<Patch> {
    let camera: &CameraIntrinsics = frame.intrinsics();
    let (width, height) = (camera.width as usize, camera.height as usize);
    let depth_mm = frame.depth().depth_mm();
    let point = |col: usize, row: usize| -> Option<Point3> {
        let depth_m = f64::from(depth_mm[row * width + col]) / 1000.0;
        (depth_m > 0.0 && depth_m <= max_m).then(|| camera.unproject(col as f64, row as f64, depth_m))
    };
    let mut found = Vec::new();
    let stride = stride_px.max(1);
    for row in (REACH_PX..height.saturating_sub(REACH_PX)).step_by(stride) {
        for col in (REACH_PX..width.saturating_sub(REACH_PX)).step_by(stride) {
            let ends = (
                point(col, row),
                point(col - REACH_PX, row),
                point(col + REACH_PX, row),
                point(col, row - REACH_PX),
                point(col, row + REACH_PX),
            );
            let (Some(here), Some(left), Some(right), Some(above), Some(below)) = ends else { continue };
            let is_edge = |end: &Point3| (end.z - here.z).abs() > JUMP_MAX * here.z;
            if [left, right, above, below].iter().any(is_edge) {
                continue;
            }
            let Some(normal) = Unit::try_new((right - left).cross(&(below - above)), 1e-12) else { continue };
            // Towards the camera, which is at the origin.
            let normal = if normal.dot(&here.coords) > 0.0 { -normal } else { normal };
            let pose = frame.map_from_camera();
            found.push(Patch { point: pose * here, normal: pose.rotation * normal });
        }
    }
    found
}

/// The floor among patches. `guess` is roughly up; when `is_exact` it is up.
///
/// Deterministic. `None` when no level surface is large enough.
#[must_use]
pub fn fit(patches: &[Patch], guess: Unit<Vector3<f64>>, is_exact: bool) -> Option<FloorPlane> {
    let up = if is_exact { guess } else { level_direction(patches, guess)? };
    let level: Vec<&Patch> =
        patches.iter().filter(|p| p.normal.dot(&up) >= (1.5 * PARALLEL_RAD).cos()).collect();
    let height_m = lowest_large(&level, up)?;
    if is_exact {
        return Some(told(patches, &level, up, height_m));
    }
    let (mut up, mut height_m) = (up, height_m);
    for _ in 0..3 {
        let on: Vec<Point3> = level
            .iter()
            .filter(|p| (p.point.coords.dot(&up) - height_m).abs() <= THICKNESS_M)
            .map(|p| p.point)
            .collect();
        let Some((normal, centre)) = plane(&on) else { break };
        let normal = if normal.dot(&up) < 0.0 { -normal } else { normal };
        // A narrow strip of floor does not fix its tilt: the many normals know better.
        if normal.dot(&up) < (PARALLEL_RAD / 2.0).cos() {
            break;
        }
        (up, height_m) = (normal, centre.coords.dot(&normal));
    }
    Some(told(patches, &level, up, height_m))
}

fn told(patches: &[Patch], level: &[&Patch], up: Unit<Vector3<f64>>, height_m: f64) -> FloorPlane {
    let n_on = level.iter().filter(|p| (p.point.coords.dot(&up) - height_m).abs() <= THICKNESS_M).count();
    FloorPlane { up, height_m, share: n_on as f64 / patches.len().max(1) as f64 }
}

/// The direction near the guess that most normals share.
fn level_direction(patches: &[Patch], guess: Unit<Vector3<f64>>) -> Option<Unit<Vector3<f64>>> {
    let near: Vec<Unit<Vector3<f64>>> =
        patches.iter().map(|p| p.normal).filter(|n| n.dot(&guess) >= GUESS_RAD.cos()).collect();
    let parallel = |up: &Unit<Vector3<f64>>| near.iter().filter(|n| n.dot(up) >= PARALLEL_RAD.cos()).count();
    let step = (near.len() / N_TRIED_MAX).max(1);
    let mut up = *near.iter().step_by(step).max_by_key(|n| parallel(n))?;
    for _ in 0..4 {
        let sum: Vector3<f64> =
            near.iter().filter(|n| n.dot(&up) >= PARALLEL_RAD.cos()).map(|n| n.into_inner()).sum();
        up = Unit::try_new(sum, 1e-9)?;
    }
    (parallel(&up) >= N_PATCHES_MIN).then_some(up)
}

/// Height of the lowest surface that shows much.
fn lowest_large(level: &[&Patch], up: Unit<Vector3<f64>>) -> Option<f64> {
    let heights: Vec<f64> = level.iter().map(|p| p.point.coords.dot(&up)).collect();
    let low = heights.iter().copied().fold(f64::INFINITY, f64::min);
    let high = heights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !(low.is_finite() && high - low < 100.0) {
        return None;
    }
    let n_bins = ((high - low) / BIN_M) as usize + 3;
    let mut bins = vec![0_usize; n_bins];
    for height in &heights {
        bins[((height - low) / BIN_M) as usize + 1] += 1;
    }
    // Five bins together: depth is noisy, and rooms are not quite level.
    let smooth: Vec<usize> =
        (0..n_bins).map(|k| bins[k.saturating_sub(2)..(k + 3).min(n_bins)].iter().sum()).collect();
    let most = *smooth.iter().max()?;
    let enough = ((SHARE_MIN * most as f64) as usize).max(N_PATCHES_MIN);
    let first = smooth.iter().position(|n| *n >= enough)?;
    // Up the slope to the peak that begins there.
    let mut peak = first;
    while smooth.get(peak + 1).is_some_and(|n| *n > smooth[peak]) {
        peak += 1;
    }
    Some(low + (peak as f64 - 0.5) * BIN_M)
}

/// Normal and centre of the plane through points; `None` when there are too few or they lie on a line.
fn plane(points: &[Point3]) -> Option<(Unit<Vector3<f64>>, Point3)> {
    if points.len() < N_PATCHES_MIN {
        return None;
    }
    let centre = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len() as f64;
    let spread: Matrix3<f64> =
        points.iter().map(|p| (p.coords - centre) * (p.coords - centre).transpose()).sum();
    let eigen = spread.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    // The second smallest tells a plane from a line.
    if eigen.eigenvalues[order[1]] < 4.0 * eigen.eigenvalues[order[0]] {
        return None;
    }
    let normal = Unit::try_new(eigen.eigenvectors.column(order[0]).into_owned(), 1e-9)?;
    Some((normal, Point3::from(centre)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::Pose3;
    use proptest::prelude::*;

    use crate::image::DepthImage;

    const CAMERA: CameraIntrinsics =
        CameraIntrinsics { width: 160, height: 120, fx: 150.0, fy: 150.0, cx: 79.5, cy: 59.5 };

    /// Depth of a room seen by a camera whose `level_from_camera` has z up: floor at 0, a table top 0.75 m
    /// high and larger in view than the floor, a wall.
    fn room(level_from_camera: &Pose3) -> Vec<u16> {
        let eye = level_from_camera.translation.vector;
        let mut depth_mm = Vec::new();
        for row in 0..CAMERA.height {
            for col in 0..CAMERA.width {
                let ray_camera = CAMERA.unproject(f64::from(col), f64::from(row), 1.0).coords;
                let ray = level_from_camera.rotation * ray_camera;
                let at_height = |z: f64| -> Option<f64> {
                    let depth = (z - eye.z) / ray.z;
                    (depth > 0.0).then_some(depth)
                };
                let table = at_height(0.75).filter(|d| {
                    let p = eye + ray * *d;
                    (0.8..2.2).contains(&p.x) && (-1.6..0.6).contains(&p.y)
                });
                let wall = Some((5.0 - eye.x) / ray.x).filter(|d| *d > 0.0);
                let nearest =
                    [table, at_height(0.0), wall].into_iter().flatten().fold(f64::INFINITY, f64::min);
                depth_mm.push(if nearest < 10.0 { (nearest * 1000.0).round() as u16 } else { 0 });
            }
        }
        depth_mm
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn the_floor_is_found_under_a_table_that_fills_more_of_the_view(
            pitch_rad in 0.25_f64..0.7, roll_rad in -0.3_f64..0.3, height_m in 1.0_f64..1.6,
        ) {
            let optical = nalgebra::Rotation3::from_matrix_unchecked(nalgebra::Matrix3::new(
                0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0,
            ));
            let tilt = nalgebra::Rotation3::from_axis_angle(&Vector3::y_axis(), pitch_rad)
                * nalgebra::Rotation3::from_axis_angle(&Vector3::x_axis(), roll_rad);
            let level_from_camera = Pose3::from_parts(
                nalgebra::Translation3::new(0.0, 0.0, height_m),
                nalgebra::UnitQuaternion::from_rotation_matrix(&(tilt * optical)),
            );
            let depth_mm = room(&level_from_camera);
            // The recording's world is the camera's own frame: it knows no up.
            let depth = DepthImage::new(CAMERA.width, CAMERA.height, &depth_mm).unwrap();
            let frame = DepthFrame::new(depth, CAMERA, Pose3::identity()).unwrap();
            let patches = patches(&frame, 2, 8.0);
            // Where next to nothing of the floor is seen, the table is the lowest surface there is.
            let at_height = |z_m: f64| {
                patches.iter().filter(|p| ((level_from_camera * p.point).z - z_m).abs() < 0.05).count()
            };
            let enough = ((SHARE_MIN * at_height(0.75) as f64) as usize).max(N_PATCHES_MIN);
            prop_assume!(at_height(0.0) >= 2 * enough);
            let floor = fit(&patches, -Vector3::y_axis(), false).unwrap();
            let up = level_from_camera.rotation.inverse() * Vector3::z();
            prop_assert!(floor.up.dot(&up) > 0.03_f64.cos(), "up {:?}, is {up:?}", floor.up);
            prop_assert!((floor.height_m + height_m).abs() < 0.04, "{} at {height_m}", floor.height_m);
        }
    }

    #[test]
    fn without_a_level_surface_there_is_no_floor() {
        let wall = vec![2000_u16; CAMERA.n_pixels()];
        let depth = DepthImage::new(CAMERA.width, CAMERA.height, &wall).unwrap();
        let frame = DepthFrame::new(depth, CAMERA, Pose3::identity()).unwrap();
        let all = patches(&frame, 2, 8.0);
        assert!(all.len() > 1000);
        assert_eq!(fit(&all, -Vector3::y_axis(), false), None);
        assert_eq!(fit(&[], -Vector3::y_axis(), true), None);
    }
}
