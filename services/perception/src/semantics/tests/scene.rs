//! A world of boxes that is ray-cast into frames, and models that know it.

use geometry::{CameraIntrinsics, Point3, Pose2, Profile};
use proto::{Header, HeatMaps, RgbdFrame, Segments};

use crate::semantics::models::{Answer, Ask};

pub(super) const CAMERA: CameraIntrinsics =
    CameraIntrinsics { width: 160, height: 120, fx: 150.0, fy: 150.0, cx: 79.5, cy: 59.5 };
const HEAT_COLS: usize = 22;
const HEAT_ROWS: usize = 16;

/// An axis-aligned box, in `map`, metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Solid {
    pub low: [f64; 3],
    pub high: [f64; 3],
}

/// A named object of several boxes; what a pixel shows is its position in the scene.
#[derive(Clone, Debug)]
pub(super) struct Object {
    pub name: &'static str,
    pub solids: Vec<Solid>,
}

/// A table of 1.2 by 0.6 m, 0.74 m high, on four legs.
pub(super) fn table(name: &'static str, x_m: f64, y_m: f64) -> Object {
    let solid = |x: (f64, f64), y: (f64, f64), z: (f64, f64)| Solid {
        low: [x_m + x.0, y_m + y.0, z.0],
        high: [x_m + x.1, y_m + y.1, z.1],
    };
    let mut solids = vec![solid((-0.3, 0.3), (-0.6, 0.6), (0.70, 0.74))];
    for x in [(-0.3, -0.25), (0.25, 0.3)] {
        for y in [(-0.6, -0.55), (0.55, 0.6)] {
            solids.push(solid(x, y, (0.0, 0.70)));
        }
    }
    Object { name, solids }
}

pub(super) fn cuboid(name: &'static str, low: [f64; 3], high: [f64; 3]) -> Object {
    Object { name, solids: vec![Solid { low, high }] }
}

/// The floor and a room of 12 by 12 m around the origin, with objects in it.
pub(super) fn room(objects: Vec<Object>) -> Vec<Object> {
    let wall =
        |low: [f64; 2], high: [f64; 2]| Solid { low: [low[0], low[1], 0.0], high: [high[0], high[1], 2.5] };
    let walls = vec![
        wall([-6.1, -6.1], [-6.0, 6.1]),
        wall([6.0, -6.1], [6.1, 6.1]),
        wall([-6.1, -6.1], [6.1, -6.0]),
        wall([-6.1, 6.0], [6.1, 6.1]),
    ];
    let floor = Solid { low: [-7.0, -7.0, -0.1], high: [7.0, 7.0, 0.0] };
    let mut scene =
        vec![Object { name: "floor", solids: vec![floor] }, Object { name: "wall", solids: walls }];
    scene.extend(objects);
    scene
}

/// What a camera at `map_from_base` sees: depth and which object each pixel shows. Water gives no depth.
fn look(scene: &[Object], map_from_base: Pose2) -> (Vec<u16>, Vec<u16>) {
    let map_from_camera = map_from_base.lifted(0.0) * Profile::sim().camera.base_from_camera();
    let eye: Point3 = map_from_camera.translation.vector.into();
    let (mut depth_mm, mut shown) = (Vec::new(), Vec::new());
    for row in 0..CAMERA.height {
        for col in 0..CAMERA.width {
            let ray_camera = CAMERA.unproject(f64::from(col), f64::from(row), 1.0).coords;
            let ray = map_from_camera.rotation * ray_camera;
            let mut nearest = (f64::INFINITY, 0_u16);
            for (object, idx) in scene.iter().zip(1_u16..) {
                for solid in &object.solids {
                    if let Some(depth_m) = hit(solid, eye, ray).filter(|d| *d < nearest.0) {
                        nearest = (depth_m, idx);
                    }
                }
            }
            let is_water = nearest.1 > 0 && scene[usize::from(nearest.1) - 1].name == "pool";
            let has_depth = nearest.0 < 60.0 && !is_water;
            depth_mm.push(if has_depth { (nearest.0 * 1000.0).round() as u16 } else { 0 });
            shown.push(nearest.1);
        }
    }
    (depth_mm, shown)
}

/// Where the ray enters the box, in lengths of the ray.
fn hit(solid: &Solid, eye: Point3, ray: nalgebra::Vector3<f64>) -> Option<f64> {
    let (mut enters, mut leaves) = (0.0_f64, f64::INFINITY);
    for axis in 0..3 {
        let a = (solid.low[axis] - eye[axis]) / ray[axis];
        let b = (solid.high[axis] - eye[axis]) / ray[axis];
        enters = enters.max(a.min(b));
        leaves = leaves.min(a.max(b));
    }
    (enters <= leaves && enters > 0.0).then_some(enters)
}

/// The frame that the camera takes with the base at a pose.
pub(super) fn frame(scene: &[Object], map_from_base: Pose2, seq: u64, stamp_ns: u64) -> RgbdFrame {
    let (depth_mm, shown) = look(scene, map_from_base);
    // The colour carries which object it is: the models below see nothing else.
    let rgb = shown.iter().flat_map(|idx| [*idx as u8, 0, 0]).collect();
    let header = Header { seq, stamp_ns, echo: 0 };
    RgbdFrame { header, intrinsics: CAMERA, rgb, depth_mm_le: RgbdFrame::depth_bytes(&depth_mm) }
}

/// What good models would say: a phrase means every object whose name it ends with.
pub(super) fn answer(scene: &[Object], ask: &Ask) -> Answer {
    let labels: Vec<u16> = ask.frame.rgb.chunks(3).map(|rgb| u16::from(rgb[0])).collect();
    let (width, height) = (CAMERA.width as usize, CAMERA.height as usize);
    let mut values = Vec::new();
    for phrase in &ask.phrases {
        let mut n_hot = vec![0_u32; HEAT_COLS * HEAT_ROWS];
        let mut n_all = n_hot.clone();
        for (idx, label) in labels.iter().enumerate() {
            let (col, row) = (idx % width * HEAT_COLS / width, idx / width * HEAT_ROWS / height);
            n_all[row * HEAT_COLS + col] += 1;
            // 0 is the sky above the walls.
            let shown = usize::from(*label).checked_sub(1).map(|idx| scene[idx].name);
            n_hot[row * HEAT_COLS + col] += u32::from(shown.is_some_and(|name| phrase.ends_with(name)));
        }
        values.extend(n_hot.iter().zip(&n_all).map(|(hot, all)| (hot * 255 / all) as u8));
    }
    let model = "test".to_owned();
    let seq = ask.frame.seq;
    Answer {
        heat_maps: HeatMaps {
            seq,
            model: model.clone(),
            width: HEAT_COLS as u32,
            height: HEAT_ROWS as u32,
            values,
            n_phrases: ask.phrases.len() as u32,
        },
        segments: Segments {
            seq,
            model,
            width: CAMERA.width,
            height: CAMERA.height,
            n_segments: scene.len() as u16,
            labels_le: Segments::label_bytes(&labels),
        },
        understood: Vec::new(),
    }
}
