//! Where the frames of a recording lie over the floor: `map`, with z up and the floor at 0.
//!
//! A recording's world knows no up, and may know no poses. Up is what the caller says or what the floor in
//! view shows. `map` begins under the first camera and looks where that looks.

use anyhow::{Context, bail, ensure};
use geometry::{Point3, Pose2, Pose3};
use mapping::floor_plane::{self, FloorPlane, Patch};
use mapping::{DepthFrame, DepthImage};
use nalgebra::{Matrix3, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};

use super::Options;
use crate::recording::Recording;

/// Every how many-th pixel is a patch when the floor is looked for.
const STRIDE_PX: usize = 4;
/// Depth beyond this says little about the floor, metres.
const DEPTH_MAX_M: f64 = 5.0;
/// Most frames that the floor is looked for in.
const N_FLOOR_FRAMES_MAX: usize = 30;

/// One frame, and where it was taken.
#[derive(Clone, Debug)]
pub struct Placed {
    /// Its number in the recording.
    pub number: u32,
    /// The camera in the recording's world, or why that is not known.
    pub world_from_camera: Result<Pose3, String>,
}

/// All frames that are looked at, and the map they lie in.
#[derive(Clone, Debug)]
pub struct Place {
    /// The frames, in order.
    pub frames: Vec<Placed>,
    /// The recording's world in `map`.
    pub map_from_world: Pose3,
    /// The floor, in the recording's world.
    pub floor: FloorPlane,
    /// What a person should know.
    pub remark: String,
}

impl Place {
    /// Places the frames of a recording.
    ///
    /// # Errors
    /// When no frame can be placed, or no floor is in view.
    pub fn of(recording: &Recording, options: &Options) -> anyhow::Result<Self> {
        let all = recording.numbers();
        let n = all.len().min(options.n_frames_max);
        // Evenly, the first and the last among them.
        let pick = |k: usize| all.get(if n > 1 { k * (all.len() - 1) / (n - 1) } else { 0 }).copied();
        let mut frames: Vec<Placed> = (0..n)
            .filter_map(pick)
            .map(|number| Placed {
                number,
                world_from_camera: recording.pose(number).map_err(|e| format!("{e:#}")),
            })
            .collect();
        let mut remark = String::new();
        if frames.iter().all(|f| f.world_from_camera.is_err())
            && let Some(first) = frames.first_mut()
        {
            "no frame has a pose: only the first is mapped, in its own frame".clone_into(&mut remark);
            first.world_from_camera = Ok(Pose3::identity());
        }
        let floor = floor(recording, &frames, options.gravity)?;
        let first = frames.iter().find_map(|f| f.world_from_camera.as_ref().ok());
        let first = first.context("no frame could be placed")?;
        let map_from_world = map_from_world(&floor, first);
        Ok(Place { frames, map_from_world, floor, remark })
    }
}

fn floor(recording: &Recording, frames: &[Placed], gravity: Option<[f64; 3]>) -> anyhow::Result<FloorPlane> {
    let step = frames.len().div_ceil(N_FLOOR_FRAMES_MAX).max(1);
    let mut all: Vec<Patch> = Vec::new();
    let mut upright = Vector3::zeros();
    for frame in frames.iter().step_by(step) {
        let Ok(world_from_camera) = &frame.world_from_camera else { continue };
        // Nobody holds a camera upside down: rows go down.
        upright -= world_from_camera.rotation * Vector3::y();
        // What is wrong with the images is told when the frame is looked at.
        let Ok((depth_mm, _)) = recording.read_images(frame.number) else { continue };
        let camera = recording.intrinsics();
        let depth = DepthImage::new(camera.width, camera.height, &depth_mm)?;
        let frame = DepthFrame::new(depth, *camera, *world_from_camera)?;
        all.extend(floor_plane::patches(&frame, STRIDE_PX, DEPTH_MAX_M));
    }
    let guess = match gravity {
        None => Unit::try_new(upright, 1e-6).context("the cameras of the recording look every way")?,
        Some(falls) => {
            let falls = Vector3::from(falls);
            ensure!(
                falls.iter().all(|v| v.is_finite()) && falls.norm() > 1e-6,
                "gravity is {falls:?}, must be a direction"
            );
            Unit::new_normalize(-falls)
        }
    };
    let Some(floor) = floor_plane::fit(&all, guess, gravity.is_some()) else {
        bail!("no floor is in view, of {} pieces of surface that have depth", all.len());
    };
    Ok(floor)
}

fn map_from_world(floor: &FloorPlane, world_from_camera: &Pose3) -> Pose3 {
    let up = floor.up.into_inner();
    let level = |direction: Vector3<f64>| Unit::try_new(direction - up * direction.dot(&up), 1e-3);
    // A camera that looks straight down looks where the top of its image is.
    let forward = level(world_from_camera.rotation * Vector3::z())
        .or_else(|| level(world_from_camera.rotation * -Vector3::y()))
        .unwrap_or_else(Vector3::x_axis)
        .into_inner();
    let left = up.cross(&forward);
    let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_rows(&[
        forward.transpose(),
        left.transpose(),
        up.transpose(),
    ]));
    let eye = world_from_camera.translation.vector;
    let under = eye - up * (eye.dot(&up) - floor.height_m);
    Pose3::from_parts(
        Translation3::from(-(rotation * under)),
        UnitQuaternion::from_rotation_matrix(&rotation),
    )
}

/// The base that would carry a camera: on the floor below it, looking where it looks; and the camera on it.
#[must_use]
pub fn base_of(map_from_camera: &Pose3) -> (Pose2, Pose3) {
    let ahead = map_from_camera.rotation * Vector3::z();
    let at = map_from_camera * Point3::origin();
    let map_from_base = Pose2::new(at.x, at.y, ahead.y.atan2(ahead.x));
    (map_from_base, map_from_base.lifted(0.0).inverse() * map_from_camera)
}
