//! Pictures of a scene: what the robot's camera sees at a pose, and the whole floor from above.
//!
//! `cargo run -p heedway-simulator --example render -- SCENE OUT_PREFIX [X Y YAW]`

use std::path::Path;

use anyhow::Context;
use geometry::{CameraIntrinsics, Pose2, Pose3, Profile};
use heedway_simulator::raycast::{Image, RayCaster};
use heedway_simulator::scene::{Hull, Scene};

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [scene_path, prefix, pose @ ..] = arguments.as_slice() else {
        anyhow::bail!("usage: render SCENE OUT_PREFIX [X Y YAW]");
    };
    let profile = Profile::sim();
    let hull = Hull { radius_m: profile.radius_m, height_m: profile.height_m };
    let scene = Scene::load(Path::new(scene_path), hull)?;
    let rays = RayCaster::new(&scene)?;
    let numbers: Vec<f64> = pose.iter().map(|n| n.parse()).collect::<Result<_, _>>().context("X Y YAW")?;
    let map_from_base = match *numbers.as_slice() {
        [x_m, y_m, yaw_rad] => Pose2::new(x_m, y_m, yaw_rad),
        _ => scene.map_from_start,
    };
    let map_from_camera = map_from_base.lifted(0.0) * profile.camera.base_from_camera();
    save(&rays.image(&map_from_camera, &profile.camera.intrinsics, 6.0), &format!("{prefix}-camera.png"))?;
    let (map_from_above, camera) = from_above(&scene);
    save(&rays.image(&map_from_above, &camera, 6.0), &format!("{prefix}-above.png"))
}

/// A camera so high above the floor that it looks almost straight down everywhere.
fn from_above(scene: &Scene) -> (Pose3, CameraIntrinsics) {
    let corners = scene.floor.corners();
    let (low, high) = corners.iter().fold((corners[0], corners[0]), |(low, high), c| {
        (low.coords.inf(&c.coords).into(), high.coords.sup(&c.coords).into())
    });
    let middle = nalgebra::center(&low, &high);
    let height_m = 40.0;
    let pixels_per_m = 100.0;
    let camera = CameraIntrinsics {
        width: ((high.x - low.x + 1.0) * pixels_per_m) as u32,
        height: ((high.y - low.y + 1.0) * pixels_per_m) as u32,
        fx: pixels_per_m * height_m,
        fy: pixels_per_m * height_m,
        cx: (high.x - low.x + 1.0) * pixels_per_m / 2.0,
        cy: (high.y - low.y + 1.0) * pixels_per_m / 2.0,
    };
    let looking_down =
        nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::x_axis(), std::f64::consts::PI);
    let at = nalgebra::Translation3::new(middle.x, middle.y, height_m);
    (Pose3::from_parts(at, looking_down), camera)
}

fn save(image: &Image, path: &str) -> anyhow::Result<()> {
    let pixels = image::RgbImage::from_raw(image.seen.width, image.seen.height, image.rgb.clone())
        .context("image size")?;
    pixels.save(path).with_context(|| format!("write {path}"))
}
