//! Recordings, models and rules that are not as they should be: each is named, the frame is left out or the rule
//! stays ungrounded, and what is good beside it is used.
//!
//! The room is drawn here: a floor and a box, seen by a camera that is tilted in a world that knows no up. The
//! models are a function that knows the box by its colour; only the tests of real model files need ONNX Runtime,
//! and say so when they skip.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test may fail loudly")]

use std::path::{Path, PathBuf};

use geometry::{Point3, Pose3, Profile};
use heedway_perception::ground::summary::Summary;
use heedway_perception::ground::{Options, run};
use heedway_perception::semantics::Settings;
use heedway_perception::semantics::frame::Frame;
use heedway_perception::semantics::models::configured::{LocalModels, YoloSettings};
use heedway_perception::semantics::models::runtime::{Runtime, RuntimeSettings};
use heedway_perception::semantics::models::stuff::Stuff;
use heedway_perception::semantics::models::yolo::Yolo;
use heedway_perception::semantics::models::{Answer, Understood};
use nalgebra::{Rotation3, Translation3, UnitQuaternion, Vector3};
use proto::{Grounding, HeatMaps, Segments};
use rules::{Relation, Rule};

const WIDTH: u32 = 160;
const HEIGHT: u32 = 120;
const FOCAL: f64 = 140.0;
/// The box, in the level frame under the camera: ahead, to the left, up.
const LOW: [f64; 3] = [1.6, -0.3, 0.0];
const HIGH: [f64; 3] = [2.0, 0.3, 0.5];

/// The camera, 1.2 m up, looking ahead and 0.45 rad down, a little askew.
fn level_from_camera() -> Pose3 {
    let optical = Rotation3::from_matrix_unchecked(nalgebra::Matrix3::new(
        0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0,
    ));
    let tilt = Rotation3::from_axis_angle(&Vector3::y_axis(), 0.45)
        * Rotation3::from_axis_angle(&Vector3::x_axis(), 0.1);
    let rotation = UnitQuaternion::from_rotation_matrix(&(tilt * optical));
    Pose3::from_parts(Translation3::new(0.0, 0.0, 1.2), rotation)
}

/// Depth and whether each pixel shows the box.
fn drawn() -> Vec<(u16, bool)> {
    let pose = level_from_camera();
    let eye = pose.translation.vector;
    let mut pixels = Vec::new();
    for row in 0..HEIGHT {
        for col in 0..WIDTH {
            let (u, v) = (f64::from(col) - 79.5, f64::from(row) - 59.5);
            let ray = pose.rotation * Vector3::new(u / FOCAL, v / FOCAL, 1.0);
            let floor = Some(-eye.z / ray.z).filter(|d| *d > 0.0).unwrap_or(f64::INFINITY);
            let (mut enters, mut leaves) = (0.0_f64, f64::INFINITY);
            for axis in 0..3 {
                let (a, b) = ((LOW[axis] - eye[axis]) / ray[axis], (HIGH[axis] - eye[axis]) / ray[axis]);
                enters = enters.max(a.min(b));
                leaves = leaves.min(a.max(b));
            }
            let is_box = enters <= leaves && enters < floor;
            let depth_m = if is_box { enters } else { floor };
            pixels.push((if depth_m < 8.0 { (depth_m * 1000.0).round() as u16 } else { 0 }, is_box));
        }
    }
    pixels
}

/// A recording of `n` equal frames; the world is the camera's own frame.
fn recording(n: u32) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: String| folder.path().join(name);
    std::fs::write(at("camera-intrinsics.txt".into()), "140 0 79.5\n0 140 59.5\n0 0 1\n").unwrap();
    let pixels = drawn();
    for number in 0..n {
        let depth: image::ImageBuffer<image::Luma<u16>, Vec<u16>> =
            image::ImageBuffer::from_raw(WIDTH, HEIGHT, pixels.iter().map(|p| p.0).collect()).unwrap();
        depth.save(at(format!("frame-{number:06}.depth.png"))).unwrap();
        let rgb = pixels.iter().flat_map(|p| if p.1 { [200, 0, 0] } else { [0, 90, 0] }).collect();
        let colour = image::RgbImage::from_raw(WIDTH, HEIGHT, rgb).unwrap();
        colour.save(at(format!("frame-{number:06}.color.png"))).unwrap();
        std::fs::write(at(format!("frame-{number:06}.pose.txt")), "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")
            .unwrap();
    }
    folder
}

/// Models that know the box by its colour, and nothing else.
fn red_is_a_box(frame: &Frame, phrases: &[String]) -> anyhow::Result<Answer> {
    let is_box: Vec<bool> = frame.rgb.chunks(3).map(|rgb| rgb[0] > 100).collect();
    let labels: Vec<u16> = is_box.iter().map(|b| u16::from(*b)).collect();
    let (width, height) = (frame.intrinsics.width, frame.intrinsics.height);
    let heat = |phrase: &String| -> Vec<u8> {
        is_box.iter().map(|b| if *b && phrase == "box" { 255 } else { 0 }).collect()
    };
    let values = phrases.iter().flat_map(heat).collect();
    let n_phrases = phrases.len() as u32;
    Ok(Answer {
        heat_maps: HeatMaps { seq: frame.seq, model: "test".into(), width, height, values, n_phrases },
        segments: Segments {
            seq: frame.seq,
            model: "test".into(),
            width,
            height,
            n_segments: 1,
            labels_le: Segments::label_bytes(&labels),
        },
        understood: phrases.iter().map(|_| Understood::Wholly).collect(),
    })
}

fn options(rgbd: &Path, out: &Path, rules: Vec<Rule>) -> Options {
    Options {
        rgbd: rgbd.to_owned(),
        out: out.to_owned(),
        rules,
        gravity: None,
        profile: Profile::turtlebot2(),
        settings: Settings { n_masks_agreeing: 1, ..Settings::default() },
        n_frames_max: 40,
    }
}

fn near(obj: &str) -> Vec<Rule> {
    vec![Rule { id: "s1".into(), ..Rule::exclusion(Relation::Near, obj) }]
}

fn ground(rgbd: &Path, rules: Vec<Rule>) -> anyhow::Result<Summary> {
    let out = tempfile::tempdir().unwrap();
    run(&options(rgbd, out.path(), rules), red_is_a_box)
}

/// What was said of a frame that was left out.
fn left_out(summary: &Summary, number: u32) -> &str {
    let frame = summary.frames.iter().find(|f| f.number == number).unwrap();
    frame.left_out.as_deref().unwrap_or_else(|| panic!("frame {number} was used"))
}

#[test]
fn a_box_on_a_floor_is_where_it_is_in_a_world_that_knows_no_up() {
    let folder = recording(2);
    let summary = ground(folder.path(), near("box")).unwrap();
    assert!((summary.floor.camera_height_m - 1.2).abs() < 0.03, "{:?}", summary.floor);
    assert_eq!(summary.rules[0].grounding, Grounding::Grounded, "{}", summary.rules[0].remark);
    let parts = &summary.rules[0].region.as_ref().unwrap().parts;
    assert_eq!(parts.len(), 1, "{parts:?}");
    // Its far half is hidden, and its near and top faces are seen.
    assert!((parts[0].centre_m[0] - 1.8).abs() < 0.12 && parts[0].centre_m[1].abs() < 0.08, "{parts:?}");
    assert!((parts[0].size_m[1] - 0.6).abs() < 0.15 && parts[0].size_m[0] <= 0.6, "{parts:?}");
}

#[test]
fn gravity_from_the_caller_is_taken_and_nonsense_is_refused() {
    let folder = recording(1);
    let out = tempfile::tempdir().unwrap();
    let falls = level_from_camera().rotation.inverse() * -Vector3::z();
    let told = |gravity| {
        let options = Options { gravity: Some(gravity), ..options(folder.path(), out.path(), near("box")) };
        run(&options, red_is_a_box)
    };
    let summary = told(falls.into()).unwrap();
    assert!((summary.floor.camera_height_m - 1.2).abs() < 0.03, "{:?}", summary.floor);
    assert!((Vector3::from(summary.floor.up_world) + falls).norm() < 1e-6);
    let refused = told([0.0, f64::NAN, 0.0]).unwrap_err().to_string();
    assert!(refused.contains("gravity") && refused.contains("NaN"), "{refused}");
}

#[test]
fn a_frame_with_depth_of_the_wrong_size_is_left_out_and_named() {
    let folder = recording(2);
    let small = image::ImageBuffer::<image::Luma<u16>, _>::from_fn(8, 6, |_, _| image::Luma([1000_u16]));
    small.save(folder.path().join("frame-000001.depth.png")).unwrap();
    let summary = ground(folder.path(), near("box")).unwrap();
    assert!(left_out(&summary, 1).contains("8×6 pixels, must be 160×120"), "{}", left_out(&summary, 1));
    assert_eq!(summary.rules[0].grounding, Grounding::Grounded);
}

#[test]
fn a_pose_gap_leaves_frames_out_and_without_any_pose_the_first_is_mapped_alone() {
    let folder = recording(3);
    std::fs::remove_file(folder.path().join("frame-000001.pose.txt")).unwrap();
    let summary = ground(folder.path(), near("box")).unwrap();
    assert!(left_out(&summary, 1).contains("frame-000001.pose.txt"), "{}", left_out(&summary, 1));
    assert_eq!((summary.rules[0].grounding, summary.remark.as_str()), (Grounding::Grounded, ""));
    for number in [0, 2] {
        std::fs::remove_file(folder.path().join(format!("frame-{number:06}.pose.txt"))).unwrap();
    }
    let summary = ground(folder.path(), near("box")).unwrap();
    assert!(summary.remark.contains("no frame has a pose"), "{}", summary.remark);
    assert_eq!(summary.rules[0].grounding, Grounding::Grounded);
    assert!(left_out(&summary, 2).contains("frame-000002.pose.txt"));
}

#[test]
fn no_intrinsics_or_no_floor_is_an_error_that_names_it() {
    let folder = recording(1);
    std::fs::remove_file(folder.path().join("camera-intrinsics.txt")).unwrap();
    let refused = format!("{:#}", ground(folder.path(), near("box")).unwrap_err());
    assert!(refused.contains("no intrinsics"), "{refused}");
    let folder = recording(1);
    let wall = image::ImageBuffer::<image::Luma<u16>, _>::from_pixel(WIDTH, HEIGHT, image::Luma([1500_u16]));
    wall.save(folder.path().join("frame-000000.depth.png")).unwrap();
    let refused = format!("{:#}", ground(folder.path(), near("box")).unwrap_err());
    assert!(refused.contains("no floor is in view"), "{refused}");
}

#[test]
fn an_empty_phrase_grounds_nothing_and_says_so() {
    let folder = recording(1);
    for empty in ["", "  "] {
        let mut rules = near("box");
        rules.push(Rule { id: "s2".into(), ..Rule::exclusion(Relation::Near, empty) });
        let summary = ground(folder.path(), rules).unwrap();
        let [box_rule, odd] = &summary.rules[..] else { panic!("two rules") };
        assert_eq!(box_rule.grounding, Grounding::Grounded);
        assert_eq!((odd.grounding, odd.region.is_none()), (Grounding::Searching, true), "{empty:?}");
        assert!(odd.remark.contains("phrase is empty"), "{}", odd.remark);
    }
}

#[test]
fn models_that_fail_leave_every_rule_ungrounded_and_are_named_with_each_frame() {
    let folder = recording(2);
    let out = tempfile::tempdir().unwrap();
    let broken = |_: &Frame, _: &[String]| anyhow::bail!("model m.onnx: out of memory");
    let summary = run(&options(folder.path(), out.path(), near("box")), broken).unwrap();
    assert_eq!((summary.rules[0].grounding, summary.rules[0].region.is_none()), (Grounding::Searching, true));
    for frame in &summary.frames {
        assert!(frame.trouble.as_deref().is_some_and(|t| t.contains("out of memory")), "{frame:?}");
    }
}

#[test]
fn a_missing_library_is_named_with_the_command_that_gets_it() {
    let settings =
        RuntimeSettings { library: "/nowhere/libonnxruntime.so".into(), ..RuntimeSettings::default() };
    let files = YoloSettings { model: "m.onnx".into(), ..YoloSettings::default() };
    let refused = format!("{:#}", LocalModels::open_yolo(&settings, &files).err().unwrap());
    for words in ["/nowhere/libonnxruntime.so", "pip download", "unzip"] {
        assert!(refused.contains(words), "{refused:?} does not say {words:?}");
    }
    // A file that is no library.
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("libonnxruntime.so");
    std::fs::write(&file, "no library").unwrap();
    let settings = RuntimeSettings { library: file.clone(), ..settings };
    let refused = format!("{:#}", Runtime::load(&settings).err().unwrap());
    assert!(refused.contains("libonnxruntime.so"), "{refused}");
}

#[test]
fn a_model_of_the_wrong_shape_is_named_with_what_it_should_be() {
    if std::env::var_os("ORT_DYLIB_PATH").is_none() {
        eprintln!("SKIPPED: no ONNX Runtime; set ORT_DYLIB_PATH to its library");
        return;
    }
    let runtime = Runtime::load(&RuntimeSettings::default()).unwrap();
    let file = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/identity.onnx");
    let refused = |error: Option<anyhow::Error>, words: &[&str]| {
        let said = format!("{:#}", error.unwrap());
        assert!(words.iter().all(|word| said.contains(word)), "{said}");
    };
    let labels = vec!["chair".to_owned(); 80];
    let yolo = Yolo::new(runtime.open(&file).unwrap(), labels.clone(), 0.3);
    refused(yolo.err(), &["identity.onnx", "YOLO segmentation of 80 classes", "[1, 3, 4, 4]"]);
    let stuff = Stuff::new(runtime.open(&file).unwrap(), &labels);
    refused(stuff.err(), &["identity.onnx", "`y` is [1, 3, 4, 4]", "81"]);
    refused(runtime.open(Path::new("/nowhere/m.onnx")).err(), &["/nowhere/m.onnx", "no such file"]);
    let folder = tempfile::tempdir().unwrap();
    let junk = folder.path().join("junk.onnx");
    std::fs::write(&junk, "junk").unwrap();
    refused(runtime.open(&junk).err(), &["junk.onnx"]);
}

#[test]
fn what_is_drawn_is_what_is_meant() {
    // The middle of the box's front, in the drawing.
    let at_camera = level_from_camera().inverse() * Point3::new(LOW[0], 0.0, 0.25);
    let col = (FOCAL * at_camera.x / at_camera.z + 79.5).round() as u32;
    let row = (FOCAL * at_camera.y / at_camera.z + 59.5).round() as u32;
    let (depth_mm, is_box) = drawn()[(row * WIDTH + col) as usize];
    assert!(
        is_box && (f64::from(depth_mm) / 1000.0 - at_camera.z).abs() < 0.02,
        "{depth_mm} {}",
        at_camera.z
    );
}
